//! Training inside the program, on the CPU.

use crate::artifact::TRAINING_FILE;
use crate::stage::capture::{CaptureStage, SolvedInputs};
use crate::stage::{SourceFile, StageContext, StageError, StageFacts as _, StepNeed};
use gs2e_render::backend::Backend;
use gs2e_scene::Gaussians;
use gs2e_source::Capture;
use gs2e_train as training;
use gs2e_train::{
    CheckpointFile, LAWS, TrainedGaussians, TrainingEnd, TrainingNews, TrainingSettings, TrainingWatch,
};
use serde::Serialize;
use std::path::PathBuf;

/// Parameters: those of the training, the rendering among them.
#[derive(Debug, Serialize)]
pub struct BuiltinStage {
    #[serde(flatten)]
    settings: TrainingSettings,
    /// See [`LAWS`].
    laws: u32,
    /// Location of its photos and points.
    #[serde(skip)]
    source: CaptureStage,
}

impl BuiltinStage {
    pub(super) fn new(settings: TrainingSettings, source: CaptureStage) -> Self {
        Self { settings, laws: LAWS, source }
    }

    /// The photos and points of the source. Its poses come with the capture.
    pub(super) fn sources(&self) -> Result<Vec<SourceFile>, StageError> {
        self.source.photos_and_points()
    }

    pub(super) fn source_folders(&self) -> Vec<PathBuf> {
        self.source.source_folders()
    }

    pub(super) fn need(&self, capture: &Capture) -> StepNeed {
        StepNeed::for_memory([training::memory_needed(&self.settings, &capture.views)])
    }

    pub(super) fn run(
        &self,
        capture: &Capture,
        solved: &SolvedInputs,
        cx: &mut StageContext<'_>,
    ) -> Result<Gaussians, StageError> {
        let files = self.source.training_files(solved)?;
        let state = cx.resumable()?;
        let (goes_on, progress, mut restarted) = (|| !cx.is_cancelled(), cx.progress, None);
        let mut news = |news: &TrainingNews| match news {
            TrainingNews::Restarted { because } => restarted = Some(because.clone()),
            TrainingNews::Read { .. } | TrainingNews::Report(_) => {
                progress.iter().for_each(|progress| progress.report(&news.to_string()));
            }
        };
        let watch = TrainingWatch {
            goes_on: &goes_on,
            news: &mut news,
            clock: cx.clock,
            // Replaced, since the state lies in the store and no person has named it.
            checkpoint: state.as_deref().map(|path| CheckpointFile { path, replaces: true }),
        };
        let trained = training::train_capture(capture, &files, &self.settings, &Backend::Cpu, watch)?;
        let TrainedGaussians { scene, record, without_photo } = trained;
        let judged = record.means();
        cx.remark =
            judged.map(|[psnr, _]| format!("{psnr:.2} dB on {} held-out photos", record.held_out.len()));
        cx.warnings.extend(restarted.map(|because| {
            format!("the training started again, because its kept state cannot be used: {because}")
        }));
        if without_photo > 0 {
            cx.warnings
                .push(format!("{without_photo} views were not used for training: their photos are missing"));
        }
        if record.ended == TrainingEnd::Minutes {
            let (made, all) = (record.iterations, self.settings.iterations);
            cx.warnings.push(format!(
                "the training ended after {made} of {all} iterations, because its minutes were used up; \
                 another run may make other bytes"
            ));
        }
        cx.write_record(TRAINING_FILE, &record)?;
        Ok(scene)
    }
}
