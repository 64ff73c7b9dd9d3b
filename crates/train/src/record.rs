//! The record of a training: its course and the figures of its held-out views.

use serde::{Deserialize, Serialize};

/// The record of a finished training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingRecord {
    /// Number of iterations that were made.
    pub iterations: u32,
    /// The reason for its end.
    pub ended: TrainingEnd,
    /// Number of photos that were trained on.
    pub photos: usize,
    /// The held-out views in order of the capture, compared at the size of training.
    pub held_out: Vec<HeldOutView>,
    /// The state at every report.
    pub course: Vec<CoursePoint>,
}

impl TrainingRecord {
    /// Mean PSNR, dB, and mean SSIM of the held-out views; `None` without such views.
    #[must_use]
    pub fn means(&self) -> Option<[f64; 2]> {
        let count = self.held_out.len() as f64;
        let sums = self.held_out.iter().fold([0.0; 2], |[p, s], view| [p + view.psnr, s + view.ssim]);
        (count > 0.0).then(|| sums.map(|sum| sum / count))
    }
}

/// The reason for the end of a training.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TrainingEnd {
    /// All iterations were made.
    Iterations,
    /// The held-out views were shown well enough.
    Psnr,
    /// The time was used up.
    Minutes,
}

/// One view and its figures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeldOutView {
    /// Name of the view.
    pub name: String,
    /// PSNR, dB.
    pub psnr: f64,
    /// SSIM.
    pub ssim: f64,
}

/// The state of a training at one of its reports.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CoursePoint {
    /// Finished iterations.
    pub iteration: u32,
    /// Mean loss since the report before.
    pub loss: f64,
    /// Mean PSNR of the held-out views, dB; `None` without such views.
    pub psnr: Option<f64>,
    /// Number of Gaussians.
    pub gaussians: u64,
}
