//! `release.yaml`: name, creator and citation of the release.

use super::include::{self, IncludedExport};
use super::splits::{self, SplitPlan};
use crate::field::Field;
use crate::forms;
use crate::resolve::{Resolver, resolved};
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
    let or = |given: Option<Option<String>>, default: String| given.map(|given| given.unwrap_or(default));
    resolved!(ReleaseInfo {
        name: or(resolver.said(&raw.name), default.name),
        version: or(resolver.formed(&raw.version, forms::VERSION), default.version),
        url: or(resolver.formed(&raw.url, forms::URL), default.url),
        creator: or(resolver.said(&raw.creator), default.creator),
        date_published: or(resolver.formed(&raw.date_published, forms::DAY), default.date_published),
        cite_as: or(resolver.said(&raw.cite_as), default.cite_as),
        description: or(resolver.said(&raw.description), default.description),
        contact: resolver.said(&raw.contact),
        purpose: resolver.said(&raw.purpose),
        funding: resolver.said(&raw.funding),
        maintenance: resolver.said(&raw.maintenance),
        splits: splits::resolve_splits(&raw.splits, resolver),
        include: include::resolve_include(&raw.include, resolver),
    })
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
