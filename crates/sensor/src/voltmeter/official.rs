//! The published sampler (Lin et al., ECCV 2022; Lynn0306/DVS-Voltmeter,
//! `src/simulator_utils.py`), for comparisons.
//!
//! Between two frames, drift and noise take their values at the middle. The polarity of a pixel's
//! next event is drawn first, with the probability of leaving through either barrier. The time to
//! that barrier is drawn next, as if the other did not exist. If it lies before the later frame, an
//! event happens and the voltage returns to 0. Otherwise the voltage moves along the straight line
//! to the barrier, and the polarity is forgotten. Event streams therefore depend on the frame rate,
//! and the noise is far from that of the process: the median waiting time is twice too long where
//! the drift is 0. The law `exact` has neither defect.
//!
//! Kept as published, although wrong: the midpoint gain, the polarity before the time, the
//! one-barrier times, the factor 2 in the time where the drift is 0, the truncated draw against the
//! drift, the straight residual, the initial voltage 0, and the sum of the terms of sigma.
//!
//! Changed where the published program breaks down: the polarity has its stable form (`0/0` became
//! ON); the inverse Gaussian is computed without cancellation; against the drift, where the
//! truncated draw underflows, the time is that of the opposite drift; a loop replaces a recursion;
//! times are 64-bit nanoseconds, not 32-bit microseconds; each draw belongs to seed, pixel and
//! frame; events of one microsecond have one order. Any addition to either list makes another law:
//! raise `VERSION`.

use super::drift::DriftProcess;
use super::{VoltmeterModel, thresholds};
use crate::label;
use crate::noise::poisson::{LinearRate, PoissonTrain};
use crate::noise::{HotPixelNoise, PixelSite};
use crate::pairs::{FrameLaw, PairWriter, PixelPair};
use crate::statistics::RenewalProcess;
use gs2e_event::{EventLabel, Polarity};
use gs2e_num::seed::{CellDraws, DrawSpace, normal};
use std::ops::ControlFlow;

/// Version of the law. Raise it when a draw or one of the lists above changes.
pub(super) const VERSION: u32 = 1;

/// The law.
#[derive(Debug)]
pub(super) struct OfficialSampler {
    process: DriftProcess,
    thresholds: [f64; 2],
    spread: f64,
    hot: HotPixelNoise,
    labels: bool,
}

/// State of one pixel.
#[derive(Debug)]
pub(super) struct OfficialPixel {
    voltage: f64,
    thresholds: [f64; 2],
    /// `ln(L + k2)` at the pixel's last event, or at the first frame before any event. Only for
    /// labelled events.
    log: f64,
    hot: PoissonTrain,
}

impl OfficialSampler {
    pub(super) fn new(sensor: &VoltmeterModel) -> Self {
        Self {
            process: DriftProcess::new(sensor),
            thresholds: [sensor.threshold_on, sensor.threshold_off],
            spread: sensor.threshold_spread,
            hot: sensor.settings.hot_pixels,
            labels: sensor.settings.labels,
        }
    }

    /// Drift and standard deviation of the noise between two frames, per ns and per root of a ns.
    fn motion(&self, pair: &PixelPair) -> [f64; 2] {
        let [from, to] = pair.luminance;
        [self.process.midpoint_drift([from, to], pair.length), self.process.sigma_of_one(0.5 * (from + to))]
    }

    /// Moves the voltage from frame to frame.
    fn walk(
        &self,
        pixel: &mut OfficialPixel,
        pair: &PixelPair,
        writer: &mut PairWriter<'_>,
    ) -> ControlFlow<()> {
        let [drift, sigma] = self.motion(pair);
        let mut draws = pair.site.draws(DrawSpace::Pair, pair.frame);
        let [up, down] = pixel.thresholds;
        let mut t = 0.0;
        loop {
            let x = pixel.voltage;
            // The exit of a path from 0 between barriers at the distances that are left.
            let exit = RenewalProcess { drift, variance: sigma * sigma, up: up - x, down: down + x };
            let on = draws.uniform() <= exit.on_share();
            let (distance, speed) = if on { (exit.up, drift) } else { (exit.down, -drift) };
            let tau = passage_time(distance, speed, sigma, &mut draws);
            // An event at the stamp of the later frame is left to the next pair.
            if t + tau >= pair.length {
                // A barrier that is never reached has an infinite `tau`, and the voltage stays.
                let way = distance * ((pair.length - t) / tau);
                pixel.voltage += if on { way } else { -way };
                return ControlFlow::Continue(());
            }
            t += tau;
            pixel.voltage = 0.0;
            let label = if self.labels { self.label(pixel, pair, t, on) } else { EventLabel::Signal };
            writer.event(t, if on { Polarity::On } else { Polarity::Off }, label)?;
        }
    }

    /// The label of an event `t` ns after the earlier frame. The logarithm is linear between the
    /// two frames.
    fn label(&self, pixel: &mut OfficialPixel, pair: &PixelPair, t: f64, on: bool) -> EventLabel {
        let DriftProcess { k1, k2, .. } = self.process;
        let [from, to] = pair.luminance.map(|luminance| libm::log(luminance + k2));
        let log = from + (to - from) * (t / pair.length);
        let rise = k1 * (log - pixel.log);
        pixel.log = log;
        let [up, down] = pixel.thresholds;
        if on { label::label_of(rise, up) } else { label::label_of(-rise, down) }
    }

    /// The events of a hot pixel's own process.
    fn hot_events(
        &self,
        pixel: &mut OfficialPixel,
        pair: &PixelPair,
        writer: &mut PairWriter<'_>,
    ) -> ControlFlow<()> {
        let rates = LinearRate { ends: [self.hot.per_ns(pair.site); 2], length: pair.length };
        let mut start = 0.0;
        while let Some(t) = pixel.hot.advance(&rates, start) {
            writer.event(t, Polarity::On, EventLabel::Noise)?;
            pixel.hot.wait(pair.site, DrawSpace::Hot);
            start = t;
        }
        ControlFlow::Continue(())
    }
}

impl FrameLaw for OfficialSampler {
    type Pixel = OfficialPixel;

    /// The drift follows the luminance itself.
    fn to_brightness(&self, _: &mut [f64]) {}

    fn begin(&self, site: PixelSite, luminance: f64, _: f64) -> OfficialPixel {
        let thresholds = thresholds::drawn_pair(self.thresholds, self.spread, site);
        let log = if self.labels { libm::log(luminance + self.process.k2) } else { 0.0 };
        OfficialPixel { voltage: 0.0, thresholds, log, hot: self.hot.train(site) }
    }

    fn cross(
        &self,
        pixel: &mut OfficialPixel,
        pair: &PixelPair,
        writer: &mut PairWriter<'_>,
    ) -> ControlFlow<()> {
        // Two independent processes. Their events are brought into order of time by the window.
        self.walk(pixel, pair, writer)?;
        self.hot_events(pixel, pair, writer)
    }

    /// The residual is drawn again in each frame, so the number of events and the drift diverge.
    fn imbalance(&self, _: &OfficialPixel, _: u32, _: u32) -> Option<f64> {
        None
    }
}

/// The published time to a barrier at `distance`, by a drift of `speed` towards it.
fn passage_time(distance: f64, speed: f64, sigma: f64, draws: &mut CellDraws) -> f64 {
    if distance <= 0.0 {
        return 0.0;
    }
    if sigma == 0.0 {
        // Without noise the drift alone decides. Away from it, the barrier is never reached.
        return if speed > 0.0 { distance / speed } else { f64::INFINITY };
    }
    let root = distance / sigma;
    let (shape, phi) = (root * root, root * (speed.abs() / sigma));
    // Against the drift, the normal draw lies beyond `2 sqrt(phi)` deviations.
    let underflows = 2.0 * phi.sqrt() > TRUNCATION;
    if speed == 0.0 {
        let z = draws.normal();
        // Twice the Lévy time `shape / z^2`, as published.
        2.0 * (root / z) * (root / z)
    } else if !(shape.is_finite() && phi.is_finite()) {
        // With next to no noise, the path is straight to all digits.
        distance / speed.abs()
    } else if speed > 0.0 || underflows {
        let (z, u) = (draws.normal(), draws.uniform());
        inverse_gaussian(shape, phi, z, u)
    } else {
        counter_drift_time(shape, phi, draws.uniform())
    }
}

/// Number of deviations beyond which a truncated normal draw has lost its digits.
const TRUNCATION: f64 = 8.0;

/// An inverse Gaussian time of shape `shape` and mean `shape / phi` from a normal and a uniform
/// draw, by Michael, Schucany and Haas (The American Statistician 30, 1976), in a form that adds
/// only numbers of like sign.
fn inverse_gaussian(shape: f64, phi: f64, z: f64, u: f64) -> f64 {
    let z = z.abs();
    let q = phi + 0.5 * z * z + z * (0.25 * z * z + phi).sqrt();
    if u * (q + phi) <= q { shape / q } else { shape / phi * (q / phi) }
}

/// [`inverse_gaussian`] for a negative mean and a normal draw below `-2 sqrt(phi)`, with `u` as its
/// share. The acceptance step then always takes the smaller root.
fn counter_drift_time(shape: f64, phi: f64, u: f64) -> f64 {
    let edge = 0.5 * libm::erfc(2.0 * phi.sqrt() / std::f64::consts::SQRT_2);
    // The quantile of 0 would be infinite.
    let z = normal::normal_quantile((edge * u).max(f64::MIN_POSITIVE));
    // Rounding may put the draw just inside the edge, and the root below would be NaN.
    let y = (z * z).max(4.0 * phi);
    // The smaller root, with a sum in the denominator instead of a difference in the numerator.
    2.0 * shape / ((y - 2.0 * phi) + (y * (y - 4.0 * phi)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::super::VoltmeterPreset;
    use super::*;
    use crate::frames::DenseFrame;
    use crate::{SensorError, SensorModel, SensorSettings, SimulationAccount};
    use gs2e_image::{Image, Size};
    use gs2e_num::seed::{Seed, SeedCell, ks};
    use gs2e_num::units::Timestamp;
    use gs2e_testing::rival;
    use std::f64::consts::SQRT_2;

    fn draws(index: u64) -> CellDraws {
        Seed(7).draws(SeedCell { x: 0, y: 0, level: 0, index }, DrawSpace::Pair)
    }

    /// For each phi, `1 + y/(2 phi) - sqrt(4 phi y + y^2)/(2 phi)` with `y = z^2` and z = 1e-6,
    /// 1e-3, 0.7 and 6: the smaller root as published, for mean 1, with 80 digits.
    #[expect(clippy::excessive_precision, reason = "17 digits name a double")]
    const ROOTS: [(f64, [f64; 4]); 8] = [
        (
            1e-12,
            [
                0.381_966_011_250_105_15,
                9.999_980_000_049_999_9e-7,
                2.040_816_326_522_282_4e-12,
                2.777_777_777_777_623_5e-14,
            ],
        ),
        (
            1e-8,
            [
                0.990_049_875_000_781_24,
                0.009_804_864_072_151_699_7,
                2.040_816_243_231_990_9e-8,
                2.777_777_776_234_567_9e-10,
            ],
        ),
        (
            1e-4,
            [
                0.999_900_004_999_875,
                0.904_875_078_027_496_07,
                0.000_203_998_376_502_516_85,
                2.777_762_345_786_178_9e-6,
            ],
        ),
        (
            1e-2,
            [
                0.999_990_000_049_999_87,
                0.990_049_875_000_781_24,
                0.019_615_387_518_186_051,
                0.000_277_623_563_874_193_01,
            ],
        ),
        (
            1.0,
            [
                0.999_999_000_000_5,
                0.999_000_499_875_000_01,
                0.503_363_296_485_401_82,
                0.026_334_038_989_724_008,
            ],
        ),
        (
            1e2,
            [
                0.999_999_900_000_005,
                0.999_900_004_999_875,
                0.932_407_138_122_432_49,
                0.553_581_609_465_366_99,
            ],
        ),
        (
            1e4,
            [
                0.999_999_990_000_000_05,
                0.999_990_000_049_999_87,
                0.993_024_457_125_131_3,
                0.941_773_006_072_267_79,
            ],
        ),
        (1e8, [0.999_999_999_9, 0.999_999_900_000_005, 0.999_930_002_449_957_13, 0.999_400_179_973]),
    ];

    #[test]
    fn the_smaller_root_of_the_inverse_gaussian_is_right_to_the_last_digits() {
        for (phi, roots) in ROOTS {
            for (z, wanted) in [1e-6, 1e-3, 0.7, 6.0].into_iter().zip(roots) {
                let found = inverse_gaussian(phi, phi, z, 0.0);
                // A relative error of 1e-15.
                assert!(
                    ((found - wanted) / wanted).abs() < 1e-15,
                    "{phi:e} {z:e}: {found:e}, wanted {wanted:e}"
                );
            }
            assert!((inverse_gaussian(phi, phi, 0.0, 0.3) - 1.0).abs() < 1e-15, "z = 0 is the mean");
        }
    }

    #[test]
    #[expect(clippy::excessive_precision, reason = "17 digits name a double")]
    fn polarities_are_right_to_the_last_digits_wherever_the_voltage_is() {
        // `(e^(m b) - 1)/(e^(m b) - e^(-m a))`, `m = 2 mu/sigma^2`, from the residuals 0.5 and
        // 0.999, with 80 digits.
        let wanted = [
            (1e-20, [0.75, 0.9995]),
            (-1e-20, [0.75, 0.9995]),
            (1e-12, [0.750_000_000_000_187_5, 0.999_500_000_000_000_5]),
            (-1e-12, [0.749_999_999_999_812_5, 0.999_499_999_999_999_5]),
            (1e-3, [0.750_187_468_738_284_51, 0.999_500_499_583_583_18]),
            (-1e-3, [0.749_812_468_761_722, 0.999_499_500_083_583_34]),
            (0.5, [0.834_703_823_328_879_98, 0.999_708_938_887_350_95]),
            (-0.5, [0.650_067_991_241_227_31, 0.999_209_209_360_699_97]),
            (30.0, [1.0, 1.0]),
            (-30.0, [3.059_023_205_018_257_9e-7, 0.970_445_533_548_508_18]),
            (1e3, [1.0, 1.0]),
        ];
        for (drift, shares) in wanted {
            for (x, wanted) in [0.5, 0.999].into_iter().zip(shares) {
                let found = RenewalProcess { drift, variance: 2.0, up: 1.0 - x, down: 1.0 + x }.on_share();
                assert!((found - wanted).abs() < 5e-16, "{drift:e} {x}: {found:e}, wanted {wanted:e}");
            }
        }
    }

    #[test]
    fn where_the_drift_is_zero_times_are_twice_too_long() {
        // The published times have a median of 4.395 where the Lévy distribution of shape 1 has
        // 2.198.
        let mut draws = draws(0);
        let mut times: Vec<f64> = (0..100_001).map(|_| passage_time(1.0, 0.0, 1.0, &mut draws)).collect();
        times.sort_unstable_by(f64::total_cmp);
        // The density at the median is 0.05: a deviation of the sample's median of 0.03.
        assert!((times[50_000] - 4.395).abs() < 0.12, "{}", times[50_000]);
    }

    /// With the drift, the published times have their correct law: mean `distance / speed` and
    /// shape `(distance / sigma)^2`.
    #[test]
    fn times_with_the_drift_are_distributed_as_those_of_rand_distr() {
        for (index, [distance, speed, sigma]) in
            [[1.0, 1.0, 1.0], [0.4, 3.0, 0.7], [1.0, 0.1, 1.0], [2.0, 5.0, 0.5]].into_iter().enumerate()
        {
            let mut draws = draws(100 + index as u64);
            let ours: Vec<f64> =
                (0..rival::N).map(|_| passage_time(distance, speed, sigma, &mut draws)).collect();
            let shape = (distance / sigma).powi(2);
            let law = rand_distr::InverseGaussian::new(distance / speed, shape).unwrap();
            let name = format!("official {distance} {speed} {sigma}");
            rival::compare(&name, &ours, &rival::theirs(&law), |t| 1.1 * t);
        }
    }

    /// KS distance of the published times against a drift from their correct law.
    fn distance(phi: f64) -> f64 {
        const N: usize = 20_000;
        let mut draws = draws(1);
        let times: Vec<f64> = (0..N).map(|_| passage_time(1.0, -phi, 1.0, &mut draws)).collect();
        let upper = |x: f64| 0.5 * libm::erfc(x / SQRT_2);
        // Of mean 1/phi and shape 1.
        let law = |t: f64| {
            upper(-(t * phi - 1.0) / t.sqrt()) + (2.0 * phi).exp() * upper((t * phi + 1.0) / t.sqrt())
        };
        ks::scaled_distance(times, law) / (N as f64).sqrt()
    }

    #[test]
    fn times_against_the_drift_are_wrong_as_published_and_right_where_those_broke_down() {
        // KS distances of 0.11, 0.41 and 0.48 at 2 |c| e / sigma^2 = 0.02, 2 and 6. The distance of
        // a sample of 20,000 deviates by at most 2.23/sqrt(20,000) = 0.016 (alpha 1e-4), and these
        // figures have two digits.
        for (phi, wanted) in [(0.01, 0.11), (1.0, 0.41), (3.0, 0.48)] {
            let found = distance(phi);
            println!("phi {phi}: KS {found:.3}, published {wanted}");
            assert!((found - wanted).abs() < 0.021);
        }
        assert!(distance(16.1) < 0.016, "past the underflow");
    }

    #[test]
    fn no_magnitude_makes_a_time_that_is_none() {
        let magnitudes = [1e-150, 1e-20, 1e-6, 1.0, 1e6, 1e20];
        let mut draws = draws(2);
        for distance in magnitudes {
            for sigma in magnitudes {
                for speed in magnitudes.into_iter().flat_map(|s| [s, -s]).chain([0.0]) {
                    let t = passage_time(distance, speed, sigma, &mut draws);
                    assert!(t >= 0.0, "{distance:e} {speed:e} {sigma:e}: {t:e}");
                }
            }
        }
    }

    const SIZE: Size = Size { width: 2, height: 1 };

    fn run(
        sensor: &VoltmeterModel,
        greys: &[[f32; 2]],
        step_ns: i64,
    ) -> Result<SimulationAccount, SensorError> {
        let mut pixels = sensor.start(SIZE, [0, 0], Seed(1))?;
        let mut events = Vec::new();
        for (index, grey) in greys.iter().enumerate() {
            let luminance = Image::from_vec(SIZE, grey.to_vec());
            let frame = DenseFrame { index, t: Timestamp(step_ns * index as i64), luminance, rate: None };
            pixels.advance(&frame, &mut events)?;
        }
        let account = pixels.finish(&mut events)?;
        let last = step_ns * (greys.len() as i64 - 1);
        assert!(events.is_sorted_by_key(gs2e_event::Event::file_order));
        assert!(events.iter().all(|e| e.t.0 > 0 && e.t.0 <= last) && events.len() as u64 == account.events);
        Ok(account)
    }

    fn official(k: [f64; 6]) -> VoltmeterModel {
        VoltmeterModel { law: super::super::SamplerKind::Official, ..VoltmeterModel::new(k) }
    }

    #[test]
    fn a_burst_is_a_loop_and_the_cap_ends_or_thins_it() {
        let [k1, k2, ..] = VoltmeterPreset::Dvs346.k();
        // A thousandth of a threshold: grey 0 to 255 is `2 k1 255/(255 + 2 k2)` thresholds of the
        // midpoint form.
        let steep = official([1000.0 * k1, k2, 1e-4, 0.0, 0.0, 0.0]);
        let events = (2000.0 * k1 * 255.0 / (255.0 + 2.0 * k2)).floor();
        let frames = [[0.0, 255.0], [255.0, 0.0]];
        let error = run(&steep, &frames, 2000).unwrap_err().to_string();
        assert!(
            error.starts_with("pixel (0, 0) fires more than 1000 events between frames 0 and 1"),
            "{error}"
        );
        let raised = VoltmeterModel {
            settings: SensorSettings { max_events_per_pixel_frame: 20_000, ..steep.settings },
            ..steep.clone()
        };
        let account = run(&raised, &frames, 2000).unwrap();
        // Noise of deviation `1e-4 sqrt(127.5 2)/147.5` a frame moves the count by one at most.
        assert!((account.on as f64 - events).abs() <= 1.0 && (account.off as f64 - events).abs() <= 1.0);
        assert!(account.on > 9000 && account.capped == 0, "{account:?}");
        let thinned = run(
            &VoltmeterModel { settings: SensorSettings { allow_cap: true, ..steep.settings }, ..steep },
            &frames,
            2000,
        )
        .unwrap();
        assert_eq!((thinned.on, thinned.off, thinned.max_per_pixel_frame), (1000, 1000, 1000));
        assert_eq!(thinned.capped + 2000, account.events);
    }

    #[test]
    fn extremes_of_brightness_and_time_stay_finite() {
        for k in [VoltmeterPreset::Dvs346.k(), VoltmeterPreset::Gs2eSi.k(), [5.265, 20.0, 0.0, 0.0, 0.0, 0.0]]
        {
            // In an hour the leak of a grey of 1e6 would be 9 million events.
            for (step_ns, white) in [(1000, 1e6), (3_600_000_000_000, 255.0)] {
                let steps = [[0.0, white], [white, 0.0], [f32::MIN_POSITIVE, 255.0], [0.0, 1e-12]];
                let sensor = VoltmeterModel {
                    settings: SensorSettings {
                        max_events_per_pixel_frame: 1_000_000,
                        ..official(k).settings
                    },
                    ..official(k)
                };
                let account = run(&sensor, &steps, step_ns).unwrap();
                assert!(account.on > 0 || k[0] < 1.0, "{k:?} {step_ns}: {account:?}");
            }
        }
    }

    #[test]
    fn what_the_law_does_not_know_is_refused() {
        let with = |sensor: VoltmeterModel| sensor.start(SIZE, [0, 0], Seed(1)).err().map(|e| e.to_string());
        let plain = official(VoltmeterPreset::Dvs346.k());
        assert_eq!(with(plain.clone()), None);
        let cubic = VoltmeterModel { between: super::super::BetweenFrames::Catmull, ..plain.clone() };
        assert_eq!(with(cubic).as_deref(), Some("`law: official` requires `between: linear`"));
        let spread = VoltmeterModel { initial: super::super::InitialVoltage::Stationary, ..plain };
        assert_eq!(with(spread).as_deref(), Some("`law: official` requires all voltages to start at zero"));
    }

    #[test]
    fn unequal_and_hot_pixels() {
        let dark = [[50.0; 2]; 3];
        let hot = HotPixelNoise { share: 1.0, rate: 1e4, ..HotPixelNoise::default() };
        let quiet = [5.0, 20.0, 0.0, 0.0, 0.0, 0.0];
        let account = run(
            &VoltmeterModel {
                settings: SensorSettings { hot_pixels: hot, ..official(quiet).settings },
                ..official(quiet)
            },
            &dark,
            50_000_000,
        )
        .unwrap();
        // 2 pixels, 0.1 s: Poisson of mean 2000.
        assert!((account.on as f64 - 2000.0).abs() < 4.5 * 2000f64.sqrt() && account.off == 0, "{account:?}");
        let spread = VoltmeterModel { threshold_spread: 0.3, ..official(quiet) };
        let ramp = run(&spread, &[[0.0; 2], [255.0; 2]], 1_000_000).unwrap();
        let equal = run(&official(quiet), &[[0.0; 2], [255.0; 2]], 1_000_000).unwrap();
        assert_ne!(ramp.on, equal.on);
    }
}
