//! Exact ratios of integers, for rates.

use std::fmt;
use std::str::FromStr;

/// A positive rational in lowest terms, read from `5`, `1.1` or `11/10` without passing through
/// floating point: in floats `ceil(1.1 * 50)` is 56.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Ratio {
    pub(super) numerator: u64,
    pub(super) denominator: u64,
}

impl Ratio {
    /// `numerator / denominator`, reduced; `None` unless both are positive.
    #[must_use]
    pub fn new(numerator: u64, denominator: u64) -> Option<Self> {
        if numerator == 0 || denominator == 0 {
            return None;
        }
        let g = greatest_divisor(numerator, denominator);
        Some(Self { numerator: numerator / g, denominator: denominator / g })
    }

    /// Numerator in lowest terms.
    #[must_use]
    pub fn numerator(self) -> u64 {
        self.numerator
    }

    /// Denominator in lowest terms.
    #[must_use]
    pub fn denominator(self) -> u64 {
        self.denominator
    }

    /// The nearest `f64`.
    #[must_use]
    pub fn to_f64(self) -> f64 {
        self.numerator as f64 / self.denominator as f64
    }

    /// `ceil(self * n)`, or `None` if that exceeds 64 bits.
    #[must_use]
    pub fn ceil_times(self, n: u64) -> Option<u64> {
        // The product of two 64-bit numbers fits 128 bits.
        let product = u128::from(self.numerator) * u128::from(n);
        u64::try_from(product.div_ceil(u128::from(self.denominator))).ok()
    }
}

fn greatest_divisor(mut a: u64, mut b: u64) -> u64 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

impl fmt::Display for Ratio {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.numerator, self.denominator)
    }
}

impl serde::Serialize for Ratio {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// The reason why a text is not a [`Ratio`].
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is not a positive number such as 5, 1.1, 2.4e3 or 11/10 (of at most 18 digits)")]
pub struct RatioError(String);

impl FromStr for Ratio {
    type Err = RatioError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        parse_ratio(text.trim()).ok_or_else(|| RatioError(text.to_owned()))
    }
}

fn parse_ratio(text: &str) -> Option<Ratio> {
    if let Some((n, d)) = text.split_once('/') {
        return Ratio::new(parse_digits(n.trim())?, parse_digits(d.trim())?);
    }
    let (mantissa, exponent) = match text.split_once(['e', 'E']) {
        Some((m, e)) => (m, e.parse::<i32>().ok()?),
        None => (text, 0),
    };
    let mantissa = mantissa.strip_prefix('+').unwrap_or(mantissa);
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    if whole.is_empty() && fraction.is_empty() {
        return None;
    }
    // Trailing zeros would only use up the digits that are allowed.
    let fraction = fraction.trim_end_matches('0');
    // The leading zero stands for a whole part that is left out, as in `.5`.
    let digits = parse_digits(&format!("0{whole}{fraction}"))?;
    let scale = exponent.checked_sub(i32::try_from(fraction.len()).ok()?)?;
    let power = 10u64.checked_pow(scale.unsigned_abs())?;
    if scale >= 0 { Ratio::new(digits.checked_mul(power)?, 1) } else { Ratio::new(digits, power) }
}

fn parse_digits(text: &str) -> Option<u64> {
    let significant = text.trim_start_matches('0');
    // 18 digits always fit 64 bits.
    let plain = !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit()) && significant.len() <= 18;
    if !plain {
        return None;
    }
    if significant.is_empty() { Some(0) } else { significant.parse().ok() }
}
