//! The release as a whole: its contents, the table of scenes, findings, checks that did not run,
//! absences, and skipped work.

use super::ReportPage;
use super::findings::{self, VerdictCount, write_badge, write_heads};
use super::html::HtmlFragment;
use super::section::{
    self, SceneSection, counted_noun, file_link, number_span, on_share, section_link, thousands_number,
};
use crate::check::{self, Finding, FindingSubject, Verdict};
use crate::release::TOOL;
use crate::release::left_out::OmissionRow;
use crate::release::products::{self, ReleaseProduct};
use std::collections::{BTreeMap, BTreeSet};

/// Maximum number of faults that are listed at the top of the page.
const MAX_FAULTS: usize = 200;
/// Maximum number of reasons that are listed of a check that was not run.
const MAX_REASONS: usize = 6;

/// Writes the head of the page: the publisher, the terms, and the amounts.
pub(super) fn write_head(html: &mut HtmlFragment, page: &ReportPage<'_>) {
    let info = page.info;
    html.within("header", &[], |html| {
        html.within("h1", &[], |html| {
            html.text(&info.name);
            html.leaf("span", &[("class", "version")], &format!(" {}", info.version));
        });
        if !info.description.is_empty() {
            html.prose_leaf("p", &[], &info.description);
        }
        html.within("p", &[], |html| {
            html.text("Licence of the release: ");
            html.leaf("code", &[], &page.licence.expression);
            html.text(&format!(". Creator: {}. Written by {TOOL}.", info.creator));
        });
        write_figures(html, page);
        html.within("nav", &[("aria-label", "Sections")], |html| {
            for (anchor, name) in SECTIONS {
                html.leaf("a", &[("href", anchor)], name);
                html.text(" ");
            }
        });
    });
}

const SECTIONS: [(&str, &str); 7] = [
    ("#each", "Pictures"),
    ("#scenes", "Scenes"),
    ("#checks", "Checks"),
    ("#not-run", "Checks that did not run"),
    ("#absent", "What is not here"),
    ("#files", "Files and terms"),
    ("#skipped", "Skipped work"),
];

/// Writes the amounts in large figures.
fn write_figures(html: &mut HtmlFragment, page: &ReportPage<'_>) {
    let parts = || page.entries.iter().flat_map(|entry| &entry.scene.file.trajectories);
    let streams = || page.entries.iter().flat_map(section::SceneEntry::counted);
    let sum = |values: &mut dyn Iterator<Item = u64>| thousands_number(values.sum());
    let frames = |product: &ReleaseProduct| {
        let paths = page.entries.iter().flat_map(|entry| entry.below(""));
        thousands_number(paths.filter(|path| product.owns(path)).count() as u64)
    };
    let seconds = parts().map(|part| part.duration_us as f64 * 1e-6).sum::<f64>();
    let figures = [
        (
            thousands_number(page.entries.len() as u64),
            if page.entries.len() == 1 { "scene" } else { "scenes" },
        ),
        (
            thousands_number(page.trajectories() as u64),
            if page.trajectories() == 1 { "trajectory" } else { "trajectories" },
        ),
        (sum(&mut parts().map(|part| part.poses as u64)), "poses"),
        (frames(&products::SHARP), products::SHARP.noun),
        (frames(&products::BLUR), products::BLUR.noun),
        (sum(&mut streams().filter_map(|counted| counted.events)), "events"),
        (crate::trajectory::picture::short_number(seconds), "s of motion"),
        (number_span(streams().filter_map(|counted| counted.rate_ev_px_s)), "events/px/s"),
        (number_span(streams().filter_map(on_share)), "share of ON events"),
    ];
    html.within("ul", &[("class", "figures-row")], |html| {
        for (figure, what) in
            figures.into_iter().filter(|(figure, what)| *what != products::BLUR.noun || figure != "0")
        {
            html.within("li", &[], |html| {
                html.leaf("strong", &[], &figure);
                html.text(&format!(" {what}"));
            });
        }
    });
    let count = VerdictCount::from_findings(page.findings());
    html.within("div", &[("class", "verdict-line")], |html| {
        count.bar(html);
        html.within("p", &[], |html| {
            html.text("Verdicts of checks: ");
            count.badges(html);
        });
    });
}

/// Writes the table of scenes.
pub(super) fn write_scenes(html: &mut HtmlFragment, page: &ReportPage<'_>, parts: &[SceneSection]) {
    html.within("section", &[("id", "scenes")], |html| {
        html.leaf("h2", &[], "Scenes");
        if let Some(words) = page.detail.left_out(page.trajectories()) {
            html.leaf("p", &[("class", "note")], &words);
        }
        write_filters(html, page);
        html.table("scenes", |html| {
            html.leaf(
                "caption",
                &[],
                "Rates and shares are ranges over the trajectories and sensors of a scene.",
            );
            write_heads(html, &COLUMNS);
            html.within("tbody", &[], |html| parts.iter().for_each(|part| html.append(&part.row)));
        });
    });
}

const COLUMNS: [(&str, &str); 11] = [
    ("frame", ""),
    ("scene", ""),
    ("source", ""),
    ("licence", ""),
    ("trajectories", "n"),
    ("poses", "n"),
    ("frames", "n"),
    ("events", "n"),
    ("events/px/s", "n"),
    ("ON share", "n"),
    ("checks", ""),
];

/// Writes the choice of rows, which works by the style sheet alone. The table comes after these
/// inputs in one parent, so that a checked input selects its rows. (`:has()` would do as well, but
/// a browser would look again at each of thousands of rows.)
fn write_filters(html: &mut HtmlFragment, page: &ReportPage<'_>) {
    let with = |verdict| page.entries.iter().filter(|entry| entry.count().get(verdict) > 0).count();
    let kinds = [
        ("warn", "with a warning", with(Verdict::Warn)),
        ("waived", "with a waiver", with(Verdict::Waived)),
        ("notrun", "with a check that did not run", with(Verdict::NotRun)),
        ("withheld", "withheld", page.entries.iter().filter(|entry| entry.is_withheld()).count()),
    ];
    let kinds: Vec<_> = kinds.into_iter().filter(|(.., count)| *count > 0).collect();
    // With `all` alone there is no choice.
    if kinds.is_empty() {
        return;
    }
    let choices = [("all", "all", page.entries.len())].into_iter().chain(kinds);
    html.leaf("span", &[("class", "show")], "Show: ");
    for (kind, words, count) in choices {
        let id = format!("show-{kind}");
        let own = [("class", "show"), ("type", "radio"), ("name", "show"), ("id", id.as_str())];
        let checked: &[(&str, &str)] = if kind == "all" { &[("checked", "")] } else { &[] };
        html.empty("input", &[&own, checked].concat());
        html.leaf("label", &[("class", "show"), ("for", &id)], &format!("{words} ({count})"));
    }
}

/// Writes the counts of statements by check, and every fault.
pub(super) fn write_checks(html: &mut HtmlFragment, page: &ReportPage<'_>) {
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
                    .for_each(|of| by_check(html, of));
            });
        });
        write_faults(html, page);
    });
}

const VERDICTS: &str = "pass: within the limits. warn: outside a limit that does not stop a release. waived: failed, and \
    accepted by the recipe for a stated reason. not-run: could not be judged; the reason is below. A release with a failed \
    check is not written.";

fn by_check(html: &mut HtmlFragment, (name, count): (&str, VerdictCount)) {
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
pub(super) fn not_run(html: &mut HtmlFragment, page: &ReportPage<'_>) {
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

/// Writes the contents that the release lacks.
pub(super) fn write_absences(html: &mut HtmlFragment, page: &ReportPage<'_>) {
    html.within("section", &[("id", "absent")], |html| {
        html.leaf("h2", &[], "What is not here");
        html.within("ul", &[], |html| {
            absence_sentences(page).iter().for_each(|words| html.leaf("li", &[], words));
        });
    });
}

/// Writes the work that was skipped.
pub(super) fn write_skipped(html: &mut HtmlFragment, page: &ReportPage<'_>) {
    html.within("section", &[("id", "skipped")], |html| {
        html.leaf("h2", &[], "Skipped work");
        let rows = page.entries.iter().flat_map(|entry| &entry.scene.trajectories).flat_map(|t| &t.left_out);
        let sums = omission_sums(rows);
        if sums.is_empty() {
            html.leaf("p", &[], "No work was skipped.");
            return;
        }
        html.leaf("p", &[], SKIPPED);
        html.table("left-out", |html| {
            let columns = [
                ("step", ""),
                ("skipped work", ""),
                ("amount", "n"),
                ("out of", "n"),
                ("share", "n"),
                ("unit", ""),
                ("effect on the release", ""),
            ];
            write_heads(html, &columns);
            html.within("tbody", &[], |html| sums.iter().for_each(|sum| sum_row(html, sum)));
        });
    });
}

const SKIPPED: &str = "The program skips work that the result does not need. \"Identical bytes\" means that not a bit of the \
    release would differ with it; the other rows state their effect. Amounts are sums over all trajectories.";

/// Contents that the release lacks, one sentence each: withheld scenes, photos, events that no
/// recipe asks for. Any other reason for an absence belongs here too.
fn absence_sentences(page: &ReportPage<'_>) -> Vec<String> {
    let withheld: Vec<&str> =
        page.entries.iter().filter(|entry| entry.is_withheld()).map(section::SceneEntry::id).collect();
    let images = page.entries.iter().flat_map(|entry| &entry.scene.file.images);
    let [unused, photos] = images.fold([0u64; 2], |[unused, all], i| [unused + u64::from(!i.used), all + 1]);
    let silent = page.entries.iter().filter(|entry| entry.counted().next().is_none()).count();
    let mut sentences = vec![match withheld.len() {
        0 => "No scene lacks its pictures and events because of its licence.".to_owned(),
        n => format!(
            "Pictures and events of {} are withheld, because the upstream terms forbid redistribution; recipe, poses and \
             reports are included.",
            counted_noun(n, "scene", "scenes")
        ),
    }];
    if page.taken_down > 0 {
        sentences.push(format!(
            "{} on the takedown list {} not in the release.",
            counted_noun(page.taken_down, "scene", "scenes"),
            if page.taken_down == 1 { "is" } else { "are" }
        ));
    }
    if photos > 0 {
        sentences.push(format!(
            "The release contains no photos at their own size; {} of {} source photos were not used.",
            thousands_number(unused),
            thousands_number(photos)
        ));
    }
    if silent > 0 {
        sentences.push(format!(
            "Without events, because the recipes do not request them: {}.",
            counted_noun(silent, "scene", "scenes")
        ));
    }
    sentences
}

/// Sums equal rows over all trajectories. The whole is unknown if one row does not know it.
fn omission_sums<'a>(rows: impl Iterator<Item = &'a OmissionRow>) -> Vec<OmissionRow> {
    let mut sums: BTreeMap<(&str, &str, &str, &str), OmissionRow> = BTreeMap::new();
    for row in rows {
        let own = sums.entry((&row.step, &row.what, &row.unit, &row.proof));
        own.and_modify(|sum| {
            sum.how_much = sum.how_much.saturating_add(row.how_much);
            sum.of = sum.of.zip(row.of).map(|(a, b)| a.saturating_add(b));
        })
        .or_insert_with(|| row.clone());
    }
    sums.into_values().collect()
}

fn sum_row(html: &mut HtmlFragment, row: &OmissionRow) {
    let none = || "\u{2013}".to_owned();
    let share = row.of.filter(|of| *of > 0).map(|of| 100.0 * row.how_much as f64 / of as f64);
    html.within("tr", &[], |html| {
        html.leaf("td", &[], &row.step);
        html.prose_leaf("td", &[], &row.what);
        html.leaf("td", &[("class", "n")], &thousands_number(row.how_much));
        html.leaf("td", &[("class", "n")], &row.of.map_or_else(none, thousands_number));
        html.leaf("td", &[("class", "n")], &share.map_or_else(none, |share| format!("{share:.1} %")));
        html.leaf("td", &[], &row.unit);
        html.prose_leaf("td", &[], &row.proof);
    });
}

/// Writes the files at the top of the tree, and the terms.
pub(super) fn write_files(html: &mut HtmlFragment, page: &ReportPage<'_>) {
    html.within("section", &[("id", "files")], |html| {
        html.leaf("h2", &[], "Files and terms");
        html.within("p", &[("class", "files")], |html| {
            html.text("Top-level files: ");
            for (number, path) in page.top.iter().enumerate() {
                html.text(if number > 0 { ", " } else { "" });
                file_link(html, path, path);
            }
        });
        html.leaf("p", &[], READING);
        let gated = page.entries.iter().filter(|entry| entry.scene.file.licence.gated).count();
        if gated > 0 {
            let of = counted_noun(gated, "scene", "scenes");
            let words = format!("Gated: receivers must first accept the upstream terms of {of}.");
            html.leaf("p", &[], &words);
        }
        let holders: BTreeSet<&str> = page
            .entries
            .iter()
            .map(|entry| entry.scene.file.licence.attribution.as_str())
            .filter(|holder| !holder.is_empty())
            .collect();
        if !holders.is_empty() {
            html.leaf("p", &[], &format!("Holders: {}.", holders.into_iter().collect::<Vec<_>>().join("; ")));
        }
        if !page.info.cite_as.is_empty() {
            html.leaf("p", &[], &format!("Cite as: {}", page.info.cite_as));
        }
    });
}

const READING: &str = "Times are counted from the first pose of a trajectory; this page does not state when the release was \
    built. Pictures on this page are scaled down; full-size frames are in sharp/. Event pictures show a pixel in red where \
    it became brighter and in blue where it became darker.";

#[cfg(test)]
mod tests {
    use super::super::findings::tests::finding;
    use super::*;

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

    #[test]
    fn rows_are_summed_and_unknown_wholes_stay_unknown() {
        let row = |what: &str, how_much, of| OmissionRow {
            step: "events".into(),
            what: what.into(),
            how_much,
            of,
            unit: "pairs".into(),
            proof: "identical bytes".into(),
        };
        let rows = [row("a", 1, Some(4)), row("b", 2, None), row("a", 2, Some(6)), row("b", 3, Some(9))];
        assert_eq!(omission_sums(rows.iter()), [row("a", 3, Some(10)), row("b", 5, None)]);
    }
}
