//! The work of a frame, counted: what the passes read, write and compute, from the counts that the device
//! returns.
//!
//! Bytes are those of the buffers as the shaders address them, each access once. A cache may save some of
//! them: the second reading of entries in a sort, or a splat that several tiles load. Operations are
//! counted by hand from the text of the shaders, to a factor of two: a sum, product, quotient, root or power
//! is one each.

use super::EDGE;
use super::buffers::DIGITS;
use super::clock::TimedStage;
use super::shader::{BLOCK, DIGIT_BITS, GROUP, ImageLayout, splat_rows};
use gs2e_scene::sh;

/// The work of one stage of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StageWork {
    /// Dispatches, which run one after another.
    pub dispatches: u64,
    /// Rounds of the scans, which one workgroup runs one after another.
    pub scan_rounds: u64,
    /// Bytes of device memory that are read and written.
    pub bytes: u64,
    /// Arithmetic operations on 32-bit floats.
    pub operations: u64,
}

/// The work of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FrameWork {
    /// Splats that were drawn.
    pub splats: u64,
    /// Pairs of splats and tiles.
    pub pairs: u64,
    /// Pairs that tiles loaded before all their pixels were finished.
    pub loaded: u64,
    /// Layers that were blended over pixels.
    pub blended: u64,
    /// By [`TimedStage::ALL`].
    pub stages: [StageWork; TimedStage::ALL.len()],
    /// Bytes of images that the host reads.
    pub transfer: u64,
}

impl FrameWork {
    /// Adds the work of another region or frame.
    pub fn add(&mut self, o: &Self) {
        self.splats += o.splats;
        self.pairs += o.pairs;
        self.loaded += o.loaded;
        self.blended += o.blended;
        self.transfer += o.transfer;
        for (stage, o) in self.stages.iter_mut().zip(&o.stages) {
            stage.dispatches += o.dispatches;
            stage.scan_rounds += o.scan_rounds;
            stage.bytes += o.bytes;
            stage.operations += o.operations;
        }
    }
}

/// What the work of a region depends on.
#[derive(Debug, Clone, Copy)]
pub(super) struct RegionCounts {
    pub(super) parts: u64,
    pub(super) gaussians: u64,
    pub(super) behind: u64,
    pub(super) splats: u64,
    pub(super) pairs: u64,
    pub(super) loaded: u64,
    pub(super) blended: u64,
    pub(super) tiles: u64,
    pub(super) pixels: u64,
    /// Digits of the sort by tile.
    pub(super) digits: u64,
    pub(super) layout: ImageLayout,
    pub(super) sh_degree: u8,
}

/// Bytes of an entry of `means`.
const MEAN: u64 = 16;
/// Bytes of an entry of `axes`.
const AXES: u64 = 36;
/// Bytes of a harmonic's coefficients.
const HARMONIC: u64 = 12;
/// Bytes of a key with its value.
const ENTRY: u64 = 8;
/// Bytes of a counter or of a float.
const WORD: u64 = 4;
/// Entries that one workgroup of a scan takes at a time: sixteen a thread.
const SCAN_ROUND: u64 = 16 * GROUP as u64;

impl RegionCounts {
    pub(super) fn work(&self) -> FrameWork {
        FrameWork {
            splats: self.splats,
            pairs: self.pairs,
            loaded: self.loaded,
            blended: self.blended,
            stages: TimedStage::ALL.map(|stage| match stage {
                TimedStage::Project => self.project(),
                TimedStage::Sort => sort(self.splats, u64::from(DIGITS)),
                TimedStage::List => self.list(),
                TimedStage::Bin => self.bin(),
                TimedStage::Raster => self.raster(),
            }),
            transfer: self.pixels * WORD * u64::from(self.layout.floats),
        }
    }

    fn splat_bytes(&self) -> u64 {
        16 * u64::from(splat_rows(self.layout.rate.is_some()))
    }

    /// `measure` and `place` project; the second one only what is drawn.
    fn project(&self) -> StageWork {
        /// Operations of the transform with 48 bits.
        const LOCATE: u64 = 170;
        /// Operations of the outline with its rates.
        const OUTLINE: u64 = 450;
        /// Operations of a harmonic with its rate, in three colours.
        const EACH_HARMONIC: u64 = 22;
        let in_front = self.gaussians - self.behind;
        let harmonics = sh::function_count(self.sh_degree) as u64;
        let groups = self.gaussians.div_ceil(GROUP.into());
        let measured = self.gaussians * (MEAN + WORD) + in_front * AXES + groups * WORD;
        let placed = self.gaussians * WORD
            + self.splats * (MEAN + AXES + harmonics * HARMONIC)
            + self.splats * (self.splat_bytes() + ENTRY);
        let scan = scan(groups);
        StageWork {
            dispatches: 3 * self.parts,
            // Each part has a scan of its own, which takes at least one round.
            scan_rounds: scan.scan_rounds.max(self.parts),
            bytes: measured + placed + scan.bytes,
            operations: self.gaussians * LOCATE
                + in_front * OUTLINE
                + self.splats * (LOCATE + OUTLINE + harmonics * EACH_HARMONIC),
        }
    }

    /// `tally` and `emit` compute the tiles of a splat by rows of tiles.
    fn list(&self) -> StageWork {
        /// Operations of the outline in a row of tiles, at about two tiles a row.
        const ROW: u64 = 60;
        let outline = ENTRY + 3 * 16 + WORD;
        let scan = scan(self.splats.div_ceil(GROUP.into()));
        StageWork {
            dispatches: 3,
            scan_rounds: scan.scan_rounds,
            bytes: 2 * self.splats * outline + self.pairs * ENTRY + scan.bytes,
            operations: 2 * (self.splats + self.pairs / 2) * ROW,
        }
    }

    fn bin(&self) -> StageWork {
        let sort = sort(self.pairs, self.digits);
        StageWork {
            dispatches: sort.dispatches + 1,
            bytes: sort.bytes + self.pairs * ENTRY + 2 * self.tiles * ENTRY,
            ..sort
        }
    }

    /// Each pixel of a tile tests each loaded splat, until the pixel is finished.
    fn raster(&self) -> StageWork {
        /// Operations of the test against the ellipse.
        const TEST: u64 = 10;
        /// Operations of a blended layer.
        const BLEND: u64 = 10;
        /// Operations of a channel of a blended layer.
        const CHANNEL: u64 = 2;
        /// Operations of the rate of a blended layer.
        const RATE: u64 = 30;
        let rate = self.layout.rate.is_some();
        let channels = u64::from(self.layout.floats) - u64::from(rate);
        StageWork {
            dispatches: 1,
            scan_rounds: 0,
            bytes: self.loaded * (ENTRY + self.splat_bytes())
                + self.tiles * ENTRY
                + self.pixels * WORD * u64::from(self.layout.floats_on_device()),
            operations: self.loaded * u64::from(EDGE * EDGE) * TEST
                + self.blended * (BLEND + channels * CHANNEL + if rate { RATE } else { 0 }),
        }
    }
}

/// A sort: each digit is counted, scanned and scattered.
fn sort(entries: u64, digits: u64) -> StageWork {
    let blocks = entries.div_ceil(BLOCK.into());
    let scan = scan(blocks << DIGIT_BITS);
    // Counted once, and for the scatter twice: for the ranks, and to be written.
    let each = entries * 4 * ENTRY + ((2 * blocks) << DIGIT_BITS) * WORD + scan.bytes;
    StageWork {
        dispatches: 3 * digits,
        scan_rounds: digits * scan.scan_rounds,
        bytes: digits * each,
        operations: 0,
    }
}

/// A scan reads its counts twice and writes them once.
fn scan(counts: u64) -> StageWork {
    StageWork {
        dispatches: 1,
        scan_rounds: counts.div_ceil(SCAN_ROUND),
        bytes: 3 * WORD * counts,
        operations: 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_render::ChannelSet;

    /// Counted by hand for one block of each sort.
    #[test]
    fn the_work_of_a_small_region_is_that_counted_by_hand() {
        let layout = ImageLayout::new(ChannelSet { rgb: true, ..ChannelSet::NONE });
        let counts = RegionCounts {
            parts: 1,
            gaussians: 300,
            behind: 100,
            splats: 150,
            pairs: 200,
            loaded: 180,
            blended: 1000,
            tiles: 4,
            pixels: 32 * 32,
            digits: 1,
            layout,
            sh_degree: 0,
        };
        let work = counts.work();
        let [project, sort, list, bin, raster] = work.stages;
        // Two groups of 256; 64 bytes a splat, and 8 for its place in the order.
        let measured = 300 * 20 + 200 * 36 + 2 * 4;
        let placed = 300 * 4 + 150 * (16 + 36 + 12 + 64 + 8);
        assert_eq!(project.bytes, measured + placed + 2 * 12);
        // Eight digits of four bits: 32 bytes an entry, and 16 counters that are written, scanned and read.
        assert_eq!(sort.bytes, 8 * (150 * 32 + 16 * 4 * 2 + 16 * 12));
        assert_eq!(bin.bytes, 200 * 32 + 16 * 8 + 16 * 12 + 200 * 8 + 4 * 16);
        assert_eq!(list.bytes, 2 * 150 * 60 + 200 * 8 + 12);
        assert_eq!(raster.bytes, 180 * (8 + 64) + 4 * 8 + 1024 * 12);
        let dispatches = work.stages.map(|stage| stage.dispatches);
        assert_eq!(dispatches, [3, 24, 3, 4, 1]);
        assert_eq!(work.stages.map(|stage| stage.scan_rounds), [1, 8, 1, 1, 0]);
        assert_eq!(work.transfer, 1024 * 12);
        let mut twice = work;
        twice.add(&work);
        assert_eq!((twice.pairs, twice.stages[1].bytes), (400, 2 * sort.bytes));
    }
}
