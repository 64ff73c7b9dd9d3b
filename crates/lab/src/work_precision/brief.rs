//! A study in brief: the cost of a given error under each rule set, and the lowest error of each.
//! Markdown.

use super::pick::{CostPlace, ErrorMeasure};
use super::report::{at_most, short_number};
use super::{SettingRow, StudyResult};
use std::fmt::Write as _;

/// Measures of the short table.
const LISTED: [ErrorMeasure; 4] =
    [ErrorMeasure::Rms, ErrorMeasure::Count, ErrorMeasure::Miscount, ErrorMeasure::Median];
/// Measures for which the lowest error is shown. A difference of counts may pass through 0 by
/// chance.
const LOWEST: [ErrorMeasure; 2] = [ErrorMeasure::Rms, ErrorMeasure::Median];

/// The cheapest method of each rule set at the errors of the reference setting.
pub(super) fn write_cheapest(out: &mut String, study: &StudyResult, base: &SettingRow) {
    let _ = writeln!(
        out,
        "## The cheapest at the errors of `{}`, {} frames a second\n\nEach rule set is compared with its own limit.\n\n\
         | {}: error | of that setting | method | frames | core-seconds | times fewer |\n|---|---|---|---|---|---|\n\
         | | | `{}` itself | {} | {} | 1 |",
        base.method(),
        base.rate,
        study.machine(),
        base.method(),
        base.frames,
        short_number(base.core_s())
    );
    for pick in study.picks().iter().filter(|pick| LISTED.contains(&pick.measure)) {
        let (mut title, mut error) = (pick.measure.title(), short_number(pick.error));
        for of in &study.rules {
            let Some(offer) = pick.offers.iter().find(|offer| offer.rules == of.rules) else { continue };
            let _ = write!(out, "| {title} | {error} | ");
            let _ = match offer.place {
                Some(place) => writeln!(out, "{}", taken_words(&offer.method, place, pick.base_core_s)),
                None => writeln!(out, "`{}` does not reach it | | | |", of.rules),
            };
            // Only the first row of a measure has its title.
            (title, error) = ("", String::new());
        }
    }
    out.push('\n');
}

fn taken_words(method: &str, place: CostPlace, base_core_s: f64) -> String {
    let (frames, core_s) = (place.frames.round(), short_number(place.core_s));
    format!("`{method}` | {}{frames} | {core_s} | {:.2} |", at_most(&place), base_core_s / place.core_s)
}

/// The lowest errors of each rule set at these rates, and their cost.
pub(super) fn write_lowest(out: &mut String, study: &StudyResult) {
    let _ = writeln!(
        out,
        "## The lowest errors\n\nEach rule set at these rates, compared with its own limit.\n\n| {}: error | lowest | setting | \
         frames | core-seconds |\n|---|---|---|---|---|",
        study.machine()
    );
    for measure in LOWEST {
        let mut title = measure.title();
        for of in &study.rules {
            let Some((row, error)) = lowest_of(study, &of.rules, measure) else { continue };
            let _ = writeln!(
                out,
                "| {title} | {} | `{}`, {} frames a second | {} | {} |",
                short_number(error),
                row.method(),
                row.rate,
                row.frames,
                short_number(row.core_s())
            );
            title = "";
        }
    }
    out.push('\n');
}

/// The row of a rule set with the lowest error; among equals, the cheapest.
fn lowest_of<'a>(
    study: &'a StudyResult,
    rules: &str,
    measure: ErrorMeasure,
) -> Option<(&'a SettingRow, f64)> {
    let rows = study.rows.iter().filter(|row| row.rules == rules);
    let known = rows.filter_map(|row| Some((row, measure.of(row)?)));
    known.min_by(|(a, x), (b, y)| x.total_cmp(y).then(a.core_s().total_cmp(&b.core_s())))
}
