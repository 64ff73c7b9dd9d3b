//! `sources.yaml`: permission to redistribute material, with its reason, for each kind of source.

use crate::recipe::field::Field;
use crate::recipe::problem::FieldProblem;
use crate::recipe::resolve::Resolver;
use crate::recipe::text::TextSpan;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The publisher's statements by kind of source (`mvimgnet`, `dl3dv`, `colmap`, …).
pub type SourceTerms = BTreeMap<String, RedistributionStatement>;

/// The statement that material of a source may be redistributed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct RedistributionStatement {
    /// The reason; never empty.
    pub because: String,
}

/// The file as written. Material of an unlisted source may be redistributed only if its licence
/// says so.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct RawSources {
    mvimgnet: Field<SourceEntry>,
    dl3dv: Field<SourceEntry>,
    colmap: Field<SourceEntry>,
    nerfstudio: Field<SourceEntry>,
    model: Field<SourceEntry>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct SourceEntry {
    redistribute: Field<RedistributeKey>,
    because: Field<String>,
}

/// The only accepted value. A source without a statement has no permission.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum RedistributeKey {
    Allowed,
}

/// Returns the statements of the file.
pub(super) fn source_terms(raw: &RawSources, resolver: &Resolver<'_>) -> Option<SourceTerms> {
    let sources = [
        ("mvimgnet", &raw.mvimgnet),
        ("dl3dv", &raw.dl3dv),
        ("colmap", &raw.colmap),
        ("nerfstudio", &raw.nerfstudio),
        ("model", &raw.model),
    ];
    let given = sources.into_iter().filter(|(_, entry)| !entry.is_absent());
    let stated: Vec<Option<(String, RedistributionStatement)>> = given
        .map(|(name, entry)| {
            let (entry, place) = entry.given()?;
            Some((name.to_owned(), redistribution_terms(entry, place, resolver)?))
        })
        .collect();
    stated.into_iter().collect()
}

fn redistribution_terms(
    entry: &SourceEntry,
    place: TextSpan,
    resolver: &Resolver<'_>,
) -> Option<RedistributionStatement> {
    let help = "write { redistribute: allowed, because: why this may be said }, or remove the source";
    let allowed = resolver.required(&entry.redistribute, "redistribute", place, help);
    let because = resolver.required(&entry.because, "because", place, help);
    let because = because.and_then(|(text, place)| {
        let reason = Some(text.trim()).filter(|text| !text.is_empty()).map(str::to_owned);
        reason.or_else(|| resolver.refuse(FieldProblem::of_field("is empty, wanted a reason").at(place)))
    });
    let (RedistributeKey::Allowed, _) = allowed?;
    Some(RedistributionStatement { because: because? })
}
