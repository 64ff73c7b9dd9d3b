//! The table of checks, the faults, and the statements that did not run.

use crate::report::findings::{VerdictCount, write_badge, write_heads};
use crate::report::section::{counted_noun, section_link, thousands_number};
use crate::report::{ReportPage, findings};
use gs2e_check as check;
use gs2e_check::{Finding, FindingSubject, Verdict};
use gs2e_files::html::HtmlFragment;
use std::collections::{BTreeMap, BTreeSet};

/// Maximum number of faults that are listed at the top of the page.
const MAX_FAULTS: usize = 200;

/// Maximum number of reasons that are listed of a check that was not run.
const MAX_REASONS: usize = 6;

/// Writes the counts of statements by check, and every fault.
pub(in crate::report) fn write_checks(html: &mut HtmlFragment, page: &ReportPage<'_>) {
    html.within("section", &[("id", "checks")], |html| {
        html.leaf("h2", &[], "Checks");
        html.leaf("p", &[], VERDICTS);
        html.table("by-check", |html| {
            html.leaf("caption", &[], "Verdicts by check");
            write_heads(html, &[("check", ""), ("share of verdicts", ""), ("number of verdicts", "")]);
            let count =
                |name| VerdictCount::from_findings(page.findings().filter(|finding| finding.check == name));
            html.within("tbody", &[], |html| {
                let counts = check::NAMES.into_iter().map(|name| (name, count(name)));
                counts
                    .filter(|(_, count)| *count != VerdictCount::default())
                    .for_each(|(name, count)| by_check(html, name, count));
            });
        });
        write_faults(html, page);
    });
}

const VERDICTS: &str = "pass: within the limits. warn: outside a limit that does not stop a release. waived: failed, and \
    accepted by the recipe for a stated reason. not-run: could not be judged; the reason is below. A scene with a \
    failed check is not in the release.";

fn by_check(html: &mut HtmlFragment, name: &str, count: VerdictCount) {
    html.within("tr", &[], |html| {
        html.leaf("th", &[("scope", "row")], name);
        html.within("td", &[("class", "verdicts")], |html| count.bar(html));
        html.leaf("td", &[], &count.words());
    });
}

fn write_faults(html: &mut HtmlFragment, page: &ReportPage<'_>) {
    let mut faults: Vec<(&str, &Finding)> = page
        .entries
        .iter()
        .flat_map(|entry| entry.scene.all_findings().map(|finding| (entry.id(), finding)))
        .filter(|(_, finding)| findings::is_fault(finding.verdict))
        .collect();
    faults.sort_by_key(|(_, finding)| findings::verdict_rank(finding.verdict));
    if faults.is_empty() {
        html.leaf("p", &[], "No finding is outside its limits.");
        return;
    }
    let words = match faults.len() {
        n if n > MAX_FAULTS => format!("Outside limits: the first {MAX_FAULTS} of {n} statements"),
        n => format!("Outside the limits: {}", counted_noun(n, "finding", "findings")),
    };
    html.table("faults", |html| {
        html.leaf("caption", &[], &words);
        write_heads(
            html,
            &[
                ("scene", ""),
                ("trajectory, sensor or part", ""),
                ("check", ""),
                ("verdict", ""),
                ("explanation", ""),
            ],
        );
        html.within("tbody", &[], |html| {
            for (id, finding) in faults.into_iter().take(MAX_FAULTS) {
                html.within("tr", &[], |html| {
                    html.within("td", &[], |html| section_link(html, id, id));
                    html.leaf("td", &[], &finding.subject.text_without(id));
                    html.leaf("td", &[], &finding.check);
                    html.within("td", &[], |html| write_badge(html, finding.verdict, finding.verdict.name()));
                    html.prose_leaf("td", &[], &finding.because);
                });
            }
        });
    });
}

/// Writes the statements that could not be judged, by check and reason.
pub(in crate::report) fn not_run(html: &mut HtmlFragment, page: &ReportPage<'_>) {
    let reasons = not_run_reasons(page.findings());
    let silent: BTreeSet<&str> = page.findings().map(|finding| finding.check.as_str()).collect();
    let silent: Vec<&str> = check::NAMES.into_iter().filter(|name| !silent.contains(name)).collect();
    html.within("section", &[("id", "not-run")], |html| {
        html.leaf("h2", &[], "Checks that did not run");
        if reasons.is_empty() {
            html.leaf("p", &[], "Every check that the recipes ask for was run.");
        } else {
            html.table("reasons", |html| {
                let columns = [("check", ""), ("how often", "n"), ("reason", ""), ("first case", "")];
                write_heads(html, &columns);
                html.within("tbody", &[], |html| reasons.iter().for_each(|reason| reason_row(html, reason)));
            });
        }
        if !silent.is_empty() {
            let words = format!(
                "These checks have no verdict in this release: they do not exist yet, or nothing here needs them: {}.",
                silent.join(", ")
            );
            html.leaf("p", &[], &words);
        }
    });
}

/// Statements that were not run for one reason.
#[derive(Debug, PartialEq, Eq)]
struct NotRunReason<'a> {
    check: &'a str,
    statements: usize,
    because: String,
    first: &'a FindingSubject,
}

/// The reasons of each check in the order of names, the most frequent first. Those past the first
/// few are put together.
fn not_run_reasons<'a>(findings: impl Iterator<Item = &'a Finding>) -> Vec<NotRunReason<'a>> {
    let mut counted: BTreeMap<(&str, &str), (usize, &FindingSubject)> = BTreeMap::new();
    for finding in findings.filter(|finding| finding.verdict == Verdict::NotRun) {
        let own = counted.entry((&finding.check, &finding.because)).or_insert((0, &finding.subject));
        own.0 += 1;
    }
    let mut all = Vec::new();
    let checks: BTreeSet<&str> = counted.keys().map(|(check, _)| *check).collect();
    for check in checks {
        let of = counted.iter().filter(|((name, _), _)| *name == check);
        let mut own: Vec<NotRunReason<'_>> = of
            .map(|((_, because), (statements, first))| NotRunReason {
                check,
                statements: *statements,
                because: (*because).to_owned(),
                first,
            })
            .collect();
        // Equal counts keep the order of their texts, so that equal findings make equal pages.
        own.sort_by_key(|reason| std::cmp::Reverse(reason.statements));
        let rest = own.split_off(own.len().min(MAX_REASONS));
        all.extend(own);
        if let Some(first) = rest.first().map(|reason| reason.first) {
            let statements = rest.iter().map(|reason| reason.statements).sum();
            let because = format!("{} other reasons, each in checks.json", rest.len());
            all.push(NotRunReason { check, statements, because, first });
        }
    }
    all
}

fn reason_row(html: &mut HtmlFragment, reason: &NotRunReason<'_>) {
    html.within("tr", &[], |html| {
        html.leaf("th", &[("scope", "row")], reason.check);
        html.leaf("td", &[("class", "n")], &thousands_number(reason.statements as u64));
        html.prose_leaf("td", &[], &reason.because);
        html.leaf("td", &[], &reason.first.to_string());
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::findings::tests::finding;

    #[test]
    fn reasons_are_counted_and_the_long_tail_is_put_together() {
        let mut findings: Vec<Finding> = (0..9)
            .map(|k| Finding {
                because: format!("reason {k}"),
                ..finding("speed", &format!("s{k}/t"), Verdict::NotRun)
            })
            .collect();
        findings.push(Finding { because: "reason 7".into(), ..finding("speed", "s9/t", Verdict::NotRun) });
        findings.push(finding("batching", "s/t", Verdict::NotRun));
        findings.push(finding("batching", "s/t", Verdict::Pass));
        let reasons = not_run_reasons(findings.iter());
        assert_eq!(reasons.len(), 1 + MAX_REASONS + 1);
        assert_eq!((reasons[0].check, reasons[0].statements), ("batching", 1));
        let second = &reasons[1];
        assert_eq!(
            (second.statements, second.because.as_str(), second.first.place.as_str()),
            (2, "reason 7", "s7/t")
        );
        let last = reasons.last().unwrap();
        assert_eq!((last.statements, last.because.as_str()), (3, "3 other reasons, each in checks.json"));
    }
}
