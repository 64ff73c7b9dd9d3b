//! Answers on the collection of the data, their processing, and their uses.

use super::{AnswerContext, SAMPLE};
use crate::TOOL;
use crate::datasheet::{DatasheetEntry, UNKNOWN, UNSTATED};
use crate::markdown::plain_text;
use std::collections::BTreeMap;

impl AnswerContext<'_> {
    pub(in crate::datasheet) fn collection(&self) -> Vec<DatasheetEntry> {
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

    pub(super) fn accessed(&self) -> String {
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

    pub(super) fn upstreams(&self) -> String {
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

    pub(super) fn removal(&self) -> String {
        let whom = match &self.info.contact {
            Some(contact) => format!("Ask for the removal of a scene at {}.", plain_text(contact)),
            None => format!("{} No contact for the removal of scenes is stated.", UNSTATED),
        };
        format!("{whom} {}", self.taken_down()).trim_end().to_owned()
    }

    pub(in crate::datasheet) fn preprocessing(&self) -> Vec<DatasheetEntry> {
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

    pub(in crate::datasheet) fn uses(&self) -> Vec<DatasheetEntry> {
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
}
