//! The sections of the card on terms and on citation.

use crate::facts::ReleaseFacts;
use crate::markdown::{breaks_line, plain_text};
use gs2e_files::escape;
use gs2e_source::licence::Redistributability;
use std::fmt::Write as _;

/// The terms of the whole, of each scene, and of the programs.
pub(super) fn licences_section(facts: &ReleaseFacts<'_>) -> String {
    let mut text =
        format!("## Licence\n\nThe whole: `{}`. Texts are in `LICENSES/`.\n\n", facts.licence.expression);
    for scene in facts.scenes {
        let holder =
            scene.recipe.licence.as_ref().map_or_else(|| "not stated".into(), |l| plain_text(&l.holder));
        let passing = match &scene.licence.passing {
            Redistributability::Free => String::new(),
            Redistributability::Allowed(because) => {
                format!("; redistributed, because: {}", plain_text(because))
            }
            Redistributability::Withheld => "; only recipe, poses and reports".to_owned(),
        };
        let (id, terms) = (&scene.recipe.scene, &scene.licence.expression);
        let _ = writeln!(text, "- {id}: `{terms}`, holder: {holder}{passing}");
    }
    for grant in facts.grants() {
        let _ = writeln!(text, "- {grant}");
    }
    let named: Vec<String> = facts.attributions().into_iter().map(plain_text).collect();
    if !named.is_empty() {
        let _ = writeln!(text, "\nAttribution: {}.", named.join("; "));
    }
    let ledger = facts.ledger();
    if !ledger.is_empty() {
        let trained = if facts.trained_elsewhere() { TRAINED } else { "" };
        let _ = writeln!(text, "\n{PROGRAMS}{trained}\n\n{ledger}");
        // The ledger ends its last line itself, so there is an empty line too many.
        text.truncate(text.trim_end().len());
        text.push('\n');
    }
    text
}

/// Introduction of the table of terms.
const PROGRAMS: &str = "Known terms. The terms of datasets are binding; the terms of programs do not bind a scene by themselves.";

/// Open question of the table of terms, if other programs trained scenes.
const TRAINED: &str = " The licence of 3D Gaussian Splatting does not state if it applies to renderings of scenes that \
    were trained with it.";

pub(super) fn citation_section(facts: &ReleaseFacts<'_>) -> String {
    let info = facts.info;
    let mut text = String::from("## Citation\n\n");
    if !info.cite_as.is_empty() {
        // As code, so that nothing in it is markup.
        for line in info.cite_as.trim_end().replace("\r\n", "\n").split(breaks_line) {
            let _ = writeln!(text, "    {}", escape::line(&line.trim_end().replace('\t', "    ")));
        }
        text.push('\n');
    }
    text.push_str("The pipeline follows GS2E (arXiv 2505.15287)");
    for (name, publication) in facts.provenance().models() {
        let _ = write!(text, "; a sensor model follows {name} ({publication})");
    }
    text.push_str(".\n");
    text
}
