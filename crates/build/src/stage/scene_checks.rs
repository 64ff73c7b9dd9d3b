//! Stage `scene_checks`: runs the validation passes over a scene's capture and photos.
//!
//! The scene id is not part of the input, so findings are stored with an empty subject, as those of
//! [`super::checks`].

use super::capture::{CaptureStage, SolvingInputs};
use super::{OpenedInputs, SourceFile, Stage, StageContext, StageError, StageFacts, StepTarget};
use crate::artifact::VerdictsRecord;
use gs2e_check::{CapturePhotos, Limits, SceneSubject, judge_scene};
use gs2e_source::colmap::{ColmapModel, ReprojectionStats};
use gs2e_source::{Capture, UnusedReason};
use gs2e_train::fidelity::PhotoFidelity;
use gs2e_trajectory::NamedPose;
use gs2e_trajectory::walk::CaptureEvenness;
use serde::Serialize;
use std::path::PathBuf;

/// Name of the stage.
pub const NAME: &str = "scene_checks";

/// Parameters: limits and waivers of the recipe for scenes.
#[derive(Debug, Serialize)]
pub(crate) struct CheckingScene {
    /// Limits and waivers.
    pub limits: Limits,
    /// Location of the capture.
    #[serde(skip)]
    pub capturing: CaptureStage,
}

const NO_MODEL: &str = "the source is not a COLMAP model";

impl StageFacts for CheckingScene {
    fn sources(&self) -> Result<Vec<SourceFile>, StageError> {
        let files = self.capturing.model().map(|model| model.files()).unwrap_or_default();
        Ok(files.into_iter().map(|(name, path)| SourceFile { name, path }).collect())
    }

    fn source_folders(&self) -> Vec<PathBuf> {
        self.capturing.source_folders()
    }
}

impl Stage for CheckingScene {
    const NAME: &'static str = NAME;
    const REVISION: u32 = 4;
    type Inputs = (StepTarget<Capture>, Option<StepTarget<PhotoFidelity>>, SolvingInputs);
    type Output = VerdictsRecord;

    fn run(&self, inputs: OpenedInputs<Self>, cx: &mut StageContext<'_>) -> Result<(), StageError> {
        let (capture, fidelity, solved) = inputs;
        let model = solved.map(|(solved, _)| solved.model).or_else(|| self.capturing.model());
        let subject = SceneSubject {
            name: "",
            photos: count_photos(&capture, model.as_ref()),
            reprojection: model_reprojection(model)?,
            walk: capture_walk(&capture),
            fidelity: fidelity.as_ref(),
            limits: &self.limits,
        };
        let verdicts = VerdictsRecord { findings: judge_scene(&subject), peaks_ev_per_ms: Vec::new() };
        cx.write_record("verdicts.json", &verdicts)
    }
}

fn model_reprojection(model: Option<ColmapModel>) -> Result<Result<ReprojectionStats, String>, StageError> {
    let Some(model) = model else { return Ok(Err(NO_MODEL.to_owned())) };
    let found = model.reprojection().map_err(StageError::work_failed("measure the model"))?;
    Ok(found.ok_or_else(|| "the model has no points that its images see".to_owned()))
}

/// Counts the photos. Photos excluded by name do not count; photos that were not selected count
/// like the others.
fn count_photos(capture: &Capture, model: Option<&ColmapModel>) -> Result<CapturePhotos, String> {
    model.ok_or(NO_MODEL)?;
    let unused = |why| capture.unused.iter().filter(move |photo| photo.why == why);
    let hashes = capture.views.iter().map(|view| &view.sha256);
    let hashes = hashes.chain(unused(UnusedReason::NotPicked).map(|photo| &photo.sha256));
    // A view without a photo has no hash.
    let registered = hashes.clone().flatten().count();
    Ok(CapturePhotos {
        there: registered + unused(UnusedReason::NotRegistered).count(),
        registered,
        views: hashes.count(),
    })
}

fn capture_walk(capture: &Capture) -> Result<CaptureEvenness, String> {
    let pose = |view: &gs2e_source::CapturedView| view.world_from_camera;
    let views = capture.views.iter().map(|v| NamedPose { name: &v.name, world_from_camera: pose(v) });
    let walk = CaptureEvenness::measure_views(&views.collect::<Vec<_>>()).map_err(|e| e.to_string())?;
    walk.ok_or_else(|| "all views have the same pose".to_owned())
}
