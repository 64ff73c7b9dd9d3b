//! `calibration.html`: the estimates and the pictures behind them, in one page without scripts.

use super::Calibrated;
use super::held_out::{EventPictures, HeldOut};
use gs2e_calibrate::{Calibration, Estimate, FlickerLine, Rung};
use gs2e_files::html::{HtmlFragment, encode_base64, write_page_head};
use gs2e_lab::real::ComparedSensor;
use gs2e_trajectory::picture::{PicturePanel, SvgText};

const SIZE: [f64; 2] = [720.0, 420.0];
const INNER: PicturePanel = PicturePanel { left: 60.0, top: 40.0, width: 620.0, height: 320.0 };
const DARK: &str = "#222222";
const LINE: &str = "#2a7fb8";
const POINT: &str = "#d1495b";

/// The page. `trust` is the sentence at its head.
pub(super) fn page(done: &Calibrated, trust: &str) -> String {
    HtmlFragment::whole_page(|html| {
        html.within("head", &[], |html| write_page_head(html, "Calibration"));
        html.within("body", &[], |html| {
            html.within("header", &[], |html| {
                html.leaf("h1", &[], "Calibration");
                html.leaf("p", &[("class", "caption")], &extent(done));
                html.leaf("p", &[], trust);
            });
            html.within("main", &[], |html| {
                estimates(html, done);
                if !done.found.ladder.is_empty() {
                    html.leaf("h2", &[], "Ladder");
                    html.leaf("p", &[], LADDER);
                    picture(html, "ladder", &ladder(done));
                }
                read_out(html, done);
                constant_light(html, &done.found);
                if let Some(held) = &done.held_out {
                    compared(html, held);
                }
                html.leaf("h2", &[], "Sensor");
                html.leaf("pre", &[], &done.sensor);
            });
        });
    })
}

const LADDER: &str = "Change of the logarithm of the grey between two frames of a pixel, against the change of its \
                      counts, ON less OFF. The line has the contrasts as its slopes.";

fn extent(done: &Calibrated) -> String {
    let Calibrated { events, frames, seconds, found, .. } = done;
    let (anchors, still) = (found.anchors, found.still_pixels);
    format!(
        "{events} events and {frames} frames over {seconds:.3} s; {anchors} greys next to events; {still} pixels in constant light"
    )
}

fn picture(html: &mut HtmlFragment, name: &str, svg: &str) {
    let source = format!("data:image/svg+xml;base64,{}", encode_base64(svg.as_bytes()));
    html.empty("img", &[("src", &source), ("alt", name)]);
}

fn cells(html: &mut HtmlFragment, tag: &'static str, words: &[&str]) {
    html.within("tr", &[], |html| words.iter().for_each(|word| html.leaf(tag, &[], word)));
}

fn value_and_error(Estimate { value, se, determined }: Estimate) -> [String; 2] {
    match se {
        Some(se) if determined => [format!("{value:.4}"), format!("{se:.4}")],
        Some(se) => [format!("{value:.4}"), format!("{se:.4} (rough)")],
        None => ["-".to_owned(), "not determined by this recording".to_owned()],
    }
}

fn estimates(html: &mut HtmlFragment, done: &Calibrated) {
    html.leaf("h2", &[], "Parameters");
    html.table("", |html| {
        cells(html, "th", &["parameter", "value", "standard error"]);
        for (name, estimate) in done.found.named() {
            let [value, se] = value_and_error(estimate);
            cells(html, "td", &[name, &value, &se]);
        }
    });
}

fn read_out(html: &mut HtmlFragment, done: &Calibrated) {
    if done.found.read_out.is_empty() {
        return;
    }
    html.leaf("h2", &[], "Read-out of frames");
    html.table("", |html| {
        cells(html, "th", &["sign", "us after the stamp", "share of the events of this sign"]);
        for burst in &done.found.read_out {
            let [from, to] = burst.after_stamp_us;
            let words =
                [burst.polarity.to_uppercase(), format!("{from} to {to}"), format!("{:.3}", burst.share)];
            cells(html, "td", &words.each_ref().map(String::as_str));
        }
    });
}

/// What pixels in constant light show.
fn constant_light(html: &mut HtmlFragment, found: &Calibration) {
    if found.noise_on_hz.se.is_none() {
        return;
    }
    html.leaf("h2", &[], "Constant light");
    html.table("", |html| {
        cells(html, "th", &["of calm pixels", "value", "standard error"]);
        for (words, estimate) in [
            ("ON events per second", found.noise_on_hz),
            ("OFF events per second", found.noise_off_hz),
            ("share of neighbouring events with the other sign", found.alternate),
            ("Fano factor of the counts", found.fano),
        ] {
            let [value, se] = value_and_error(estimate);
            cells(html, "td", &[words, &value, &se]);
        }
    });
    if found.spectrum.is_empty() {
        return;
    }
    html.leaf("p", &[], SPECTRUM);
    picture(html, "spectrum", &spectrum(found));
}

const SPECTRUM: &str = "Power of the number of events by frequency. Events that do not know of each other have a power of 1; \
                        a lamp on the mains makes lines at twice its frequency.";

/// The spectrum as SVG: logarithms of power by frequency.
fn spectrum(found: &Calibration) -> String {
    let mut out = SvgText::new(SIZE);
    out.frame(INNER);
    out.text([INNER.left, 26.0], "start", DARK, "Power by frequency (Hz)");
    let last = found.spectrum.len() - 1;
    // Frequencies of motion and the mean are left out.
    let shown = &found.spectrum[1..];
    let decade = |power: f64| power.max(1e-3).log10();
    let high = shown.iter().map(|power| decade(*power)).fold(1.0, f64::max).ceil();
    let low = shown.iter().map(|power| decade(*power)).fold(-1.0, f64::min).floor();
    let at = |hz: f64, power: f64| INNER.point([hz / last as f64, (decade(power) - low) / (high - low)]);
    out.polyline(shown.iter().enumerate().map(|(i, power)| at((i + 1) as f64, *power)), LINE, 1.0);
    for FlickerLine { hz, .. } in &found.flicker {
        let [x, y] = at(*hz as f64, found.spectrum[*hz]);
        out.text([x, y - 6.0], "middle", POINT, &format!("{hz}"));
    }
    for hz in (0..=last).step_by(100) {
        let [x, _] = at(hz as f64, 1.0);
        out.text([x, INNER.bottom() + 18.0], "middle", DARK, &hz.to_string());
    }
    let mut exponent = low;
    while exponent <= high {
        let [_, y] = INNER.point([0.0, (exponent - low) / (high - low)]);
        out.text([INNER.left - 6.0, y + 4.0], "end", DARK, &format!("1e{exponent:.0}"));
        exponent += 1.0;
    }
    out.finish()
}

fn compared(html: &mut HtmlFragment, held: &HeldOut) {
    html.leaf("h2", &[], "Held out");
    let share = |share: Option<f64>| share.map_or_else(|| "-".to_owned(), |share| format!("{share:.3}"));
    html.table("", |html| {
        cells(
            html,
            "th",
            &["stream", "events per pixel and second", "ON", "KS counts", "KS intervals", "distance"],
        );
        let rate = format!("{:.4}", held.rate_ev_px_s);
        cells(html, "td", &["recording", &rate, &share(held.on_share), "", "", ""]);
        for ComparedSensor { sensor, rate_ev_px_s, on_share, ks_counts, ks_intervals, distance, .. } in
            [&held.before, &held.after]
        {
            let numbers = [ks_counts, ks_intervals, distance].map(|v| format!("{v:.3}"));
            let [counts, intervals, distance] = numbers.each_ref().map(String::as_str);
            let rate = format!("{rate_ev_px_s:.4}");
            cells(html, "td", &[sensor, &rate, &share(*on_share), counts, intervals, distance]);
        }
    });
    picture(html, "intervals", &held.intervals);
    let EventPictures { from_us, length_us, recorded, simulated } = &held.events;
    let words = format!(
        "Events of {} ms from {:.1} ms after the first frame that was held out: red is brighter, blue darker.",
        length_us / 1000,
        *from_us as f64 * 1e-3
    );
    html.leaf("p", &[], &words);
    html.within("div", &[("class", "row")], |html| {
        for (words, png) in [("recorded", recorded), ("simulated", simulated)] {
            html.within("figure", &[], |html| {
                let source = format!("data:image/png;base64,{}", encode_base64(png));
                html.empty("img", &[("src", &source), ("alt", words)]);
                html.leaf("figcaption", &[], words);
            });
        }
    });
}

/// The ladder as SVG.
fn ladder(done: &Calibrated) -> String {
    let mut out = SvgText::new(SIZE);
    out.frame(INNER);
    out.text([INNER.left, 26.0], "start", DARK, "Change of ln(grey) by change of the counts");
    let rungs = &done.found.ladder;
    let widest = rungs.iter().map(|rung| rung.net.abs()).max().unwrap_or(1).max(1);
    let [on, off] = [done.found.contrast_on.value, done.found.contrast_off.value];
    let high = f64::from(widest) * on.max(off) * 1.1;
    let at = |net: f64, ln: f64| {
        INNER.point([0.5 + 0.5 * net / (f64::from(widest) + 0.5), (0.5 + 0.5 * ln / high).clamp(0.0, 1.0)])
    };
    let wide = f64::from(widest);
    out.polyline([at(-wide, -wide * off), at(0.0, 0.0), at(wide, wide * on)], LINE, 1.5);
    for Rung { net, ln, se, .. } in rungs {
        let net = f64::from(*net);
        let [x, y] = at(net, *ln);
        let dot = format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{POINT}\"/>");
        out.line(&dot);
        out.polyline([at(net, ln - se), at(net, ln + se)], POINT, 2.0);
        out.text([x, INNER.bottom() + 18.0], "middle", DARK, &format!("{net:+.0}"));
    }
    for step in [-1.0, -0.5, 0.0, 0.5, 1.0] {
        let ln = step * high;
        let [_, y] = at(0.0, ln);
        out.text([INNER.left - 6.0, y + 4.0], "end", DARK, &format!("{ln:.2}"));
    }
    out.finish()
}
