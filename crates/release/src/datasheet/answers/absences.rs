//! Answers on what the dataset lacks, how its parts belong together, and its risks.

use super::{AnswerContext, counted_list};
use crate::croissant;
use crate::facts::FileCounts;
use gs2e_recipe::SplitUnit;

impl AnswerContext<'_> {
    pub(super) fn missing(&self) -> String {
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
        let held_back = match self.facts.held_back.len() {
            0 => String::new(),
            count => format!("Scenes held back because of failed checks: {count}; the card lists them. "),
        };
        let text = format!("{photos}{withheld}{held_back}{}", self.taken_down());
        if text.is_empty() {
            "Outputs that the recipes do not request; nothing else is known to be missing.".into()
        } else {
            text
        }
    }

    pub(super) fn taken_down(&self) -> String {
        match self.facts.taken_down {
            0 => String::new(),
            count => format!("{count} scenes were removed on request."),
        }
    }

    pub(super) fn relationships(&self) -> String {
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

    pub(super) fn splits(&self) -> String {
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

    pub(super) fn errors(&self) -> String {
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

    pub(super) fn self_contained(&self) -> String {
        if self.facts.photos() == 0 {
            "It is self-contained.".to_owned()
        } else {
            "The release needs nothing else. To make it again, the captures are needed: `scene.json` lists their photos by \
             name and SHA-256, and their holders distribute them."
                .to_owned()
        }
    }

    /// One answer for scenes that are all procedural, or another one for captures.
    pub(super) fn of_captures(&self, made_up: &str, captured: &str) -> String {
        if self.facts.made_up() {
            format!("{made_up} Its scenes are procedural.")
        } else {
            captured.to_owned()
        }
    }

    pub(super) fn persons(&self) -> String {
        croissant::personal_words(self.facts.made_up()).to_owned()
    }
}
