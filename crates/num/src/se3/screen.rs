//! Checks of rotations in files: from nine or four numbers to a rotation, or to the reason why they
//! are not one.
//!
//! # Examples
//!
//! ```
//! use glam::{DMat3, DQuat, DVec3};
//! use gs2e_num::se3::{RotationError, rotation_from_matrix, rotation_from_quaternion};
//!
//! // A quaternion with few digits is normalised, and gets a positive w. A deviation above 1e-6 is marked.
//! let screened = rotation_from_quaternion(DQuat::from_xyzw(0.0, 0.0, -0.8, -0.60001))?;
//! assert!(screened.rotation.w > 0.0 && screened.projected);
//! assert!((screened.rotation.length() - 1.0).abs() < 1e-12);
//! // A mirror is no rotation.
//! let mirror = DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0));
//! assert!(matches!(rotation_from_matrix(&mirror), Err(RotationError::Mirrors { .. })));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use glam::{DMat3, DQuat};

/// Deviation from a rotation above which numbers are refused.
const REFUSED: f64 = 1e-3;
/// Deviation above which a warning says that the nearest rotation was taken.
const MAX_SILENT: f64 = 1e-6;

/// A rotation read from a file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScreenedRotation {
    /// The nearest rotation, a unit quaternion with `w >= 0`.
    pub rotation: DQuat,
    /// True if the numbers deviate by more than 1e-6, so that a warning is due.
    pub projected: bool,
    /// Deviation of the numbers from a rotation: `max |R^T R - I|`, or `| |q|^2 - 1 |`.
    pub deviation: f64,
}

/// The reason why numbers are not a rotation.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum RotationError {
    /// A number is NaN or infinite.
    #[error("a rotation holds a number that is not finite")]
    NotFinite,
    /// The columns are not orthonormal, or the quaternion is not of length 1.
    #[error("a rotation is not orthonormal: it deviates by {deviation:.3e}, wanted at most {REFUSED:e}")]
    NotOrthonormal {
        /// `max |R^T R - I|`, or `| |q|^2 - 1 |`.
        deviation: f64,
    },
    /// The determinant is negative.
    #[error("a rotation contains a reflection: its determinant is {determinant:.6}, wanted 1")]
    Mirrors {
        /// Determinant of the matrix.
        determinant: f64,
    },
}

/// The rotation nearest to `matrix` in the Frobenius norm.
///
/// # Errors
/// A number is not finite, `max |R^T R - I|` exceeds 1e-3, or the determinant is negative.
pub fn rotation_from_matrix(matrix: &DMat3) -> Result<ScreenedRotation, RotationError> {
    if !matrix.is_finite() {
        return Err(RotationError::NotFinite);
    }
    let excess = matrix.transpose() * *matrix - DMat3::IDENTITY;
    let deviation = excess.to_cols_array().iter().fold(0.0, |m: f64, e| m.max(e.abs()));
    refuse_above_limit(deviation)?;
    let determinant = matrix.determinant();
    // A reflection has orthonormal columns too, so the determinant is tested by itself.
    if determinant < 0.0 {
        return Err(RotationError::Mirrors { determinant });
    }
    let rotation = super::rotation::canonical_sign(DQuat::from_mat3(&nearest_rotation(*matrix)).normalize());
    Ok(ScreenedRotation { rotation, projected: deviation > MAX_SILENT, deviation })
}

/// Normalises a quaternion.
///
/// # Errors
/// A number is not finite, or `|q|^2` differs from 1 by more than 1e-3.
pub fn rotation_from_quaternion(q: DQuat) -> Result<ScreenedRotation, RotationError> {
    if !q.is_finite() {
        return Err(RotationError::NotFinite);
    }
    let deviation = (q.length_squared() - 1.0).abs();
    refuse_above_limit(deviation)?;
    let rotation = super::rotation::canonical_sign(q.normalize());
    Ok(ScreenedRotation { rotation, projected: deviation > MAX_SILENT, deviation })
}

/// Written so that infinity and NaN are refused too.
fn refuse_above_limit(deviation: f64) -> Result<(), RotationError> {
    if deviation <= REFUSED { Ok(()) } else { Err(RotationError::NotOrthonormal { deviation }) }
}

/// The orthogonal factor of the polar decomposition, by Newton's iteration `X <- (X + X^-T) / 2`
/// (Higham 1986, "Computing the polar decomposition"). Each round squares the error: from the
/// accepted 1e-3, four rounds leave nothing above rounding.
fn nearest_rotation(matrix: DMat3) -> DMat3 {
    (0..4).fold(matrix, |x, _| (x + x.inverse().transpose()) * 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::se3::rotation::{exp_vector, relative_angle};
    use glam::DVec3;

    fn tilted() -> DMat3 {
        // Columns of a rotation from Pythagorean triples, exact in binary except for one rounding
        // each.
        DMat3::from_cols(DVec3::new(0.6, 0.8, 0.0), DVec3::new(-0.8, 0.6, 0.0), DVec3::Z)
    }

    #[test]
    fn matrices_and_quaternions_name_the_same_rotation_at_every_angle() {
        // Every branch of the conversion: the largest of w, x, y, z in turn, and the half turns
        // between them.
        for axis in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::new(0.6, -0.8, 0.0), DVec3::new(-0.48, 0.6, 0.64)] {
            for degrees in [0.0f64, 1e-9, 1e-3, 30.0, 90.0, 119.0, 121.0, 179.0, 180.0 - 1e-9, 180.0] {
                let q = exp_vector(axis * (degrees * std::f64::consts::PI / 180.0));
                let screened = rotation_from_matrix(&DMat3::from_quat(q)).unwrap();
                // Some roundings of the matrix entries, 1.1e-16 each; an angle is twice the step of
                // a quaternion.
                assert!(relative_angle(q, screened.rotation) < 2e-15, "{axis} {degrees}");
                assert!(!screened.projected && screened.rotation.w >= 0.0);
            }
        }
    }

    #[test]
    fn a_matrix_beside_a_rotation_is_projected_to_the_nearest() {
        // The rotation nearest to R S, with S symmetric and positive, is R.
        let s = DMat3::from_cols_array(&[1.0003, 1e-4, 0.0, 1e-4, 0.9998, -2e-4, 0.0, -2e-4, 1.0001]);
        let screened = rotation_from_matrix(&(tilted() * s)).unwrap();
        let exact = rotation_from_matrix(&tilted()).unwrap();
        assert!(screened.projected && !exact.projected);
        assert!(relative_angle(screened.rotation, exact.rotation) < 1e-15);
    }

    #[test]
    fn what_is_no_rotation_is_refused_by_name() {
        let refuse = |m: DMat3| rotation_from_matrix(&m).unwrap_err();
        assert!(matches!(refuse(tilted() * 1.001), RotationError::NotOrthonormal { .. }));
        assert!(matches!(refuse(DMat3::ZERO), RotationError::NotOrthonormal { .. }));
        assert!(matches!(refuse(tilted() * 1e200), RotationError::NotOrthonormal { .. }));
        assert!(matches!(refuse(tilted() * f64::NAN), RotationError::NotFinite));
        assert!(matches!(refuse(tilted() * -1.0), RotationError::Mirrors { .. }));
        assert!(rotation_from_matrix(&(tilted() * 1.0004)).unwrap().projected);
    }

    #[test]
    fn quaternions_are_screened_by_their_length() {
        let q = DQuat::from_xyzw(0.0, 0.6, 0.0, -0.8);
        let screened = rotation_from_quaternion(q * 1.0001).unwrap();
        assert!(screened.projected && (screened.rotation.w - 0.8).abs() < 1e-15);
        assert!(!rotation_from_quaternion(q).unwrap().projected);
        assert!(rotation_from_quaternion(q * 0.9).is_err());
        assert!(rotation_from_quaternion(q * 0.0).is_err());
        assert!(rotation_from_quaternion(q * f64::INFINITY).is_err());
    }
}
