//! Compensated sums: a million small steps add up to their sum within two roundings.
//!
//! # Examples
//!
//! ```
//! use gs2e_num::se3::sum::NeumaierSum;
//!
//! // Next to 1e16, an f64 has no room for 1.
//! let terms = [1e16, 1.0, -1e16];
//! assert_eq!(terms.iter().sum::<f64>(), 0.0);
//! assert_eq!(NeumaierSum::sum_of(terms), 1.0);
//! ```

/// A running sum with Neumaier's compensation (Neumaier 1974), the variant of Kahan's that
/// tolerates terms larger than the sum.
#[derive(Debug, Clone, Copy, Default)]
pub struct NeumaierSum {
    sum: f64,
    lost: f64,
}

impl NeumaierSum {
    /// Adds `term`.
    #[inline]
    pub fn add(&mut self, term: f64) {
        let next = self.sum + term;
        // The smaller of the two loses its low bits in the sum, so they are recovered from it.
        self.lost +=
            if self.sum.abs() >= term.abs() { (self.sum - next) + term } else { (term - next) + self.sum };
        self.sum = next;
    }

    /// The sum so far.
    #[must_use]
    #[inline]
    pub fn value(&self) -> f64 {
        self.sum + self.lost
    }

    /// The sum of `terms`.
    pub fn sum_of(terms: impl IntoIterator<Item = f64>) -> f64 {
        let mut sum = Self::default();
        terms.into_iter().for_each(|t| sum.add(t));
        sum.value()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_terms_survive_large_ones() {
        assert_eq!(NeumaierSum::sum_of([1.0, 1e100, 1.0, -1e100]).to_bits(), 2.0f64.to_bits());
        let million = NeumaierSum::sum_of(std::iter::repeat_n(0.1, 1_000_000));
        // 0.1 itself is 5.6e-18 too large, which adds up to 5.6e-12: below the spacing of doubles
        // at 1e5.
        assert_eq!(million.to_bits(), 100_000.0f64.to_bits());
    }
}
