//! The sensor that a calibration describes, as a recipe writes it.

use crate::calibration::Calibration;
use crate::estimate::Estimate;
use std::fmt::Write as _;

/// Smallest offset that a sensor can have, grey: the frames are darker than the logarithm allows where the
/// black level is above the offset.
const SMALLEST_OFFSET: f64 = 0.1;

/// The content of a recipe's `sensor`. Its constants are in greys of the frames.
#[must_use]
pub fn sensor_text(found: &Calibration) -> String {
    let mut text = String::new();
    let mut line = |words: String| {
        text.push_str(&words);
        text.push('\n');
    };
    let offset = found.offset.value.max(SMALLEST_OFFSET);
    let [on, off] = [found.contrast_on.value, found.contrast_off.value];
    // The voltage is the logarithm itself, so thresholds are contrasts and the leak is in contrasts.
    let leak = found.leak_hz.value.max(0.0) * on * 1e-6;
    let spread = found.spread.value * 0.5 * (on + off);
    line("voltmeter:".to_owned());
    line(format!("  k: [1, {offset:.4}, 0, {leak:.4e}, 0, 0]"));
    line("  units: { time: us, brightness: 255 }".to_owned());
    line(format!("  threshold: {{ on: {on:.5}, off: {off:.5}, spread: {spread:.5} }}"));
    if found.dead_time_us.determined {
        line(format!("  refractory: {{ period_us: {:.0} }}", found.dead_time_us.value));
    }
    if found.hot_pixels.determined && found.hot_pixels.value > 0.0 {
        let [rate, spread] = found.hot_rate;
        let share = found.hot_pixels.value;
        line(format!("  hot_pixels: {{ share: {share:.3e}, rate: {rate:.2}, spread: {spread:.3} }}"));
    }
    remarks(found, &mut text);
    text
}

/// Comments on what the file leaves at its preset.
fn remarks(found: &Calibration, text: &mut String) {
    let named = found.named();
    let open = |is_rough: bool| {
        let open = named.iter().filter(|(_, e)| !e.determined && e.se.is_some() == is_rough);
        open.map(|(name, _)| *name).collect::<Vec<_>>().join(", ")
    };
    for (names, is) in [(open(true), "rough"), (open(false), "not determined by the recording")] {
        if !names.is_empty() {
            let _ = writeln!(text, "# {is}: {names}");
        }
    }
    if found.offset.value < SMALLEST_OFFSET {
        let black = SMALLEST_OFFSET - found.offset.value;
        let _ =
            writeln!(text, "# frames are {black:.1} grey too bright: subtract this black level from them");
    }
}

impl Calibration {
    /// The parameters of the camera by name.
    #[must_use]
    pub fn named(&self) -> Vec<(&'static str, Estimate)> {
        vec![
            ("contrast_on", self.contrast_on),
            ("contrast_off", self.contrast_off),
            ("spread", self.spread),
            ("dead_time_us", self.dead_time_us),
            ("cutoff_hz", self.cutoff_hz),
            ("delay_us", self.delay_us),
            ("offset", self.offset),
            ("black_level", self.black_level),
            ("leak_hz", self.leak_hz),
            ("noise", self.noise),
            ("hot_pixels", self.hot_pixels),
        ]
    }
}
