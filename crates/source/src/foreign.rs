//! Programs of other people that recipes do not name. COLMAP finds the poses of photos, and ffmpeg
//! takes frames from a video. Others judge a built trajectory: COLMAP registers its pictures from
//! scratch, OpenCV projects points with its poses and recovers the motion between its pictures, and
//! h5py reads its events.
//!
//! This module finds the programs, hands the released files to them, runs them and reads the
//! answers. The passes `pose_colmap`, `pose_opencv` and `readback` judge the answers. If a program
//! cannot determine an answer for these pictures, the result is a reason, [`ForeignAnswer`]; a failing
//! program is an error. Only the programs `colmap`, `ffmpeg` and `python3` are run, and a recipe
//! contributes only numbers and the paths of its source to their arguments.
//!
//! Equal pictures give equal answers: every program runs with one thread and one seed. Key points
//! are matched here, because COLMAP 3.8 matches them with trees that are randomised in each run.

pub mod align;
pub mod colmap;
mod colmap_run;
mod error;
mod features;
pub mod opencv;
pub mod photos;
mod pose_watch;
mod python;
pub mod readback;
mod run;
pub mod versions;
pub mod video;

pub use error::ForeignError;

use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The answer of a program, or the reason why it has no answer.
pub type ForeignAnswer<T> = Result<T, String>;

/// The answers of the programs that were asked: `foreign.json`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExternalReport {
    /// COLMAP's answer on the poses of pictures.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colmap: Option<ForeignAnswer<colmap::ColmapRegistration>>,
    /// OpenCV's answer on poses and camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub opencv: Option<ForeignAnswer<opencv::OpencvGeometry>>,
    /// Answer of Python's readers on events and pictures.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub readback: Option<ForeignAnswer<readback::ReadbackReport>>,
}

/// A picture of a trajectory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TrajectoryPicture {
    /// Index of its pose.
    pub pose: usize,
    /// Path of the file.
    pub file: PathBuf,
}

/// Returns `wanted` of `count` indices, evenly spread and including the first and the last. Returns
/// all indices if there are no more.
#[must_use]
pub fn spread_evenly(count: usize, wanted: usize) -> Vec<usize> {
    // The last case rounds to the nearest index, and hits both ends exactly.
    match wanted.min(count) {
        0 => Vec::new(),
        1 => vec![0],
        wanted => (0..wanted).map(|k| (k * (count - 1) + (wanted - 1) / 2) / (wanted - 1)).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_spread_evenly_from_end_to_end() {
        let t = |count, wanted, places: &[usize]| {
            assert_eq!(spread_evenly(count, wanted), places, "{wanted} of {count}")
        };
        t(0, 5, &[]);
        t(5, 1, &[0]);
        t(3, 20, &[0, 1, 2]);
        t(30, 4, &[0, 10, 19, 29]);
        t(101, 5, &[0, 25, 50, 75, 100]);
    }
}
