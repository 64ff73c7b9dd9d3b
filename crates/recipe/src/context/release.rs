//! `release.yaml`: name, creator and citation of the release.

use super::include::{self, IncludedExport};
use super::splits::{self, SplitPlan};
use crate::field::Field;
use crate::forms;
use crate::resolve::Resolver;
use serde::{Deserialize, Serialize};

/// Description of a release for catalogues. No field is read from a clock.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReleaseInfo {
    /// Name of the release; default `gs2e release`.
    pub name: String,
    /// Semantic version; default `0.0.0`.
    pub version: String,
    /// Web page; default `https://unpublished.invalid/`, a reserved name that never resolves.
    pub url: String,
    /// Creator; default `unstated`.
    pub creator: String,
    /// Day of publication, `YYYY-MM-DD`; default `1970-01-01`.
    pub date_published: String,
    /// Citation; default `unpublished dataset made with gs2e`.
    pub cite_as: String,
    /// Description; default `Sequences with exact camera poses, rendered from 3D Gaussian splats.`
    pub description: String,
    /// Contact for questions and requests for removal. Optional.
    pub contact: Option<String>,
    /// Purpose of the dataset, in the publisher's words.
    pub purpose: Option<String>,
    /// Funding, in the publisher's words.
    pub funding: Option<String>,
    /// Maintenance plan, in the publisher's words.
    pub maintenance: Option<String>,
    /// Rules that assign scenes to splits, if the release has splits.
    pub splits: Option<SplitPlan>,
    /// Exports that the release has besides its own files.
    pub include: Vec<IncludedExport>,
}

impl Default for ReleaseInfo {
    fn default() -> Self {
        Self {
            name: "gs2e release".into(),
            version: "0.0.0".into(),
            url: "https://unpublished.invalid/".into(),
            creator: "unstated".into(),
            date_published: "1970-01-01".into(),
            cite_as: "unpublished dataset made with gs2e".into(),
            description: "Sequences with exact camera poses, rendered from 3D Gaussian splats.".into(),
            contact: None,
            purpose: None,
            funding: None,
            maintenance: None,
            splits: None,
            include: Vec::new(),
        }
    }
}

/// The file as written.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct RawRelease {
    name: Field<String>,
    version: Field<String>,
    url: Field<String>,
    creator: Field<String>,
    date_published: Field<String>,
    cite_as: Field<String>,
    description: Field<String>,
    contact: Field<String>,
    purpose: Field<String>,
    funding: Field<String>,
    maintenance: Field<String>,
    /// Rules that assign scenes to splits.
    splits: Field<splits::RawSplits>,
    /// Exports that the release has besides its own files.
    include: Field<Vec<Field<include::RawInclude>>>,
}

/// Returns the content of the file, completed with defaults.
pub(super) fn release_info(raw: &RawRelease, resolver: &Resolver<'_>) -> Option<ReleaseInfo> {
    let default = ReleaseInfo::default();
    let name = resolve_text(resolver, &raw.name, default.name);
    let version = resolver.formed(&raw.version, forms::VERSION).map(|given| given.unwrap_or(default.version));
    let url = resolver.formed(&raw.url, forms::URL).map(|given| given.unwrap_or(default.url));
    let creator = resolve_text(resolver, &raw.creator, default.creator);
    let date = resolver.formed(&raw.date_published, forms::DAY);
    let date = date.map(|given| given.unwrap_or(default.date_published));
    let cite_as = resolve_text(resolver, &raw.cite_as, default.cite_as);
    let description = resolve_text(resolver, &raw.description, default.description);
    let [contact, purpose, funding, maintenance] =
        [&raw.contact, &raw.purpose, &raw.funding, &raw.maintenance]
            .map(|field| optional_text(resolver, field));
    let splits = splits::resolve_splits(&raw.splits, resolver);
    let include = include::resolve_include(&raw.include, resolver);
    Some(ReleaseInfo {
        name: name?,
        version: version?,
        url: url?,
        creator: creator?,
        date_published: date?,
        cite_as: cite_as?,
        description: description?,
        contact: contact?,
        purpose: purpose?,
        funding: funding?,
        maintenance: maintenance?,
        splits: splits?,
        include: include?,
    })
}

fn resolve_text(resolver: &Resolver<'_>, field: &Field<String>, default: String) -> Option<String> {
    let Some((text, place)) = field.given() else { return field.is_absent().then_some(default) };
    resolver.filled(text, place)
}

fn optional_text(resolver: &Resolver<'_>, field: &Field<String>) -> Option<Option<String>> {
    let Some((text, place)) = field.given() else { return field.is_absent().then_some(None) };
    resolver.filled(text, place).map(Some)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_of_the_form_that_is_asked_for() {
        let ReleaseInfo { version, url, date_published, .. } = ReleaseInfo::default();
        for (text, form) in [(version, forms::VERSION), (url, forms::URL), (date_published, forms::DAY)] {
            assert!(form.holds(&text), "{text}");
        }
    }
}
