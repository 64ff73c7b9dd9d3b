//! Principal axes of a symmetric 3x3 matrix, by Jacobi's method (Golub and Van Loan, "Matrix
//! Computations", 8.5).

use glam::{DMat3, DVec3};

/// Number of sweeps over the three pairs of axes. Convergence is quadratic: five sweeps reach the
/// rounding error, and further ones change nothing.
const SWEEPS: usize = 12;

/// The eigenvalues of a symmetric matrix in ascending order, each with its eigenvector of unit
/// length.
pub(super) fn principal_axes(symmetric: DMat3) -> [(f64, DVec3); 3] {
    let (mut a, mut axes) = (symmetric, DMat3::IDENTITY);
    for _ in 0..SWEEPS {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let turn = rotation(&a, p, q);
            a = turn.transpose() * a * turn;
            axes *= turn;
        }
    }
    let mut found = [0, 1, 2].map(|k| (a.col(k)[k], axes.col(k)));
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found
}

/// The rotation in the plane of two axes that removes their covariance.
fn rotation(a: &DMat3, p: usize, q: usize) -> DMat3 {
    let both = a.col(q)[p];
    let mut turn = DMat3::IDENTITY;
    if both == 0.0 {
        return turn;
    }
    let theta = (a.col(q)[q] - a.col(p)[p]) / (2.0 * both);
    // The smaller of the two solutions, which keeps the axes in order.
    let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
    let c = (t * t + 1.0).sqrt().recip();
    let s = t * c;
    (turn.col_mut(p)[p], turn.col_mut(q)[q]) = (c, c);
    (turn.col_mut(q)[p], turn.col_mut(p)[q]) = (s, -s);
    turn
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn planted_axes_are_found() {
        for (turn, values) in [
            (DQuat::IDENTITY, [3.0, 1.0, 2.0]),
            (DQuat::from_xyzw(0.1, -0.5, 0.3, 0.7).normalize(), [0.5, 4.0, 1e3]),
            (DQuat::from_xyzw(0.9, 0.1, -0.2, 0.1).normalize(), [1e-9, 1.0, 1.0]),
        ] {
            let axes = DMat3::from_quat(turn);
            let planted = axes * DMat3::from_diagonal(DVec3::from_array(values)) * axes.transpose();
            let found = principal_axes(planted);
            let mut sorted = values;
            sorted.sort_by(f64::total_cmp);
            let largest = sorted[2];
            for ((value, axis), wanted) in found.into_iter().zip(sorted) {
                // A dozen roundings of 1e-16 of the largest entry.
                assert!((value - wanted).abs() < 1e-14 * largest, "{value} {wanted}");
                assert!((planted * axis - axis * value).length() < 1e-14 * largest);
                assert!((axis.length() - 1.0).abs() < 1e-14);
            }
        }
        assert!(principal_axes(DMat3::ZERO).iter().all(|(value, _)| value.abs() < 1e-300));
    }
}
