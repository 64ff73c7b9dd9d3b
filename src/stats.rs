//! Medians, by their rule for an even number of values. Values are ordered by `total_cmp`.

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
}
