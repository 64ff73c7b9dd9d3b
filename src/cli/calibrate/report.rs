//! The report on a calibration.

use super::Calibrated;
use super::held_out::HeldOut;
use crate::cli::Console;
use gs2e_calibrate::{Estimate, FlickerLine, LightLevel};
use gs2e_lab::real::ComparedSensor;
use serde_json::{Value, json};

pub(super) fn report(done: &Calibrated, trust: &str, console: &Console) {
    if console.json {
        let held = done.held_out.as_ref().map(held_json);
        let Calibrated { found, sensor, events, frames, seconds, .. } = done;
        let mut all = json!(found);
        let more = json!({
            "events": events, "frames": frames, "seconds": seconds, "sensor": sensor, "held_out": held,
            "trust": trust,
        });
        if let (Value::Object(all), Value::Object(more)) = (&mut all, more) {
            all.extend(more);
        }
        return console.result(&all);
    }
    console.print("parameter        value      standard error");
    let found = &done.found;
    let more = [
        ("lag_us", found.lag_us),
        ("noise_on_hz", found.noise_on_hz),
        ("noise_off_hz", found.noise_off_hz),
        ("alternate", found.alternate),
        ("fano", found.fano),
    ];
    found.named().into_iter().chain(more).for_each(|(name, e)| console.print(&row(name, e)));
    if found.by_light.len() > 1 {
        console.print("constant light, lux    ON Hz   OFF Hz  alternate     Fano  leak Hz  hot pixels");
        for level in &found.by_light {
            let lux = level.lux.map_or_else(|| "-".to_owned(), |lux| format!("{lux}"));
            let LightLevel { noise_on_hz, noise_off_hz, alternate, fano, leak_hz, hot_pixels, .. } = level;
            let [on, off, leak] = [noise_on_hz, noise_off_hz, leak_hz].map(|e| e.value);
            console.print(&format!(
                "{lux:>19} {on:8.4} {off:8.4} {:>10} {:>8} {leak:8.4} {:11.5}",
                short(*alternate),
                short(*fano),
                hot_pixels.value
            ));
        }
    }
    for FlickerLine { hz, times_median } in &found.flicker {
        console.print(&format!("flicker: {hz} Hz, {times_median:.0} times the median of the spectrum"));
    }
    for burst in &done.found.read_out {
        let [from, to] = burst.after_stamp_us;
        let (share, sign) = (100.0 * burst.share, burst.polarity.to_uppercase());
        console.print(&format!(
            "read-out: {share:.1} % of the {sign} events, {from} to {to} us after the stamps"
        ));
    }
    if let Some(held) = &done.held_out {
        console.print("held out          ev/px/s    ON  KS counts  KS intervals  distance");
        let share = held.on_share.map_or_else(|| "-".to_owned(), percent);
        console.print(&format!("recording        {:8.4}  {share:>4}", held.rate_ev_px_s));
        [&held.before, &held.after].into_iter().for_each(|row| console.print(&compared(row)));
    }
    console.print(trust);
}

fn short(estimate: Estimate) -> String {
    if estimate.determined { format!("{:.3}", estimate.value) } else { "-".to_owned() }
}

fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

fn row(name: &str, estimate: Estimate) -> String {
    let value = estimate.value;
    match estimate.se {
        Some(se) if estimate.determined => format!("{name:14} {value:8.4}  +- {se:.4}"),
        Some(se) => format!("{name:14} {value:8.4}  +- {se:.4}  rough: not determined by this recording"),
        None => format!("{name:14} not determined by this recording"),
    }
}

fn compared(row: &ComparedSensor) -> String {
    let share = row.on_share.map_or_else(|| "-".to_owned(), percent);
    format!(
        "{:14}   {:8.4}  {share:>4}  {:9.3}  {:12.3}  {:8.3}",
        row.sensor, row.rate_ev_px_s, row.ks_counts, row.ks_intervals, row.distance
    )
}

fn held_json(held: &HeldOut) -> Value {
    let HeldOut { rate_ev_px_s, on_share, before, after, .. } = held;
    json!({ "rate_ev_px_s": rate_ev_px_s, "on_share": on_share, "before": before, "after": after })
}

/// One sentence that says what to trust.
pub(super) fn trust(done: &Calibrated) -> String {
    let named = done.found.named();
    let part = |passes: &dyn Fn(&Estimate) -> bool| {
        let names: Vec<&str> = named.iter().filter(|(_, e)| passes(e)).map(|(name, _)| *name).collect();
        if names.is_empty() { "nothing".to_owned() } else { names.join(", ") }
    };
    let found = part(&|e| e.determined);
    let rough = part(&|e| !e.determined && e.se.is_some());
    let open = part(&|e| e.se.is_none());
    format!("trust {found} within their errors; rough: {rough}; not determined: {open}")
}
