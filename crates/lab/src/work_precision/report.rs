//! The results of a study as a table for programs, and in words.

use super::grid::StepRule;
use super::pick::{CostPlace, ErrorMeasure, MethodComparison, MethodOffer};
use super::{SettingRow, StudyResult, brief};
use gs2e_image::Size;
use std::fmt::Write as _;
use std::io::{self, Write};

/// Beginning of the summary of every study.
pub const SUMMARY_HEAD: &str = "# Work and precision: ";

/// Writes one row per setting.
///
/// # Errors
/// Writing fails.
pub fn write_csv(study: &StudyResult, out: &mut dyn Write) -> io::Result<()> {
    writeln!(
        out,
        "rules,between,steps,rate_hz,frames,rms_th,events,reference_events,count_error,miscount,f1_10us,f1_100us,\
         f1_1000us,median_us,p99_us,render_core_s,render_wall_s,sensor_core_s,sensor_wall_s,core_s,wall_s,pairs,peak_mb"
    )?;
    let may = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
    for row in &study.rows {
        let e = &row.errors;
        let steps = if row.steps == StepRule::Flow { "flow" } else { "uniform" };
        write!(out, "{},{},{steps},{},{},", row.rules, row.between.name(), row.rate, row.frames)?;
        write!(out, "{},{},{},{},{},", row.rms_th, e.events, e.reference, e.count, e.miscount)?;
        write!(out, "{},{},{},{},{},", e.f1[0], e.f1[1], e.f1[2], may(e.median_us), may(e.p99_us))?;
        write!(out, "{},{},", row.render.core_s, row.render.wall_s)?;
        write!(out, "{},{},", row.sensor.core_s, row.sensor.wall_s)?;
        write!(out, "{},{},", row.core_s(), row.render.wall_s + row.sensor.wall_s)?;
        writeln!(out, "{},{}", row.pairs, may(row.peak_mb))?;
    }
    Ok(())
}

/// The study in words: the cheapest setting at each error. Markdown.
#[must_use]
pub fn study_words(study: &StudyResult) -> String {
    let mut out = String::new();
    let Size { width, height } = study.size;
    let noise = if study.noise { "the sensor's noise, the same in all" } else { "no noise" };
    let _ = writeln!(
        out,
        "{SUMMARY_HEAD}{}\n\n{width}x{height} px, {:.1} ms, references at {} frames a second, {noise}; {}.\n",
        study.scene,
        1e3 * study.seconds,
        study.finest,
        study.machine()
    );
    let Some(base) = study.base() else { return out };
    let _ = writeln!(out, "{}\n", conclusion_words(study));
    brief::write_cheapest(&mut out, study, base);
    brief::write_lowest(&mut out, study);
    write_rules(&mut out, study);
    write_picks(&mut out, study, base);
    write_pictures(&mut out, study);
    write_settings(&mut out, study);
    out
}

/// Conclusions for the user.
#[must_use]
pub fn conclusion_words(study: &StudyResult) -> String {
    let Some(base) = study.base() else { return String::new() };
    let mut said = format!(
        "`{}` at {} frames a second costs {} core-seconds.",
        base.method(),
        base.rate,
        short_number(base.core_s())
    );
    for pick in study.picks() {
        let what = pick.measure.says(&short_number(pick.error));
        let Some((offer, place)) = pick.cheapest() else { continue };
        let _ = write!(
            said,
            " At its {what}, the cheapest is `{}` with {}{} frames: {} core-seconds, {:.2} times fewer.",
            offer.method,
            at_most(&place),
            place.frames.round(),
            short_number(place.core_s),
            pick.base_core_s / place.core_s
        );
    }
    if let Some((lowest, found)) = study.below_the_first().filter(|_| study.rules.len() > 1) {
        let first = &study.rules[0].rules;
        let _ = match found {
            Some(row) => write!(
                said,
                " `{first}` comes no closer to its own limit than an RMS of {} thresholds; `{}` comes closer at {} frames \
                 a second: {} for {} core-seconds.",
                short_number(lowest),
                row.method(),
                row.rate,
                short_number(row.rms_th),
                short_number(row.core_s())
            ),
            None => write!(
                said,
                " The lowest RMS is {} thresholds, by `{first}`: no other rule set reaches a lower one at these rates.",
                short_number(lowest)
            ),
        };
    }
    said
}

pub(super) fn at_most(place: &CostPlace) -> &'static str {
    if place.at_most { "at most " } else { "" }
}

/// The cost of each method at the errors of the reference setting.
fn write_picks(out: &mut String, study: &StudyResult, base: &SettingRow) {
    let picks = study.picks();
    let _ = write!(
        out,
        "## Core-seconds at the error of `{}`, {} frames a second\n\nIn brackets: the frames, and how many times fewer \
         core-seconds than that setting. `-`: not reached, with the lowest error reached.\n\n| method |",
        base.method(),
        base.rate
    );
    for pick in &picks {
        let _ = write!(out, " {}: {} |", pick.measure.title(), short_number(pick.error));
    }
    let _ = writeln!(out, "\n|---|{}", "---|".repeat(picks.len()));
    let mut methods: Vec<&str> =
        picks.iter().flat_map(|pick| &pick.offers).map(|offer| offer.method.as_str()).collect();
    methods.sort_unstable();
    methods.dedup();
    for method in methods {
        let _ = write!(out, "| {method} |");
        for pick in &picks {
            let offer = pick.offers.iter().find(|offer| offer.method == method);
            let _ = write!(out, " {} |", offer.map_or_else(String::new, |offer| offer_cell(pick, offer)));
        }
        out.push('\n');
    }
    out.push('\n');
}

fn offer_cell(pick: &MethodComparison, offer: &MethodOffer) -> String {
    let Some(place) = offer.place else { return format!("- ({})", short_number(offer.lowest)) };
    let times = pick.base_core_s / place.core_s;
    format!("{}{} ({:.0}, {times:.2}x)", at_most(&place), short_number(place.core_s), place.frames)
}

fn write_rules(out: &mut String, study: &StudyResult) {
    let _ = writeln!(
        out,
        "## Rule sets\n\nThe law is that of `hermite` at the three finest rates, `e^2 = (C h^p)^2 + J h` with h in ms. J is \
         the contribution of jumps of the renderer; the frames miss each jump in the interval that contains it. The table has its error \
         at the finest rate.\n\n| rules | reference events | p | C | J | jumps at the finest, thresholds | sensor's own jitter, \
         thresholds | us | frame, core ms | with rate | pairs per pixel |\n|---|---|---|---|---|---|---|---|---|---|---|"
    );
    for of in &study.rules {
        // The law is fitted in seconds, and the table is in milliseconds.
        let law = of.law.map_or_else(
            || " | | ".to_owned(),
            |law| {
                format!(
                    "{:.2} | {} | {}",
                    law.p,
                    short_number(law.c * libm::pow(1e-3, law.p)),
                    short_number(1e-3 * law.jumps)
                )
            },
        );
        let jitter = of.jitter.map_or_else(
            || " | ".to_owned(),
            |jitter| format!("{} | {}", short_number(jitter.rms_th), short_number(jitter.us)),
        );
        let _ = writeln!(
            out,
            "| {} ({}) | {} | {law} | {} | {jitter} | {} | {:.2}x | {} |",
            of.rules,
            of.class,
            of.reference,
            of.left_by_jumps().map_or_else(String::new, short_number),
            short_number(1e3 * of.costs.value.frame.core_s),
            of.costs.rated.frame.core_s / of.costs.value.frame.core_s,
            short_number(of.costs.value.pairs / study.size.pixels() as f64),
        );
    }
    out.push('\n');
}

fn write_pictures(out: &mut String, study: &StudyResult) {
    if study.pictures.is_empty() {
        return;
    }
    let _ = writeln!(
        out,
        "## Pictures against f64\n\n| rules | rendered | core ms | pairs per pixel | peak MB | PSNR, dB | worst, grey |\n\
         |---|---|---|---|---|---|---|"
    );
    for picture in &study.pictures {
        let _ = writeln!(
            out,
            "| {} | {} | {} | {} | {} | {} | {} |",
            picture.rules,
            picture.what,
            short_number(1e3 * picture.cost.frame.core_s),
            short_number(picture.cost.pairs / study.size.pixels() as f64),
            picture.cost.peak_mb.map_or_else(String::new, short_number),
            picture.psnr_db.map_or_else(|| "equal".to_owned(), |db| format!("{db:.1}")),
            short_number(picture.worst_grey),
        );
    }
    out.push('\n');
}

fn write_settings(out: &mut String, study: &StudyResult) {
    let _ = writeln!(
        out,
        "## Settings\n\n| method | rate | frames | core s (render, sensor) | RMS, thresholds | miscounted | count | F1 at \
         10, 100, 1000 us | median us | 99 % us |\n|---|---|---|---|---|---|---|---|---|---|"
    );
    for row in &study.rows {
        let e = &row.errors;
        let us = |measure: ErrorMeasure| measure.of(row).map_or_else(|| "0".to_owned(), short_number);
        let _ = writeln!(
            out,
            "| {} | {} | {} | {} ({}, {}) | {} | {} | {} | {:.4}, {:.4}, {:.4} | {} | {} |",
            row.method(),
            row.rate,
            row.frames,
            short_number(row.core_s()),
            short_number(row.render.core_s),
            short_number(row.sensor.core_s),
            short_number(row.rms_th),
            short_number(e.miscount),
            short_number(e.count),
            e.f1[0],
            e.f1[1],
            e.f1[2],
            us(ErrorMeasure::Median),
            us(ErrorMeasure::P99),
        );
    }
}

/// Three significant digits.
pub(super) fn short_number(value: f64) -> String {
    match value.abs() {
        size if size < f64::MIN_POSITIVE => "0".to_owned(),
        size if size >= 100.0 => format!("{value:.0}"),
        size if size >= 10.0 => format!("{value:.1}"),
        size if size >= 1.0 => format!("{value:.2}"),
        size if size >= 0.1 => format!("{value:.3}"),
        size if size >= 0.01 => format!("{value:.4}"),
        size if size >= 1e-3 => format!("{value:.5}"),
        _ => format!("{value:.1e}"),
    }
}
