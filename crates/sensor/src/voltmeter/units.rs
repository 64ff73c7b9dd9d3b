//! The units of a literal `k`, and the one unit system in which the program computes.
//!
//! The official system is that of the published program: microseconds and grey 0..255. There k1 is
//! a pure number, k2 in grey, k3 in grey^.5/us^.5, k4 in 1/us, k5 in 1/(grey us), k6 in 1/us^.5.
//!
//! # Examples
//!
//! ```
//! use gs2e_sensor::voltmeter::units::{ConstantUnits, TimeUnit, WhiteBrightness};
//!
//! let units = ConstantUnits { time: TimeUnit::S, brightness: WhiteBrightness::Unit };
//! // k1 has no unit, k2 is a brightness, and k4 is a rate.
//! let k = units.to_official([0.5, 0.1, 0.0, 2.0, 0.0, 0.0]);
//! assert_eq!(k, [0.5, 25.5, 0.0, 2e-6, 0.0, 0.0]);
//! assert_eq!(ConstantUnits::OFFICIAL.to_official(k), k);
//! ```

use serde::{Deserialize, Serialize};

/// Units of `k`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConstantUnits {
    /// Unit of time. Required.
    pub time: TimeUnit,
    /// Brightness of white. Required.
    pub brightness: WhiteBrightness,
}

/// A unit of time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TimeUnit {
    /// Microseconds.
    Us,
    /// Milliseconds.
    Ms,
    /// Seconds.
    S,
}

impl TimeUnit {
    /// Length of a microsecond in this unit.
    #[must_use]
    pub fn of_a_microsecond(self) -> f64 {
        match self {
            Self::Us => 1.0,
            Self::Ms => 1e-3,
            Self::S => 1e-6,
        }
    }
}

/// The brightness of white; `255` or `1` in a recipe.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "u32", into = "u32")]
pub enum WhiteBrightness {
    /// Grey 0..255.
    Grey255,
    /// 0..1.
    Unit,
}

impl WhiteBrightness {
    /// The number of greys of 0..255 in one unit of this scale.
    #[must_use]
    pub fn greys(self) -> f64 {
        match self {
            Self::Grey255 => 1.0,
            Self::Unit => 255.0,
        }
    }
}

/// The error for a brightness of white other than 255 or 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("brightness {0} is neither 255 nor 1")]
pub struct BrightnessError(u32);

impl TryFrom<u32> for WhiteBrightness {
    type Error = BrightnessError;

    fn try_from(white: u32) -> Result<Self, BrightnessError> {
        match white {
            255 => Ok(Self::Grey255),
            1 => Ok(Self::Unit),
            other => Err(BrightnessError(other)),
        }
    }
}

impl From<WhiteBrightness> for u32 {
    fn from(brightness: WhiteBrightness) -> Self {
        match brightness {
            WhiteBrightness::Grey255 => 255,
            WhiteBrightness::Unit => 1,
        }
    }
}

impl ConstantUnits {
    /// The units of the published program.
    pub const OFFICIAL: Self = Self { time: TimeUnit::Us, brightness: WhiteBrightness::Grey255 };

    /// Converts `k` from these units to the official ones. The process stays the same: every
    /// increment of the drift and of the noise's standard deviation is unchanged.
    #[must_use]
    pub fn to_official(self, k: [f64; 6]) -> [f64; 6] {
        let (r, g) = (self.time.of_a_microsecond(), self.brightness.greys());
        // `sqrt(L)/(L + k2)` falls by the root of `g` when greys are counted, so k3 grows by it.
        [k[0], k[1] * g, k[2] * (g * r).sqrt(), k[3] * r, k[4] * r / g, k[5] * r.sqrt()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Drift between two brightnesses and standard deviation over a time, in the common units of
    /// the arguments.
    fn increments([k1, k2, k3, k4, k5, k6]: [f64; 6], [a, b]: [f64; 2], time: f64) -> [f64; 2] {
        let drift = k1 * ((b + k2) / (a + k2)).ln() + (k4 + k5 * a) * time;
        [drift, (k3 * a.sqrt() / (a + k2) + k6) * time.sqrt()]
    }

    #[test]
    fn a_process_does_not_know_its_units() {
        let k = [0.5, 1e-3, 0.1, 0.01, 0.1, 1e-5];
        for time in [TimeUnit::Us, TimeUnit::Ms, TimeUnit::S] {
            for brightness in [WhiteBrightness::Grey255, WhiteBrightness::Unit] {
                let units = ConstantUnits { time, brightness };
                let (g, r) = (brightness.greys(), time.of_a_microsecond());
                for [a, b] in [[1.0, 1.25], [16.0, 17.0], [128.0, 255.0]] {
                    let own = increments(k, [a / g, b / g], 416.0 * r);
                    let official = increments(units.to_official(k), [a, b], 416.0);
                    for (x, y) in own.into_iter().zip(official) {
                        // Four roundings in either form, each of at most half an ulp of a sum of
                        // like signs.
                        assert!((x - y).abs() <= 4.0 * f64::EPSILON * x.abs(), "{units:?}: {x:e} and {y:e}");
                    }
                }
            }
        }
    }

    #[test]
    fn official_units_change_nothing() {
        let k = [5.265, 20.0, 1e-4, 1e-7, 5e-9, 1e-5];
        assert!(
            ConstantUnits::OFFICIAL.to_official(k).iter().zip(k).all(|(a, b)| a.to_bits() == b.to_bits())
        );
    }

    #[test]
    fn units_are_written_as_in_recipes() {
        let units = ConstantUnits { time: TimeUnit::Ms, brightness: WhiteBrightness::Unit };
        let text = r#"{"time":"ms","brightness":1}"#;
        assert_eq!(serde_json::to_string(&units).unwrap(), text);
        assert_eq!(serde_json::from_str::<ConstantUnits>(text).unwrap(), units);
        let wrong = serde_json::from_str::<ConstantUnits>(r#"{"time":"ms","brightness":100}"#).unwrap_err();
        assert!(wrong.to_string().starts_with("brightness 100 is neither 255 nor 1"), "{wrong}");
    }
}
