//! `release.yaml`: what the release is called, by whom, and how it is cited.

use super::splits::{self, Splits};
use crate::recipe::field::Field;
use crate::recipe::forms;
use crate::recipe::resolve::Resolver;
use serde::{Deserialize, Serialize};

/// What catalogues say of a release. Nothing in it is read from a clock.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReleaseInfo {
    /// Its name; default `gs2e release`.
    pub name: String,
    /// Semantic version; default `0.0.0`.
    pub version: String,
    /// Its page; default `https://unpublished.invalid/`, a name that is reserved to lead nowhere.
    pub url: String,
    /// Who made it; default `unstated`.
    pub creator: String,
    /// Day of publication, `YYYY-MM-DD`; default `1970-01-01`.
    pub date_published: String,
    /// How it is cited; default `unpublished dataset made with gs2e`.
    pub cite_as: String,
    /// What it is; default `Synthetic event-camera sequences, rendered from 3D Gaussian splats.`
    pub description: String,
    /// Who answers, and takes requests for removal; default: nobody is named.
    pub contact: Option<String>,
    /// What it was made for, as the publisher says.
    pub purpose: Option<String>,
    /// Who paid for it, as the publisher says.
    pub funding: Option<String>,
    /// How it is kept up, as the publisher says.
    pub maintenance: Option<String>,
    /// How scenes are dealt into splits, if they are.
    pub splits: Option<Splits>,
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
            description: "Synthetic event-camera sequences, rendered from 3D Gaussian splats.".into(),
            contact: None,
            purpose: None,
            funding: None,
            maintenance: None,
            splits: None,
        }
    }
}

/// The file as it is written.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Raw {
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
    /// Names of splits and how scenes are dealt to them.
    splits: Field<splits::Raw>,
}

/// What the file says, with defaults.
pub(super) fn info(raw: &Raw, resolver: &Resolver<'_>) -> Option<ReleaseInfo> {
    let default = ReleaseInfo::default();
    let name = text(resolver, &raw.name, default.name);
    let version = resolver.formed(&raw.version, forms::VERSION).map(|given| given.unwrap_or(default.version));
    let url = resolver.formed(&raw.url, forms::URL).map(|given| given.unwrap_or(default.url));
    let creator = text(resolver, &raw.creator, default.creator);
    let date = resolver.formed(&raw.date_published, forms::DAY);
    let date = date.map(|given| given.unwrap_or(default.date_published));
    let cite_as = text(resolver, &raw.cite_as, default.cite_as);
    let description = text(resolver, &raw.description, default.description);
    let [contact, purpose, funding, maintenance] =
        [&raw.contact, &raw.purpose, &raw.funding, &raw.maintenance].map(|field| optional(resolver, field));
    let splits = splits::splits(&raw.splits, resolver);
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
    })
}

fn text(resolver: &Resolver<'_>, field: &Field<String>, default: String) -> Option<String> {
    let Some((text, place)) = field.given() else { return field.is_absent().then_some(default) };
    resolver.filled(text, place)
}

fn optional(resolver: &Resolver<'_>, field: &Field<String>) -> Option<Option<String>> {
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
