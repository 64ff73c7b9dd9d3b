//! The law of the sensor: exact probabilities, laws of times, bursts, and units.

mod bursts;
mod passages;

pub use passages::{bridge_off, first_off};

use super::answers::{KnownAnswer, find_answers};
use super::{CaseResult, StressArea, StressCase, StressPoint, WorstPoint};
use gs2e_sensor::statistics::RenewalProcess;
use gs2e_sensor::voltmeter;
use gs2e_sensor::voltmeter::VoltmeterModel;
use gs2e_sensor::voltmeter::units::{ConstantUnits, TimeUnit, WhiteBrightness};

/// All cases of the sensor.
#[must_use]
pub(crate) fn sensor_cases<'a>() -> Vec<StressCase<'a>> {
    let case = |words, run: fn() -> CaseResult| StressCase::new(StressArea::Sensor, words, run);
    let mut all = vec![
        case(["polarity", "2 mu Th/s^2 of 0 and +-1e-20 .. +-1e3, residual 0, .5, .999", "1"], || {
            polarity_case(|drift, up, down| RenewalProcess { drift, variance: 2.0, up, down }.on_share())
        }),
        case(["inverse-gaussian-root", "phi 1e-12 .. 1e8, z 0 and 1e-6 .. 6; all > 0", "rel"], || {
            root_case(voltmeter::touch_time)
        }),
        case(
            ["first-off", "x = -.99, mu T = 3 and x = .98, mu T = -1.98, s^2 T = .05; a leaf", "se"],
            || first_off(passages::first_of_leaf),
        ),
        case(["first-off-of-sensor", "the same, set by thresholds, through the whole sensor", "se"], || {
            passages::first_off_of_sensor()
        }),
        case(["bridge", "both barriers in reach: three bridges", "se"], || {
            bridge_off(passages::first_of_leaf)
        }),
    ];
    all.extend(passages::interval_cases());
    all.extend(bursts::burst_cases());
    all.extend([
        case(["brightness-steps", "L = 0, 1e-12, 1, 255, 1e6; dvs346 and gs2e-si", "Th"], bursts::steps_case),
        case(["units", "one K in six readings", "ulp"], units_case),
        case(
            ["noise-of-units", "events of a pixel at rest, six readings, grey 1, 16, 128", "rel"],
            noise_case,
        ),
        case(["thresholds", "Th 1e-3, 1e3; A = 1.2 with B = .7: polarity, interval", "se"], || {
            passages::threshold_cases()
        }),
    ]);
    all
}

/// The probability that a voltage with this drift and variance 2 leaves through the upper barrier,
/// not through the lower one, at these distances.
#[must_use]
pub fn polarity_case(on_share: impl Fn(f64, f64, f64) -> f64) -> CaseResult {
    let mut worst = WorstPoint::default();
    for KnownAnswer { given, wanted } in find_answers("polarity") {
        let [drift, up, down] = [given[0], given[1], given[2]];
        let point = StressPoint::absolute_error(on_share(drift, up, down), wanted[0], 5e-16);
        worst.see(point, || format!("2 mu/s^2 = {drift:e}, up {up}"));
    }
    worst.found()
}

/// The time of the first touch, as a share of a bridge's length, from the distances `a` and `g` of
/// its ends, its variance, and a normal and a uniform draw. The cases cover both roots of the
/// inverse Gaussian's transform, with `a` and the variance equal to 1.
#[must_use]
pub fn root_case(touch_time: impl Fn(f64, f64, f64, f64, f64) -> f64) -> CaseResult {
    /// The draw takes the larger root if the smaller one is less likely than this.
    const LIKELY: f64 = 0.99;
    let mut worst = WorstPoint::default();
    for KnownAnswer { given, wanted } in find_answers("root") {
        let [phi, z] = [given[0], given[1]];
        let [smaller, larger, likelihood] = [wanted[0], wanted[1], wanted[2]];
        let second = (likelihood < LIKELY).then_some((LIKELY, larger));
        for (u, share) in [(0.0, smaller)].into_iter().chain(second) {
            let found = touch_time(1.0, phi, 1.0, z, u);
            let point = StressPoint::relative_error(found, share, 1e-15);
            // An invalid time has an infinite error.
            let point = if found > 0.0 { point } else { StressPoint { error: f64::INFINITY, ..point } };
            worst.see(point, || format!("phi {phi:e}, z {z:e}, u {u}"));
        }
    }
    worst.found()
}

/// The set that the GS2E paper prints without units.
const PRINTED: [f64; 6] = [0.5, 1e-3, 0.1, 0.01, 0.1, 1e-5];

/// The units of a reading, by their names in the table of answers.
fn reading_units(microsecond: f64, white: f64) -> ConstantUnits {
    let time = [TimeUnit::Us, TimeUnit::Ms, TimeUnit::S];
    let time = time.into_iter().find(|unit| unit.of_a_microsecond().to_bits() == microsecond.to_bits());
    let brightness = if white > 1.0 { WhiteBrightness::Grey255 } else { WhiteBrightness::Unit };
    ConstantUnits { time: time.expect("us, ms or s"), brightness }
}

fn units_case() -> CaseResult {
    let mut worst = WorstPoint::default();
    for KnownAnswer { given, wanted } in find_answers("units") {
        let units = reading_units(given[0], given[1]);
        for (i, (found, wanted)) in units.to_official(PRINTED).into_iter().zip(wanted).enumerate() {
            let ulp = wanted.next_up() - wanted;
            worst.see(StressPoint::scaled_error(found, wanted, ulp, 4.0), || {
                format!("k{} of {units:?}", i + 1)
            });
        }
    }
    worst.found()
}

/// Rates of both polarities together. The form for small drift omits a relative part of 1e-8.
fn noise_case() -> CaseResult {
    let mut worst = WorstPoint::default();
    for KnownAnswer { given, wanted } in find_answers("noise") {
        let units = reading_units(given[0], given[1]);
        let found = VoltmeterModel::new(units.to_official(PRINTED)).noise(given[2]).total_hz;
        worst.see(StressPoint::relative_error(found, wanted[0], 1e-8), || {
            format!("grey {} of {units:?}", given[2])
        });
    }
    worst.found()
}
