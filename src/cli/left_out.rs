//! The table of work that a build left out, for people: one table per rendered trajectory.

use super::Console;
use gs2e_release::left_out::OmissionRow;
use gs2e_sampling::rendered::TimeSaved;
use std::collections::BTreeMap;

/// Maximum number of tables printed. Few people read more.
const MAX_ROWS: usize = 8;

/// The work left out of one trajectory by the steps that were made.
#[derive(Debug, Default)]
pub(super) struct OmissionTable {
    pub(super) rows: Vec<OmissionRow>,
    pub(super) saving: Option<TimeSaved>,
}

/// Prints one table per trajectory. The keys are `scene/trajectory`.
pub(super) fn report_left_out(tables: &BTreeMap<String, OmissionTable>, console: &Console) {
    if tables.len() > MAX_ROWS {
        let trajectories = tables.len();
        console.note(&format!(
            "work skipped for {trajectories} trajectories: see --json, or manifest.json of a release"
        ));
        return;
    }
    for (name, table) in tables {
        table.to_lines(name).iter().for_each(|line| console.note(line));
    }
}

impl OmissionTable {
    fn to_lines(&self, name: &str) -> Vec<String> {
        if self.rows.is_empty() {
            return vec![format!("work skipped for {name}: none")];
        }
        let amounts: Vec<String> = self.rows.iter().map(share_words).collect();
        let width = |texts: &mut dyn Iterator<Item = &str>| texts.map(str::len).max().unwrap_or(0);
        let step = width(&mut self.rows.iter().map(|row| row.step.as_str()));
        let what = width(&mut self.rows.iter().map(|row| row.what.as_str()));
        let much = width(&mut amounts.iter().map(String::as_str));
        let line = |(row, amount): (&OmissionRow, &String)| {
            format!("  {:step$}  {:what$}  {amount:much$}  {}", row.step, row.what, row.proof)
        };
        let head = format!("work skipped for {name} (output is byte-identical unless noted)");
        let lines = self.rows.iter().zip(&amounts).map(line);
        std::iter::once(head).chain(lines).chain(self.saving.as_ref().map(saved_words)).collect()
    }
}

/// Formats `12.5 %, 25 of 200 pairs`, or the number alone.
fn share_words(row: &OmissionRow) -> String {
    match row.of {
        Some(of) if of > 0 => {
            let share = 100.0 * row.how_much as f64 / of as f64;
            format!("{share:5.1} %, {} of {of} {}", row.how_much, row.unit)
        }
        _ => format!("{} {}", row.how_much, row.unit),
    }
}

fn saved_words(saving: &TimeSaved) -> String {
    let TimeSaved { seconds, sampled, frames } = saving;
    format!(
        "  without skipping it, rendering the events' frames would take about {seconds:.1} s longer \
         (an estimate from {sampled} of {frames} frames)"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(what: &str, how_much: u64, of: Option<u64>) -> OmissionRow {
        let [step, what, unit, proof] = ["events", what, "pairs", "identical bytes"].map(str::to_owned);
        OmissionRow { step, what, how_much, of, unit, proof }
    }

    #[test]
    fn a_table_has_a_line_a_row_and_one_for_the_time() {
        let rows = vec![row("hidden", 25, Some(200)), row("unknown", 7, None)];
        let saving = Some(TimeSaved { seconds: 12.34, sampled: 3, frames: 1500 });
        let lines = OmissionTable { rows, saving }.to_lines("lab/base");
        assert_eq!(
            lines,
            [
                "work skipped for lab/base (output is byte-identical unless noted)",
                "  events  hidden    12.5 %, 25 of 200 pairs  identical bytes",
                "  events  unknown  7 pairs                   identical bytes",
                "  without skipping it, rendering the events' frames would take about 12.3 s longer (an estimate from 3 of \
                 1500 frames)",
            ]
        );
        assert_eq!(OmissionTable::default().to_lines("lab/base"), ["work skipped for lab/base: none"]);
    }
}
