//! Residuals of single events: the drift of a pixel since the first frame, less the voltage of its
//! events.
//!
//! This needs equal thresholds, and events that all come from the drift. Where voltages start
//! anywhere, each pixel has an unknown level, and its means are removed.

use super::line_sums::LineSums;
use super::{BAND, Crossing, LARGE, SMALL};
use crate::drift::DriftLaw;

/// Sums over the events of all pixels.
#[derive(Debug)]
pub(super) struct LevelResiduals {
    law: DriftLaw,
    /// Voltage of the events of each pixel.
    levels: Vec<f64>,
    /// Sums over events with small residuals, and over those that a lag of some frames explains: of
    /// each pixel where its level is unknown, and otherwise of each block of the picture.
    sums: Vec<[LineSums; 2]>,
}

impl LevelResiduals {
    pub(super) fn new(law: DriftLaw, pixels: usize, blocks: usize) -> Self {
        let places = if law.from_zero { blocks } else { pixels };
        Self { law, levels: vec![0.0; pixels], sums: vec![[LineSums::default(); 2]; places] }
    }

    /// The bits of the values that an event meets at a pixel.
    pub(super) fn met_at(&self, pixel: usize) -> u64 {
        let sums = if self.law.from_zero { 0 } else { self.sums[pixel][0].n.to_bits() };
        self.levels[pixel].to_bits() ^ sums
    }

    pub(super) fn see(&mut self, crossing: &Crossing) {
        let Crossing { pixel, block, drift, moves, threshold, .. } = *crossing;
        self.levels[pixel] += crossing.jump();
        // An event against the drift is noise, or comes from another interval. NaN is left out.
        if !crossing.is_along() {
            return;
        }
        let left = drift - self.levels[pixel];
        // Where voltages start anywhere, a pixel's own level is up to a threshold off, and only
        // the noise around it counts.
        let own = if self.law.from_zero { 0.0 } else { self.law.most_residual() };
        let place = if self.law.from_zero { block } else { pixel };
        for (sums, most) in self.sums[place].iter_mut().zip([SMALL, LARGE]) {
            let size = left.abs() / (own + most * threshold);
            if size < 1.0 {
                sums.add(moves, left);
            }
            if (size - 1.0).abs() < BAND {
                sums.add_near_bound(moves);
            }
        }
    }

    /// The sums of each block, for small or large residuals. `block` is the block of a pixel.
    pub(super) fn blocks(
        &self,
        width: usize,
        blocks: usize,
        block: impl Fn(usize) -> usize,
    ) -> Vec<LineSums> {
        if self.law.from_zero {
            return self.sums.iter().map(|sums| sums[width]).collect();
        }
        let mut all = vec![LineSums::default(); blocks];
        for (pixel, sums) in self.sums.iter().enumerate() {
            let block = &mut all[block(pixel)];
            *block = block.plus(sums[width].centred(), 1.0);
        }
        all
    }
}
