//! The answers of the datasheet.

use super::{DatasheetEntry, UNKNOWN, UNSTATED};
use crate::licence::LicenceObligation;
use crate::recipe::{ReleaseInfo, SplitUnit};
use crate::release::facts::{FileCounts, ReleaseFacts, plain_text};
use crate::release::published::PublishedScene;
use crate::release::{TOOL, card, croissant};
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
            ("What do the instances represent?", INSTANCES.to_owned()),
            ("How many instances are there?", self.how_many()),
            ("Is it all possible instances, or a sample?", SAMPLE.to_owned()),
            ("What data does each instance consist of?", EACH.to_owned()),
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
            ("Any other comments?", card::LIMITS.to_owned()),
        ]
    }

    fn how_many(&self) -> String {
        let FileCounts { scenes, trajectories, poses, streams, events, withheld, .. } = self.facts.counts();
        let pictures = self.facts.pictures();
        let mut text = format!(
            "{scenes} scenes ({}) with {trajectories} trajectories of {poses} poses together; in the release are {streams} \
             event streams with {events} events, and {pictures}.",
            counted_list(&self.facts.sources())
        );
        if withheld > 0 {
            let _ = write!(
                text,
                " Of {withheld} scenes there are recipe, poses and reports alone, as their upstream does not let \
                 everyone pass on what is made from them."
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
            "Exact camera poses; where a stream has `events/label`, each event is told as signal or noise."
                .to_owned()
        } else {
            "Exact camera poses; events have no labels.".to_owned()
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
            count => format!("Events and pictures of {count} scenes are withheld. "),
        };
        let text = format!("{photos}{withheld}{}", self.taken_down());
        if text.is_empty() {
            "What recipes did not ask for; otherwise nothing is known to be missing.".into()
        } else {
            text
        }
    }

    fn taken_down(&self) -> String {
        match self.facts.taken_down {
            0 => String::new(),
            count => format!("{count} scenes were left out, as their removal was asked for."),
        }
    }

    fn relationships(&self) -> String {
        "Trajectories of one scene lie in its folder; streams of several sensors on one trajectory lie in its `events/`. \
         `group` of a scene's `split`, where there are splits, says what is of one capture or object."
            .to_owned()
    }

    fn splits(&self) -> String {
        let Some(splits) = &self.info.splits else {
            return "No: the release is not dealt into splits.".to_owned();
        };
        let by = match splits.by {
            SplitUnit::Capture => "captures",
            SplitUnit::Object => "objects",
        };
        format!(
            "Yes, by whole {by}, never by trajectory: {} scenes. A group lies where SHA-256 of salt, a NUL and its key puts \
             it, so a scene that is added moves no other; rule and salt are in `manifest.json`. No photo and no Gaussians \
             are in two splits.",
            counted_list(&self.facts.splits())
        )
    }

    fn errors(&self) -> String {
        format!(
            "Of {} checks {} passed ({}); what is not a pass is in the card, all in `checks.json` of each trajectory. Sensor \
             noise is that of the stated models. Copies are not known.",
            self.facts.verdicts().values().sum::<usize>(),
            self.facts.passed(),
            counted_list(&self.facts.verdicts())
        )
    }

    fn self_contained(&self) -> String {
        if self.facts.photos() == 0 {
            "It is self-contained.".to_owned()
        } else {
            "What is in it needs nothing else. To make it anew takes the captures, whose photos are named and hashed in \
             `scene.json` and had from their own holders."
                .to_owned()
        }
    }

    /// One answer for scenes that are all procedural, or another one for captures.
    fn of_captures(&self, made_up: &str, captured: &str) -> String {
        if self.facts.made_up() {
            format!("{made_up} Its scenes are made up by the program.")
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
            ("How was the data acquired?", format!("{} {trained}", croissant::COLLECTION)),
            ("What mechanisms were used, and how were they validated?", MECHANISMS.to_owned()),
            ("If it is a sample, how was it drawn?", SAMPLE.to_owned()),
            ("Who was involved, and how were they compensated?", UNSTATED.to_owned()),
            ("Over what time was it collected?", self.accessed()),
            ("Were there ethical reviews?", UNSTATED.to_owned()),
            ("Was it collected from persons directly, or through others?", self.upstreams()),
            ("Were persons notified?", self.of_captures("Nobody was concerned.", UNKNOWN)),
            ("Did they consent?", self.of_captures("Nobody was concerned.", UNKNOWN)),
            ("Can they revoke consent?", self.removal()),
            ("Was the impact on persons analysed?", self.of_captures("Nobody is concerned.", UNSTATED)),
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
                "Captures were downloaded between {first} and {last} ({} of {} scenes say when). When they were taken is not \
                 known.",
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
                "From nobody.",
                "By the owners of the captures: see `licence` in each `scene.json`.",
            )
        } else {
            format!("Captures are from {}.", names.join("; "))
        }
    }

    fn removal(&self) -> String {
        let whom = match &self.info.contact {
            Some(contact) => format!("Ask for the removal of a scene at {}.", plain_text(contact)),
            None => format!("{} No contact for the removal of scenes is named.", UNSTATED),
        };
        format!("{whom} {}", self.taken_down()).trim_end().to_owned()
    }

    pub(super) fn preprocessing(&self) -> Vec<DatasheetEntry> {
        vec![
            ("Was there preprocessing, cleaning or labelling?", PREPROCESSING.to_owned()),
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
            ("What other tasks could it be used for?", croissant::USES.to_owned()),
            (
                "Is there anything that might affect future uses?",
                format!("{} {}", croissant::BIASES, card::LIMITS),
            ),
            (
                "Are there tasks it should not be used for?",
                "To stand in for recordings of a sensor where a method is to be used on those.".to_owned(),
            ),
            ("Any other comments?", "None.".to_owned()),
        ]
    }

    pub(super) fn distribution(&self) -> Vec<DatasheetEntry> {
        let gated = if self.facts.licence.gated {
            " Receivers accept the terms of the upstreams first, where it is distributed: the card has the form."
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
            [] => "None is known.".to_owned(),
            _ => format!("Together the terms ask for: {}.", asked.join(", ")),
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
                    "{} This is version {}; `gs2e diff` tells two versions apart.",
                    stated_or_silent(self.info.maintenance.as_ref()),
                    plain_text(&self.info.version)
                ),
            ),
            ("Are there limits on how long data on persons are kept?", self.removal()),
            ("Will older versions be supported?", UNSTATED.to_owned()),
            (
                "Can others extend or contribute?",
                "Each `scene.json` has its recipe in full, from which the same program makes the same bytes."
                    .to_owned(),
            ),
            ("Any other comments?", "None.".to_owned()),
        ]
    }
}

const INSTANCES: &str = "Trajectories of a camera through scenes of 3D Gaussians, each with the events that a model of an \
    event sensor makes of it, exact poses, and sharp and blurred frames, depth and optical flow where they were asked for.";

const SAMPLE: &str = "The scenes that its recipes name; how they were chosen is not stated by the publisher.";

const EACH: &str = "Events (time in microseconds, column, row, polarity), poses, time stamps, speed report, checks, 8-bit \
    sRGB frames, and float32 depth (scene units) and optical flow (px/s), as the recipe asks; source, camera, recipe, seeds and statistics in the scene's `scene.json`.";

const MECHANISMS: &str = "A renderer of Gaussian splats and models of event sensors, in one program. Every trajectory was \
    held against a list of checks, whose records are in `checks.json`.";

const PREPROCESSING: &str = "Captured poses were smoothed and resampled along curves, as each recipe states; nothing was \
    edited by hand.";
