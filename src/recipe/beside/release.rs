//! `release.yaml`: what the release is called, by whom, and how it is cited.

use crate::recipe::field::{Field, Later};
use crate::recipe::problem::{Problem, quoted};
use crate::recipe::resolve::Resolver;
use serde::{Deserialize, Serialize};

/// What catalogues say of a release. Nothing in it is read from a clock.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
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
    /// Names of splits and how scenes are dealt to them.
    splits: Field<Later>,
}

/// What the file says, with defaults.
pub(super) fn info(raw: &Raw, resolver: &Resolver<'_>) -> Option<ReleaseInfo> {
    resolver.later(&raw.splits, "this gs2e releases without splits");
    let default = ReleaseInfo::default();
    let name = text(resolver, &raw.name, default.name);
    let version = checked(resolver, &raw.version, default.version, is_version, "a version such as 1.2.0");
    let url = checked(resolver, &raw.url, default.url, is_url, "an address such as https://example.org/data");
    let creator = text(resolver, &raw.creator, default.creator);
    let date =
        checked(resolver, &raw.date_published, default.date_published, is_date, "a day such as 2025-05-21");
    let cite_as = text(resolver, &raw.cite_as, default.cite_as);
    let description = text(resolver, &raw.description, default.description);
    Some(ReleaseInfo {
        name: name?,
        version: version?,
        url: url?,
        creator: creator?,
        date_published: date?,
        cite_as: cite_as?,
        description: description?,
    })
}

fn text(resolver: &Resolver<'_>, field: &Field<String>, default: String) -> Option<String> {
    let Some((text, place)) = field.given() else { return field.is_absent().then_some(default) };
    resolver.filled(text, place)
}

fn checked(
    resolver: &Resolver<'_>,
    field: &Field<String>,
    default: String,
    holds: fn(&str) -> bool,
    wanted: &str,
) -> Option<String> {
    let Some((text, place)) = field.given() else { return field.is_absent().then_some(default) };
    if holds(text) {
        return Some(text.clone());
    }
    resolver.refuse(Problem::of_field(format!("is {}, wanted {wanted}", quoted(text))).at(place))
}

/// A semantic version (semver.org 2.0.0), without a check of the identifiers behind `-` and `+` beyond their letters.
fn is_version(text: &str) -> bool {
    let core_end = text.find(['-', '+']).unwrap_or(text.len());
    let (core, suffix) = text.split_at(core_end);
    let number = |part: &str| {
        let digits = !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit());
        digits && (part == "0" || !part.starts_with('0'))
    };
    let identifiers = suffix.is_empty()
        || suffix.len() > 1 && suffix.bytes().all(|b| b.is_ascii_alphanumeric() || b"-+.".contains(&b));
    core.split('.').count() == 3 && core.split('.').all(number) && identifiers
}

fn is_url(text: &str) -> bool {
    let Some((scheme, rest)) = text.split_once(':') else { return false };
    let named = scheme.starts_with(|c: char| c.is_ascii_lowercase())
        && scheme.bytes().all(|b| b.is_ascii_alphanumeric() || b"+.-".contains(&b));
    named
        && !rest.trim_matches('/').is_empty()
        && !text.contains(|c: char| c.is_whitespace() || c.is_control())
}

/// A day of the Gregorian calendar.
fn is_date(text: &str) -> bool {
    let shape = text.len() == 10
        && text
            .bytes()
            .enumerate()
            .all(|(i, b)| if i == 4 || i == 7 { b == b'-' } else { b.is_ascii_digit() });
    if !shape {
        return false;
    }
    let [year, month, day] =
        [&text[..4], &text[5..7], &text[8..]].map(|part| part.parse::<u32>().unwrap_or(0));
    let leap = year.is_multiple_of(4) && !year.is_multiple_of(100) || year.is_multiple_of(400);
    let days = match month {
        2 if leap => 29,
        2 => 28,
        4 | 6 | 9 | 11 => 30,
        1..=12 => 31,
        _ => return false,
    };
    (1..=days).contains(&day)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(holds: fn(&str) -> bool, good: &[&str], bad: &[&str]) {
        good.iter().for_each(|text| assert!(holds(text), "{text}"));
        bad.iter().for_each(|text| assert!(!holds(text), "{text}"));
    }

    #[test]
    fn the_defaults_are_of_the_form_that_is_asked_for() {
        let ReleaseInfo { version, url, date_published, .. } = ReleaseInfo::default();
        assert!(is_version(&version) && is_url(&url) && is_date(&date_published));
    }

    #[test]
    fn versions_addresses_and_days_are_told_from_others() {
        check(
            is_version,
            &["0.0.0", "1.2.3", "10.0.1-rc.1+build"],
            &["", "1", "1.2", "1.2.3.4", "v1.2.3", "01.2.3", "1.2.3-"],
        );
        check(
            is_url,
            &["https://a.org", "doi:10.5281/zenodo.1"],
            &["", "a.org", "https://", "https://a b", "1x:y"],
        );
        check(
            is_date,
            &["2025-05-21", "2024-02-29", "2000-02-29"],
            &[
                "2025-02-29",
                "1900-02-29",
                "2025-13-01",
                "2025-00-01",
                "2025-04-31",
                "21.5.2025",
                "2025-5-21",
                "2025-05-2é",
            ],
        );
    }
}
