//! The answers of the datasheet.

mod absences;
mod collection;
mod composition;
mod distribution;

use super::{DatasheetEntry, UNSTATED};
use crate::facts::ReleaseFacts;
use crate::markdown::plain_text;
use gs2e_recipe::ReleaseInfo;
use std::collections::BTreeMap;

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
}

/// Choice of the scenes, as far as it is known.
const SAMPLE: &str = "The scenes of the recipes; the publisher does not state how they were chosen.";
