//! The sections of the card on splits, and on the removal of scenes.

use crate::facts::ReleaseFacts;
use crate::markdown::plain_text;
use gs2e_recipe::{ReleaseInfo, SplitUnit};

/// Number of scenes in each split; empty if there are no splits.
pub(super) fn splits_section(facts: &ReleaseFacts<'_>) -> String {
    let Some(rule) = &facts.info.splits else { return String::new() };
    let by = match rule.by {
        SplitUnit::Capture => "capture",
        SplitUnit::Object => "object",
    };
    let counts: Vec<String> =
        facts.splits().iter().map(|(name, count)| format!("`{name}` {count}")).collect();
    format!(
        "## Splits\n\nBy {by}, never by trajectory; number of scenes: {}. `index.parquet` and each `scene.json` name the \
         `split`. No photo and no scene file is in two splits.\n",
        counts.join(", ")
    )
}

/// Contact for requests to remove a scene.
pub(super) fn removal_section(info: &ReleaseInfo) -> String {
    let whom = match &info.contact {
        Some(contact) => format!("Write to {}", plain_text(contact)),
        None if info.url == ReleaseInfo::default().url => "No contact is stated".to_owned(),
        None => format!("No contact is stated; the publisher's page is {}", plain_text(&info.url)),
    };
    format!("## Removal of scenes\n\n{whom}. Later versions do not contain a scene that was taken down.\n")
}
