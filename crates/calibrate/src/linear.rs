//! Small symmetric systems of equations.

/// Largest number of unknowns.
pub(crate) const MOST: usize = 8;

/// A symmetric matrix. Its first `n` rows and columns are used.
pub(crate) type Square = [[f64; MOST]; MOST];

/// The lower triangle `L` of `L L' = a`; `None` if `a` is not positive definite.
fn factor(a: &Square, n: usize) -> Option<Square> {
    let mut lower = [[0.0; MOST]; MOST];
    for i in 0..n {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| lower[i][k] * lower[j][k]).sum();
            let rest = a[i][j] - sum;
            if i != j {
                lower[i][j] = rest / lower[j][j];
            } else if rest > 1e-14 * a[i][i].abs() && rest.is_finite() {
                lower[i][i] = rest.sqrt();
            } else {
                return None;
            }
        }
    }
    Some(lower)
}

/// The solution of `a x = b` with `n` unknowns, by Cholesky; `None` if `a` is not positive definite.
pub(crate) fn solve(a: &Square, b: &[f64; MOST], n: usize) -> Option<[f64; MOST]> {
    let lower = factor(a, n)?;
    let mut x = [0.0; MOST];
    for i in 0..n {
        let sum: f64 = (0..i).map(|k| lower[i][k] * x[k]).sum();
        x[i] = (b[i] - sum) / lower[i][i];
    }
    for i in (0..n).rev() {
        let sum: f64 = (i + 1..n).map(|k| lower[k][i] * x[k]).sum();
        x[i] = (x[i] - sum) / lower[i][i];
    }
    Some(x)
}

/// The inverse of a symmetric matrix of three rows; `None` if it is singular.
pub(crate) fn inverse_of_three(a: &[[f64; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    let minor = |i: usize, j: usize| {
        let [r, s] = [(i + 1) % 3, (i + 2) % 3];
        let [c, d] = [(j + 1) % 3, (j + 2) % 3];
        a[r][c] * a[s][d] - a[r][d] * a[s][c]
    };
    let determinant: f64 = (0..3).map(|j| a[0][j] * minor(0, j)).sum();
    let inverse = |i: usize| [0, 1, 2].map(|j| minor(j, i) / determinant);
    (determinant.is_finite() && determinant != 0.0).then(|| [0, 1, 2].map(inverse))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A matrix with a known inverse: `[[4, 2, 0], [2, 5, 1], [0, 1, 3]]` times `[1, -2, 3]`.
    #[test]
    fn planted_solutions_are_found() {
        let rows = [[4.0, 2.0, 0.0], [2.0, 5.0, 1.0], [0.0, 1.0, 3.0]];
        let mut a = [[0.0; MOST]; MOST];
        (0..3).for_each(|i| a[i][..3].copy_from_slice(&rows[i]));
        let mut b = [0.0; MOST];
        b[..3].copy_from_slice(&[0.0, -5.0, 7.0]);
        let x = solve(&a, &b, 3).unwrap();
        [1.0, -2.0, 3.0].iter().zip(x).for_each(|(want, got)| assert!((want - got).abs() < 1e-13, "{x:?}"));
        let inverse = inverse_of_three(&rows).unwrap();
        for i in 0..3 {
            let found: f64 = (0..3).map(|j| inverse[i][j] * b[j]).sum();
            assert!((found - x[i]).abs() < 1e-13);
        }
        assert!(solve(&[[0.0; MOST]; MOST], &b, 3).is_none());
    }
}
