//! Findings of checks: counts of verdicts, and tables of statements with faults first.

use gs2e_check::{Finding, Verdict};
use gs2e_files::html::HtmlFragment;
use gs2e_trajectory::picture::short_number;

/// The verdicts, the worst first.
pub(super) const WORST_FIRST: [Verdict; 5] =
    [Verdict::Fail, Verdict::Warn, Verdict::Waived, Verdict::NotRun, Verdict::Pass];

/// Rank of a verdict in [`WORST_FIRST`].
pub(super) fn verdict_rank(verdict: Verdict) -> usize {
    WORST_FIRST.iter().position(|other| *other == verdict).unwrap_or(WORST_FIRST.len())
}

/// Returns true if something was found to be outside its limits.
pub(super) fn is_fault(verdict: Verdict) -> bool {
    matches!(verdict, Verdict::Fail | Verdict::Warn | Verdict::Waived)
}

/// The worst verdict.
pub(super) fn worst_verdict<'a>(findings: impl IntoIterator<Item = &'a Finding>) -> Option<Verdict> {
    findings.into_iter().map(|finding| finding.verdict).min_by_key(|verdict| verdict_rank(*verdict))
}

/// Number of statements with each verdict, the worst first.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub(super) struct VerdictCount([usize; 5]);

impl VerdictCount {
    pub(super) fn from_findings<'a>(findings: impl IntoIterator<Item = &'a Finding>) -> Self {
        let mut count = Self::default();
        findings.into_iter().for_each(|finding| count.0[verdict_rank(finding.verdict)] += 1);
        count
    }

    pub(super) fn get(self, verdict: Verdict) -> usize {
        self.0[verdict_rank(verdict)]
    }

    fn total(self) -> usize {
        self.0.iter().sum()
    }

    fn present(self) -> impl Iterator<Item = (Verdict, usize)> {
        WORST_FIRST.into_iter().zip(self.0).filter(|(_, count)| *count > 0)
    }

    /// In words: `1 warn, 2 not-run, 23 pass`.
    pub(super) fn words(self) -> String {
        let words: Vec<String> =
            self.present().map(|(verdict, count)| format!("{count} {}", verdict.name())).collect();
        if words.is_empty() { "no findings".to_owned() } else { words.join(", ") }
    }

    /// Width of each part of a bar of 1000, as long as its count, but wide enough to be seen.
    fn widths(self) -> Vec<(Verdict, usize)> {
        const MIN_WIDTH: usize = 8;
        let total = self.total().max(1);
        let mut widths: Vec<(Verdict, usize)> =
            self.present().map(|(verdict, count)| (verdict, (1000 * count / total).max(MIN_WIDTH))).collect();
        // The widest part gives what the rare ones take, and takes what rounding leaves.
        let others: usize = widths.iter().map(|(_, width)| width).sum();
        if let Some((_, widest)) = widths.iter_mut().max_by_key(|(_, width)| *width) {
            *widest = 1000 + *widest - others;
        }
        widths
    }

    /// A bar whose parts are as long as their counts, with the worst verdict at the left.
    pub(super) fn bar(self, html: &mut HtmlFragment) {
        let words = self.words();
        let attributes =
            [("class", "bar"), ("viewBox", "0 0 1000 10"), ("preserveAspectRatio", "none"), ("role", "img")];
        html.within("svg", &[attributes.as_slice(), &[("aria-label", &words)]].concat(), |html| {
            let mut left = 0;
            for (verdict, width) in self.widths() {
                let [x, drawn] = [left, width].map(|n: usize| n.to_string());
                html.empty(
                    "rect",
                    &[("class", verdict_class(verdict)), ("x", &x), ("width", &drawn), ("height", "10")],
                );
                left += width;
            }
        });
    }

    /// Each verdict with its count.
    pub(super) fn badges(self, html: &mut HtmlFragment) {
        for (verdict, count) in self.present() {
            write_badge(html, verdict, &format!("{count} {}", verdict.name()));
        }
    }
}

/// The class that colours a verdict.
pub(super) fn verdict_class(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Pass => "pass",
        Verdict::Warn => "warn",
        Verdict::Fail => "fail",
        Verdict::Waived => "waived",
        Verdict::NotRun => "notrun",
    }
}

pub(super) fn write_badge(html: &mut HtmlFragment, verdict: Verdict, words: &str) {
    html.leaf("span", &[("class", &format!("badge {}", verdict_class(verdict)))], words);
}

/// Writes a table of statements, faults first and otherwise in the order of the reports. Subjects
/// are shown without `prefix`.
pub(super) fn write_table<'a>(
    html: &mut HtmlFragment,
    prefix: &str,
    findings: impl IntoIterator<Item = &'a Finding>,
) {
    let mut findings: Vec<&Finding> = findings.into_iter().collect();
    // A stable sort, so statements with one verdict keep their order.
    findings.sort_by_key(|finding| verdict_rank(finding.verdict));
    html.table("findings", |html| {
        write_heads(
            html,
            &[
                ("check", ""),
                ("sensor or part", ""),
                ("verdict", ""),
                ("measured", "n"),
                ("limit", "n"),
                ("unit", ""),
                ("detects", "n"),
                ("explanation", ""),
            ],
        );
        html.within("tbody", &[], |html| {
            findings.iter().for_each(|finding| write_row(html, finding, prefix))
        });
    });
}

/// Writes the same statements with one line each, which a browser shows sooner if there are
/// thousands.
pub(super) fn write_list<'a>(
    html: &mut HtmlFragment,
    prefix: &str,
    findings: impl IntoIterator<Item = &'a Finding>,
) {
    let mut findings: Vec<&Finding> = findings.into_iter().collect();
    findings.sort_by_key(|finding| verdict_rank(finding.verdict));
    html.within("ul", &[("class", "listed")], |html| {
        for finding in findings {
            let number = |name: &str, value: Option<f64>| {
                value.map_or_else(String::new, |v| {
                    format!(", {name} {} {}", short_number(v), unit_text(finding))
                })
            };
            let mut of = finding.subject.text_without(prefix);
            if !of.is_empty() {
                of.insert(0, ' ');
            }
            let words = format!(
                "{}: {}{of}{}{}: {}",
                finding.verdict.name(),
                finding.check,
                number("measured", finding.measured).trim_end(),
                number("limit", finding.limit).trim_end(),
                finding.because
            );
            html.prose_leaf("li", &[("class", verdict_class(finding.verdict))], &words);
        }
    });
}

/// The smallest fault that would have been found; empty if the pass states none.
fn detects_text(finding: &Finding) -> String {
    finding.detects.as_ref().map_or_else(String::new, |fault| {
        let unit = if fault.unit == "1" { "" } else { &fault.unit };
        format!("{} {unit}", short_number(fault.size)).trim_end().to_owned()
    })
}

/// The unit; empty for pure numbers.
fn unit_text(finding: &Finding) -> &str {
    if finding.unit == "1" { "" } else { &finding.unit }
}

/// The head of a table: each column's name and class.
pub(super) fn write_heads(html: &mut HtmlFragment, columns: &[(&str, &str)]) {
    html.within("thead", &[], |html| {
        html.within("tr", &[], |html| {
            for (name, class) in columns {
                html.leaf("th", &[("scope", "col"), ("class", class)], name);
            }
        });
    });
}

fn write_row(html: &mut HtmlFragment, finding: &Finding, prefix: &str) {
    let number = |value: Option<f64>| value.map_or_else(|| "\u{2013}".to_owned(), short_number);
    html.within("tr", &[], |html| {
        html.leaf("th", &[("scope", "row")], &finding.check);
        html.leaf("td", &[], &finding.subject.text_without(prefix));
        html.within("td", &[], |html| write_badge(html, finding.verdict, finding.verdict.name()));
        html.leaf("td", &[("class", "n")], &number(finding.measured));
        html.leaf("td", &[("class", "n")], &number(finding.limit));
        html.leaf("td", &[], unit_text(finding));
        html.leaf("td", &[("class", "n")], &detects_text(finding));
        html.prose_leaf("td", &[], &finding.because);
    });
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in super::super) fn finding(check: &str, subject: &str, verdict: Verdict) -> Finding {
        Finding {
            check: check.to_owned(),
            subject: subject.to_owned().into(),
            verdict,
            measured: Some(0.25),
            limit: None,
            unit: "1".to_owned(),
            because: "a reason".to_owned(),
            detects: None,
        }
    }

    #[test]
    fn faults_come_first_and_order_stays() {
        let findings = [
            finding("schema", "s/t", Verdict::Pass),
            finding("stamps", "s/t#order", Verdict::NotRun),
            finding("speed", "s/t#arc", Verdict::Warn),
            finding("speed", "s/t#chord", Verdict::Warn),
            finding("polarity", "s/t/fine", Verdict::Waived),
        ];
        let mut html = HtmlFragment::default();
        write_table(&mut html, "s/t", &findings);
        let page = HtmlFragment::whole_page(|page| page.append(&html));
        let place = |words: &str| page.find(words).unwrap_or_else(|| panic!("{words} in {page}"));
        let order = ["<td>arc", "<td>chord", "<td>fine", "<td>order", ">schema<"].map(place);
        assert!(order.is_sorted(), "{page}");
        let mut html = HtmlFragment::default();
        write_list(&mut html, "s/t", &findings[2..]);
        let page = HtmlFragment::whole_page(|page| page.append(&html));
        let [first, last] = ["warn: speed arc, measured 0.25: a reason<", "waived: polarity fine,"];
        assert!(page.find(first) < page.find(last) && page.contains(first), "{page}");
        assert_eq!(worst_verdict(&findings), Some(Verdict::Warn));
        assert_eq!(VerdictCount::from_findings(&findings).words(), "2 warn, 1 waived, 1 not-run, 1 pass");
        assert_eq!(VerdictCount::default().words(), "no findings");
    }

    #[test]
    fn the_rarest_fault_is_seen() {
        let mut findings = vec![finding("speed", "", Verdict::Warn)];
        findings.resize(5000, finding("schema", "", Verdict::Pass));
        let mut html = HtmlFragment::default();
        VerdictCount::from_findings(&findings).bar(&mut html);
        let page = HtmlFragment::whole_page(|page| page.append(&html));
        assert!(page.contains("class=\"warn\" x=\"0\" width=\"8\""), "{page}");
    }
}
