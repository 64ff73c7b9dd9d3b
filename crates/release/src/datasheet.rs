//! `DATASHEET.md`: the questions of "Datasheets for Datasets" (Gebru et al., Communications of the
//! ACM 64(12), 2021), in their order, answered from facts about the release. Unknown facts are
//! called unknown; nothing is made up.

use super::facts::ReleaseFacts;
use super::markdown::{self, markup};
use super::{TOOL, croissant};
use crate::products::products;
use gs2e_recipe::ReleaseInfo;
use gs2e_source::licence::LicenceObligation;
use minijinja::{Value, context};
use std::collections::{BTreeMap, BTreeSet};

/// Name of the file.
pub const NAME: &str = "DATASHEET.md";

/// Composes the file.
pub(super) fn compose_datasheet(facts: &ReleaseFacts<'_>) -> String {
    let values = context! { ..publisher_values(facts.info), ..computed_values(facts), ..facts.values() };
    markdown::render(include_str!("templates/datasheet.md.jinja"), values)
}

/// The publisher's own words. The default of a field is not a statement of the publisher.
fn publisher_values(info: &ReleaseInfo) -> Value {
    let default = ReleaseInfo::default();
    let said = |of: fn(&ReleaseInfo) -> &String| Some(of(info)).filter(|text| *text != of(&default));
    context! {
        creator => &info.creator, purpose => &info.purpose, funding => &info.funding, maintenance => &info.maintenance,
        description => said(|info| &info.description), url => said(|info| &info.url),
        date_published => said(|info| &info.date_published),
    }
}

fn computed_values(facts: &ReleaseFacts<'_>) -> Value {
    let (counts, provenance, verdicts) = (facts.counts(), facts.provenance(), facts.verdicts());
    let products = products().filter(|product| counts.has(product));
    let products =
        products.map(|product| context! { instance => product.instance, content => product.content });
    let assets = facts.assets();
    let datasets = assets.iter().filter(|asset| asset.is_dataset()).map(|asset| asset.attribution);
    let unverified = assets.iter().filter(|asset| !asset.verified).map(|asset| asset.name);
    let obligations = facts.obligations().into_iter().map(LicenceObligation::words);
    let days: BTreeSet<&str> = facts.accessed().collect();
    context! {
        products => products.collect::<Value>(), sources => markup(counted_list(&facts.sources())),
        is_static => provenance.is_static(), made_up => facts.made_up(), photos => facts.photos(),
        several_sensors => facts.has_several_sensors(), passed => facts.passed(),
        checks => verdicts.values().sum::<usize>(), verdicts => markup(counted_list(&verdicts)),
        persons => croissant::personal_words(facts.made_up()), trained => facts.trained().map(markup),
        first_day => days.first().copied(), last_day => days.last().copied(), accessed => facts.accessed().count(),
        datasets => joined(datasets, "; "), unverified => joined(unverified, ", "),
        obligations => joined(obligations, ", "), tool => TOOL, uses => markup(provenance.uses()),
        biases => markup(provenance.biases()),
    }
}

fn joined<'t>(texts: impl Iterator<Item = &'t str>, between: &str) -> Value {
    markup(texts.collect::<Vec<_>>().join(between))
}

/// Counts in the form `1 a, 2 b`.
fn counted_list(counts: &BTreeMap<&str, usize>) -> String {
    let each: Vec<String> = counts.iter().map(|(name, count)| format!("{count} {name}")).collect();
    each.join(", ")
}
