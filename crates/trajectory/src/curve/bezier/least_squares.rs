//! Small least-squares problems by Householder's QR factorisation with column pivoting (Golub and
//! Van Loan, "Matrix Computations", algorithm 5.4.1). Normal equations would square the condition
//! of Bernstein polynomials, which is about `2^degree`.

use glam::DVec3;

/// Remaining share of the largest column below which a column counts as dependent. Its coefficient
/// would be rounding multiplied by 10^12.
const DEPENDENT: f64 = 1e-12;

/// The `q` that minimises `sum_k |sum_i columns[i][k] q[i] - right[k]|^2`. Coefficients of
/// dependent columns are zero.
pub(super) fn solve_columns(mut columns: Vec<Vec<f64>>, mut right: Vec<DVec3>) -> Vec<DVec3> {
    let mut order: Vec<usize> = (0..columns.len()).collect();
    let mut pivots = Vec::with_capacity(columns.len());
    for k in 0..columns.len().min(right.len()) {
        let Some((widest, norm)) = widest_column(&columns[k..], k) else { break };
        // Before the first pivot the limit is 0, so that only columns of zeros end the
        // factorisation there.
        let least = DEPENDENT * pivots.first().map_or(0.0, |first: &f64| first.abs());
        if norm <= least {
            break;
        }
        // Whole columns are swapped, because the rows above `k` hold their part of the triangular factor.
        columns.swap(k, k + widest);
        order.swap(k, k + widest);
        let (done, rest) = columns.split_at_mut(k + 1);
        let mirror = HouseholderReflection::onto_axis(&mut done[k][k..], norm);
        rest.iter_mut().for_each(|column| mirror.apply(&mut column[k..]));
        mirror.apply(&mut right[k..]);
        pivots.push(mirror.pivot);
    }
    let mut solution = vec![DVec3::ZERO; columns.len()];
    for k in (0..pivots.len()).rev() {
        // The triangular factor is in row `k` of the later columns. Its diagonal is kept apart,
        // because the normals of the reflections occupy it.
        let known: DVec3 = (k + 1..pivots.len()).map(|j| solution[order[j]] * columns[j][k]).sum();
        solution[order[k]] = (right[k] - known) / pivots[k];
    }
    solution
}

/// The column with the largest norm from row `k` on, and that norm.
fn widest_column(columns: &[Vec<f64>], k: usize) -> Option<(usize, f64)> {
    // Computed for each pivot: if the squares were updated by subtraction, dependent columns would cancel.
    let norm = |column: &Vec<f64>| column[k..].iter().map(|a| a * a).sum::<f64>().sqrt();
    columns.iter().map(norm).enumerate().reduce(|a, b| if b.1 > a.1 { b } else { a })
}

/// A Householder reflection that maps one column to a multiple of the first axis.
struct HouseholderReflection<'a> {
    normal: &'a [f64],
    /// 2 divided by the squared length of the normal.
    factor: f64,
    /// The resulting multiple.
    pivot: f64,
}

impl<'a> HouseholderReflection<'a> {
    /// Replaces the column of length `norm > 0` by the normal of the reflection.
    fn onto_axis(column: &'a mut [f64], norm: f64) -> Self {
        // The sign is the opposite of the column's, so that `column[0] - pivot` does not cancel.
        let pivot = -norm.copysign(column[0]);
        // v.v = 2 norm (norm + |a|), without cancellation.
        let factor = 1.0 / (norm * (norm + column[0].abs()));
        column[0] -= pivot;
        Self { normal: column, factor, pivot }
    }

    fn apply<T>(&self, column: &mut [T])
    where
        T: Copy + std::ops::Mul<f64, Output = T> + std::ops::SubAssign + std::iter::Sum,
    {
        let along = self.normal.iter().zip(&*column).map(|(n, c)| *c * *n).sum::<T>() * self.factor;
        self.normal.iter().zip(column).for_each(|(n, c)| *c -= along * *n);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns(rows: &[&[f64]]) -> Vec<Vec<f64>> {
        (0..rows[0].len()).map(|i| rows.iter().map(|row| row[i]).collect()).collect()
    }

    #[test]
    fn planted_solutions_are_found() {
        // Vandermonde rows of distinct nodes: a right side made from coefficients has them as its
        // only solution.
        let nodes = [-0.9, -0.3, 0.1, 0.4, 0.8, 1.0];
        for count in 1..=6 {
            let rows: Vec<Vec<f64>> = nodes
                .iter()
                .map(|x| std::iter::successors(Some(1.0), |p| Some(p * x)).take(count).collect())
                .collect();
            let rows: Vec<&[f64]> = rows.iter().map(Vec::as_slice).collect();
            let planted: Vec<DVec3> = (0..count).map(|i| DVec3::new(1.0, -2.0, i as f64)).collect();
            let right = rows.iter().map(|r| r.iter().zip(&planted).map(|(a, q)| *q * *a).sum()).collect();
            for (got, want) in solve_columns(columns(&rows), right).iter().zip(&planted) {
                // A condition of at most 1e3, and some roundings.
                assert!((*got - *want).length() < 1e-12, "{count}: {got} {want}");
            }
        }
    }

    #[test]
    fn what_remains_is_orthogonal_to_every_column() {
        let rows: [&[f64]; 4] = [&[1.0, 2.0], &[0.5, -1.0], &[3.0, 0.25], &[-1.0, 1.0]];
        let right = [DVec3::X, DVec3::new(2.0, 1.0, 0.0), DVec3::Z, DVec3::ONE];
        let q = solve_columns(columns(&rows), right.to_vec());
        for i in 0..2 {
            let gradient: DVec3 =
                rows.iter().zip(right).map(|(r, b)| (q[0] * r[0] + q[1] * r[1] - b) * r[i]).sum();
            assert!(gradient.length() < 1e-14, "{i}: {gradient}");
        }
    }

    #[test]
    fn dependent_columns_get_nothing() {
        let t = |rows: &[&[f64]], right: &[f64], want: &[f64]| {
            let q = solve_columns(columns(rows), right.iter().map(|b| DVec3::X * *b).collect());
            let off = q.iter().zip(want).map(|(q, w)| (q.x - w).abs()).fold(0.0, f64::max);
            assert!(off < 1e-14, "{q:?}");
        };
        t(&[&[1.0, 2.0], &[1.0, 2.0]], &[4.0, 4.0], &[0.0, 2.0]);
        t(&[&[0.0, 0.0], &[0.0, 0.0]], &[1.0, 2.0], &[0.0, 0.0]);
        t(&[&[3.0, 1e-15]], &[6.0], &[2.0, 0.0]);
        t(&[&[0.0, 1e-120]], &[1e-120], &[0.0, 1.0]);
    }
}
