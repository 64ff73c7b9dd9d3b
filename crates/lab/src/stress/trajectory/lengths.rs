//! Curves with closed-form lengths, and with speeds that almost vanish or change quickly.

use crate::stress::{CaseResult, StressPoint, WorstPoint};
use gs2e_num::se3::arc_length::ArcLength;
use gs2e_num::se3::spline::CurvePlace;

/// A speed over `x` in [0, 1].
#[derive(Debug, Clone, Copy)]
enum SpeedShape {
    /// `sqrt((x - c)^2 + e^2)`: passes a stop at `c` at the distance `e`.
    NearCusp { at: f64, distance: f64 },
    /// The semicubical parabola `((x - c)^2, (x - c)^3)`, which stops at `c` and turns back.
    Cusp { at: f64 },
    /// `1 + 49/(1 + (40 (x - 0.4))^2)`.
    Burst,
}

impl SpeedShape {
    fn speed(self, x: f64) -> f64 {
        match self {
            Self::NearCusp { at, distance } => libm::hypot(x - at, distance),
            Self::Cusp { at } => (x - at).abs() * (4.0 + 9.0 * (x - at) * (x - at)).sqrt(),
            Self::Burst => {
                let w = 40.0 * (x - 0.4);
                1.0 + 49.0 / (1.0 + w * w)
            }
        }
    }

    /// Its integral, up to a constant.
    fn integral(self, x: f64) -> f64 {
        match self {
            Self::NearCusp { at, distance: e } => {
                let u = x - at;
                0.5 * (u * libm::hypot(u, e) + e * e * libm::asinh(u / e))
            }
            Self::Cusp { at } => {
                let u = x - at;
                let root = (4.0 + 9.0 * u * u).sqrt();
                (root * root * root - 8.0).copysign(u) / 27.0
            }
            Self::Burst => x + 49.0 / 40.0 * libm::atan(40.0 * (x - 0.4)),
        }
    }

    fn length(self, x: f64) -> f64 {
        self.integral(x) - self.integral(0.0)
    }
}

fn length_curves() -> Vec<SpeedShape> {
    let places = [0.1, 0.25, 0.3719, 0.5, 0.9999];
    let distances = [1e-1, 1e-2, 1e-3, 1e-5, 1e-7, 1e-9];
    let near =
        places.iter().flat_map(|at| distances.map(|distance| SpeedShape::NearCusp { at: *at, distance }));
    near.chain(places.map(|at| SpeedShape::Cusp { at })).chain([SpeedShape::Burst]).collect()
}

/// The length of a curve with that speed over [0, 1], as paths are measured.
pub(super) fn measured_length(speed: &dyn Fn(f64) -> f64) -> f64 {
    ArcLength::measure_curve(&[1.0], |at: CurvePlace| speed(at.x)).total()
}

/// Lengths by `measure` from speeds over [0, 1].
#[must_use]
pub fn length_case(measure: impl Fn(&dyn Fn(f64) -> f64) -> f64) -> CaseResult {
    let mut worst = WorstPoint::default();
    for curve in length_curves() {
        let found = measure(&|x| curve.speed(x));
        worst.see(StressPoint::relative_error(found, curve.length(1.0), 1e-7), || format!("{curve:?}"));
    }
    worst.found()
}

/// The closed form at the place where a curve reaches a length must give that length.
pub(super) fn inversion_case() -> CaseResult {
    const LENGTHS: u32 = 200;
    let mut worst = WorstPoint::default();
    for curve in length_curves() {
        let arc = ArcLength::measure_curve(&[1.0], |at: CurvePlace| curve.speed(at.x));
        for k in 0..=LENGTHS {
            let wanted = curve.length(1.0) * f64::from(k) / f64::from(LENGTHS);
            let found = curve.length(arc.invert(wanted).x);
            let point = StressPoint::scaled_error(found, wanted, curve.length(1.0), 1e-12);
            worst.see(point, || format!("{curve:?}, {wanted:.3} of its length"));
        }
    }
    worst.found()
}
