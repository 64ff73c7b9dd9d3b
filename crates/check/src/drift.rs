//! The drift of a pixel's voltage between two frames, by the sensor's law.

mod error;
mod light_table;
mod noise;

pub use error::FrameRounding;
pub(crate) use error::length;
use gs2e_sensor::SensorChoice;
use gs2e_sensor::esim::{EsimModel, IntensityScale};
use gs2e_sensor::noise::HotPixelNoise;
use gs2e_sensor::v2e::{V2eModel, lin_log};
use gs2e_sensor::voltmeter::{BetweenFrames, DriftGain, InitialVoltage, SamplerKind, VoltmeterModel};
use light_table::LightTable;
use noise::ShotNoise;
use std::f64::consts::TAU;

/// The deterministic part of a sensor's law: `D(t) = k1 f(L) + integral of (k4 + k5 L)`, in
/// microseconds and greys, with `f(L) = ln(L + k2)` or another brightness scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriftLaw {
    k: [f64; 6],
    scale: BrightnessScale,
    /// Thresholds of ON and OFF events.
    pub thresholds: [f64; 2],
    /// Standard deviation of the thresholds over the pixels.
    pub spread: f64,
    /// Relative standard deviation of the leak over pixels and frames.
    leak_spread: f64,
    /// True if all voltages are 0 at the first frame. Otherwise they lie anywhere between the
    /// thresholds.
    pub from_zero: bool,
    /// The noise of a v2e pixel, which replaces `k3` and `k6`.
    shots: Option<ShotNoise>,
    /// ON and OFF events per second of the noise floor of a voltmeter, if it has one.
    floor: Option<LightTable<2>>,
    /// Standard deviation of the photoreceptor's noise in thresholds, its events per second, and its variance
    /// per microsecond of the time in which it returns, if there is any.
    receptor: Option<LightTable<3>>,
    /// Pixels with events of their own.
    hot: HotPixelNoise,
    /// The reason why events need not balance the drift, if there is one. Signs and places can
    /// still be compared.
    pub loose: Option<&'static str>,
    /// Delay of the events of a pixel of medium brightness by a filter, us; 0 without a filter.
    pub delay_us: f64,
    /// The rounding of the frames, if they are pictures of 8 bits.
    pub rounding: Option<FrameRounding>,
}

/// The brightness that a pixel compares, as a function of its grey.
#[derive(Debug, Clone, Copy, PartialEq)]
enum BrightnessScale {
    /// `ln(L + k2)`.
    Log,
    /// `L / 255`.
    Linear,
    /// Linear up to a grey of 20, and the logarithm above.
    LinLog,
}

impl DriftLaw {
    /// The law of a sensor.
    #[must_use]
    pub fn for_sensor(sensor: &SensorChoice) -> Self {
        let law = match sensor {
            SensorChoice::Voltmeter(voltmeter) => of_voltmeter(voltmeter),
            SensorChoice::Esim(esim) => of_esim(esim),
            SensorChoice::V2e(v2e) => of_v2e(v2e),
        };
        let law = Self { hot: sensor.hot_pixels(), ..law };
        let law = match sensor.latency() {
            Some(latency) => {
                let lux = sensor.as_model().front_end().white_lux() * MEDIUM / 255.0;
                Self {
                    loose: law.loose.or(Some(LATE)),
                    delay_us: law.delay_us + latency.mean_us(lux).max(latency.jitter_us),
                    ..law
                }
            }
            None => law,
        };
        match sensor.readout() {
            Some(bus) => {
                // The longest wait: a full queue, or an event of each pixel of a usual sensor. Millions of
                // events per second are events per microsecond.
                let waiting = bus.queue.map_or(TYPICAL_PIXELS, |queue| queue as f64) + 1.0;
                Self { loose: Some(READ_LATE), delay_us: law.delay_us.max(waiting / bus.rate_mev_s), ..law }
            }
            None => law,
        }
    }

    /// The law by which frames predict the times of single events.
    ///
    /// # Errors
    /// The frames do not determine these times; the text is the reason.
    pub fn for_crossings(sensor: &SensorChoice) -> Result<Self, &'static str> {
        let because = match sensor {
            _ if sensor.readout().is_some() => Some(READ_LATE),
            _ if sensor.latency().is_some() => Some(LATE),
            SensorChoice::V2e(_) => {
                Some("not applicable to v2e, whose filter and thresholds move the times of events")
            }
            SensorChoice::Voltmeter(VoltmeterModel { law: SamplerKind::Official, .. }) => Some(OFFICIAL),
            SensorChoice::Voltmeter(VoltmeterModel { gain: DriftGain::Midpoint, .. }) => Some(MIDPOINT),
            SensorChoice::Voltmeter(voltmeter) if !voltmeter.bandwidth.is_absent() => Some(DELAYED),
            SensorChoice::Voltmeter(voltmeter) => (voltmeter.between != BetweenFrames::Linear).then_some(
                "brightness is not linear between frames (`sampling.between`), so crossing times are not known well",
            ),
            SensorChoice::Esim(esim) if esim.intensity == IntensityScale::Linear => {
                Some("not applicable to `intensity: linear`: the check needs a log-brightness sensor")
            }
            SensorChoice::Esim(esim) => lost_events(esim),
        };
        because.map_or_else(|| Ok(Self::for_sensor(sensor)), Err)
    }

    /// Returns true if the events of a pixel state its voltage: all pixels have the stated thresholds,
    /// and every event comes from the drift.
    #[must_use]
    pub(crate) fn keeps_levels(&self) -> bool {
        self.spread <= 0.0 && self.floor.is_none() && self.receptor.is_none() && self.loose.is_none()
    }

    /// Returns true if the events of a pixel show the sign of its drift `dv`, although some may be lost.
    ///
    /// Let the drift be `n` thresholds, with at most `2 n` events. If these have the wrong sign, at most `n`
    /// go along with the drift. At least `n` more did, because those against it are as many. So the sensor
    /// lost at least half of them, and a dead time loses far fewer.
    #[must_use]
    pub(crate) fn shows_sign(&self, dv: f64, counts: [u32; 2]) -> bool {
        let [on, off] = counts.map(f64::from);
        self.loose.is_none() || (on + off) * self.least_threshold() <= 2.0 * dv.abs()
    }

    /// The law for frames that are known to 8 bits only.
    #[must_use]
    pub fn with_rounding(self, rounding: FrameRounding) -> Self {
        Self { rounding: Some(rounding), ..self }
    }

    /// The largest difference between a pixel's drift and its events without noise: the remaining
    /// voltage minus the initial voltage.
    #[must_use]
    pub(crate) fn most_residual(&self) -> f64 {
        let [on, off] = self.thresholds;
        // From zero, the remaining voltage is the whole difference. Otherwise the initial voltage
        // may lie at the opposite threshold.
        if self.from_zero { on.max(off) } else { on + off }
    }

    /// The smaller of both thresholds.
    #[must_use]
    pub(crate) fn least_threshold(&self) -> f64 {
        self.thresholds[0].min(self.thresholds[1])
    }

    /// `f(L)`, the brightness of a luminance; negative luminance counts as 0.
    #[must_use]
    pub fn brightness(&self, luminance: f32) -> f64 {
        self.brightness_of(f64::from(luminance).max(0.0))
    }

    fn brightness_of(&self, luminance: f64) -> f64 {
        match self.scale {
            BrightnessScale::Log => libm::log(luminance + self.k[1]),
            BrightnessScale::Linear => luminance / 255.0,
            BrightnessScale::LinLog => lin_log(luminance),
        }
    }

    /// The drift for a change of `f(L)` by `change` in `dt_us` microseconds, with an integral of
    /// luminance of `exposure` grey-microseconds.
    #[must_use]
    pub fn drift(&self, change: f64, dt_us: f64, exposure: f64) -> f64 {
        self.k[0] * change + self.k[3] * dt_us + self.k[4] * exposure
    }
}

const fn quiet_law(k: [f64; 6], scale: BrightnessScale, thresholds: [f64; 2]) -> DriftLaw {
    DriftLaw {
        k,
        scale,
        thresholds,
        spread: 0.0,
        leak_spread: 0.0,
        from_zero: true,
        shots: None,
        floor: None,
        receptor: None,
        hot: HotPixelNoise { share: 0.0, rate: 0.0, spread: 0.0 },
        loose: None,
        delay_us: 0.0,
        rounding: None,
    }
}

/// Returns true if a sensor makes the same events from frames of any rate that show the same light. The
/// noise floor, hot pixels and the dead time of a voltmeter follow time and light, not frames.
#[must_use]
pub fn is_frame_independent(sensor: &SensorChoice) -> bool {
    match sensor {
        // A bus that is busy makes much of small differences.
        _ if sensor.readout().is_some() => false,
        SensorChoice::Voltmeter(sensor) => sensor.law == SamplerKind::Exact && sensor.gain == DriftGain::Log,
        SensorChoice::Esim(sensor) => sensor.intensity == IntensityScale::Log && sensor.keeps_references(),
        // Its leak is drawn per frame.
        SensorChoice::V2e(_) => false,
    }
}

fn of_voltmeter(sensor: &VoltmeterModel) -> DriftLaw {
    let loose = match (sensor.law, sensor.gain) {
        (SamplerKind::Official, _) => Some(OFFICIAL),
        (_, DriftGain::Midpoint) => Some(MIDPOINT),
        _ if !sensor.settings.hot_pixels.is_absent() => Some(HOT),
        _ if sensor.settings.refractory.period_us > 0.0 => Some(DEAD),
        _ if !sensor.bandwidth.is_absent() => Some(DELAYED),
        _ => None,
    };
    let white_lux = sensor.settings.front_end.white_lux();
    DriftLaw {
        floor: (!sensor.floor.is_absent())
            .then(|| LightTable::new(|grey| sensor.floor.rates_at_grey(grey, white_lux))),
        receptor: (!sensor.photoreceptor_noise.is_absent())
            .then(|| LightTable::new(|grey| receptor_values(sensor, grey))),
        spread: sensor.threshold_spread,
        from_zero: sensor.initial == InitialVoltage::Zero,
        loose,
        delay_us: 1e6 * sensor.bandwidth.delay_seconds(white_lux * MEDIUM / 255.0),
        ..quiet_law(sensor.k, BrightnessScale::Log, [sensor.threshold_on, sensor.threshold_off])
    }
}

/// The values of [`DriftLaw::receptor`] at a grey, in thresholds of `k`. The deviation is that of a
/// pixel among the noisiest 2 %.
fn receptor_values(sensor: &VoltmeterModel, grey: f64) -> [f64; 3] {
    let noise = &sensor.photoreceptor_noise;
    let point = noise.at_grey(grey, sensor.settings.front_end.white_lux());
    let largest = sensor.k[0] * point.deviation * libm::exp(2.0 * noise.spread);
    // The noise returns at `2 pi cutoff` per second.
    let returning = 1e-6 * TAU * point.cutoff_hz;
    [largest, sensor.receptor_hz(grey).iter().sum(), largest * largest * returning]
}

/// The grey whose delay represents all greys.
const MEDIUM: f64 = 64.0;
const OFFICIAL: &str = "not applicable to `law: official`: it redraws the remaining voltage at each frame, so events need not match the drift";
const MIDPOINT: &str =
    "not applicable to `gain: midpoint`: its drift depends on every frame, and only some frames are kept";
const HOT: &str = "not applicable with hot pixels: they fire without a brightness change";
const DELAYED: &str =
    "not applicable with a low-pass filter: events follow the frames with a delay of their own";
/// Pixels of a sensor whose size is not known, rounded: a DAVIS346 has 89,960.
const TYPICAL_PIXELS: f64 = 1e5;
const READ_LATE: &str = "not applicable behind a readout of limited rate: events are late, and some are lost";
const LATE: &str = "not applicable with a latency: events are late, by different times";
const DEAD: &str = "not applicable with a dead time: events need not match the brightness change";
const REDRAWN: &str =
    "not applicable with thresholds drawn per frame: events need not match the brightness change";
const CAPPED: &str = "not applicable with an allowed cap: events need not match the brightness change";

/// Without noise, the reference of a pixel moves like the voltage of a voltmeter with `k1 = 1` and
/// `k2` equal to `eps` on the grey scale.
fn of_esim(esim: &EsimModel) -> DriftLaw {
    let EsimModel { threshold, intensity, eps, .. } = esim;
    let scale = match intensity {
        IntensityScale::Log => BrightnessScale::Log,
        IntensityScale::Linear => BrightnessScale::Linear,
    };
    let loose = match esim.settings.hot_pixels.is_absent() {
        false => Some(HOT),
        true => lost_events(esim),
    };
    // `ln(L/255 + eps)` and `ln(L + 255 eps)` differ by a constant, which no change shows.
    let k = [1.0, 255.0 * eps, 0.0, 0.0, 0.0, 0.0];
    DriftLaw { spread: threshold.spread, loose, ..quiet_law(k, scale, [threshold.on, threshold.off]) }
}

/// The setting that loses events, or moves references without events.
fn lost_events(esim: &EsimModel) -> Option<&'static str> {
    match esim {
        _ if esim.keeps_references() => None,
        _ if esim.settings.refractory.period_us > 0.0 => Some(DEAD),
        _ if esim.settings.allow_cap => Some(CAPPED),
        _ => Some(REDRAWN),
    }
}

/// Without its filter, a pixel of v2e moves like an ideal logarithm with a leak of `C+` per event.
fn of_v2e(v2e: &V2eModel) -> DriftLaw {
    let delayed = v2e.cutoff > 0.0;
    let loose = match (delayed, v2e.settings.hot_pixels.is_absent()) {
        (true, _) => Some(DELAYED),
        (false, false) => Some(HOT),
        (false, true) if v2e.settings.refractory.period_us > 0.0 => Some(DEAD),
        (false, true) => v2e.settings.allow_cap.then_some(CAPPED),
    };
    let leak = v2e.leak;
    // A threshold per event, per microsecond.
    let k4 = 1e-6 * leak.rate * v2e.threshold.on;
    let k = [1.0, 0.0, 0.0, k4, 0.0, 0.0];
    let shots = ShotNoise { dark_hz: v2e.shot, leak_hz: leak.rate };
    DriftLaw {
        spread: v2e.threshold.spread,
        // The rate is log-normal over the pixels, with this standard deviation of its logarithm.
        leak_spread: libm::hypot(leak.cov * std::f64::consts::LN_10, leak.jitter),
        shots: Some(shots),
        loose,
        delay_us: if delayed { 1e6 * v2e.filter_seconds(MEDIUM) } else { 0.0 },
        ..quiet_law(k, BrightnessScale::LinLog, [v2e.threshold.on, v2e.threshold.off])
    }
}

/// Requires that a sensor's events balance the change of each pixel's brightness. The sensor's
/// account states this for every pixel.
///
/// # Errors
/// The events of this sensor need not balance; the text is the reason.
pub(crate) fn require_balance(sensor: &SensorChoice) -> Result<(), &'static str> {
    match sensor {
        SensorChoice::Voltmeter(VoltmeterModel { law: SamplerKind::Official, .. }) => Err(OFFICIAL),
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
    use gs2e_sensor::SensorSettings;
    use gs2e_sensor::front_end::{ChannelDecode, FrontEnd};
    use std::f64::consts::LN_10;

    fn preset() -> DriftLaw {
        quiet_law([5.265, 20.0, 1e-4, 1e-7, 5e-9, 1e-5], BrightnessScale::Log, [1.0; 2])
    }

    #[test]
    fn noise_is_largest_where_luminance_is_k2() {
        let law = preset();
        let most = law.most_noise(1e4);
        for luminance in [0.0, 1.0, 10.0, 19.0, 21.0, 40.0, 128.0, 255.0] {
            assert!(law.noise(luminance, 1e4) < most, "{luminance}");
        }
    }

    #[test]
    fn a_brighter_pixel_drifts_by_the_logarithm_and_leaks() {
        let law = preset();
        let logs = law.brightness(128.0) - law.brightness(64.0);
        // ln(148 / 84) = 0.566396. The preset has 0.74 leak events per second at grey 128.
        assert!((law.drift(logs, 0.0, 0.0) - 5.265 * 0.566_395).abs() < 1e-5);
        assert!((law.drift(0.0, 1e6, 128e6) - 0.74).abs() < 1e-12);
    }

    /// The sensor behind a filter of 100 Hz.
    fn filtered(sensor: &VoltmeterModel) -> VoltmeterModel {
        use gs2e_sensor::bandwidth::{BandwidthPoint, PixelBandwidth};
        let points = vec![BandwidthPoint { lux: 1.0, cutoff_hz: 100.0 }];
        VoltmeterModel { bandwidth: PixelBandwidth { order: 2, points }, ..sensor.clone() }
    }

    #[test]
    fn a_filter_delays_and_hides_no_other_reason() {
        let paper = VoltmeterModel::new([5.265, 20.0, 1e-4, 1e-7, 5e-9, 1e-5]);
        let law = |sensor: VoltmeterModel| DriftLaw::for_sensor(&sensor.into());
        let slow = law(filtered(&paper));
        assert_eq!(slow.loose, Some(DELAYED));
        // Two time constants of 100 Hz.
        assert!((slow.delay_us - 2e6 / (std::f64::consts::TAU * 100.0)).abs() < 1e-9);
        assert_eq!(law(filtered(&gs2e_sensor::voltmeter::VoltmeterPreset::Evk4.model())).loose, Some(DEAD));
        let at_once = SensorChoice::from(filtered(&paper)).without_bandwidth();
        assert_eq!(DriftLaw::for_sensor(&at_once), law(paper));
    }

    #[test]
    fn sensors_whose_noise_moves_the_level_balance_nothing() {
        use gs2e_sensor::noise::RefractoryPeriod;
        use gs2e_sensor::v2e::{V2eModel, V2ePreset};
        let voltmeter = VoltmeterModel::new([5.265, 20.0, 1e-4, 1e-7, 5e-9, 1e-5]);
        let official = VoltmeterModel { law: SamplerKind::Official, ..voltmeter.clone() };
        let slow = filtered(&voltmeter);
        let dead = EsimModel {
            settings: SensorSettings {
                refractory: RefractoryPeriod { period_us: 1.0, ..RefractoryPeriod::default() },
                ..SensorSettings::default()
            },
            ..EsimModel::default()
        };
        let t = |sensor: SensorChoice, balance: bool, drift: bool| {
            assert_eq!(
                (require_balance(&sensor).is_ok(), DriftLaw::for_sensor(&sensor).loose.is_none(),),
                (balance, drift),
                "{sensor:?}"
            );
        };
        t(SensorChoice::Voltmeter(voltmeter), true, true);
        t(SensorChoice::Voltmeter(official), false, false);
        t(SensorChoice::Voltmeter(slow), true, false);
        t(SensorChoice::Esim(EsimModel::default()), true, true);
        t(SensorChoice::Esim(dead), false, false);
        t(SensorChoice::V2e(V2eModel::from(V2ePreset::Clean)), true, true);
        t(SensorChoice::V2e(V2eModel::from(V2ePreset::Noisy)), false, false);
    }

    #[test]
    fn drawn_pixels_exceed_their_bound_as_often_as_stated() {
        use crate::planted::SplitMixDraws;
        let law = DriftLaw { spread: 0.157, ..preset() };
        let mut draws = SplitMixDraws(8);
        for n in [1, 5, 20] {
            let trials = 400_000;
            let beyond = (0..trials).filter(|_| {
                // A pixel that rose evenly to anywhere between two events.
                let own = 1.0 + 0.157 * draws.normal();
                let drift = (f64::from(n) + draws.share()) * own;
                drift - f64::from(n) > 1.0 + law.spread_error([n, 0])
            });
            let (found, stated) =
                (beyond.count() as f64, law.beyond_spread_error([n, 0]) * f64::from(trials));
            println!("{n}: {found} beyond, {stated:.1} stated");
            // A bound, to four standard deviations of a count, and not a wide one.
            assert!(found <= stated + 4.0 * stated.sqrt() && stated <= 2.0 * found + 20.0, "{n}");
        }
        assert!(preset().beyond_spread_error([3, 2]) <= 0.0);
    }

    #[test]
    fn times_of_events_need_a_law_of_the_logarithm() {
        use gs2e_sensor::voltmeter::VoltmeterPreset;
        let t = |sensor: SensorChoice, crossings: bool, levels: bool, frames: bool| {
            let law = DriftLaw::for_crossings(&sensor);
            assert_eq!(law.is_ok(), crossings, "{sensor:?}");
            assert_eq!(law.is_ok_and(|law| law.keeps_levels()), levels, "{sensor:?}");
            assert_eq!(is_frame_independent(&sensor), frames, "{sensor:?}");
        };
        t(VoltmeterPreset::Davis346.model().into(), true, false, true);
        // Its dead time drops events, and says nothing of the frames.
        t(VoltmeterPreset::Evk4.model().into(), true, false, true);
        let paper = VoltmeterPreset::Dvs346.model();
        t(paper.clone().into(), true, true, true);
        t(VoltmeterModel { law: SamplerKind::Official, ..paper.clone() }.into(), false, false, false);
        t(filtered(&paper).into(), false, false, true);
        t(VoltmeterModel { between: BetweenFrames::Catmull, ..paper }.into(), false, false, true);
        t(SensorChoice::Esim(EsimModel::default()), true, true, true);
        t(
            SensorChoice::Esim(EsimModel {
                settings: SensorSettings { allow_cap: true, ..SensorSettings::default() },
                ..EsimModel::default()
            }),
            false,
            false,
            false,
        );
        t(gs2e_sensor::v2e::V2eModel::from(gs2e_sensor::v2e::V2ePreset::Clean).into(), false, false, false);
    }

    #[test]
    fn events_of_hot_pixels_scatter_as_they_are_drawn() {
        use crate::planted::SplitMixDraws;
        let model = EsimModel {
            settings: SensorSettings {
                hot_pixels: HotPixelNoise { share: 0.05, rate: 300.0, spread: 0.2 },
                ..SensorSettings::default()
            },
            ..EsimModel::default()
        };
        let law = DriftLaw::for_sensor(&model.into());
        assert!(law.hot_events(0.0, 1e4).iter().all(|events| *events <= 0.0));
        let [mean, deviation] = law.hot_events(400.0, 1e4);
        let mut draws = SplitMixDraws(3);
        let sums: Vec<f64> = (0..4000)
            .map(|_| {
                let hot = (0..400).filter(|_| draws.share() < 0.05).count();
                let mut sum = 0.0;
                for _ in 0..hot {
                    // The waiting times of a Poisson process.
                    let expected = 0.01 * 300.0 * (0.2 * LN_10 * draws.normal()).exp();
                    let mut waited = -draws.share().ln();
                    while waited < expected {
                        sum += 1.0;
                        waited -= draws.share().ln();
                    }
                }
                sum
            })
            .collect();
        let found = sums.iter().sum::<f64>() / 4000.0;
        let scatter = (sums.iter().map(|sum| (sum - found) * (sum - found)).sum::<f64>() / 4000.0).sqrt();
        // Four standard deviations of a mean; of a deviation, with room for the heavy tail.
        assert!((found - mean).abs() < 4.0 * deviation / 4000f64.sqrt(), "{found} for {mean}");
        assert!((scatter / deviation - 1.0).abs() < 0.08, "{scatter} for {deviation}");
    }

    #[test]
    fn an_ideal_logarithm_drifts_by_its_own() {
        let law = DriftLaw::for_sensor(&SensorChoice::Esim(EsimModel::default()));
        // ln(0.001 + 1) - ln(0.001), for any added constant.
        let logs = law.brightness(255.0) - law.brightness(0.0);
        assert!((law.drift(logs, 5.0, 1e3) - 6.908_754_779_3).abs() < 1e-9);
        assert!(law.thresholds.iter().all(|threshold| (threshold - 0.2).abs() < 1e-15));
    }

    #[test]
    fn a_step_of_eight_bits_costs_a_dark_pixel_most() {
        let sensor = SensorChoice::Esim(EsimModel::default());
        let front_end = FrontEnd::default();
        let law = DriftLaw::for_sensor(&sensor);
        assert_eq!(law.rounding_error(40.0).to_bits(), 0.0f64.to_bits());
        let law = law.with_rounding(FrameRounding { front_end, between: 0.0 });
        // ln(40.255 / 39.755), and ln(0.755 / 0.255) for black.
        assert!((law.rounding_error(40.0) - 0.012_498_6).abs() < 1e-6);
        assert!((law.rounding_error(0.0) - 1.085_453_8).abs() < 1e-6);
        // At white, linear light changes by 2.275 per display value (2.4 / 1.055).
        let linear = FrontEnd { decode: ChannelDecode::Srgb, ..front_end };
        let error = FrameRounding { front_end: linear, between: 0.0 }.error(255.0);
        assert!((error - 0.5 * 2.4 / 1.055).abs() < 0.01, "{error}");
    }

    #[test]
    fn a_v2e_pixel_leaks_one_threshold_per_event() {
        use gs2e_sensor::v2e::{LeakNoise, V2ePreset};
        let leak = LeakNoise { rate: 4.0, jitter: 0.0, cov: 0.0 };
        let v2e = V2eModel { leak, ..V2eModel::from(V2ePreset::Clean) };
        let law = DriftLaw::for_sensor(&SensorChoice::V2e(v2e));
        // Half a second of four events per second, at thresholds of 0.2.
        assert!((law.drift(0.0, 5e5, 0.0) - 0.4).abs() < 1e-12);
        assert!((law.noise_events(128.0) - 4e-6).abs() < 1e-18);
    }
}
