//! `sources.yaml`: permission to redistribute material, with its reason, for each kind of source.

use crate::recipe::field::Field;
use crate::recipe::problem::Problem;
use crate::recipe::resolve::Resolver;
use crate::recipe::text::Place;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The publisher's statements by kind of source (`mvimgnet`, `dl3dv`, `colmap`, …).
pub type SourceTerms = BTreeMap<String, Redistribution>;

/// The statement that material of a source may be redistributed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Redistribution {
    /// The reason; never empty.
    pub because: String,
}

/// The file as written. Material of an unlisted source may be redistributed only if its licence
/// says so.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Raw {
    mvimgnet: Field<Entry>,
    dl3dv: Field<Entry>,
    colmap: Field<Entry>,
    nerfstudio: Field<Entry>,
    model: Field<Entry>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Entry {
    redistribute: Field<Redistribute>,
    because: Field<String>,
}

/// The only accepted value. A source without a statement has no permission.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Redistribute {
    Allowed,
}

/// Returns the statements of the file.
pub(super) fn source_terms(raw: &Raw, resolver: &Resolver<'_>) -> Option<SourceTerms> {
    let sources = [
        ("mvimgnet", &raw.mvimgnet),
        ("dl3dv", &raw.dl3dv),
        ("colmap", &raw.colmap),
        ("nerfstudio", &raw.nerfstudio),
        ("model", &raw.model),
    ];
    let given = sources.into_iter().filter(|(_, entry)| !entry.is_absent());
    let stated: Vec<Option<(String, Redistribution)>> = given
        .map(|(name, entry)| {
            let (entry, place) = entry.given()?;
            Some((name.to_owned(), redistribution_terms(entry, place, resolver)?))
        })
        .collect();
    stated.into_iter().collect()
}

fn redistribution_terms(entry: &Entry, place: Place, resolver: &Resolver<'_>) -> Option<Redistribution> {
    let help = "write { redistribute: allowed, because: why this may be said }, or remove the source";
    let allowed = resolver.required(&entry.redistribute, "redistribute", place, help);
    let because = resolver.required(&entry.because, "because", place, help);
    let because = because.and_then(|(text, place)| {
        let reason = Some(text.trim()).filter(|text| !text.is_empty()).map(str::to_owned);
        reason.or_else(|| resolver.refuse(Problem::of_field("is empty, wanted a reason").at(place)))
    });
    let (Redistribute::Allowed, _) = allowed?;
    Some(Redistribution { because: because? })
}
