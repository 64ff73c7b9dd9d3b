//! The weights of red, green and blue in the brightness.

use super::FrontEndError;
use serde::{Deserialize, Serialize};

/// Largest accepted difference between the sum of the weights and 1: the rounding of decimals with
/// seven digits.
const SUM: f64 = 1e-6;

/// Weights of red, green and blue.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LuminanceWeights {
    /// 0.299, 0.587, 0.114 of ITU-R BT.601: the published simulators read their frames with them.
    #[default]
    Rec601,
    /// 0.2126, 0.7152, 0.0722 of ITU-R BT.709: the luminance of sRGB light.
    Rec709,
    /// Weights given as numbers.
    Weights(ColourWeights),
}

/// Three finite numbers of at least 0 with a sum of 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "[f64; 3]", into = "[f64; 3]")]
pub struct ColourWeights([f64; 3]);

impl LuminanceWeights {
    /// Weights from numbers; the named ones if the numbers are theirs.
    ///
    /// # Errors
    /// A weight is not finite or below 0, or they do not sum to 1 within 1e-6.
    pub fn from_weights(weights: [f64; 3]) -> Result<Self, FrontEndError> {
        let bits = |weights: [f64; 3]| weights.map(f64::to_bits);
        let mut named = [Self::Rec601, Self::Rec709].into_iter();
        // Compared as bits, so that only the exact numbers of a named set get its name.
        let named = named.find(|named| bits(named.weights()) == bits(weights));
        named.map_or_else(|| ColourWeights::try_from(weights).map(Self::Weights), Ok)
    }

    /// Weights of red, green and blue.
    #[must_use]
    pub fn weights(self) -> [f64; 3] {
        match self {
            Self::Rec601 => [0.299, 0.587, 0.114],
            Self::Rec709 => [0.2126, 0.7152, 0.0722],
            Self::Weights(ColourWeights(weights)) => weights,
        }
    }
}

/// The sum of weights with nine digits, for messages.
pub fn told_sum(weights: &[f64; 3]) -> f64 {
    libm::round(weights.iter().sum::<f64>() * 1e9) / 1e9
}

impl TryFrom<[f64; 3]> for ColourWeights {
    type Error = FrontEndError;

    fn try_from(weights: [f64; 3]) -> Result<Self, FrontEndError> {
        let sound = weights.iter().all(|w| w.is_finite() && *w >= 0.0);
        let sum: f64 = weights.iter().sum();
        if sound && (sum - 1.0).abs() <= SUM {
            Ok(Self(weights))
        } else {
            Err(FrontEndError::Weights(weights))
        }
    }
}

impl From<ColourWeights> for [f64; 3] {
    fn from(ColourWeights(weights): ColourWeights) -> Self {
        weights
    }
}
