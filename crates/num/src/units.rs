//! Units that would otherwise be bare numbers: exact ratios, frame rates, time stamps.
//!
//! Inside the program, time is an integer number of nanoseconds since a trajectory's first stamp.
//! Files hold integer microseconds. Both conversions are here only.
//!
//! # Examples
//!
//! ```
//! use gs2e_num::units::{Hertz, Ratio, Timestamp, format_amount};
//!
//! // Exact, where floats give 56.
//! assert_eq!("1.1".parse::<Ratio>()?.ceil_times(50), Some(55));
//! // Frame 1 lies at 416.67 us.
//! assert_eq!(Hertz("2400".parse()?).stamp_us(1), 417);
//! // Events are stamped with the microsecond in which they lie.
//! assert_eq!(Timestamp(1999).floor_micros(), 1);
//! assert_eq!(format_amount(52_100_000, "B"), "52.1 MB");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod ratio;

pub use ratio::{Ratio, RatioError};

/// An instant, in nanoseconds since the trajectory's first stamp.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Timestamp(pub i64);

impl Timestamp {
    /// The instant of a stamp in integer microseconds.
    ///
    /// # Panics
    /// The stamp is beyond 292,000 years, where nanoseconds exceed 64 bits. Readers bound their
    /// stamps long before.
    #[must_use]
    #[inline]
    pub fn from_micros(us: i64) -> Self {
        Self(us.checked_mul(1000).expect("stamps are bounded where they are read"))
    }

    /// The microsecond that contains this instant, as event files store it: `floor(ns / 1000)`.
    #[must_use]
    #[inline]
    pub fn floor_micros(self) -> i64 {
        self.0.div_euclid(1000)
    }

    /// Seconds since the first stamp.
    #[must_use]
    pub fn seconds(self) -> f64 {
        self.0 as f64 * 1e-9
    }
}

/// An amount for messages, with at most three digits before the point: `999 B`, `52.1 MB`,
/// `12.4 Mev`.
#[must_use]
pub fn format_amount(n: u64, unit: &str) -> String {
    const PREFIXES: [&str; 6] = ["k", "M", "G", "T", "P", "E"];
    if n < 1000 {
        return format!("{n} {unit}");
    }
    let mut scaled = n as f64 / 1000.0;
    let mut prefix = 0;
    // A value that would round to 1000.0 is shown as 1.0 of the next unit.
    while scaled >= 999.95 && prefix + 1 < PREFIXES.len() {
        scaled /= 1000.0;
        prefix += 1;
    }
    format!("{scaled:.1} {}{unit}", PREFIXES[prefix])
}

/// A real for people, by value: `0.25`, `150`, and with an exponent where it would be long,
/// `1e300`.
#[must_use]
pub fn brief(value: f64) -> String {
    let usual = value == 0.0 || !value.is_finite() || (1e-6..1e16).contains(&value.abs());
    if usual { value.to_string() } else { format!("{value:e}") }
}

/// A frame rate in frames per second, exact.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
pub struct Hertz(pub Ratio);

impl Hertz {
    /// Frames per second as the nearest `f64`.
    #[must_use]
    pub fn to_f64(self) -> f64 {
        self.0.to_f64()
    }

    /// The stamp of frame `index` in microseconds: `index / rate`, rounded half up in integers.
    /// 2400 Hz gives 0, 417, 833, 1250, ... and never drifts.
    ///
    /// # Panics
    /// The stamp exceeds 64 bits (index and rate are bounded where recipes are read).
    #[must_use]
    pub fn stamp_us(self, index: u64) -> i64 {
        self.stamp(index, 1_000_000)
    }

    /// As [`Hertz::stamp_us`], in nanoseconds.
    ///
    /// # Panics
    /// The stamp exceeds 64 bits.
    #[must_use]
    pub fn stamp_ns(self, index: u64) -> i64 {
        self.stamp(index, 1_000_000_000)
    }

    fn stamp(self, index: u64, a_second: u128) -> i64 {
        // In 128 bits: 2e9 times an index and a denominator of 18 digits exceeds 64.
        let (p, q) = (u128::from(self.0.numerator), u128::from(self.0.denominator));
        // Rounded half up in integers: `floor((2 n + d) / (2 d))` for the fraction `n / d`.
        let stamp = (2 * a_second * u128::from(index) * q + p) / (2 * p);
        i64::try_from(stamp).expect("indices and rates are bounded where they are read")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reals_are_short_whatever_their_size() {
        let t = |value: f64, wanted: &str| assert_eq!(brief(value), wanted);
        t(0.0, "0");
        t(150.0, "150");
        t(-0.25, "-0.25");
        t(1e-6, "0.000001");
        t(1e300, "1e300");
        t(-1.5e-7, "-1.5e-7");
        t(9_007_199_254_740_992.0, "9007199254740992");
        t(f64::INFINITY, "inf");
    }

    #[test]
    fn ratios_are_read_exactly() {
        let t = |text: &str, n, d| assert_eq!(text.parse(), Ok(Ratio::new(n, d).unwrap()), "{text}");
        t("5", 5, 1);
        t("1.1", 11, 10);
        t(".50", 1, 2);
        t("24e2", 2400, 1);
        t("0.5e-1", 1, 20);
        t("22/20", 11, 10);
        t(" 3 / 9 ", 1, 3);
        for bad in ["", "0", "-1", "1/0", "nan", "1.2.3", "1e400", ".", "1/2/3", "12345678901234567890"] {
            assert!(bad.parse::<Ratio>().is_err(), "{bad}");
        }
    }

    #[test]
    fn poses_per_view_are_counted_in_rationals() {
        assert_eq!("1.1".parse::<Ratio>().unwrap().ceil_times(50), Some(55));
        assert_eq!("5".parse::<Ratio>().unwrap().ceil_times(30), Some(150));
        assert_eq!("18446744073709/1".parse::<Ratio>().unwrap().ceil_times(u64::MAX), None);
    }

    #[test]
    fn stamps_round_half_up_and_do_not_drift() {
        let rate = Hertz("2400".parse().unwrap());
        let stamps: Vec<i64> = (0..5).map(|j| rate.stamp_us(j)).collect();
        assert_eq!(stamps, [0, 417, 833, 1250, 1667]);
        assert_eq!(rate.stamp_us(2400 * 3600), 3_600_000_000);
        // 32 Hz: frame 1 is at 31,250 us; 3200000 Hz would be 0.3125 us and frame 2 rounds to 1.
        assert_eq!(Hertz("3200000".parse().unwrap()).stamp_us(2), 1);
    }

    #[test]
    fn instants_floor_to_the_microsecond_they_lie_in() {
        assert_eq!(Timestamp(1999).floor_micros(), 1);
        assert_eq!(Timestamp(-1).floor_micros(), -1);
        assert_eq!(Timestamp::from_micros(-3).0, -3000);
    }
}
