//! Blurred frames: the exposure of each, and its sub-frames.
//!
//! An exposure is the mean, in linear light unless asked otherwise, of `frames` pictures at equal steps of
//! time, those of the dense frames around a pose. If the image moves by more than a pixel per step,
//! sub-frames are added: a mean of frames that are ten pixels apart is a row of ghosts, not blur.

mod exposer;

pub use exposer::{DenseView, ExposeError, ExposedFrame, ExposureCourse, FrameExposer};

use gs2e_image::light::MeanScale;
use serde::{Deserialize, Serialize};

/// Parameters of blurred frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct ShutterSettings {
    /// Dense frames per exposure. The number is odd, so that one is in the middle. Exposures follow
    /// one another without a gap.
    pub frames: u32,
    /// Number of sub-frames.
    pub subframes: SubframeRule,
    /// The values that are averaged. The default stays out of keys.
    #[serde(skip_serializing_if = "MeanScale::is_linear")]
    pub mean: MeanScale,
}

/// The number of sub-frames per dense frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SubframeRule {
    /// An odd number per dense frame, at most 33, so that the picture moves by at most 1 px between
    /// two. Motion beyond that draws a warning. It is measured at pixels with a depth.
    Auto,
    /// No sub-frames. Ablation.
    Literal,
}

/// Default number of dense frames per exposure.
pub const FRAMES: u32 = 15;

/// Maximum sub-frames per dense frame; bounds the cost of an exposure. Residual motion above 1 px
/// is reported as a warning.
const MAX_SUBFRAMES: u32 = 33;

/// Record of a blurred frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExposureRecord {
    /// Index of the pose in the middle.
    pub pose: usize,
    /// Opening time of the shutter.
    pub start_us: i64,
    /// Closing time of the shutter.
    pub end_us: i64,
    /// Sub-frames per dense frame; 1 for dense frames alone.
    pub subframes: u32,
    /// The largest motion between two neighbouring sub-frames, px, over pixels with a depth at the
    /// dense frames; `None` if it was not measured.
    pub step_px: Option<f32>,
}

impl ExposureRecord {
    /// The pose and the times of the shutter.
    #[must_use]
    pub fn times(&self) -> (usize, [i64; 2]) {
        (self.pose, [self.start_us, self.end_us])
    }
}

/// The poses at the centres of exposures of this many frames: back to back, each exposure within
/// the path.
#[must_use]
pub fn exposure_centres(poses: usize, frames: u32) -> Vec<usize> {
    let frames = frames as usize;
    // One frame beyond half an exposure: the shutter opens halfway to the frame before.
    let beyond = frames / 2 + 1;
    (beyond..poses.saturating_sub(beyond)).step_by(frames).collect()
}

/// Opening and closing time of the shutter around one of [`exposure_centres`], s: halfway between
/// the frames of the exposure and the frames beyond.
///
/// # Panics
/// There are no frames beyond.
#[must_use]
pub fn shutter_times(seconds: &[f64], pose: usize, frames: u32) -> [f64; 2] {
    let half = frames as usize / 2;
    let halfway = |i: usize| f64::midpoint(seconds[i], seconds[i + 1]);
    [halfway(pose - half - 1), halfway(pose + half)]
}

/// [`shutter_times`], in whole microseconds.
///
/// # Panics
/// There are no frames beyond.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "a trajectory lasts no 292,000 years")]
pub fn open_us(seconds: &[f64], pose: usize, frames: u32) -> [i64; 2] {
    shutter_times(seconds, pose, frames).map(|s| (s * 1e6).round() as i64)
}

/// Indices of the poses with a sharp frame that is kept, ascending: every `every`-th pose, and the
/// centres of exposures of `exposed` frames.
#[must_use]
pub fn kept_poses(poses: usize, every: u32, exposed: Option<u32>) -> Vec<usize> {
    let mut kept: Vec<usize> = (0..poses).step_by(every as usize).collect();
    kept.extend(exposed.iter().flat_map(|frames| exposure_centres(poses, *frames)));
    kept.sort_unstable();
    kept.dedup();
    kept
}

/// The error for a trajectory that ends before a shutter closes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "the trajectory has {poses} poses, but an exposure of {frames} frames needs {}; \
     lower `frames` in `blur`", u64::from(*frames) + 2
)]
pub struct TooShort {
    /// Number of poses of the trajectory.
    pub poses: usize,
    /// Number of frames of an exposure.
    pub frames: u32,
}

/// A warning for sub-frames that are so far apart that edges appear separately.
#[must_use]
pub fn ghost_warning(exposures: &[ExposureRecord]) -> Option<String> {
    let apart: Vec<(f32, usize)> =
        exposures.iter().filter_map(|e| Some((e.step_px?, e.pose))).filter(|(px, _)| *px > 1.0).collect();
    let (px, pose) = apart.iter().copied().max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(format!(
        "{} of {} blurred frames average pictures more than 1 px apart; at pose {pose} a pixel moves by {px:.1} px \
         between two of them, though {MAX_SUBFRAMES} stand for a dense frame",
        apart.len(),
        exposures.len()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A case like the paper's: 150 poses and 15 frames. The first centre is 8, then every 15th.
    #[test]
    fn exposures_follow_one_another_within_the_path() {
        assert_eq!(exposure_centres(150, 15), [8, 23, 38, 53, 68, 83, 98, 113, 128]);
        let t =
            |poses: usize, frames: u32, wanted: &[usize]| assert_eq!(exposure_centres(poses, frames), wanted);
        t(5, 3, &[2]);
        t(4, 3, &[]);
        t(3, 1, &[1]);
        t(0, 15, &[]);
        assert_eq!(kept_poses(12, 5, Some(3)), [0, 2, 5, 8, 10]);
        assert_eq!(kept_poses(12, 5, None), [0, 5, 10]);
    }
}
