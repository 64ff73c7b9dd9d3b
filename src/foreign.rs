//! What other programs say of a trajectory that was built: COLMAP, which registers its pictures anew, OpenCV, which projects
//! points by its poses and finds the poses of its pictures, and h5py, which reads its events.
//!
//! Here they are found, given what is released, run and read; what they found is judged by the passes `pose_colmap`,
//! `pose_opencv` and `readback`. What a program could not find out about these pictures is a reason, [`Told`]; a program that
//! fails is an error. Only programs of these names are run, `colmap` and `python3`, and nothing of a recipe is among their
//! arguments but numbers.
//!
//! Equal pictures give equal findings: every program is held to one thread and one seed, and key points are matched here,
//! since COLMAP 3.8 matches them by trees that are drawn anew each time.

pub mod align;
pub mod colmap;
mod error;
mod features;
pub mod opencv;
mod python;
pub mod readback;
mod run;
pub mod versions;

pub use error::ForeignError;

use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// What a program found, or why it could find nothing.
pub type Told<T> = Result<T, String>;

/// What the programs found that were asked: `foreign.json`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Foreign {
    /// COLMAP, on the poses of pictures.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colmap: Option<Told<colmap::Registration>>,
    /// OpenCV, on poses and camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub opencv: Option<Told<opencv::Geometry>>,
    /// Python's readers, on events and pictures.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub readback: Option<Told<readback::Readback>>,
}

/// A picture of a trajectory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Number of its pose.
    pub pose: usize,
    /// Where it is.
    pub file: PathBuf,
}

/// `wanted` of `count` places, evenly spread, the first and the last among them; all of them where there are no more.
#[must_use]
pub fn spread(count: usize, wanted: usize) -> Vec<usize> {
    match wanted.min(count) {
        0 => Vec::new(),
        1 => vec![0],
        wanted => (0..wanted).map(|k| (k * (count - 1) + (wanted - 1) / 2) / (wanted - 1)).collect(),
    }
}

/// The middle one of some values, the upper one of two; 0 of none.
#[must_use]
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_spread_evenly_from_end_to_end() {
        let t = |count, wanted, places: &[usize]| {
            assert_eq!(spread(count, wanted), places, "{wanted} of {count}")
        };
        t(0, 5, &[]);
        t(5, 1, &[0]);
        t(3, 20, &[0, 1, 2]);
        t(30, 4, &[0, 10, 19, 29]);
        t(101, 5, &[0, 25, 50, 75, 100]);
    }
}
