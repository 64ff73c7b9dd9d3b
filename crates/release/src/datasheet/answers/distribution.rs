//! Answers on distribution and maintenance.

use super::{AnswerContext, stated_or_silent};
use crate::datasheet::{DatasheetEntry, UNKNOWN, UNSTATED};
use crate::markdown::plain_text;
use gs2e_source::licence::LicenceObligation;
use std::fmt::Write as _;

impl AnswerContext<'_> {
    pub(in crate::datasheet) fn distribution(&self) -> Vec<DatasheetEntry> {
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

    pub(super) fn published(&self) -> String {
        self.said(|info| &info.date_published)
    }

    pub(super) fn restrictions(&self) -> String {
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

    pub(in crate::datasheet) fn maintenance(&self) -> Vec<DatasheetEntry> {
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
