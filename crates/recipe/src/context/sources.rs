//! `sources.yaml`: permission to redistribute material, with its reason, for each kind of source.

use crate::field::Field;
use crate::problem::FieldProblem;
use crate::resolve::{Resolver, all};
use crate::text::TextSpan;
use gs2e_source::kind::CaptureKind;
use serde::de::{Deserializer, MapAccess, Visitor};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use std::sync::LazyLock;

/// The publisher's statements by kind of source (`mvimgnet`, `dl3dv`, `colmap`, …).
pub type SourceTerms = BTreeMap<String, RedistributionStatement>;

/// The statement that material of a source may be redistributed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct RedistributionStatement {
    /// The reason; never empty.
    pub because: String,
}

/// The file as written: an entry per kind of capture. Material of an unlisted source may be
/// redistributed only if its licence says so.
#[derive(Debug, Default)]
pub(super) struct RawSources(BTreeMap<String, Field<SourceEntry>>);

/// Names of the kinds of captures: first the datasets, which have terms of their own.
static KINDS: LazyLock<Vec<&'static str>> = LazyLock::new(|| {
    let (datasets, others): (Vec<_>, Vec<_>) =
        CaptureKind::ALL.into_iter().partition(|kind| kind.dataset().is_some());
    datasets.into_iter().chain(others).map(CaptureKind::name).collect()
});

impl<'de> Deserialize<'de> for RawSources {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct SourcesVisitor;

        impl<'de> Visitor<'de> for SourcesVisitor {
            type Value = RawSources;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a mapping of sources")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<RawSources, A::Error> {
                let mut sources = BTreeMap::new();
                while let Some((name, entry)) = entries.next_entry()? {
                    sources.insert(name, entry);
                }
                Ok(RawSources(sources))
            }
        }

        deserializer.deserialize_struct("RawSources", &KINDS, SourcesVisitor)
    }
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
    let given = raw.0.iter().filter(|(_, entry)| !entry.is_absent());
    all(given, |(name, entry)| {
        let (entry, place) = entry.given()?;
        Some((name.clone(), redistribution_terms(entry, place, resolver)?))
    })
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
