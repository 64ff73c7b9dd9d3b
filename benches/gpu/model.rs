//! The time of a frame predicted from counted work, for GPUs that were not measured.
//!
//! A stage takes the longer of its bytes at the memory's rate and its operations at the processors' rate,
//! and a fixed time for each dispatch and for each round of a scan, because each waits for the one before.
//! The stages run one after another.

use gs2e_gpu::{FrameWork, StageWork, TimedStage};

/// Share of the memory's rate that a pass achieves.
const OF_BANDWIDTH: f64 = 0.7;
/// Share of the processors' rate that a pass achieves. The rate counts a fused product and sum as two
/// operations, and [`StageWork::operations`] does not fuse; threads of a tile wait for each other.
const OF_RATE: f64 = 0.3;
/// Time from the start of a dispatch to the start of the next one, which needs its results, s.
const DISPATCH: f64 = 4e-6;
/// Time of a round of a scan, s: 16 loads in a row, a sum over 256 threads, and 16 stores.
const ROUND: f64 = 4e-6;

/// A GPU as its maker describes it.
pub(super) struct Card {
    pub(super) name: &'static str,
    /// Rate of the memory, B/s.
    pub(super) bandwidth: f64,
    /// Operations on 32-bit floats a second.
    rate: f64,
    /// Rate of the link to the host, B/s, as it is achieved.
    link: f64,
}

/// NVIDIA H200 Tensor Core GPU datasheet (SXM: 4.8 TB/s, 67 Tflop/s, PCIe 5.0 x16); NVIDIA Ampere GA102
/// whitepaper (RTX 3090: 936 GB/s, 35.6 Tflop/s, PCIe 4.0 x16). Links at four fifths of their rate.
pub(super) const CARDS: [Card; 2] = [
    Card { name: "H200", bandwidth: 4.8e12, rate: 67e12, link: 50e9 },
    Card { name: "RTX 3090", bandwidth: 0.936e12, rate: 35.6e12, link: 25e9 },
];

impl Card {
    /// The card with this name, if it is known.
    pub(super) fn named(name: &str) -> Option<&'static Self> {
        CARDS.iter().find(|card| name.contains(card.name))
    }

    /// Predicted time of a stage, s.
    pub(super) fn stage_seconds(&self, work: &StageWork) -> f64 {
        let bytes = work.bytes as f64 / (OF_BANDWIDTH * self.bandwidth);
        let operations = work.operations as f64 / (OF_RATE * self.rate);
        bytes.max(operations) + work.dispatches as f64 * DISPATCH + work.scan_rounds as f64 * ROUND
    }

    /// Predicted time of a frame, s: the stages, or the transfer of an earlier frame, which goes on
    /// meanwhile.
    pub(super) fn frame_seconds(&self, work: &FrameWork) -> f64 {
        let stages = TimedStage::ALL.map(|stage| self.stage_seconds(&work.stages[stage as usize]));
        stages.iter().sum::<f64>().max(work.transfer as f64 / self.link)
    }
}
