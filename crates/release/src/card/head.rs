//! Front matter of the card, in the form that dataset hubs read.

use crate::facts::ReleaseFacts;
use gs2e_files::escape::quoted;
use gs2e_source::licence::LicenceObligation;
use std::fmt::Write as _;

/// The name that dataset hubs have for an SPDX expression. They know few licences by name; any other
/// expression is given as another licence with a link.
pub fn hub_licence(expression: &str) -> Option<String> {
    const KNOWN: [&str; 14] = [
        "Apache-2.0",
        "BSD-3-Clause",
        "CC-BY-2.0",
        "CC-BY-3.0",
        "CC-BY-4.0",
        "CC-BY-NC-4.0",
        "CC-BY-NC-ND-4.0",
        "CC-BY-NC-SA-4.0",
        "CC-BY-ND-4.0",
        "CC-BY-SA-3.0",
        "CC-BY-SA-4.0",
        "CC0-1.0",
        "MIT",
        "Unlicense",
    ];
    KNOWN.contains(&expression).then(|| expression.to_lowercase())
}

/// Composes the front matter.
pub(super) fn card_head(facts: &ReleaseFacts<'_>) -> String {
    let (info, licence) = (facts.info, facts.licence);
    let mut text = String::from("---\nlanguage: en\n");
    let _ = match hub_licence(&licence.expression) {
        Some(id) => writeln!(text, "license: {id}"),
        None => writeln!(
            text,
            "license: other\nlicense_name: {}\nlicense_link: LICENSES",
            quoted(&licence.expression)
        ),
    };
    let _ = writeln!(text, "pretty_name: {}", quoted(&info.name));
    let rows = facts.counts().trajectories;
    // The names that dataset hubs know.
    let size = [(1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K")];
    let size = size.iter().find(|(limit, _)| rows < *limit).map_or("100K<n<1M", |(_, name)| name);
    let _ = writeln!(text, "size_categories: [{}]", quoted(size));
    text.push_str(match facts.provenance().has_events() {
        true => "tags: [event-camera, 3d-gaussian-splatting, synthetic]\n",
        false => "tags: [3d-gaussian-splatting, synthetic]\n",
    });
    let _ = writeln!(text, "configs: [{{ config_name: index, data_files: {} }}]", crate::index::NAME);
    if licence.gated {
        text.push_str(&gate_prompt(facts));
    }
    text.push_str("---\n");
    text
}

/// Questions to receivers before they get access, in the form that hubs read: name and affiliation,
/// and a promise for each obligation of the terms.
fn gate_prompt(facts: &ReleaseFacts<'_>) -> String {
    let mut text = String::from(
        "extra_gated_heading: \"Terms of the upstream datasets\"\n\
         extra_gated_prompt: \"To get access, accept the upstream terms in LICENSES.\"\n\
         extra_gated_fields:\n  Name: text\n  Affiliation: text\n  \
         \"I have read and accept the terms in LICENSES\": checkbox\n",
    );
    let asked = [
        (LicenceObligation::NonCommercial, "I do not use it commercially"),
        (LicenceObligation::NoRedistribution, "I do not redistribute any part of it"),
        (LicenceObligation::DeletionOnRequest, "I delete data about a person on request"),
    ];
    let obligations = facts.obligations();
    for (_, promise) in asked.iter().filter(|(obligation, _)| obligations.contains(obligation)) {
        let _ = writeln!(text, "  \"{promise}\": checkbox");
    }
    text
}
