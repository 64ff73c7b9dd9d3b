//! Fixed text formats: versions, addresses, days.

use super::field::Field;
use super::problem::{FieldProblem, quote_text};
use super::resolve::Resolver;
use gs2e_files::escape::is_hidden;

/// A text format.
#[derive(Debug, Clone, Copy)]
pub(super) struct TextForm {
    holds: fn(&str) -> bool,
    /// Description, to follow "wanted".
    wanted: &'static str,
}

/// A version.
pub(super) const VERSION: TextForm = TextForm { holds: is_version, wanted: "a version such as 1.2.0" };
/// An address.
pub(super) const URL: TextForm =
    TextForm { holds: is_url, wanted: "an address (http, https or doi) such as https://example.org/data" };
/// A day.
pub(super) const DAY: TextForm = TextForm { holds: is_date, wanted: "a day such as 2025-05-21" };

impl TextForm {
    /// Returns true if a text has this format.
    pub(super) fn holds(self, text: &str) -> bool {
        (self.holds)(text)
    }
}

impl Resolver<'_> {
    /// Returns a text in this format, if one is present.
    pub(super) fn formed(&self, field: &Field<String>, form: TextForm) -> Option<Option<String>> {
        let Some((text, place)) = field.given() else { return field.is_absent().then_some(None) };
        if form.holds(text) {
            return Some(Some(text.clone()));
        }
        self.refuse(
            FieldProblem::of_field(format!("is {}, wanted {}", quote_text(text), form.wanted)).at(place),
        )
    }
}

/// Checks a semantic version (semver.org 2.0.0). In the identifiers after `-` and `+`, only the
/// characters are checked.
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

/// Returns true for an address that leads to text and not to a program. It has no character that
/// would end it where pages show it (RFC 3986, appendix A: of ASCII, only these characters may
/// occur in an address).
fn is_url(text: &str) -> bool {
    let leads = match text.split_once(':') {
        // A host must follow. The bracket begins an IPv6 address.
        Some(("http" | "https", rest)) => rest
            .strip_prefix("//")
            .is_some_and(|rest| rest.starts_with(|c: char| c.is_alphanumeric() || c == '[')),
        Some(("doi", rest)) => rest.starts_with("10."),
        _ => false,
    };
    let lawful = |c: char| match c {
        c if c.is_ascii() => c.is_ascii_alphanumeric() || "-._~:/?#[]@!$&'()*+,;=%".contains(c),
        c => !c.is_whitespace() && !is_hidden(c),
    };
    leads && text.chars().all(lawful)
}

/// Checks a day of the Gregorian calendar.
fn is_date(text: &str) -> bool {
    let shape = text.len() == 10
        && text
            .bytes()
            .enumerate()
            .all(|(i, b)| if i == 4 || i == 7 { b == b'-' } else { b.is_ascii_digit() });
    if !shape {
        return false;
    }
    // All ten bytes are ASCII here, so the slices lie at borders of characters.
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
    fn versions_addresses_and_days_are_told_from_others() {
        check(
            is_version,
            &["0.0.0", "1.2.3", "10.0.1-rc.1+build"],
            &["", "1", "1.2", "1.2.3.4", "v1.2.3", "01.2.3", "1.2.3-"],
        );
        check(
            is_url,
            &["https://a.org", "http://[::1]:80/x?y=1#z", "https://例え.jp/é", "doi:10.5281/zenodo.1"],
            &[
                "",
                "a.org",
                "https://",
                "https:///x",
                "https://a b",
                "https://a\u{202e}b",
                "https://a>b",
                "https://a|b",
                "1x:y",
                "javascript:alert(1)",
                "data:text/html,x",
                "file:///etc/passwd",
                "doi:x",
            ],
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
