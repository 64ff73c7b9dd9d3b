//! The Kolmogorov-Smirnov statistic, for tests and for the stress table.
//!
//! # Examples
//!
//! ```
//! use gs2e_num::seed::ks::scaled_distance;
//!
//! let uniform = |x: f64| x.clamp(0.0, 1.0);
//! // Four even values: the steps of their distribution function are 1/8 off, and sqrt(4) is 2.
//! assert_eq!(scaled_distance(vec![0.125, 0.375, 0.625, 0.875], uniform), 0.25);
//! // Four values at the lower end are as far off as values can be.
//! assert_eq!(scaled_distance(vec![0.0; 4], uniform), 2.0);
//! ```

/// Largest distance between a sample's distribution function and `cdf`, times the square root of
/// the sample size. Critical values: 1.63 at alpha 1e-2, 2.23 at 1e-4, 2.69 at 1e-6.
#[must_use]
pub fn scaled_distance(mut sample: Vec<f64>, cdf: impl Fn(f64) -> f64) -> f64 {
    sample.sort_unstable_by(f64::total_cmp);
    let n = sample.len() as f64;
    let distance = |(i, x): (usize, &f64)| {
        let p = cdf(*x);
        // The sample's function jumps at each value, so its level on both sides of the jump is compared.
        (p - i as f64 / n).max((i + 1) as f64 / n - p)
    };
    sample.iter().enumerate().map(distance).fold(0.0, f64::max) * n.sqrt()
}
