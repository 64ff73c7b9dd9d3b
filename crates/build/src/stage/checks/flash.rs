//! The sharp frames of a trajectory as blocks, and the Gaussian that made a flash.

use super::ChecksStage;
use crate::artifact::{SceneFiles, SharpFrames, SimulationRecord, TrajectoryProduct};
use crate::stage::near::hide_near_along;
use crate::stage::{StageContext, StageError, StepTarget};
use gs2e_check::flash::PictureFlash;
use gs2e_check::flash::blocks::FrameBlocks;
use gs2e_check::{Finding, TrajectorySubject, Verdict, flash};
use gs2e_files as files;
use gs2e_image::png;
use gs2e_render::near::cause::{FlashViews, find_cause};
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::CameraView;
use rayon::prelude::*;
use std::io::BufReader;
use std::path::Path;
use std::sync::Arc;

/// The sharp frames, if they are made and the light does not change; and the scene, if there are events.
pub(crate) type FlashProducts = (Option<StepTarget<SharpFrames>>, Option<StepTarget<SceneFiles>>);

/// Number of frames between two looks at the clock of a cancellation.
const BATCH: usize = 64;

/// The things that show which Gaussian made a flash.
pub(super) struct FlashGround<'a> {
    pub(super) scene: &'a SceneFiles,
    pub(super) camera: Camera,
    pub(super) motion: &'a TrajectoryProduct,
}

impl<'a> FlashGround<'a> {
    /// `None` without events or a scene.
    pub(super) fn new(
        simulation: Option<&SimulationRecord>,
        scene: Option<&'a SceneFiles>,
        motion: &'a TrajectoryProduct,
    ) -> Option<Self> {
        Some(Self { scene: scene?, camera: simulation?.camera, motion })
    }
}

impl ChecksStage {
    /// The blocks of the sharp frames. `None` without frames.
    pub(super) fn frame_blocks(
        &self,
        frames: Option<&SharpFrames>,
        cx: &StageContext<'_>,
    ) -> Result<Option<Vec<FrameBlocks>>, StageError> {
        let Some(SharpFrames(pictures)) = frames else { return Ok(None) };
        let pose = |name: &str| name.strip_suffix(".png").and_then(|pose| pose.parse::<usize>().ok());
        let named = pictures.files.iter().filter_map(|(name, path)| Some((pose(name)?, path)));
        let mut blocks = Vec::new();
        for batch in named.collect::<Vec<_>>().chunks(BATCH) {
            cx.go_on()?;
            let read: Vec<FrameBlocks> =
                batch.par_iter().map(|(pose, path)| blocks_of(*pose, path)).collect::<Result<_, _>>()?;
            blocks.extend(read);
        }
        Ok(Some(blocks))
    }

    /// Adds to each finding of a flash the Gaussian that made it.
    pub(super) fn name_sources<'s, 'a: 's>(
        &self,
        findings: &mut [Finding],
        subjects: &(impl Iterator<Item = &'s TrajectorySubject<'a>> + Clone),
        ground: Option<&FlashGround<'_>>,
    ) -> Result<(), StageError> {
        let Some(ground) = ground else { return Ok(()) };
        for finding in findings.iter_mut().filter(|finding| is_alarm(finding)) {
            let found = subjects.clone().find_map(|subject| flash_of(subject, finding));
            if let Some(found) = found {
                finding.because.extend(self.cause(&found, ground)?);
            }
        }
        Ok(())
    }

    /// The words for the Gaussian that made a flash.
    fn cause(&self, found: &PictureFlash, ground: &FlashGround<'_>) -> Result<Option<String>, StageError> {
        let scene = ground.scene.read().map_err(StageError::work_failed("read the scene"))?;
        let (scene, _) = hide_near_along(&Arc::new(scene), ground.motion, &ground.camera, &self.render);
        let view = |pose: usize| {
            let trajectory = &ground.motion.trajectory;
            let view = CameraView::at_rest(ground.camera, trajectory.world_from_camera[pose]);
            view.at_time(trajectory.seconds(pose))
        };
        let views =
            FlashViews { views: found.poses.map(view), style: self.render.resolve(scene.antialiased) };
        let cause =
            find_cause(&scene, &views).map_err(StageError::work_failed("find the cause of a flash"))?;
        Ok(cause.map(|cause| {
            format!(
                "; Gaussian {}, {:.2} units from the camera, makes {:.0} % of it",
                cause.gaussian,
                cause.distance,
                100.0 * cause.share
            )
        }))
    }
}

fn blocks_of(pose: usize, path: &Path) -> Result<FrameBlocks, StageError> {
    let file = files::open(path).map_err(StageError::io_error(path))?;
    let frame = png::read_colours(BufReader::new(file), None);
    let frame = frame.map_err(StageError::work_failed(&format!("read {}", path.display())))?;
    Ok(FrameBlocks::new(pose, &frame.luminance))
}

fn is_alarm(finding: &Finding) -> bool {
    finding.check == flash::NAME && matches!(finding.verdict, Verdict::Fail | Verdict::Waived | Verdict::Warn)
}

/// The flash of a finding, if it is on this subject.
fn flash_of(subject: &TrajectorySubject<'_>, finding: &Finding) -> Option<PictureFlash> {
    let of_subject = finding.subject.place == subject.name;
    match (of_subject, finding.subject.statement.as_str(), subject.blocks) {
        (true, "frames", Some(frames)) => flash::in_frames(subject, frames),
        (true, "events", _) => flash::in_events(subject).map(|(found, _)| found),
        _ => None,
    }
}
