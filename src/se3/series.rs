//! Polynomials, and the power series of sines and cosines.

/// `sum c[k] x^k`
pub(super) fn series(x: f64, coefficients: &[f64]) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// `(-1)^k numerators[k] / (2k + first)!`: the coefficients of a sine, a cosine or what is made of them.
pub(super) const fn alternating<const N: usize>(first: usize, numerators: &[f64; N]) -> [f64; N] {
    let mut out = [0.0; N];
    let mut factorial = 1.0;
    let mut sign = 1.0;
    let (mut k, mut n) = (0, 1);
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
