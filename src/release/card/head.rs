//! Front matter of the card, in the form that dataset hubs read.

use crate::escape::quoted;
use crate::licence::LicenceObligation;
use crate::release::facts::ReleaseFacts;
use std::fmt::Write as _;

/// Composes the front matter.
pub(super) fn card_head(facts: &ReleaseFacts<'_>) -> String {
    let (info, licence) = (facts.info, facts.licence);
    let mut text = String::from("---\nlanguage: en\n");
    // Hubs know few licences by name. An expression is given as another licence with a link.
    let _ = writeln!(
        text,
        "license: other\nlicense_name: {}\nlicense_link: LICENSES",
        quoted(&licence.expression)
    );
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
    let _ =
        writeln!(text, "configs: [{{ config_name: index, data_files: {} }}]", crate::release::index::NAME);
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
