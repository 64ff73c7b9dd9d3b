//! The answers of the datasheet.

use super::{DatasheetEntry, UNKNOWN, UNSTATED};
use crate::licence::LicenceObligation;
use crate::recipe::{ReleaseInfo, SplitUnit};
use crate::release::facts::{FileCounts, ReleaseFacts, plain_text};
use crate::release::products::{ReleaseProduct, products};
use crate::release::published::PublishedScene;
use crate::release::{TOOL, croissant};
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// Input of the answers.
#[derive(Debug, Clone, Copy)]
pub(super) struct AnswerContext<'a> {
    pub(super) facts: &'a ReleaseFacts<'a>,
    pub(super) info: &'a ReleaseInfo,
}

/// A statement of the publisher, or the note that it is missing.
fn stated_or_silent(text: Option<&String>) -> String {
    text.map_or_else(|| UNSTATED.to_owned(), |text| format!("The publisher: \"{}\"", plain_text(text)))
}

/// Counts in the form `1 a, 2 b`.
fn counted_list<K: AsRef<str>>(counts: &BTreeMap<K, usize>) -> String {
    let each: Vec<String> = counts.iter().map(|(name, count)| format!("{count} {}", name.as_ref())).collect();
    each.join(", ")
}

impl AnswerContext<'_> {
    /// A statement from `release.yaml`. The default value of a field is not a statement of the
    /// publisher.
    fn said(&self, of: fn(&ReleaseInfo) -> &String) -> String {
        let given = of(self.info);
        stated_or_silent(Some(given).filter(|text| *text != of(&ReleaseInfo::default())))
    }

    pub(super) fn motivation(&self) -> Vec<DatasheetEntry> {
        vec![
            ("For what purpose was the dataset created?", stated_or_silent(self.info.purpose.as_ref())),
            (
                "Who created it, and on behalf of whom?",
                format!("The publisher: \"{}\"", plain_text(&self.info.creator)),
            ),
            ("Who funded its creation?", stated_or_silent(self.info.funding.as_ref())),
            ("Any other comments?", self.said(|info| &info.description)),
        ]
    }

    pub(super) fn composition(&self) -> Vec<DatasheetEntry> {
        let none = "No.".to_owned();
        vec![
            ("What do the instances represent?", self.instances()),
            ("How many instances are there?", self.how_many()),
            ("Is it all possible instances, or a sample?", SAMPLE.to_owned()),
            ("What data does each instance consist of?", self.each_instance()),
            ("Is there a label or target with each instance?", self.labels()),
            ("Is any information missing from instances?", self.missing()),
            ("Are relationships between instances made explicit?", self.relationships()),
            ("Are there recommended splits?", self.splits()),
            ("Are there errors, noise or redundancies?", self.errors()),
            ("Is it self-contained, or does it rely on external resources?", self.self_contained()),
            ("Does it hold data that might be considered confidential?", self.of_captures(&none, UNKNOWN)),
            (
                "Does it hold data that might be offensive or cause anxiety?",
                self.of_captures(&none, "Not examined."),
            ),
            ("Does it identify subpopulations?", none.clone()),
            ("Can individuals be identified?", self.persons()),
            ("Does it hold sensitive data on persons?", self.persons()),
            ("Any other comments?", self.facts.provenance().limits()),
        ]
    }

    /// Words for the products of a trajectory, each if the release has it.
    fn kinds(&self, words: fn(&ReleaseProduct) -> &'static str) -> String {
        let counts = self.facts.counts();
        products()
            .filter(|product| counts.has(product))
            .map(|product| format!(", {}", words(product)))
            .collect()
    }

    fn instances(&self) -> String {
        let kinds = self.kinds(|product| product.instance);
        format!("Camera trajectories through static scenes of 3D Gaussians, each with exact poses{kinds}.")
    }

    fn each_instance(&self) -> String {
        let kinds = self.kinds(|product| product.content);
        format!(
            "Poses, time stamps, a speed report, verdicts of checks{kinds}. `scene.json` has the scene's source, camera, \
             recipe, seeds and statistics."
        )
    }

    fn mechanisms(&self) -> String {
        let provenance = self.facts.provenance();
        let models: Vec<String> =
            provenance.models().map(|(name, publication)| format!("{name} ({publication})")).collect();
        let sensors = match models.as_slice() {
            [] => String::new(),
            models => format!(" and the event sensor models {}", models.join(" and ")),
        };
        format!(
            "One program, which implements a renderer of Gaussian splats{sensors}. Every trajectory was checked; the verdicts are in \
             `checks.json`."
        )
    }

    fn preprocessing_words(&self) -> String {
        if self.facts.made_up() {
            "No; nothing was edited by hand.".to_owned()
        } else {
            "Captured poses were smoothed and resampled along curves, as each recipe states; nothing was edited by hand."
                .to_owned()
        }
    }

    fn how_many(&self) -> String {
        let FileCounts { scenes, trajectories, withheld, .. } = self.facts.counts();
        let mut text = format!(
            "{scenes} scenes ({}) with {trajectories} trajectories: {}.",
            counted_list(&self.facts.sources()),
            self.facts.contents()
        );
        if withheld > 0 {
            let _ = write!(
                text,
                " For {withheld} scenes the release has only recipe, poses and reports, because the terms of their upstream \
                 do not allow everyone to redistribute derived data."
            );
        }
        text
    }

    fn labels(&self) -> String {
        let of = |scene: &PublishedScene| {
            let mut streams = scene.file.trajectories.iter().flat_map(|part| scene.streams(part));
            streams.any(|(_, sensor)| sensor.as_model().labels())
        };
        if self.facts.scenes.iter().any(of) {
            "Exact camera poses; `events/label`, where a stream has it, marks each event as signal or noise."
                .to_owned()
        } else {
            match self.facts.provenance().has_events() {
                true => "Exact camera poses; events have no labels.".to_owned(),
                false => "Exact camera poses.".to_owned(),
            }
        }
    }

    fn missing(&self) -> String {
        let photos = match self.facts.photos() {
            0 => String::new(),
            count => format!(
                "The {count} photos of the captures are not in the release: `scene.json` has name and SHA-256 of each. "
            ),
        };
        let FileCounts { withheld, .. } = self.facts.counts();
        let withheld = match withheld {
            0 => String::new(),
            count => format!("The pictures and events of {count} scenes are withheld. "),
        };
        let text = format!("{photos}{withheld}{}", self.taken_down());
        if text.is_empty() {
            "Outputs that the recipes do not request; nothing else is known to be missing.".into()
        } else {
            text
        }
    }

    fn taken_down(&self) -> String {
        match self.facts.taken_down {
            0 => String::new(),
            count => format!("{count} scenes were removed on request."),
        }
    }

    fn relationships(&self) -> String {
        let mut text = "The trajectories of a scene are in its folder.".to_owned();
        if self.facts.scenes.iter().any(|scene| scene.file.trajectories.iter().any(|t| !t.sensors.is_empty()))
        {
            text.push_str(" The streams of several sensors on one trajectory are in its `events/`.");
        }
        if self.info.splits.is_some() {
            text.push_str(" `group` in the `split` of a scene names its capture or object.");
        }
        text
    }

    fn splits(&self) -> String {
        let Some(splits) = &self.info.splits else {
            return "No.".to_owned();
        };
        let by = match splits.by {
            SplitUnit::Capture => "captures",
            SplitUnit::Object => "objects",
        };
        format!(
            "Yes, by whole {by}, never by trajectory: {} scenes. The split of a group follows from the SHA-256 of \
             salt, a NUL and its key, so a new scene does not move others. Rule and salt are in `manifest.json`. No photo \
             and no scene file is in two splits.",
            counted_list(&self.facts.splits())
        )
    }

    fn errors(&self) -> String {
        let noise = match self.facts.provenance().has_events() {
            true => " Sensor noise is that of the stated models.",
            false => "",
        };
        format!(
            "{} of {} checks passed ({}). The card lists those that did not; `checks.json` of each trajectory has all.{noise} \
             No duplicates are known.",
            self.facts.passed(),
            self.facts.verdicts().values().sum::<usize>(),
            counted_list(&self.facts.verdicts())
        )
    }

    fn self_contained(&self) -> String {
        if self.facts.photos() == 0 {
            "It is self-contained.".to_owned()
        } else {
            "The release needs nothing else. To make it again, the captures are needed: `scene.json` lists their photos by \
             name and SHA-256, and their holders distribute them."
                .to_owned()
        }
    }

    /// One answer for scenes that are all procedural, or another one for captures.
    fn of_captures(&self, made_up: &str, captured: &str) -> String {
        if self.facts.made_up() {
            format!("{made_up} Its scenes are procedural.")
        } else {
            captured.to_owned()
        }
    }

    fn persons(&self) -> String {
        croissant::personal_words(self.facts.made_up()).to_owned()
    }

    pub(super) fn collection(&self) -> Vec<DatasheetEntry> {
        let trained = self.facts.trained().map_or_else(
            || "No scene was trained.".to_owned(),
            |how| format!("Gaussians were trained with: {how}."),
        );
        vec![
            ("How was the data acquired?", format!("{} {trained}", self.facts.provenance().collection())),
            ("What mechanisms were used, and how were they validated?", self.mechanisms()),
            ("If it is a sample, how was it drawn?", SAMPLE.to_owned()),
            ("Who was involved, and how were they compensated?", UNSTATED.to_owned()),
            ("Over what time was it collected?", self.accessed()),
            ("Were there ethical reviews?", UNSTATED.to_owned()),
            ("Was it collected from persons directly, or through others?", self.upstreams()),
            ("Were persons notified?", self.of_captures("No persons are involved.", UNKNOWN)),
            ("Did they consent?", self.of_captures("No persons are involved.", UNKNOWN)),
            ("Can they revoke consent?", self.removal()),
            ("Was the impact on persons analysed?", self.of_captures("No persons are involved.", UNSTATED)),
            ("Any other comments?", "None.".to_owned()),
        ]
    }

    fn accessed(&self) -> String {
        let days: BTreeMap<&str, usize> =
            self.facts.scenes.iter().filter_map(|scene| scene.file.source.accessed.as_deref()).fold(
                BTreeMap::new(),
                |mut days, day| {
                    *days.entry(day).or_default() += 1;
                    days
                },
            );
        match (days.keys().next(), days.keys().next_back()) {
            // Days are `YYYY-MM-DD`, so the order of the texts is that of time.
            (Some(first), Some(last)) => format!(
                "Captures were downloaded between {first} and {last} (stated for {} of {} scenes). The dates of the photos \
                 are not known.",
                days.values().sum::<usize>(),
                self.facts.scenes.len()
            ),
            _ => self.of_captures("Nothing was collected.", UNKNOWN),
        }
    }

    fn upstreams(&self) -> String {
        let assets = self.facts.assets();
        let names: Vec<&str> =
            assets.iter().filter(|asset| asset.is_dataset()).map(|asset| asset.attribution).collect();
        if names.is_empty() {
            self.of_captures(
                "Not from persons.",
                "Through the owners of the captures: see `licence` in each `scene.json`.",
            )
        } else {
            format!("Captures are from {}.", names.join("; "))
        }
    }

    fn removal(&self) -> String {
        let whom = match &self.info.contact {
            Some(contact) => format!("Ask for the removal of a scene at {}.", plain_text(contact)),
            None => format!("{} No contact for the removal of scenes is stated.", UNSTATED),
        };
        format!("{whom} {}", self.taken_down()).trim_end().to_owned()
    }

    pub(super) fn preprocessing(&self) -> Vec<DatasheetEntry> {
        vec![
            ("Was there preprocessing, cleaning or labelling?", self.preprocessing_words()),
            (
                "Was the raw data saved too?",
                if self.facts.photos() == 0 {
                    "There is none.".to_owned()
                } else {
                    "Not in the release.".to_owned()
                },
            ),
            (
                "Is the software for it available?",
                format!("{}; every step, with its key, is in `manifest.json`.", TOOL),
            ),
            ("Any other comments?", "None.".to_owned()),
        ]
    }

    pub(super) fn uses(&self) -> Vec<DatasheetEntry> {
        vec![
            ("Has it been used for any tasks already?", UNSTATED.to_owned()),
            ("Is there a list of papers or systems that use it?", UNSTATED.to_owned()),
            ("What other tasks could it be used for?", self.facts.provenance().uses().to_owned()),
            ("Is there anything that might affect future uses?", {
                let provenance = self.facts.provenance();
                format!("{} {}", provenance.biases(), provenance.limits())
            }),
            (
                "Are there tasks it should not be used for?",
                if self.facts.provenance().has_events() {
                    "As a replacement for recordings of a real sensor, for methods that will run on such recordings."
                        .to_owned()
                } else {
                    UNSTATED.to_owned()
                },
            ),
            ("Any other comments?", "None.".to_owned()),
        ]
    }

    pub(super) fn distribution(&self) -> Vec<DatasheetEntry> {
        let gated = if self.facts.licence.gated {
            " Receivers must first accept the upstream terms; the card has the form."
        } else {
            ""
        };
        let grants = self.facts.grants();
        let grants = if grants.is_empty() { String::new() } else { format!("\n\n- {}", grants.join("\n- ")) };
        let terms = format!(
            "The whole: `{}`. Texts are in `LICENSES/`; each scene has its own terms, part by part, in `scene.json`.{gated}\n\n{}{grants}",
            self.facts.licence.expression,
            self.facts.ledger()
        );
        vec![
            ("Will it be distributed to third parties?", format!("Where: {}", self.said(|info| &info.url))),
            ("How will it be distributed?", UNSTATED.to_owned()),
            ("When?", self.published()),
            ("Under which licence or terms?", terms),
            ("Have third parties imposed restrictions?", self.restrictions()),
            ("Do export controls or other rules apply?", UNKNOWN.to_owned()),
            ("Any other comments?", "None.".to_owned()),
        ]
    }

    fn published(&self) -> String {
        self.said(|info| &info.date_published)
    }

    fn restrictions(&self) -> String {
        let asked: Vec<&str> = self.facts.obligations().into_iter().map(LicenceObligation::words).collect();
        let unverified: Vec<&str> =
            self.facts.assets().iter().filter(|asset| !asset.verified).map(|asset| asset.name).collect();
        let mut text = match asked.as_slice() {
            [] => "No restrictions are known.".to_owned(),
            _ => format!("Together the terms require: {}.", asked.join(", ")),
        };
        if !unverified.is_empty() {
            let _ = write!(text, " The terms of {} could not be verified in full.", unverified.join(", "));
        }
        text
    }

    pub(super) fn maintenance(&self) -> Vec<DatasheetEntry> {
        vec![
            ("Who supports, hosts and maintains it?", stated_or_silent(self.info.maintenance.as_ref())),
            ("How can the publisher be contacted?", stated_or_silent(self.info.contact.as_ref())),
            ("Is there an erratum?", UNSTATED.to_owned()),
            (
                "Will it be updated?",
                format!(
                    "{} This is version {}; `gs2e diff` compares two versions.",
                    stated_or_silent(self.info.maintenance.as_ref()),
                    plain_text(&self.info.version)
                ),
            ),
            ("Are there limits on how long data on persons are kept?", self.removal()),
            ("Will older versions be supported?", UNSTATED.to_owned()),
            (
                "Can others extend or contribute?",
                "Each `scene.json` contains the full recipe, from which the same program makes the same bytes."
                    .to_owned(),
            ),
            ("Any other comments?", "None.".to_owned()),
        ]
    }
}

const SAMPLE: &str = "The scenes of the recipes; the publisher does not state how they were chosen.";
