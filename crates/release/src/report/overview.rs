//! The release as a whole: its contents, the table of scenes, findings, checks that did not run,
//! absences, and skipped work.

mod skipped;
mod verdicts;

pub(super) use skipped::{write_absences, write_skipped};

pub(super) use verdicts::{not_run, write_checks};

use super::ReportPage;
use super::findings::{VerdictCount, write_heads};
use super::section::{self, SceneSection, counted_noun, file_link, number_span, on_share, thousands_number};
use crate::products::ReleaseProduct;
use crate::{TOOL, products};
use gs2e_check::Verdict;
use gs2e_files::html::HtmlFragment;
use std::collections::BTreeSet;

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
        (gs2e_trajectory::picture::short_number(seconds), "s of motion"),
        (number_span(streams().filter_map(|counted| counted.rate_ev_px_s)), "events/px/s"),
        (number_span(streams().filter_map(on_share)), "share of ON events"),
    ];
    html.figures(figures.into_iter().filter(|(figure, what)| *what != products::BLUR.noun || figure != "0"));
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
