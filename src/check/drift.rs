//! The drift of a pixel's voltage between two frames, by the sensor's law.

use crate::sensor::SensorChoice;
use crate::sensor::esim::{EsimModel, IntensityScale};
use crate::sensor::voltmeter::{DriftGain, InitialVoltage, SamplerKind, VoltmeterModel};

/// The deterministic part of a sensor's law: `D(t) = k1 ln(L + k2) + integral of (k4 + k5 L)`, in
/// microseconds and greys.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriftLaw {
    k: [f64; 6],
    /// Thresholds of ON and OFF events.
    pub thresholds: [f64; 2],
    /// True if all voltages are 0 at the first frame. Otherwise they lie anywhere between the
    /// thresholds.
    pub from_zero: bool,
}

impl DriftLaw {
    /// The law of a sensor.
    ///
    /// # Errors
    /// The frames at two instants do not determine the drift between them; the text is the reason.
    pub fn for_sensor(sensor: &SensorChoice) -> Result<Self, &'static str> {
        let VoltmeterModel { k, threshold_on, threshold_off, gain, initial, law, .. } = match sensor {
            SensorChoice::Voltmeter(voltmeter) => voltmeter,
            SensorChoice::Esim(esim) => return of_esim(esim),
            SensorChoice::V2e(_) => {
                return Err("not applicable to v2e: the check needs an unfiltered log-brightness sensor");
            }
        };
        let from_zero = *initial == InitialVoltage::Zero;
        if !sensor.hot_pixels().is_absent() {
            return Err("not applicable with hot pixels: they fire without a brightness change");
        }
        if *law == SamplerKind::Official {
            return Err(
                "not applicable to `law: official`: its drift depends on every frame, and only some frames are kept",
            );
        }
        match gain {
            DriftGain::Log => Ok(Self { k: *k, thresholds: [*threshold_on, *threshold_off], from_zero }),
            DriftGain::Midpoint => Err(
                "not applicable to `gain: midpoint`: its drift depends on every frame, and only some frames are kept",
            ),
        }
    }

    /// The largest difference between a pixel's drift and its events without noise: the remaining
    /// voltage minus the initial voltage.
    #[must_use]
    pub fn most_residual(&self) -> f64 {
        let [on, off] = self.thresholds;
        // From zero, the remaining voltage is the whole difference. Otherwise the initial voltage
        // may lie at the opposite threshold.
        if self.from_zero { on.max(off) } else { on + off }
    }

    /// Change of `ln(L + k2)` for one ON and one OFF event.
    #[must_use]
    pub fn contrast(&self) -> [f64; 2] {
        self.thresholds.map(|threshold| threshold / self.k[0])
    }

    /// `ln(L + k2)`; negative luminance counts as 0.
    #[must_use]
    pub fn log_brightness(&self, luminance: f32) -> f64 {
        libm::log(f64::from(luminance).max(0.0) + self.k[1])
    }

    /// The drift for a change of `ln(L + k2)` by `logs` in `dt_us` microseconds, with an integral
    /// of luminance of `exposure` grey-microseconds.
    #[must_use]
    pub fn drift(&self, logs: f64, dt_us: f64, exposure: f64) -> f64 {
        self.k[0] * logs + self.k[3] * dt_us + self.k[4] * exposure
    }

    /// Standard deviation of the voltage after `dt_us` microseconds at this luminance.
    #[must_use]
    pub fn noise(&self, luminance: f64, dt_us: f64) -> f64 {
        let [_, k2, k3, _, _, k6] = self.k;
        (k3 * luminance.max(0.0).sqrt() / (luminance.max(0.0) + k2) + k6) * dt_us.sqrt()
    }

    /// The largest of [`DriftLaw::noise`] over all luminances, which is at `L = k2`.
    #[must_use]
    pub fn most_noise(&self, dt_us: f64) -> f64 {
        self.noise(self.k[1], dt_us)
    }

    /// An upper bound of the events of a pixel of constant luminance in `dt_us` microseconds. The
    /// renewal rate is `(mu / Th) coth(mu Th / sigma^2)`, and `coth x <= 1 + 1/x`.
    #[must_use]
    pub fn most_noise_events(&self, luminance: f64, dt_us: f64) -> f64 {
        // The lower threshold is reached more often, so it bounds the events of both.
        let threshold = self.thresholds[0].min(self.thresholds[1]);
        let noise = self.noise(luminance, dt_us) / threshold;
        self.drift(0.0, dt_us, luminance * dt_us).abs() / threshold + noise * noise
    }

    /// Standard deviation of the leak if the luminance is known only at the ends of `intervals`
    /// intervals of `dt_us`. In each interval, the mean luminance has a random error of an eighth
    /// of the grey scale, typical for pictures with contrast.
    #[must_use]
    pub fn leak_error(&self, dt_us: f64, intervals: usize) -> f64 {
        // 32 of 255 greys. Errors of intervals are independent, so their sum grows with the root.
        32.0 * self.k[4].abs() * dt_us * (intervals as f64).sqrt()
    }
}

/// Without noise, the reference of a pixel moves like the voltage of a voltmeter with `k1 = 1` and
/// `k2` equal to `eps` on the grey scale.
fn of_esim(esim: &EsimModel) -> Result<DriftLaw, &'static str> {
    let EsimModel { threshold, intensity, eps, .. } = esim;
    if *intensity == IntensityScale::Linear {
        return Err("not applicable to `intensity: linear`: the check needs a log-brightness sensor");
    }
    if threshold.spread > 0.0 || !esim.keeps_balance() {
        return Err(
            "not applicable with a threshold spread, dead time, hot pixels or an allowed cap: events need not match the brightness change",
        );
    }
    // `ln(L/255 + eps)` and `ln(L + 255 eps)` differ by a constant, which no change shows.
    let k = [1.0, 255.0 * eps, 0.0, 0.0, 0.0, 0.0];
    Ok(DriftLaw { k, thresholds: [threshold.on, threshold.off], from_zero: true })
}

/// Requires that a sensor's events balance the change of each pixel's brightness. The sensor's
/// account states this for every pixel.
///
/// # Errors
/// The events of this sensor need not balance; the text is the reason.
pub fn require_balance(sensor: &SensorChoice) -> Result<(), &'static str> {
    match sensor {
        SensorChoice::Voltmeter(VoltmeterModel { law: SamplerKind::Official, .. }) => Err(
            "not applicable to `law: official`: it redraws the remaining voltage at each frame, so events need not match the drift",
        ),
        SensorChoice::Esim(sensor) if !sensor.keeps_balance() => Err(
            "not applicable with dead time, thresholds drawn per frame, hot pixels or an allowed cap: events need not match the brightness change",
        ),
        SensorChoice::V2e(sensor) if !sensor.keeps_balance() => Err(
            "not applicable with leak, shot noise, dead time, hot pixels or an allowed cap: events need not match the brightness change",
        ),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_largest_where_luminance_is_k2() {
        let law =
            DriftLaw { k: [5.265, 20.0, 1e-4, 1e-7, 5e-9, 1e-5], thresholds: [1.0; 2], from_zero: true };
        let most = law.most_noise(1e4);
        for luminance in [0.0, 1.0, 10.0, 19.0, 21.0, 40.0, 128.0, 255.0] {
            assert!(law.noise(luminance, 1e4) < most, "{luminance}");
        }
    }

    #[test]
    fn a_brighter_pixel_drifts_by_the_logarithm_and_leaks() {
        let law =
            DriftLaw { k: [5.265, 20.0, 1e-4, 1e-7, 5e-9, 1e-5], thresholds: [1.0; 2], from_zero: true };
        let logs = law.log_brightness(128.0) - law.log_brightness(64.0);
        // ln(148 / 84) = 0.566396. The preset has 0.74 leak events per second at grey 128.
        assert!((law.drift(logs, 0.0, 0.0) - 5.265 * 0.566_395).abs() < 1e-5);
        assert!((law.drift(0.0, 1e6, 128e6) - 0.74).abs() < 1e-12);
    }

    #[test]
    fn sensors_whose_noise_moves_the_level_balance_nothing() {
        use crate::sensor::noise::RefractoryPeriod;
        use crate::sensor::v2e::{V2eModel, V2ePreset};
        let voltmeter = VoltmeterModel::new([5.265, 20.0, 1e-4, 1e-7, 5e-9, 1e-5]);
        let official = VoltmeterModel { law: SamplerKind::Official, ..voltmeter.clone() };
        let dead = EsimModel {
            refractory: RefractoryPeriod { period_us: 1.0, ..RefractoryPeriod::default() },
            ..EsimModel::default()
        };
        let t = |sensor: SensorChoice, balance: bool, drift: bool| {
            assert_eq!(
                (require_balance(&sensor).is_ok(), DriftLaw::for_sensor(&sensor).is_ok()),
                (balance, drift),
                "{sensor:?}"
            );
        };
        t(SensorChoice::Voltmeter(voltmeter), true, true);
        t(SensorChoice::Voltmeter(official), false, false);
        t(SensorChoice::Esim(EsimModel::default()), true, true);
        t(SensorChoice::Esim(dead), false, false);
        t(SensorChoice::V2e(V2eModel::from(V2ePreset::Clean)), true, false);
        t(SensorChoice::V2e(V2eModel::from(V2ePreset::Noisy)), false, false);
    }

    #[test]
    fn an_ideal_logarithm_drifts_by_its_own() {
        let law = DriftLaw::for_sensor(&SensorChoice::Esim(EsimModel::default())).unwrap();
        // ln(0.001 + 1) - ln(0.001), for any added constant.
        let logs = law.log_brightness(255.0) - law.log_brightness(0.0);
        assert!((law.drift(logs, 5.0, 1e3) - 6.908_754_779_3).abs() < 1e-9);
        assert!(law.thresholds.iter().all(|threshold| (threshold - 0.2).abs() < 1e-15));
    }
}
