//! Front matter of the card, in the form that dataset hubs read.

use crate::facts::ReleaseFacts;
use crate::markdown::markup;
use gs2e_files::escape::quoted;
use gs2e_source::licence::LicenceObligation;
use minijinja::{Value, context};

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

/// Names of sizes that dataset hubs know, each with the number of rows from which on it does not hold.
const SIZES: [(usize, &str); 4] =
    [(1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (usize::MAX, "100K<n<1M")];

/// Promises of receivers before they get access, one per obligation of the terms.
const PROMISES: [(LicenceObligation, &str); 3] = [
    (LicenceObligation::NonCommercial, "I do not use it commercially"),
    (LicenceObligation::NoRedistribution, "I do not redistribute any part of it"),
    (LicenceObligation::DeletionOnRequest, "I delete data about a person on request"),
];

pub(super) fn head_values(facts: &ReleaseFacts<'_>) -> Value {
    let (rows, obligations) = (facts.counts().trajectories, facts.obligations());
    let size = SIZES.iter().find(|(limit, _)| rows < *limit).map(|(_, name)| markup(*name));
    let promises = PROMISES.iter().filter(|(obligation, _)| obligations.contains(obligation));
    context! {
        hub_licence => hub_licence(&facts.licence.expression).map(markup),
        quoted_licence => markup(quoted(&facts.licence.expression)), quoted_name => markup(quoted(&facts.info.name)),
        size, index => crate::index::NAME, promises => promises.map(|(_, promise)| *promise).collect::<Value>(),
    }
}
