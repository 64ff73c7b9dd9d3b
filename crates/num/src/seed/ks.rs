//! The Kolmogorov-Smirnov statistic, for tests and for the stress table.

/// Largest distance between a sample's distribution function and `cdf`, times the square root of
/// the sample size. Critical values: 1.63 at alpha 1e-2, 2.23 at 1e-4, 2.69 at 1e-6.
#[must_use]
pub fn scaled_distance(mut sample: Vec<f64>, cdf: impl Fn(f64) -> f64) -> f64 {
    sample.sort_unstable_by(f64::total_cmp);
    let n = sample.len() as f64;
    let distance = |(i, x): (usize, &f64)| {
        let p = cdf(*x);
        (p - i as f64 / n).max((i + 1) as f64 / n - p)
    };
    sample.iter().enumerate().map(distance).fold(0.0, f64::max) * n.sqrt()
}
