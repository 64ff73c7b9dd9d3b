//! Bandwidth of a pixel: a low-pass filter of the logarithm of the brightness, in front of the thresholds.
//!
//! One stage is `dy/dt = 2 pi cutoff (V - y)`; a second equal stage may follow it. The cutoff grows with the
//! light, so dark pixels are late: a stage delays brightness that changes steadily by `1 / (2 pi cutoff)`.
//! Photoreceptor and source follower of a pixel are such stages (Lichtsteiner, Posch and Delbruck, IEEE JSSC
//! 43, 2008; the low-pass filter of v2e). Unlike a latency, the filter makes fast changes smaller, and events
//! may be lost.
//!
//! # Examples
//!
//! ```
//! use gs2e_sensor::bandwidth::{BandwidthPoint, PixelBandwidth};
//!
//! let point = |lux, cutoff_hz| BandwidthPoint { lux, cutoff_hz };
//! let bandwidth = PixelBandwidth { order: 1, points: vec![point(1.0, 20.0), point(100.0, 200.0)] };
//! // Halfway between 1 and 100 lux on a logarithmic axis is 10 lux.
//! assert!((bandwidth.cutoff_hz(10.0) - 20.0 * 10f64.sqrt()).abs() < 1e-9);
//! // Outside the points, the nearest one holds.
//! assert_eq!(bandwidth.cutoff_hz(1e4), 200.0);
//! assert!((bandwidth.delay_seconds(1.0) - 1.0 / (std::f64::consts::TAU * 20.0)).abs() < 1e-12);
//! ```

use crate::WHITE;
use crate::noise::grey_table::between_lights;
use crate::screening::ScreenError;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Bandwidth of the pixels against light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PixelBandwidth {
    /// Number of equal stages, 1 or 2.
    pub order: u32,
    /// Points at rising lights; none for pixels without a filter. Between two, logarithms are linear in the
    /// logarithm of the light.
    pub points: Vec<BandwidthPoint>,
}

/// Bandwidth at one light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BandwidthPoint {
    /// Light on the sensor, lux.
    pub lux: f64,
    /// Cutoff of a stage: there it passes half of the power.
    pub cutoff_hz: f64,
}

/// Largest cutoff. No pixel is faster, and the events of faster ones would not differ.
pub const MAX_CUTOFF_HZ: f64 = 1e6;
/// Largest number of stages.
pub const MAX_ORDER: u32 = 2;

impl Default for PixelBandwidth {
    /// No filter.
    fn default() -> Self {
        Self { order: 1, points: Vec::new() }
    }
}

impl PixelBandwidth {
    /// Returns true if there is no filter.
    #[must_use]
    pub fn is_absent(&self) -> bool {
        self.points.is_empty()
    }

    /// Returns true if the cutoff depends on the light.
    #[must_use]
    pub fn follows_light(&self) -> bool {
        self.points.len() > 1
    }

    /// The cutoff of a stage at a light, Hz; 0 without a filter.
    #[must_use]
    pub fn cutoff_hz(&self, lux: f64) -> f64 {
        let [cutoff] = between_lights(&self.points, lux, |point| point.lux, |point| [point.cutoff_hz]);
        cutoff
    }

    /// [`PixelBandwidth::cutoff_hz`] at a grey, where white is `white_lux`.
    #[must_use]
    pub fn cutoff_at_grey(&self, grey: f64, white_lux: f64) -> f64 {
        self.cutoff_hz(white_lux * grey / WHITE)
    }

    /// The delay of brightness that changes steadily at a light, seconds; 0 without a filter.
    #[must_use]
    pub fn delay_seconds(&self, lux: f64) -> f64 {
        if self.is_absent() { 0.0 } else { f64::from(self.order) / (TAU * self.cutoff_hz(lux)) }
    }

    /// The lowest and the highest cutoff at any light, Hz.
    pub(crate) fn extremes_hz(&self) -> [f64; 2] {
        let cutoffs = || self.points.iter().map(|point| point.cutoff_hz);
        [cutoffs().fold(f64::INFINITY, f64::min), cutoffs().fold(0.0, f64::max)]
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// A number is outside its range, or the lights do not rise.
    pub(crate) fn validate(&self) -> Result<(), ScreenError> {
        if !(1..=MAX_ORDER).contains(&self.order) {
            let (name, found) = ("bandwidth.order", f64::from(self.order));
            return Err(ScreenError::Parameter { name, found, wanted: "1 or 2" });
        }
        for BandwidthPoint { lux, cutoff_hz } in &self.points {
            for (name, found, most, wanted) in [
                ("bandwidth.lux", *lux, f64::MAX, "a finite number above 0"),
                ("bandwidth.cutoff_hz", *cutoff_hz, MAX_CUTOFF_HZ, "above 0 and at most 1000000"),
            ] {
                if !(found > 0.0 && found <= most) {
                    return Err(ScreenError::Parameter { name, found, wanted });
                }
            }
        }
        if self.points.is_sorted_by(|before, after| before.lux < after.lux) {
            return Ok(());
        }
        Err(ScreenError::Combination("the lights of `bandwidth` must rise from point to point"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bandwidth(order: u32, points: &[[f64; 2]]) -> PixelBandwidth {
        let point = |&[lux, cutoff_hz]: &[f64; 2]| BandwidthPoint { lux, cutoff_hz };
        PixelBandwidth { order, points: points.iter().map(point).collect() }
    }

    #[test]
    fn numbers_outside_their_ranges_are_named() {
        let t = |bandwidth: PixelBandwidth, message: &str| {
            assert_eq!(bandwidth.validate().unwrap_err().to_string(), message);
        };
        t(bandwidth(3, &[]), "bandwidth.order is 3, not 1 or 2");
        t(bandwidth(1, &[[0.0, 5.0]]), "bandwidth.lux is 0, not a finite number above 0");
        t(bandwidth(1, &[[1.0, 0.0]]), "bandwidth.cutoff_hz is 0, not above 0 and at most 1000000");
        t(bandwidth(1, &[[1.0, 2e6]]), "bandwidth.cutoff_hz is 2000000, not above 0 and at most 1000000");
        t(bandwidth(2, &[[2.0, 5.0], [1.0, 5.0]]), "the lights of `bandwidth` must rise from point to point");
        assert!(PixelBandwidth::default().is_absent() && PixelBandwidth::default().validate().is_ok());
    }

    #[test]
    fn two_stages_take_twice_as_long() {
        let [one, two] = [1, 2].map(|order| bandwidth(order, &[[1.0, 20.0], [100.0, 200.0]]));
        assert!((two.delay_seconds(7.0) - 2.0 * one.delay_seconds(7.0)).abs() < 1e-15);
        let [least, most] = one.extremes_hz();
        assert!((least - 20.0).abs() < 1e-12 && (most - 200.0).abs() < 1e-12);
        assert!(PixelBandwidth::default().delay_seconds(7.0) <= 0.0);
    }
}
