//! The thresholds of all pixels: one pair, or one pair per pixel where pixels are unequal.

use super::VoltmeterModel;
use super::bridge::{Barriers, WideBarriers};
use crate::chain::PixelArray;
use crate::noise::{PixelSite, mismatch};
use fearless_simd::Simd;
use gs2e_num::elementary::load_eight;

/// Thresholds of ON and OFF for every pixel.
#[derive(Debug)]
pub(super) enum PixelThresholds {
    Equal(Barriers),
    /// One value per pixel, padded with the nominal threshold to a multiple of 8.
    Unequal([Vec<f64>; 2]),
}

/// Smallest threshold of a pixel where thresholds differ, as a share of the nominal threshold.
pub(super) const FLOOR: f64 = 0.01;

/// The thresholds of ON and OFF of the pixel at `site`, drawn once for a sensor.
pub(super) fn drawn_pair(nominal: [f64; 2], spread: f64, site: PixelSite) -> [f64; 2] {
    mismatch::draw_thresholds(nominal, spread, nominal.map(|threshold| FLOOR * threshold), site, 0)
}

impl PixelThresholds {
    /// The thresholds of a sensor's pixels.
    pub(super) fn new(sensor: &VoltmeterModel, array: &PixelArray) -> Self {
        let [up, down] = [sensor.threshold_on, sensor.threshold_off];
        if sensor.threshold_spread == 0.0 {
            return Self::Equal(Barriers { up, down });
        }
        // Padding lanes compute like others, and a threshold of 0 would put all of them within
        // reach.
        let padded = array.size.pixels().next_multiple_of(8);
        let mut both = [up, down].map(|nominal| Vec::from_iter(std::iter::repeat_n(nominal, padded)));
        for pixel in 0..array.size.pixels() {
            // By the position on the sensor, so that a crop has the thresholds of the whole image.
            let own = drawn_pair([up, down], sensor.threshold_spread, array.site(pixel));
            both.iter_mut().zip(own).for_each(|(all, own)| all[pixel] = own);
        }
        Self::Unequal(both)
    }

    /// The thresholds of one pixel, numbered row by row.
    #[inline(always)]
    pub(super) fn of(&self, pixel: usize) -> Barriers {
        match self {
            Self::Equal(barriers) => *barriers,
            Self::Unequal([up, down]) => Barriers { up: up[pixel], down: down[pixel] },
        }
    }

    /// The thresholds of eight pixels from `first` on.
    #[inline(always)]
    pub(super) fn eight<S: Simd>(&self, simd: S, first: usize) -> WideBarriers<S> {
        match self {
            Self::Equal(barriers) => WideBarriers::splat(simd, *barriers),
            Self::Unequal([up, down]) => {
                WideBarriers { up: load_eight(simd, up, first), down: load_eight(simd, down, first) }
            }
        }
    }
}
