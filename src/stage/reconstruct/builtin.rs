//! Training inside the program, on the CPU.

use crate::reconstruct::model_points;
use crate::scene::Gaussians;
use crate::source::{Capture, SourceError};
use crate::stage::capture::{CaptureStage, SolvedInputs};
use crate::stage::{SourceFile, Stage as _, StageContext, StageError, StepNeed};
use crate::training::photos::{TrainingViews, trained_size};
use crate::training::{self, TrainingError, TrainingReport, TrainingSettings, TrainingWatch};
use serde::Serialize;
use std::path::PathBuf;

/// Parameters: those of the training, the rendering among them.
#[derive(Debug, Serialize)]
pub struct BuiltinStage {
    #[serde(flatten)]
    settings: TrainingSettings,
    /// Location of its photos and points.
    #[serde(skip)]
    source: CaptureStage,
}

impl BuiltinStage {
    pub(super) fn new(settings: TrainingSettings, source: CaptureStage) -> Self {
        Self { settings, source }
    }

    /// The photos and points of the source. Its poses come with the capture.
    pub(super) fn sources(&self) -> Result<Vec<SourceFile>, StageError> {
        self.source.photos_and_points()
    }

    pub(super) fn source_folders(&self) -> Vec<PathBuf> {
        self.source.source_folders()
    }

    pub(super) fn need(&self, capture: &Capture) -> StepNeed {
        let sizes = capture.views.iter().map(|view| trained_size(view.camera.size, self.settings.resolution));
        StepNeed::for_parts([training::memory_needed(self.settings.gaussians, sizes)])
    }

    pub(super) fn run(
        &self,
        capture: &Capture,
        solved: &SolvedInputs,
        cx: &mut StageContext<'_>,
    ) -> Result<Gaussians, StageError> {
        let files = self.source.training_files(solved)?;
        let goes_on = || !cx.is_cancelled();
        let TrainingSettings { resolution, hold_out, .. } = self.settings;
        let views = TrainingViews::read(capture, &files, (resolution, hold_out), &goes_on);
        let views = views.map_err(stage_failure)?;
        let points =
            model_points(&files).map_err(StageError::work_failed::<SourceError>("read the points"))?;
        let mut last = None;
        let mut report = |report: &TrainingReport| last = Some(*report);
        let watch = TrainingWatch { goes_on: &goes_on, report: &mut report, checkpoint: None };
        let trained = training::train(&views, &points, &self.settings, watch).map_err(stage_failure)?;
        let judged = trained.figures.means();
        cx.remark =
            judged.map(|[psnr, _]| format!("{psnr:.2} dB on {} held-out photos", views.held_out.len()));
        if views.without_photo > 0 {
            let count = views.without_photo;
            cx.warnings.push(format!("{count} views were not used for training: their photos are missing"));
        }
        Ok(trained.scene)
    }
}

fn stage_failure(error: TrainingError) -> StageError {
    match error {
        TrainingError::Stopped => StageError::Cancelled,
        error => StageError::work_failed("train the scene")(error),
    }
}
