//! Time jitter of events from the sensor's own noise: errors of brightness below it have no visible
//! effect.

use gs2e_image::Image;
use gs2e_sensor::SimulationAccount;
use gs2e_sensor::voltmeter::VoltmeterModel;
use serde::Serialize;

/// The noise of a pixel between two events.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct IntervalNoise {
    /// Mean time between the events of a pixel that has any, us.
    pub interval_us: f64,
    /// Standard deviation of the noise over this time, thresholds.
    pub rms_th: f64,
    /// The time in which the signal changes by the same amount, us.
    pub us: f64,
}

impl IntervalNoise {
    /// The jitter of a noisy sensor with a stream of this duration, event count and pixel count:
    /// `sigma sqrt(Ti) / Th`, with sigma at this grey. `None` without events.
    #[must_use]
    pub fn for_sensor(
        sensor: &VoltmeterModel,
        grey: f64,
        [events, active_pixels]: [u64; 2],
        seconds: f64,
    ) -> Option<Self> {
        if events == 0 {
            return None;
        }
        let [_, k2, k3, .., k6] = sensor.k;
        let grey = grey.max(0.0);
        let sigma = k3 * grey.sqrt() / (grey + k2) + k6;
        let interval_us = seconds * 1e6 * active_pixels as f64 / events as f64;
        let threshold = f64::midpoint(sensor.threshold_on, sensor.threshold_off);
        let rms_th = sigma * interval_us.sqrt() / threshold;
        // Between two events the signal moves by one threshold, and so by `rms_th` in that share of the
        // interval.
        Some(Self { interval_us, rms_th, us: rms_th * interval_us })
    }
}

/// A warning if a tolerance in thresholds is below the jitter of a sensor whose first frame was
/// this one, over this many us.
#[must_use]
pub fn lost_in_noise(
    tolerance: f64,
    sensor: &VoltmeterModel,
    first: &Image<f32>,
    account: &SimulationAccount,
    duration_us: i64,
) -> Option<String> {
    let grey = first.pixels().iter().map(|l| f64::from(*l)).sum::<f64>() / first.pixels().len() as f64;
    let counts = [account.events, account.active_pixels];
    let jitter = IntervalNoise::for_sensor(sensor, grey, counts, duration_us as f64 * 1e-6)?;
    (tolerance < jitter.rms_th).then(|| {
        format!(
            "sampling.tolerance {tolerance} is below the sensor's own jitter of {:.2e} thresholds, {:.1} us: the noise hides \
             the benefit of the additional frames",
            jitter.rms_th, jitter.us
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_image::Size;
    use gs2e_sensor::voltmeter::VoltmeterPreset;

    #[test]
    fn jitter_is_the_noise_over_the_time_between_events() {
        // dvs346, 10 ms between events: 1.8e-3 thresholds, which is 17.6 us.
        let sensor = VoltmeterModel::new(VoltmeterPreset::Dvs346.k());
        let jitter = IntervalNoise::for_sensor(&sensor, 100.0, [100, 1], 1.0).unwrap();
        assert!((jitter.interval_us - 1e4).abs() < 1e-6);
        assert!((1.5e-3..2.2e-3).contains(&jitter.rms_th), "{jitter:?}");
        assert!((jitter.us / 1e4 - jitter.rms_th).abs() < 1e-12);
        assert_eq!(IntervalNoise::for_sensor(&sensor, 100.0, [0, 0], 1.0), None);
    }

    #[test]
    fn a_tolerance_below_the_jitter_is_told() {
        let sensor = VoltmeterModel::new(VoltmeterPreset::Dvs346.k());
        let grey = Image::filled(Size { width: 2, height: 1 }, 100.0);
        let account = SimulationAccount { events: 100, active_pixels: 1, ..SimulationAccount::default() };
        let message = |tolerance| lost_in_noise(tolerance, &sensor, &grey, &account, 1_000_000);
        assert_eq!(message(0.03), None);
        assert!(message(0.001).unwrap().contains("below the sensor's own jitter"));
        let quiet = VoltmeterModel::new([5.0, 20.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(lost_in_noise(1e-9, &quiet, &grey, &account, 1_000_000), None);
    }
}
