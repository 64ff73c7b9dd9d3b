//! The interpolating C2 spline through rotations.
//!
//! Between knots, `R(s) = R_i exp(phi_i(s))` with `phi_i` a cubic in the body's rotation vector.
//! The body rates at the knots make rate and angular acceleration continuous. The system is that of
//! N. Mayorov, "Smooth Attitude Interpolation" (attached to scipy issue 8964; scipy's
//! `RotationSpline`), with the same end conditions: the rates of the mean turn of the first and of
//! the last interval.
//!
//! It differs from scipy in two ways. The coefficients of small angles are summed as series where
//! scipy's closed forms cancel (below 1 rad; scipy switches at 1e-4). And the rates are found by
//! Newton's method, where scipy takes at most 10 rounds of a fixed-point iteration, which does not
//! converge for a capture with a turn of 90 degrees and back. The only nonlinear term is a
//! quadratic form, so its derivative is exact and lies on the diagonal of the system.
//!
//! # Examples
//!
//! ```
//! use glam::DVec3;
//! use gs2e_num::se3::rotation::{exp_vector, relative_angle};
//! use gs2e_num::se3::rotation_spline::RotationSpline;
//! use gs2e_num::se3::spline::CurvePlace;
//!
//! // A steady turn about z: 0.2 rad in every 0.1 of the parameter.
//! let rotations = [0.0, 0.2, 0.4].map(|angle| exp_vector(DVec3::Z * angle));
//! let spline = RotationSpline::new(&[0.1, 0.1], &rotations)?;
//! let middle = CurvePlace { segment: 1, x: 0.05 };
//! assert!(relative_angle(spline.rotation(middle), exp_vector(DVec3::Z * 0.3)) < 1e-9);
//! assert!(spline.rate(middle).distance(DVec3::Z * 2.0) < 1e-9);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::rotation::{exp_vector, log_vector, renormalised};
use super::series::{alternating_series, power_sum};
use super::spline::{CubicSegment, CurvePlace};
use glam::{DMat3, DQuat, DVec3};
use libm::{cos, sin};
use std::f64::consts::PI;

/// Turns within this distance of a half turn have no unique axis.
const HALF_TURN_MARGIN: f64 = 1e-6;
/// Number of rounds with full steps, then of rounds with half steps from the start again.
const ROUNDS: [(u32, f64); 2] = [(15, 1.0), (60, 0.5)];
/// Largest accepted change of a rate in one round, relative to 1 + its size.
const ACCEPTED: f64 = 1e-9;
/// Change below which further rounds are pointless.
const SETTLED: f64 = 1e-13;

/// The rotation vector that turns `a` into `b`, and whether it is a half turn within 1e-6 rad. The
/// axis of a half turn is the one with a positive first non-zero component. (Both signs lead to `b`
/// exactly.)
#[must_use]
pub fn turn_between(a: DQuat, b: DQuat) -> (DVec3, bool) {
    let r = log_vector(a.conjugate() * b);
    let length = r.length();
    if length <= PI - HALF_TURN_MARGIN {
        return (r, false);
    }
    let leading = r.to_array().into_iter().find(|c| *c != 0.0).unwrap_or(0.0);
    // The same rotation about the opposite axis has the angle `2 pi - length`.
    (if leading < 0.0 { r * (1.0 - 2.0 * PI / length) } else { r }, true)
}

/// The iteration for the spline's rates does not converge.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("the rates of the rotation spline did not converge: the last relative change is {change:.3e}")]
pub struct SplineDiverged {
    /// Largest relative change of a rate in the last round.
    pub change: f64,
}

/// A C2 spline through rotations.
#[derive(Debug, Clone, PartialEq)]
pub struct RotationSpline {
    starts: Vec<DQuat>,
    turns: Vec<CubicSegment>,
}

impl RotationSpline {
    /// The spline through `rotations`, with `steps[i] > 0` as the length of the parameter from
    /// rotation i to rotation i+1. Two rotations give their slerp.
    ///
    /// # Errors
    /// The body rates do not converge: neighbouring turns are both large and of very different
    /// lengths.
    ///
    /// # Panics
    /// There are fewer than two rotations, or their number is not one more than that of steps.
    pub fn new(steps: &[f64], rotations: &[DQuat]) -> Result<Self, SplineDiverged> {
        Self::with_ends(steps, rotations, None)
    }

    /// As [`RotationSpline::new`], with these body rates at the first and at the last rotation. The mean turn
    /// of an interval misses the rate at its end by half of the interval's acceleration.
    ///
    /// # Errors
    /// As [`RotationSpline::new`].
    ///
    /// # Panics
    /// As [`RotationSpline::new`].
    pub fn with_end_rates(
        steps: &[f64],
        rotations: &[DQuat],
        ends: [DVec3; 2],
    ) -> Result<Self, SplineDiverged> {
        Self::with_ends(steps, rotations, Some(ends))
    }

    fn with_ends(
        steps: &[f64],
        rotations: &[DQuat],
        ends: Option<[DVec3; 2]>,
    ) -> Result<Self, SplineDiverged> {
        assert!(
            rotations.len() >= 2 && steps.len() + 1 == rotations.len(),
            "a spline needs a step between any two rotations"
        );
        let vectors: Vec<DVec3> = rotations.windows(2).map(|r| turn_between(r[0], r[1]).0).collect();
        let rates = RateEquations::new(steps, &vectors, ends).solve()?;
        // The rate at the end of a segment is turned into the slope of its rotation vector there.
        let turns = (0..steps.len())
            .map(|i| {
                let end_slope = slope_from_rate(vectors[i]) * rates[i + 1];
                CubicSegment::from_hermite(steps[i], [DVec3::ZERO, vectors[i]], [rates[i], end_slope])
            })
            .collect();
        Ok(Self { starts: rotations[..steps.len()].to_vec(), turns })
    }

    /// The rotation at a place, a unit quaternion.
    #[must_use]
    #[inline]
    pub fn rotation(&self, at: CurvePlace) -> DQuat {
        renormalised(self.starts[at.segment] * exp_vector(self.turns[at.segment].value(at.x)))
    }

    /// The body rate at a place, rad per parameter, in the body's axes.
    #[must_use]
    pub fn rate(&self, at: CurvePlace) -> DVec3 {
        let turn = &self.turns[at.segment];
        rate_from_slope_times(turn.value(at.x), turn.slope(at.x))
    }

    /// The derivative of the body rate at a place, rad per parameter squared.
    #[must_use]
    pub fn acceleration(&self, at: CurvePlace) -> DVec3 {
        let turn = &self.turns[at.segment];
        let (r, slope) = (turn.value(at.x), turn.slope(at.x));
        rate_from_slope_times(r, turn.bend(at.x)) + quadratic_part(r, slope)
    }
}

/// The equations for the rates at the inner knots. Knot k+1 lies between segments k and k+1:
///
/// ```text
/// 2/h_k J_k w_k + 4 (1/h_k + 1/h_{k+1}) w_{k+1} + 2/h_{k+1} J_{k+1}^-1 w_{k+2} + q_k(w_{k+1})
///     = 6 (r_k/h_k^2 + r_{k+1}/h_{k+1}^2)
/// ```
/// with `w` the rates, `r` the turns, `h` the steps, `J` the right Jacobian and `q` the quadratic
/// part of the angular acceleration at the end of segment k, whose slope is `J_k^-1 w_{k+1}`.
struct RateEquations<'a> {
    steps: &'a [f64],
    turns: &'a [DVec3],
    /// `J^-1(r_k)` for every segment.
    slope_from_rate: Vec<DMat3>,
    /// Rates at both ends; without them, the mean turns of the first and of the last segment.
    ends: Option<[DVec3; 2]>,
}

impl<'a> RateEquations<'a> {
    fn new(steps: &'a [f64], turns: &'a [DVec3], ends: Option<[DVec3; 2]>) -> Self {
        Self { steps, turns, slope_from_rate: turns.iter().map(|r| slope_from_rate(*r)).collect(), ends }
    }

    /// Rates at all knots. Those at the ends are fixed; those at the inner knots start from the
    /// mean turns.
    fn solve(&self) -> Result<Vec<DVec3>, SplineDiverged> {
        let mean: Vec<DVec3> = self.turns.iter().zip(self.steps).map(|(r, h)| *r / *h).collect();
        let mut change = f64::INFINITY;
        // Half steps converge where full steps overshoot, but they need more rounds.
        for (rounds, damping) in ROUNDS {
            // Each attempt starts from the mean turns: rates that have diverged are no start.
            // The chain sets the end conditions too: its first and last rates are the mean turns there, and
            // no step changes them.
            let mut rates: Vec<DVec3> = std::iter::once(mean[0]).chain(mean.iter().copied()).collect();
            if let Some([first, last]) = self.ends {
                (rates[0], rates[mean.len()]) = (first, last);
            }
            for _ in 0..rounds {
                change = self.improve(&mut rates, damping);
                if change < SETTLED {
                    break;
                }
            }
            if change < ACCEPTED {
                return Ok(rates);
            }
        }
        Err(SplineDiverged { change })
    }

    /// One Newton step. Returns the largest change of a rate, relative to 1 + its size.
    fn improve(&self, rates: &mut [DVec3], damping: f64) -> f64 {
        let mut largest = 0.0f64;
        for (k, step) in self.newton_step(rates).into_iter().enumerate() {
            rates[k + 1] += step * damping;
            let relative = step.length() / (1.0 + rates[k + 1].length());
            // `f64::max` would drop a NaN. This keeps it, and a NaN never counts as converged.
            largest = if relative <= largest { largest } else { relative };
        }
        largest
    }

    /// Solves the linearised equations for the changes of the inner rates by block elimination. The
    /// diagonal dominates the pivots as long as turns are under half a turn.
    fn newton_step(&self, rates: &[DVec3]) -> Vec<DVec3> {
        let inner = self.turns.len() - 1;
        let mut pivots: Vec<DMat3> = Vec::with_capacity(inner);
        let mut x: Vec<DVec3> = Vec::with_capacity(inner);
        for k in 0..inner {
            let (mut pivot, mut right) = (self.derivative(k, rates), self.residual(k, rates));
            if k > 0 {
                let eliminated = self.before(k) * pivots[k - 1];
                pivot -= eliminated * self.after(k - 1);
                right -= eliminated * x[k - 1];
            }
            // Inverted once: the next row and the back substitution both use it.
            pivots.push(pivot.inverse());
            x.push(right);
        }
        for k in (0..inner).rev() {
            let next = x.get(k + 1).map_or(DVec3::ZERO, |next| self.after(k) * *next);
            x[k] = pivots[k] * (x[k] - next);
        }
        x
    }

    /// Coefficient of the rate before inner knot k+1.
    fn before(&self, k: usize) -> DMat3 {
        rate_from_slope(self.turns[k]) * (2.0 / self.steps[k])
    }

    /// Coefficient of the rate after inner knot k+1.
    fn after(&self, k: usize) -> DMat3 {
        self.slope_from_rate[k + 1] * (2.0 / self.steps[k + 1])
    }

    /// Coefficient of the rate at inner knot k+1 in the linear part.
    fn diagonal(&self, k: usize) -> f64 {
        4.0 * (1.0 / self.steps[k] + 1.0 / self.steps[k + 1])
    }

    /// Residual of equation k.
    fn residual(&self, k: usize, rates: &[DVec3]) -> DVec3 {
        let (r, h) = (self.turns, self.steps);
        let mean = (r[k] / h[k] / h[k] + r[k + 1] / h[k + 1] / h[k + 1]) * 6.0;
        let linear =
            self.before(k) * rates[k] + rates[k + 1] * self.diagonal(k) + self.after(k) * rates[k + 2];
        mean - linear - quadratic_part(r[k], self.slope_from_rate[k] * rates[k + 1])
    }

    /// Derivative of equation k by the rate at its own knot. For a quadratic form q,
    /// `q(s+e) - q(s) - q(e)` is exactly the derivative along e.
    fn derivative(&self, k: usize, rates: &[DVec3]) -> DMat3 {
        let (r, slope) = (self.turns[k], self.slope_from_rate[k] * rates[k + 1]);
        let along = |e: DVec3| quadratic_part(r, slope + e) - quadratic_part(r, slope) - quadratic_part(r, e);
        let form = DMat3::from_cols(along(DVec3::X), along(DVec3::Y), along(DVec3::Z));
        DMat3::from_diagonal(DVec3::splat(self.diagonal(k))) + form * self.slope_from_rate[k]
    }
}

/// The right Jacobian `J(r)`: the body rate is `J(r)` times the derivative of the rotation vector.
fn rate_from_slope(r: DVec3) -> DMat3 {
    let (skew, c) = (skew_matrix(r), LogCoefficients::for_angle(r.length_squared()));
    DMat3::IDENTITY - skew * c.versine + skew * skew * c.sine
}

/// `rate_from_slope` times a slope, for every finite `r`.
pub fn rate_from_slope_times(r: DVec3, slope: DVec3) -> DVec3 {
    let c = LogCoefficients::for_angle(r.length_squared());
    let once = r.cross(slope);
    slope - once * c.versine + r.cross(once) * c.sine
}

/// The inverse of [`rate_from_slope`], for `|r| <= pi`:
/// `I + [r]/2 + (1 - t/2 cot(t/2)) / t^2 [r]^2`.
fn slope_from_rate(r: DVec3) -> DMat3 {
    let t2 = r.length_squared();
    let skew = skew_matrix(r);
    DMat3::IDENTITY + skew * 0.5 + skew * skew * cotangent_coefficient(t2)
}

/// The part of the angular acceleration that is quadratic in the slope of the rotation vector.
pub fn quadratic_part(r: DVec3, slope: DVec3) -> DVec3 {
    let c = LogQuadratic::for_angle(r.length_squared());
    let once = r.cross(slope);
    (once * c.k1 + r.cross(once) * c.k2) * r.dot(slope) + slope.cross(once) * c.k3
}

fn skew_matrix(r: DVec3) -> DMat3 {
    DMat3::from_cols(DVec3::new(0.0, r.z, -r.y), DVec3::new(-r.z, 0.0, r.x), DVec3::new(r.y, -r.x, 0.0))
}

/// `(1 - cos t) / t^2` and `(t - sin t) / t^3`.
struct LogCoefficients {
    versine: f64,
    sine: f64,
}

impl LogCoefficients {
    // The closed forms cancel for small angles, so the series take over below 1 rad.
    fn for_angle(t2: f64) -> Self {
        if t2 < 1.0 {
            return Self { versine: power_sum(t2, &VERSINE), sine: power_sum(t2, &SINE) };
        }
        let t = t2.sqrt();
        Self { versine: (1.0 - cos(t)) / t2, sine: (t - sin(t)) / (t2 * t) }
    }
}

/// `(2 (1 - cos t) - t sin t) / t^4`, `(3 sin t - 2t - t cos t) / t^5` and `(t - sin t) / t^3`.
struct LogQuadratic {
    k1: f64,
    k2: f64,
    k3: f64,
}

impl LogQuadratic {
    fn for_angle(t2: f64) -> Self {
        if t2 < 1.0 {
            return Self { k1: power_sum(t2, &K1), k2: power_sum(t2, &K2), k3: power_sum(t2, &SINE) };
        }
        let t = t2.sqrt();
        let (s, c) = (sin(t), cos(t));
        // The numerators begin with t^4/12 and -t^5/60, so near 0 these forms would lose all digits.
        Self {
            k1: (2.0 * (1.0 - c) - t * s) / (t2 * t2),
            k2: (3.0 * s - 2.0 * t - t * c) / (t2 * t2 * t),
            k3: (t - s) / (t2 * t),
        }
    }
}

/// `(1 - t/2 cot(t/2)) / t^2`, by its power series (Bernoulli numbers) below 1 rad.
fn cotangent_coefficient(t2: f64) -> f64 {
    if t2 < 1.0 {
        return power_sum(t2, &COTANGENT);
    }
    let half = t2.sqrt() / 2.0;
    (1.0 - half * cos(half) / sin(half)) / t2
}

// With `t2 < 1`, the first omitted term of each table below is under 1e-17 of the sum.
// The last table falls only by `4 pi^2` per term, so it is longer than the others.

const TERMS: usize = 9;
/// `(-1)^k / (2k+2)!`
const VERSINE: [f64; TERMS] = alternating_series(2, &[1.0; TERMS]);
/// `(-1)^k / (2k+3)!`
const SINE: [f64; TERMS] = alternating_series(3, &[1.0; TERMS]);
/// `(-1)^k (2k+2) / (2k+4)!`
const K1: [f64; TERMS] = alternating_series(4, &[2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 14.0, 16.0, 18.0]);
/// `-(-1)^k (2k+2) / (2k+5)!`
const K2: [f64; TERMS] = alternating_series(5, &[-2.0, -4.0, -6.0, -8.0, -10.0, -12.0, -14.0, -16.0, -18.0]);
/// `|B_{2k+2}| / (2k+2)!`
const COTANGENT: [f64; 12] = [
    1.0 / 12.0,
    1.0 / 720.0,
    1.0 / 30_240.0,
    1.0 / 1_209_600.0,
    1.0 / 47_900_160.0,
    691.0 / 1_307_674_368_000.0,
    1.0 / 74_724_249_600.0,
    3617.0 / 10_670_622_842_880_000.0,
    43_867.0 / 5_109_094_217_170_944_000.0,
    174_611.0 / 802_857_662_698_291_200_000.0,
    77_683.0 / 14_101_100_039_391_805_440_000.0,
    236_364_091.0 / 1_693_824_136_731_743_669_452_800_000.0,
];
