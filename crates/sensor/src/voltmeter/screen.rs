//! Predictions for a parameter set of the voltmeter: ranges, noise at constant grey, refusals.

use super::{BetweenFrames, DriftGain, InitialVoltage, SamplerKind, VoltmeterModel};
use crate::SensorSettings;
use crate::noise::{ReferenceRule, RefractoryPeriod};
use crate::screening::{ConstantLightNoise, ScreenError, at_least_zero, standard_normal_mean};
use crate::statistics::RenewalProcess;
use crate::statistics::receptor_rate::ReceptorRate;
use std::f64::consts::{FRAC_1_SQRT_2, TAU};

impl VoltmeterModel {
    /// The behaviour of a pixel with nominal thresholds at this constant grey, without the noise
    /// floor.
    #[must_use]
    pub fn noise(&self, grey: f64) -> ConstantLightNoise {
        let pairs = self.receptor_pairs(grey, 0.0);
        self.noise_of([self.threshold_on, self.threshold_off], grey).plus([pairs, pairs])
    }

    /// Rates of ON and OFF events by the photoreceptor's noise at this grey, Hz: the mean over pixels with
    /// unequal amplitudes and thresholds.
    #[must_use]
    pub fn receptor_hz(&self, grey: f64) -> [f64; 2] {
        [self.receptor_pairs(grey, self.threshold_spread); 2]
    }

    pub(super) fn noise_of(&self, [up, down]: [f64; 2], grey: f64) -> ConstantLightNoise {
        let [_, k2, k3, k4, k5, k6] = self.k;
        let sigma = k3 * grey.sqrt() / (grey + k2) + k6;
        let drift = k4 + k5 * grey;
        let renewal = RenewalProcess { drift, variance: sigma * sigma, up, down };
        // A leak against the sign of the ON threshold makes OFF events.
        let leak = drift / if drift < 0.0 { down } else { up };
        let share = renewal.on_share();
        ConstantLightNoise {
            grey,
            leak_hz: PER_SECOND * leak,
            total_hz: PER_SECOND * renewal.rate(),
            on_share: (!share.is_nan()).then_some(share),
        }
    }

    /// Rate of ON events, and of OFF events, by the photoreceptor's noise, Hz: the mean over pixels whose
    /// thresholds have this deviation.
    fn receptor_pairs(&self, grey: f64, of_thresholds: f64) -> f64 {
        let noise = &self.photoreceptor_noise;
        if noise.is_absent() {
            return 0.0;
        }
        let (up, down) = (self.threshold_on, self.threshold_off);
        let drift = self.k[3] + self.k[4] * grey;
        let point = noise.at_grey(grey, self.settings.front_end.white_lux());
        let theta = TAU * point.cutoff_hz;
        // Sum and difference of the thresholds are independent. The noise is felt in thresholds, so their sum
        // and the amplitude act as one.
        let apart = of_thresholds * FRAC_1_SQRT_2;
        let spread = libm::hypot(noise.spread, apart / (0.5 * (up + down)));
        standard_normal_mean(|z| {
            let deviation = self.k[0] * point.deviation * libm::exp(spread * z);
            let rate = ReceptorRate { deviation, theta, up, down };
            if drift == 0.0 && self.initial == InitialVoltage::Zero {
                // The pixel keeps the noise of the first frame as its reference.
                return standard_normal_mean(|start| rate.pairs((deviation * start).clamp(-down, up)));
            }
            let leak = PER_SECOND * drift;
            // Without a leak, a difference of the thresholds moves the voltages, but not their distribution.
            if drift == 0.0 || apart == 0.0 {
                return rate.at_rest(leak).pairs;
            }
            // Three points of Gauss and Hermite.
            [(-SQRT_3, 1.0 / 6.0), (0.0, 2.0 / 3.0), (SQRT_3, 1.0 / 6.0)].into_iter().fold(
                0.0,
                |mean, (z, weight)| {
                    let rate = ReceptorRate { up: up + z * apart, down: down - z * apart, ..rate };
                    mean + weight * rate.at_rest(leak).pairs
                },
            )
        })
    }

    /// Checks that the law supports the settings other than `k` and the thresholds.
    pub(super) fn validate_options(&self) -> Result<(), ScreenError> {
        let SensorSettings { refractory, front_end, .. } = self.settings;
        at_least_zero("threshold.spread", self.threshold_spread)?;
        self.settings.validate()?;
        self.floor.validate()?;
        if !self.floor.is_absent() && front_end.lux.is_none() {
            return Err(ScreenError::Combination("`floor` requires `front_end.lux`, the light of white"));
        }
        self.photoreceptor_noise.validate()?;
        if self.photoreceptor_noise.follows_light() && front_end.lux.is_none() {
            let found =
                "`photoreceptor_noise` with several points requires `front_end.lux`, the light of white";
            return Err(ScreenError::Combination(found));
        }
        if self.law == SamplerKind::Official && !self.photoreceptor_noise.is_absent() {
            return Err(ScreenError::Combination("`photoreceptor_noise` requires `law: exact`"));
        }
        self.validate_bandwidth()?;
        let RefractoryPeriod { period_us, reference } = refractory;
        if period_us > 0.0 && (period_us < 1.0 || reference != ReferenceRule::Passing) {
            return Err(ScreenError::Combination(
                "`refractory` of a voltmeter requires a period of at least 1 us and `reference: passing`",
            ));
        }
        if self.law == SamplerKind::Official && self.initial == InitialVoltage::Stationary {
            return Err(ScreenError::Combination("`law: official` requires all voltages to start at zero"));
        }
        if self.law == SamplerKind::Official && self.between != BetweenFrames::Linear {
            return Err(ScreenError::Combination("`law: official` requires `between: linear`"));
        }
        Ok(())
    }

    fn validate_bandwidth(&self) -> Result<(), ScreenError> {
        self.bandwidth.validate()?;
        if self.bandwidth.is_absent() {
            return Ok(());
        }
        if self.bandwidth.follows_light() && self.settings.front_end.lux.is_none() {
            let found = "`bandwidth` with several points requires `front_end.lux`, the light of white";
            return Err(ScreenError::Combination(found));
        }
        if self.law == SamplerKind::Official {
            return Err(ScreenError::Combination("`bandwidth` requires `law: exact`"));
        }
        if self.gain == DriftGain::Midpoint {
            return Err(ScreenError::Combination("`bandwidth` requires `gain: log`"));
        }
        Ok(())
    }
}

/// Place of a point of Gauss and Hermite, in standard deviations.
const SQRT_3: f64 = 1.732_050_807_568_877_2;
/// Microseconds per second: rates of the published program are per microsecond.
const PER_SECOND: f64 = 1e6;

#[cfg(test)]
mod tests {
    use super::super::VoltmeterPreset;
    use super::super::units::{ConstantUnits, TimeUnit, WhiteBrightness};
    use super::*;
    use crate::SensorParameters as _;
    use crate::screening::ScreeningWarning;
    use gs2e_num::units::Hertz;

    const PRINTED: [f64; 6] = [0.5, 1e-3, 0.1, 0.01, 0.1, 1e-5];

    fn rate() -> Hertz {
        Hertz("2400".parse().unwrap())
    }

    fn reading(time: TimeUnit, brightness: WhiteBrightness) -> VoltmeterModel {
        VoltmeterModel::new(ConstantUnits { time, brightness }.to_official(PRINTED))
    }

    /// Relative tolerance of a figure given to two digits or more: half of its last digit.
    fn near(found: f64, wanted: f64, relative: f64) {
        assert!((found - wanted).abs() <= relative * wanted, "{found:e}, wanted {wanted:e}");
    }

    #[test]
    fn contrast_and_leak_of_the_presets() {
        // The published presets, to the digits given.
        let t = |preset: VoltmeterPreset, contrast: f64, leaks: [f64; 5]| {
            let screening = VoltmeterModel::new(preset.k()).screen(rate()).unwrap();
            near(screening.contrast[0], contrast, 3e-3);
            for (noise, leak) in screening.noise.iter().zip(leaks) {
                near(noise.leak_hz, leak, 0.05);
            }
        };
        t(VoltmeterPreset::Dvs346, 0.190, [0.10, 0.18, 0.42, 0.74, 1.375]);
        t(VoltmeterPreset::Dvs240, 0.226, [0.10, 0.90, 3.3, 6.5, 12.85]);
        t(VoltmeterPreset::Gs2eSi, 2.0, [0.010, 0.016, 0.035, 0.060, 0.11]);
    }

    #[test]
    fn noise_of_gs2e_si() {
        // Rates of the printed set, read as seconds and brightness 0..1.
        let sensor = VoltmeterModel::new(VoltmeterPreset::Gs2eSi.k());
        let t = |grey, hz, share: f64| {
            let noise = sensor.noise(grey);
            near(noise.total_hz, hz, 0.02);
            near(noise.on_share.unwrap(), share, 0.01);
        };
        t(1.0, 1.62, 0.503);
        t(2.0, 1.00, 0.505);
        t(8.0, 0.30, 0.52);
        t(32.0, 0.081, 0.64);
        t(64.0, 0.049, 0.855);
        t(128.0, 0.0605, 0.998);
        t(255.0, 0.11, 1.0);
    }

    #[test]
    fn readings_of_the_printed_set() {
        // The readings of the GS2E set: noise at greys 1, 16 and 128, and whether a sensor can have
        // it.
        let t = |time, brightness, hz: [f64; 3], usable: bool| {
            let sensor = reading(time, brightness);
            for (grey, hz) in [1.0, 16.0, 128.0].into_iter().zip(hz) {
                near(sensor.noise(grey).total_hz, hz, 0.04);
            }
            assert_eq!(sensor.screen(rate()).is_ok(), usable, "{time:?} {brightness:?}");
        };
        t(TimeUnit::Us, WhiteBrightness::Grey255, [1.1e5, 1.6e6, 1.28e7], false);
        t(TimeUnit::Us, WhiteBrightness::Unit, [1.6e6, 1.6e5, 6.0e4], false);
        t(TimeUnit::Ms, WhiteBrightness::Grey255, [110.0, 1610.0, 12810.0], true);
        t(TimeUnit::Ms, WhiteBrightness::Unit, [1619.0, 155.0, 60.0], true);
        t(TimeUnit::S, WhiteBrightness::Grey255, [0.11, 1.6, 12.8], true);
        t(TimeUnit::S, WhiteBrightness::Unit, [1.62, 0.155, 0.060], true);
    }

    #[test]
    fn the_refusal_names_grey_and_rate() {
        let error = reading(TimeUnit::Us, WhiteBrightness::Grey255).screen(rate()).unwrap_err();
        assert!(error.to_string().starts_with("a static pixel of grey 255 would make 255100"), "{error}");
        // 25.5 kHz at grey 255 are 10.6 events in a frame interval of 1/2400 s and 510 in one of
        // 1/50 s.
        let slow = reading(TimeUnit::Ms, WhiteBrightness::Grey255).screen(Hertz("50".parse().unwrap()));
        assert!(
            matches!(slow, Err(ScreenError::Impossible { per_frame, .. }) if (509.0..511.0).contains(&per_frame))
        );
    }

    #[test]
    fn warnings() {
        let codes = |sensor: VoltmeterModel| sensor.screen(rate()).unwrap().warnings;
        let one_polarity = ScreeningWarning::OnePolarity { lacks_off: true };
        assert_eq!(codes(VoltmeterPreset::Dvs346.model()), [one_polarity]);
        for preset in [VoltmeterPreset::Evk4, VoltmeterPreset::Davis346] {
            assert_eq!(codes(preset.model()), []);
        }
        assert_eq!(
            codes(VoltmeterModel::new(VoltmeterPreset::Gs2eSi.k())),
            [ScreeningWarning::UncertainUnits]
        );
        let noisy = codes(reading(TimeUnit::Ms, WhiteBrightness::Unit));
        assert!(matches!(noisy[..], [ScreeningWarning::Noisy { hz }] if hz > 59.0));
    }

    #[test]
    fn parameters_out_of_range_are_named() {
        let t = |change: fn(&mut VoltmeterModel), message: &str| {
            let mut sensor = VoltmeterModel::new(VoltmeterPreset::Dvs346.k());
            change(&mut sensor);
            assert_eq!(sensor.validate().unwrap_err().to_string(), message);
        };
        t(|s| s.k[0] = 0.0, "k1 is 0, not a finite number above 0");
        t(|s| s.k[1] = f64::NAN, "k2 is NaN, not a finite number above 0");
        t(|s| s.k[2] = -1.0, "k3 is -1, not a finite number of at least 0");
        t(|s| s.k[4] = f64::INFINITY, "k5 is inf, not a finite number");
        t(|s| s.threshold_off = -0.5, "threshold.off is -0.5, not a finite number above 0");
        t(|s| s.settings.max_events_per_pixel_frame = 0, "max_events_per_pixel_frame is 0, not at least 1");
    }

    #[test]
    fn the_table_is_for_people() {
        let table = VoltmeterModel::new(VoltmeterPreset::Dvs346.k()).screen(rate()).unwrap().to_string();
        let lines: Vec<&str> = table.lines().collect();
        assert_eq!(lines[0], "contrast C: ON 0.1899 (brightness x1.209), OFF 0.1899 (x0.827)");
        assert_eq!(lines[2], "    0     0.1000     0.1000    1.000");
        assert_eq!(lines.len(), 7);
    }
}
