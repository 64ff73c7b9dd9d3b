//! The comparison as tables for people, and as CSV and JSON for programs.

use crate::cli::Console;
use gs2e_lab::real::{AlignedFigures, AlignedStudy, ComparedSensor};
use serde::Serialize;
use serde_json::json;
use std::io::{self, Write};

const COLUMNS: &str = "sensor,events,capped,rate_ev_px_s,on_share,ks_counts,ks_intervals,ln_density,distance,\
    still_rate_ev_px_s,still_on_share,moving_rate_ev_px_s,moving_on_share,delay_us,ncc,counts_r,\
    contrast_on,contrast_off,lag_us";

/// A stream with all its figures.
#[derive(Debug, Serialize)]
struct StreamRow {
    #[serde(flatten)]
    compared: ComparedSensor,
    #[serde(flatten)]
    aligned: AlignedFigures,
}

/// The recording, whose distances from itself are 0, and the sensors.
fn rows(found: &AlignedStudy) -> Vec<StreamRow> {
    let real = &found.study.real;
    let intervals = real.intervals();
    let compared = ComparedSensor {
        sensor: "recording".to_owned(),
        events: real.events(),
        capped: 0,
        rate_ev_px_s: real.per_pixel() / found.study.seconds,
        on_share: real.on_share(),
        ks_counts: 0.0,
        ks_intervals: 0.0,
        ln_density: intervals.inverse_gaussian().and_then(|law| intervals.mean_ln_density(law)),
        distance: 0.0,
    };
    let recording = StreamRow { compared, aligned: found.recording };
    let sensors = found.study.rows.iter().zip(&found.sensors);
    let sensors = sensors.map(|(row, aligned)| StreamRow { compared: row.clone(), aligned: *aligned });
    [recording].into_iter().chain(sensors).collect()
}

pub(super) fn write_csv(found: &AlignedStudy, out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "{COLUMNS}")?;
    let number = |value: Option<f64>| value.map(|value| value.to_string()).unwrap_or_default();
    for StreamRow { compared, aligned } in rows(found) {
        let ComparedSensor { sensor, events, capped, rate_ev_px_s, .. } = &compared;
        let ComparedSensor { ks_counts, ks_intervals, distance, .. } = &compared;
        let (on_share, ln_density) = (number(compared.on_share), number(compared.ln_density));
        write!(
            out,
            "{sensor},{events},{capped},{rate_ev_px_s},{on_share},{ks_counts},{ks_intervals},{ln_density},{distance}"
        )?;
        let figures = [
            number(aligned.still_rate_ev_px_s),
            number(aligned.still_on_share),
            number(aligned.moving_rate_ev_px_s),
            number(aligned.moving_on_share),
            aligned.delay_us.map(|us| us.to_string()).unwrap_or_default(),
            number(aligned.ncc),
            number(aligned.counts_r),
            number(aligned.contrast_on),
            number(aligned.contrast_off),
            number(aligned.lag_us),
        ];
        writeln!(out, ",{}", figures.join(","))?;
    }
    Ok(())
}

pub(super) fn report(found: &AlignedStudy, console: &Console) {
    let (rows, real) = (rows(found), &found.study.real);
    let nearest = found.study.rows.first().map(|row| &row.sensor);
    if console.json {
        return console.result(&json!({
            "seconds": found.study.seconds, "recording": rows[0], "outside": real.outside(),
            "sensors": rows[1..], "nearest": nearest, "masked": real.masked(), "pixels": found.pixels,
        }));
    }
    if real.outside() > 0 {
        console.note(&format!(
            "{} recorded events are before the first or after the last frame, and do not count",
            real.outside()
        ));
    }
    if real.masked() > 0 {
        console.note(&format!("{} recorded events are masked, and do not count", real.masked()));
    }
    print_distances(&rows, console);
    console.print("");
    print_figures(&rows, console);
    let pixels = found.pixels;
    console.print(&format!(
        "pixels: {} still, {} moving, {} black or white",
        pixels.still, pixels.moving, pixels.clipped
    ));
    for row in found.study.rows.iter().filter(|row| row.capped > 0) {
        console.note(&format!("{}: {} events beyond the cap were dropped", row.sensor, row.capped));
    }
    if let Some(nearest) = nearest {
        console.print(&format!("nearest: {nearest}"));
    }
}

fn print_distances(rows: &[StreamRow], console: &Console) {
    console.print(
        "sensor                 events    ev/px/s    ON  KS counts  KS intervals  ln density  distance",
    );
    for StreamRow { compared: row, .. } in rows {
        let density = row.ln_density.map_or_else(|| "-".to_owned(), |mean| format!("{mean:.3}"));
        console.print(&format!(
            "{:18}  {:9}  {:9.4}  {:>4}  {:9.3}  {:12.3}  {density:>10}  {:8.3}",
            row.sensor,
            row.events,
            row.rate_ev_px_s,
            percent(row.on_share),
            row.ks_counts,
            row.ks_intervals,
            row.distance
        ));
    }
}

fn print_figures(rows: &[StreamRow], console: &Console) {
    console.print(
        "sensor                  still    ON     moving    ON  delay ms    NCC      r   C_on  C_off  lag ms",
    );
    for StreamRow { compared, aligned } in rows {
        let number = |value: Option<f64>, digits: usize| {
            value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
        };
        let rates = [aligned.still_rate_ev_px_s, aligned.moving_rate_ev_px_s].map(|rate| number(rate, 4));
        let shares = [aligned.still_on_share, aligned.moving_on_share].map(percent);
        let correlations = [aligned.ncc, aligned.counts_r].map(|value| number(value, 3));
        let contrasts = [aligned.contrast_on, aligned.contrast_off].map(|value| number(value, 3));
        console.print(&format!(
            "{:18}  {:>9}  {:>4}  {:>9}  {:>4}  {:>8}  {:>5}  {:>5}  {:>5}  {:>5}  {:>6}",
            compared.sensor,
            rates[0],
            shares[0],
            rates[1],
            shares[1],
            number(aligned.delay_us.map(|us| us as f64 * 1e-3), 1),
            correlations[0],
            correlations[1],
            contrasts[0],
            contrasts[1],
            number(aligned.lag_us.map(|us| us * 1e-3), 1),
        ));
    }
}

fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "-".to_owned(), |share| format!("{:.0} %", 100.0 * share))
}
