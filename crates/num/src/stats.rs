//! Medians, by their rule for an even number of values, and quantiles. Values are ordered by `total_cmp`.
//!
//! # Examples
//!
//! ```
//! use gs2e_num::stats::{lower_median, mean_median, nearest_ranks, upper_median};
//!
//! let mut values = [4.0, 1.0, 8.0, 2.0];
//! assert_eq!(lower_median(&mut values), Some(2.0));
//! assert_eq!(mean_median(values.to_vec()), Some(3.0));
//! assert_eq!(upper_median(values.to_vec()), Some(4.0));
//! // A quarter of four values is the first, and NaN does not count.
//! assert_eq!(nearest_ranks(vec![3.0, f32::NAN, 1.0, 2.0, 4.0], [25, 100]), Some([1.0, 4.0]));
//! ```

/// The median: the mean of the middle two for an even number of values. `None` without values.
#[must_use]
pub fn mean_median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    // Equal positions for an odd number of values.
    let (lower, upper) = (values.len().checked_sub(1)? / 2, values.len() / 2);
    Some(if lower == upper { values[lower] } else { f64::midpoint(values[lower], values[upper]) })
}

/// The median that is one of the values: the smaller of the middle two for an even number. `None`
/// without values.
#[must_use]
pub fn lower_median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len().checked_sub(1)? / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The median that is one of the values: the larger of the middle two for an even number. `None`
/// without values.
#[must_use]
pub fn upper_median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// Quantiles in percent of the values that are not NaN. `None` if no value is left. Each quantile
/// is one of the values: the smallest for which at least that share of all values is not larger
/// (nearest rank).
#[must_use]
pub fn nearest_ranks<const N: usize>(mut values: Vec<f32>, percents: [usize; N]) -> Option<[f32; N]> {
    values.retain(|v| !v.is_nan());
    values.sort_unstable_by(f32::total_cmp);
    let n = values.len();
    // At least rank 1, so that 0 % gives the smallest value.
    (n > 0).then(|| percents.map(|percent| values[(n * percent).div_ceil(100).max(1) - 1]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_differ_for_even_numbers_only() {
        let t = |values: &[f64], wanted: [Option<f64>; 3]| {
            let mut own = values.to_vec();
            let found = [lower_median(&mut own), mean_median(values.to_vec()), upper_median(values.to_vec())];
            assert_eq!(found, wanted, "{values:?}");
        };
        t(&[], [None; 3]);
        t(&[3.0], [Some(3.0); 3]);
        t(&[5.0, 1.0, 2.0], [Some(2.0); 3]);
        t(&[4.0, 1.0, 8.0, 2.0], [Some(2.0), Some(3.0), Some(4.0)]);
        t(&[f64::MAX, f64::MAX], [Some(f64::MAX); 3]);
    }

    #[test]
    fn quantiles_are_values_of_nearest_rank() {
        let t = |values: Vec<f32>, wanted: Option<[f32; 3]>| {
            assert_eq!(nearest_ranks(values, [50, 95, 100]), wanted);
        };
        t((1..=100).rev().map(|v| v as f32).collect(), Some([50.0, 95.0, 100.0]));
        t((1..=21).map(|v| v as f32).collect(), Some([11.0, 20.0, 21.0]));
        t(vec![3.0, f32::NAN], Some([3.0, 3.0, 3.0]));
        t(vec![f32::NAN], None);
        t(Vec::new(), None);
    }
}
