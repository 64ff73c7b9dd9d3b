//! The table as a page of the documentation.

use super::{CaseVerdict, StressRow, summary_line};
use crate::cli::machine;
use gs2e_lab::stress::StressArea;
use std::io::{self, Write};

/// Writes the page.
pub(super) fn write_page(rows: &[StressRow], out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "# Numerics at their extremes\n")?;
    writeln!(
        out,
        "`gs2e stress` compares the result of each case with an independent answer: a closed form, a series, a number \
         of 120 digits,\nor an equivalent input without extremes. This page is its output, written by \
         `gs2e stress --markdown crates/lab/results/stress.md`.\n"
    )?;
    writeln!(
        out,
        "A row shows the worst of its points and the limit there. `rel` is relative to the answer, `se` is in standard errors of a \
         count with\na fixed seed, `KS sqrt N` the Kolmogorov-Smirnov distance times the root of the sample size (2.23 is \
         alpha 1e-4), `values`\nand `events` count differences. Times are from one run, with {} cores.\n",
        machine::available_cores()
    )?;
    writeln!(out, "{}.", summary_line(rows))?;
    for area in StressArea::ALL {
        let rows: Vec<&StressRow> = rows.iter().filter(|row| row.area == area).collect();
        if rows.is_empty() {
            continue;
        }
        writeln!(out, "\n## {}\n", area.name())?;
        writeln!(out, "| case | regime | error | limit | unit | within | time |")?;
        writeln!(out, "|---|---|---|---|---|---|---|")?;
        rows.into_iter().try_for_each(|row| write_row(row, out))?;
    }
    Ok(())
}

fn write_row(row: &StressRow, out: &mut dyn Write) -> io::Result<()> {
    let by = row.backend.map(|backend| format!(", {backend}")).unwrap_or_default();
    let (case, regime, unit) = (row.case, escape_cell(row.regime), row.unit);
    let found = match &row.outcome {
        Err(why) => {
            return writeln!(out, "| {case}{by} | {regime} | | | | not run: {} | |", escape_cell(&why.0));
        }
        Ok(found) => found,
    };
    let within = if row.verdict() == CaseVerdict::Pass { "yes" } else { "**no**" };
    let (error, limit) = (two_digits(found.worst.error), two_digits(found.worst.limit));
    writeln!(out, "| {case}{by} | {regime} | {error} | {limit} | {unit} | {within} | {:.2} s |", row.seconds)
}

/// Formats a value with two digits, and zero as `0`.
fn two_digits(value: f64) -> String {
    if value == 0.0 { "0".to_owned() } else { format!("{value:.1e}") }
}

/// Escapes the characters that would end a table cell.
fn escape_cell(text: &str) -> String {
    text.replace('|', "\\|").replace('\n', " ")
}
