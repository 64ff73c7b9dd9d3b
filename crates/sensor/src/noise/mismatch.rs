//! Threshold mismatch: each pixel has thresholds of its own.
//!
//! Thresholds are normal around their nominal values, with a floor. ON and OFF are drawn
//! separately, as in the programs of ESIM (uzh-rpg/rpg_esim) and v2e (SensorsINI/v2e). v2e draws
//! once per sensor, ESIM for every pixel and frame. In real pixels, thresholds are fixed at
//! manufacture.
//!
//! # Examples
//!
//! ```
//! use gs2e_sensor::esim::EsimModel;
//! use gs2e_sensor::noise::{RedrawRule, ThresholdMismatch};
//! use gs2e_sensor::{SensorModel, SensorParameters};
//!
//! // Nominal contrasts of 0.25 and 0.5, with a deviation of 0.02 over the pixels.
//! let threshold = ThresholdMismatch { on: 0.25, off: 0.5, spread: 0.02 };
//! let model = EsimModel { threshold, mismatch: RedrawRule::PerSensor, ..EsimModel::default() };
//! assert_eq!(model.contrast(), (0.25, 0.5));
//! assert_eq!(model.contrast_spread(), 0.02);
//! ```

use super::PixelSite;
use crate::screening::{ScreenError, at_least_zero};
use gs2e_num::seed::DrawSpace;
use serde::{Deserialize, Serialize};

/// Time at which thresholds are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RedrawRule {
    /// Once per sensor.
    #[default]
    PerSensor,
    /// For each pair of frames. The behaviour of a pixel then depends on the frame rate. Ablation.
    PerFrame,
}

/// Nominal thresholds of a sensor and their spread.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ThresholdMismatch {
    /// Nominal threshold of ON events, above 0.
    pub on: f64,
    /// Nominal threshold of OFF events, above 0.
    pub off: f64,
    /// Standard deviation over the pixels, at least 0. If it is above 0, thresholds are at least
    /// [`FLOOR`].
    pub spread: f64,
}

/// Smallest threshold of a pixel where thresholds differ, as in the programs of ESIM and v2e.
pub const FLOOR: f64 = 0.01;

impl ThresholdMismatch {
    /// Checks the numbers.
    ///
    /// # Errors
    /// Names the first number that is outside its range.
    pub(crate) fn validate(&self) -> Result<(), ScreenError> {
        let Self { on, off, spread } = *self;
        let least = if spread > 0.0 { FLOOR } else { f64::MIN_POSITIVE };
        let wanted = if spread > 0.0 {
            "at least 0.01, as threshold.spread requires"
        } else {
            "a finite number above 0"
        };
        for (name, found) in [("threshold.on", on), ("threshold.off", off)] {
            if !(found >= least && found.is_finite()) {
                return Err(ScreenError::Parameter { name, found, wanted });
            }
        }
        at_least_zero("threshold.spread", spread)
    }

    /// The nominal thresholds of ON and OFF.
    pub(crate) fn sides(&self) -> [f64; 2] {
        [self.on, self.off]
    }

    /// The thresholds of the pixel at `site`. `frame` is 0 if they are drawn once.
    pub(crate) fn at(&self, site: PixelSite, frame: u64) -> [f64; 2] {
        draw_thresholds(self.sides(), self.spread, [FLOOR; 2], site, frame)
    }
}

/// The thresholds of ON and OFF of the pixel at `site`. `frame` is 0 if they are drawn once.
pub(crate) fn draw_thresholds(
    nominal: [f64; 2],
    spread: f64,
    floors: [f64; 2],
    site: PixelSite,
    frame: u64,
) -> [f64; 2] {
    // The floor is left out as well: equal thresholds below it are allowed.
    if spread == 0.0 {
        return nominal;
    }
    // Both come from one cell, ON first. Another order would change every stream with mismatch.
    let mut draws = site.draws(DrawSpace::Mismatch, frame);
    let [on, off] = [0, 1].map(|side| (nominal[side] + spread * draws.normal()).max(floors[side]));
    [on, off]
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_num::seed::{Seed, ks};

    fn sample(spread: f64, frame: u64) -> Vec<[f64; 2]> {
        let site = |i: u16| PixelSite { seed: Seed(5), x: i % 200, y: i / 200 };
        (0..20_000).map(|i| draw_thresholds([0.2, 0.3], spread, [0.01; 2], site(i), frame)).collect()
    }

    #[test]
    fn thresholds_are_normal_around_the_nominal_ones() {
        let sample = sample(0.03, 0);
        for (side, nominal) in [0.2, 0.3].into_iter().enumerate() {
            let values: Vec<f64> = sample.iter().map(|t| t[side]).collect();
            let cdf = |spread: f64| {
                move |t: f64| 0.5 * libm::erfc((nominal - t) / (spread * std::f64::consts::SQRT_2))
            };
            let [found, defect] =
                [0.03, 0.0315].map(|spread| ks::scaled_distance(values.clone(), cdf(spread)));
            println!("side {side}: KS {found:.2}, of a spread 5 % off {defect:.2} (alpha 1e-4: 2.23)");
            assert!(found < 2.23 && defect > found);
        }
        // Independent draws: the correlation of n pairs has a standard deviation of 1/sqrt(n).
        let product: f64 = sample.iter().map(|[on, off]| (on - 0.2) * (off - 0.3) / 9e-4).sum();
        assert!((product / 20_000f64.sqrt()).abs() < 4.5);
    }

    #[test]
    fn no_threshold_is_below_the_floor_and_none_moves_without_a_spread() {
        let wide = sample(1.0, 0);
        let low = wide.iter().flatten().filter(|t| **t <= 0.01).count();
        // A normal of mean 0.2 or 0.3 and standard deviation 1 is below 0.01 with probability 0.425
        // or 0.386.
        assert!(wide.iter().flatten().all(|t| *t >= 0.01) && (15_000..18_000).contains(&low), "{low}");
        let nominal = [0.2f64, 0.3].map(f64::to_bits);
        assert!(sample(0.0, 0).iter().all(|t| t.map(f64::to_bits) == nominal));
        assert_ne!(sample(0.03, 0), sample(0.03, 1));
    }
}
