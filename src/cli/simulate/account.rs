//! The report on a finished simulation.

use super::SimulateArgs;
use super::sensor::DrawnNumbers;
use super::sequence::StampedFrames;
use crate::cli::output::unwritable_file;
use crate::cli::{Console, VerbError, path};
use gs2e_num::units::format_amount;
use gs2e_sensor::screening::SensorScreening;
use gs2e_sensor::{SensorChoice, SimulationAccount};
use serde_json::{Value, json};

/// The report on a simulation.
pub(super) struct SimulateReport<'a> {
    pub(super) asked: &'a SimulateArgs,
    pub(super) sensor: &'a SensorChoice,
    pub(super) drawn: DrawnNumbers,
    pub(super) screening: SensorScreening,
    pub(super) sequence: &'a StampedFrames,
    pub(super) account: SimulationAccount,
}

impl SimulateReport<'_> {
    pub(super) fn report(&self, console: &Console) -> Result<(), VerbError> {
        let out = &self.asked.out;
        let bytes = std::fs::metadata(out).map_err(|e| unwritable_file(out, e))?.len();
        let SimulationAccount { events, on, active_pixels, .. } = self.account;
        let (size, seconds) = (self.sequence.frames.size(), self.seconds());
        let (out, frames) = (out.display(), self.sequence.stamps_us.len());
        let [amount, written] = [format_amount(events, "events"), format_amount(bytes, "B")];
        console
            .note(&format!("{out}: {amount} from {frames} frames of {size} over {seconds:.6} s, {written}"));
        if events > 0 {
            let (rate, share) = (self.rate(), 100.0 * on as f64 / events as f64);
            let active = 100.0 * active_pixels as f64 / size.pixels() as f64;
            console.note(&format!(
                "{rate:.3} events per pixel and second, {share:.1} % of them ON, from {active:.1} % of the pixels"
            ));
        }
        if let Some(late) = &self.account.latency {
            console.note(&format!(
                "latency: events are {:.3} us late on average and {:.1} us at most; {} of {} would be after the last \
                 frame and were left out",
                late.mean_us, late.max_us, late.unread, late.made
            ));
        }
        if let Some(bus) = &self.account.readout {
            console.note(&format!(
                "readout: {} of {} events lost, the others {:.3} us late on average and {:.1} us at most",
                bus.lost(),
                bus.made,
                bus.mean_delay_us,
                bus.max_delay_us
            ));
        }
        self.oddities().iter().for_each(|line| console.note(line));
        console.result(&self.to_json(bytes));
        Ok(())
    }

    /// Warnings about events and pixels that do not occur in a usual run.
    fn oddities(&self) -> Vec<String> {
        let found = &self.account;
        let drift =
            format!("pixels deviate from their drift, at worst by {:.2} times the limit", found.drift_worst);
        let lines = [
            (found.capped, "events beyond the cap per pixel and frame were dropped"),
            (found.negative_luminance, "luminance values below zero were set to zero"),
            (found.same_us_same_pixel, "pairs of events of the same pixel share a microsecond"),
            (found.drift_violations, &drift),
        ];
        let warning = |(count, what): &(_, &str)| (*count > 0).then(|| format!("warning: {count} {what}"));
        lines.iter().filter_map(warning).collect()
    }

    fn seconds(&self) -> f64 {
        let (first, last) = self.sequence.span_us();
        last.abs_diff(first) as f64 * 1e-6
    }

    /// Events per pixel and second.
    fn rate(&self) -> f64 {
        // The time is not zero: there are at least two stamps, strictly increasing.
        self.account.events as f64 / self.sequence.frames.size().pixels() as f64 / self.seconds()
    }

    fn to_json(&self, bytes: u64) -> Value {
        let (asked, size) = (self.asked, self.sequence.frames.size());
        let (first_us, last_us) = self.sequence.span_us();
        let full_scale = self.sequence.full_scale.white();
        json!({
            "output": path(&asked.out), "bytes": bytes, "seed": asked.seed, "origin": asked.origin,
            "frames": {
                "input": path(asked.input_path()), "count": self.sequence.stamps_us.len(), "width": size.width,
                "height": size.height, "first_us": first_us, "last_us": last_us, "full_scale": full_scale,
                "full_scale_decided": self.sequence.decided,
            },
            "sensor": self.sensor, "drawn": self.drawn, "contrast": self.screening.contrast, "noise": self.screening.noise,
            "warnings": self.screening.warnings, "account": self.account,
            "capped": self.account.capped,
            "events_per_pixel_second": self.rate(),
        })
    }
}
