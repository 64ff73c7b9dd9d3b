//! The outputs that are absent, and the work that was skipped.

use crate::left_out::OmissionRow;
use crate::report::findings::write_heads;
use crate::report::section::{counted_noun, thousands_number};
use crate::report::{ReportPage, section};
use gs2e_files::html::HtmlFragment;
use std::collections::BTreeMap;

/// Writes the contents that the release lacks.
pub(in crate::report) fn write_absences(html: &mut HtmlFragment, page: &ReportPage<'_>) {
    html.within("section", &[("id", "absent")], |html| {
        html.leaf("h2", &[], "What is not here");
        html.within("ul", &[], |html| {
            absence_sentences(page).iter().for_each(|words| html.leaf("li", &[], words));
        });
    });
}

/// Writes the work that was skipped.
pub(in crate::report) fn write_skipped(html: &mut HtmlFragment, page: &ReportPage<'_>) {
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
    sentences.extend(
        page.held_back
            .iter()
            .map(|scene| format!("The scene {} is held back: {}.", scene.id, scene.reasons().join("; "))),
    );
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

#[cfg(test)]
mod tests {
    use super::*;

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
