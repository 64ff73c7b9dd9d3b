//! Rotations as unit quaternions: exponential and logarithm, angle, slerp, mean, canonical sign.
//!
//! Rotation vectors point along the axis (right-handed) and are as long as the angle. Products
//! compose on the right: `a * exp(v)` turns `a` by `v` in its own body frame.
//!
//! # Examples
//!
//! ```
//! use glam::{DQuat, DVec3};
//! use gs2e_num::se3::rotation::{exp_vector, karcher_mean, log_vector, relative_angle, slerp};
//! use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};
//!
//! // A quarter turn about z takes x to y.
//! let quarter = exp_vector(DVec3::Z * FRAC_PI_2);
//! assert!((quarter * DVec3::X).distance(DVec3::Y) < 1e-12);
//! // Half of it is an eighth of a turn, and the mean of both ends.
//! let eighth = slerp(DQuat::IDENTITY, quarter, 0.5);
//! assert!(log_vector(eighth).distance(DVec3::Z * FRAC_PI_4) < 1e-12);
//! let mean = karcher_mean(&[DQuat::IDENTITY, quarter], quarter)?;
//! assert!(relative_angle(mean, eighth) < 1e-12);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::series::{alternating_series, power_sum};
use glam::{DQuat, DVec3};
use libm::{atan2, cos, sin};

/// The rotation by the rotation vector `r`.
///
/// Below `|r| = 1`, half-angle cosine and sine are power series in `|r|^2 / 4` with first omitted
/// terms under 1e-18; above, they are `libm`'s. Valid for every finite `r`.
#[must_use]
#[inline]
pub fn exp_vector(r: DVec3) -> DQuat {
    let t2 = r.length_squared();
    let (w, k) = if t2 < 1.0 {
        let y = t2 / 4.0;
        // The leading terms are added last, so that the sums are rounded once.
        (1.0 + y * power_sum(y, &COSINE), 0.5 + y * power_sum(y, &HALF_SINE))
    } else {
        let t = t2.sqrt();
        (cos(t / 2.0), sin(t / 2.0) / t)
    };
    let v = r * k;
    DQuat::from_xyzw(v.x, v.y, v.z, w)
}

/// Normalises a quaternion that differs from unit length by rounding only: one Newton step on the
/// inverse root, which leaves the square of the deviation.
#[must_use]
#[inline]
pub fn renormalised(q: DQuat) -> DQuat {
    q * (1.5 - 0.5 * q.length_squared())
}

/// `-(-1)^k / (2k+2)!`
const COSINE: [f64; 7] = alternating_series(2, &[-1.0; 7]);
/// `-(-1)^k / (2 (2k+3)!)`
const HALF_SINE: [f64; 7] = alternating_series(3, &[-0.5; 7]);

/// The rotation vector of the unit quaternion `q`, of length at most pi.
///
/// Computed by `atan2`, never by `acos` (which loses half the digits near 0) or by the trace (with
/// an axis that fails near pi). At exactly pi, both directions name the same rotation; the result
/// is the direction of `q` with `w = +0`.
#[must_use]
pub fn log_vector(q: DQuat) -> DVec3 {
    // `q` and `-q` are the same rotation. With `w >= 0`, `atan2` is at most pi/2, and the angle at most pi.
    let q = if q.w < 0.0 { -q } else { q };
    let v = DVec3::new(q.x, q.y, q.z);
    let n = v.length();
    // Below 1e-8, `atan2(n, w)` is `n / w` to rounding. The quotient by `n` would be 0/0 at 0.
    if n < 1e-8 { v * (2.0 / q.w) } else { v * (2.0 * atan2(n, q.w) / n) }
}

/// The angle between two rotations, 0 to pi.
#[must_use]
pub fn relative_angle(a: DQuat, b: DQuat) -> f64 {
    let q = a.conjugate() * b;
    // `q` and `-q` are the same rotation. The absolute value takes the one with the smaller angle.
    2.0 * atan2(DVec3::new(q.x, q.y, q.z).length(), q.w.abs())
}

/// The rotation at share `t` of the shorter arc from `a` to `b`.
#[must_use]
#[inline]
pub fn slerp(a: DQuat, b: DQuat, t: f64) -> DQuat {
    renormalised(a * exp_vector(log_vector(a.conjugate() * b) * t))
}

/// The sign convention of files: `w >= 0`, and if `w = 0`, the first non-zero of x, y, z is
/// positive. Negative zeros become zeros.
#[must_use]
#[inline]
pub fn canonical_sign(q: DQuat) -> DQuat {
    let leading = || [q.w, q.x, q.y, q.z].into_iter().find(|c| *c != 0.0).unwrap_or(0.0);
    let q = if q.w <= 0.0 && leading() < 0.0 { -q } else { q };
    // Adding 0 turns -0 into 0.
    DQuat::from_xyzw(q.x + 0.0, q.y + 0.0, q.z + 0.0, q.w + 0.0)
}

/// `q` or `-q`, whichever lies in the hemisphere of `of`.
#[must_use]
#[inline]
pub fn same_hemisphere(q: DQuat, of: DQuat) -> DQuat {
    if q.dot(of) < 0.0 { -q } else { q }
}

/// The reason why rotations have no mean.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum MeanError {
    /// They spread over more than a quarter turn around their mean, which need not be unique then.
    #[error("the rotations spread {degrees:.1} degrees around their mean, wanted at most 90")]
    TooWide {
        /// Largest angle to the mean.
        degrees: f64,
    },
    /// The iteration does not converge.
    #[error("the mean rotation did not converge in {ROUNDS} rounds: its last step is {step:.3e} rad")]
    Unsettled {
        /// Length of the last step, rad.
        step: f64,
    },
}

const ROUNDS: u32 = 50;
/// Length of the last step, rad. The iteration converges quadratically for narrow windows and
/// linearly for wide ones; a step this short moves a pose less than rounding does.
const SETTLED: f64 = 1e-12;

/// The Karcher mean: the rotation `m` for which the mean of `log(m^-1 r)` is zero, with equal
/// weights. The iteration starts at `start`.
///
/// # Errors
/// An element lies more than pi/2 from the mean, or 50 rounds do not bring the step below 1e-12
/// rad.
pub fn karcher_mean(rotations: &[DQuat], start: DQuat) -> Result<DQuat, MeanError> {
    within_quarter_turn(rotations, settled_mean(rotations, start)?)
}

/// The mean near `start`, for any spread of the rotations. If they spread over more than a quarter
/// turn, other means may exist.
///
/// # Errors
/// 50 rounds do not bring the step below 1e-12 rad.
pub fn settled_mean(rotations: &[DQuat], start: DQuat) -> Result<DQuat, MeanError> {
    let mut mean = start;
    let mut step = 0.0;
    for _ in 0..ROUNDS {
        let sum: DVec3 = rotations.iter().map(|r| log_vector(mean.conjugate() * *r)).sum();
        let mean_log = sum / rotations.len().max(1) as f64;
        // Products drift from unit length, so every round normalises.
        mean = (mean * exp_vector(mean_log)).normalize();
        step = mean_log.length();
        if step < SETTLED {
            return Ok(mean);
        }
    }
    Err(MeanError::Unsettled { step })
}

fn within_quarter_turn(rotations: &[DQuat], mean: DQuat) -> Result<DQuat, MeanError> {
    let widest = rotations.iter().map(|r| relative_angle(mean, *r)).fold(0.0, f64::max);
    if widest > std::f64::consts::FRAC_PI_2 {
        return Err(MeanError::TooWide { degrees: widest * 180.0 / std::f64::consts::PI });
    }
    Ok(mean)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    const AXES: [DVec3; 4] =
        [DVec3::X, DVec3::new(0.0, -0.6, 0.8), DVec3::new(-0.48, 0.6, 0.64), DVec3::new(0.36, 0.48, -0.8)];

    #[test]
    fn log_inverts_exp_from_zero_to_a_half_turn() {
        for axis in AXES {
            for t in
                [0.0, 1e-300, 1e-160, 1e-12, 1e-10, 1e-8, 1e-6, 1e-3, 0.0099999, 0.01, 1.0, 3.0, PI - 1e-9]
            {
                let r = axis * t;
                let error = (log_vector(exp_vector(r)) - r).length();
                // Two roundings of the half angle near pi, where the spacing of doubles is 4.4e-16.
                assert!(error <= 1e-15 * t.max(1e-300), "{axis} {t}: {error}");
            }
            let half_turn = log_vector(exp_vector(axis * PI));
            let up_to_sign = (half_turn - axis * PI).length().min((half_turn + axis * PI).length());
            assert!(up_to_sign < 1e-15, "{up_to_sign}");
        }
    }

    #[test]
    fn exp_is_the_half_angle_quaternion() {
        // Right-handed quarter turn about z: x goes to y. Exact except for the last bit: sqrt(1/2).
        let q = exp_vector(DVec3::Z * (PI / 2.0));
        assert!((q * DVec3::X - DVec3::Y).length() < 3e-16);
        assert!((q.w - 0.5f64.sqrt()).abs() < 2e-16);
        // cos and sin of half the angle from their series with 40 decimal digits. Both angles are
        // on the side of the power series.
        for (t, w, z) in [
            (0.005, 0.999_996_875_001_627_6, 0.002_499_997_395_834_147),
            (0.02, 0.999_950_000_416_665_3, 0.009_999_833_334_166_665),
        ] {
            let q = exp_vector(DVec3::Z * t);
            assert!((q.w - w).abs() <= 1.2e-16 && (q.z - z).abs() <= 2e-18 && q.x == 0.0, "{t}");
        }
    }

    #[test]
    fn the_angle_does_not_care_for_the_quaternions_sign() {
        let a = exp_vector(DVec3::new(0.3, -0.2, 0.9));
        for t in [0.0, 1e-12, 1e-6, 0.7, 3.0, PI - 1e-9] {
            let b = a * exp_vector(AXES[2] * t);
            for (p, q) in [(a, b), (-a, b), (a, -b)] {
                assert!((relative_angle(p, q) - t).abs() < 5e-16, "{t}");
                assert!((relative_angle(slerp(p, q, 0.25), a) - t / 4.0).abs() < 1e-15);
            }
        }
    }

    #[test]
    fn the_mean_of_turns_about_one_axis_is_the_mean_angle() {
        let base = exp_vector(DVec3::new(1.0, 0.2, -0.4));
        let turns: Vec<DQuat> =
            [-0.9, 0.1, 0.2, 1.0, 0.35].iter().map(|t| base * exp_vector(AXES[1] * *t)).collect();
        let mean = karcher_mean(&turns, turns[2]).unwrap();
        assert!(relative_angle(mean, base * exp_vector(AXES[1] * 0.15)) < 1e-15);
        let flipped: Vec<DQuat> =
            turns.iter().enumerate().map(|(i, q)| if i % 2 == 0 { -*q } else { *q }).collect();
        assert!(relative_angle(karcher_mean(&flipped, flipped[2]).unwrap(), mean) < 1e-15);
    }

    #[test]
    fn rotations_around_the_whole_circle_have_no_mean() {
        let turns: Vec<DQuat> =
            (0..5).map(|k| exp_vector(DVec3::Z * (f64::from(k) * 2.0 * PI / 5.0))).collect();
        assert!(matches!(karcher_mean(&turns, turns[2]), Err(MeanError::TooWide { .. })));
    }

    #[test]
    fn files_hold_one_sign_of_each_quaternion() {
        let t = |q: [f64; 4], want: [f64; 4]| {
            let got = canonical_sign(DQuat::from_array(q)).to_array();
            assert_eq!(got.map(f64::to_bits), want.map(f64::to_bits), "{q:?}");
        };
        t([0.6, 0.0, 0.0, -0.8], [-0.6, 0.0, 0.0, 0.8]);
        t([0.0, -0.6, 0.8, -0.0], [0.0, 0.6, -0.8, 0.0]);
        t([0.0, 0.0, -1.0, 0.0], [0.0, 0.0, 1.0, 0.0]);
        t([-0.6, 0.0, 0.0, 0.8], [-0.6, 0.0, 0.0, 0.8]);
    }
}
