//! Polynomials, and the power series of sines and cosines.

/// `sum c[k] x^k`, with even and odd powers in separate chains of operations, which a processor
/// overlaps.
#[inline]
pub(super) fn power_sum<const N: usize>(x: f64, coefficients: &[f64; N]) -> f64 {
    let x2 = x * x;
    let (mut even, mut odd) = (0.0, 0.0);
    for k in (0..N).rev() {
        if k % 2 == 0 {
            even = even * x2 + coefficients[k];
        } else {
            odd = odd * x2 + coefficients[k];
        }
    }
    even + x * odd
}

/// `(-1)^k numerators[k] / (2k + first)!`: coefficients of a sine, a cosine or a related function.
pub(super) const fn alternating_series<const N: usize>(first: usize, numerators: &[f64; N]) -> [f64; N] {
    let mut out = [0.0; N];
    let mut factorial = 1.0;
    let mut sign = 1.0;
    let (mut k, mut n) = (0, 1);
    // `while`, because constant functions have no `for`.
    while k < N {
        while n <= 2 * k + first {
            factorial *= n as f64;
            n += 1;
        }
        out[k] = sign * numerators[k] / factorial;
        sign = -sign;
        k += 1;
    }
    out
}
