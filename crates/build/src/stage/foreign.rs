//! Stage `foreign`: asks other programs about a trajectory. The stage exists if a recipe requests
//! `pose_colmap`, `pose_opencv` or `readback`. Its class contains the versions of the programs, so
//! a program that is installed later is asked.

use super::{OpenedInputs, Stage, StageContext, StageError, StageFacts, StepNeed, StepTarget, known_program};
use crate::artifact::{ArtifactFiles, EventStreams, PictureSet, TrajectoryProduct};
use gs2e_check::Limits;
use gs2e_scene::camera::CameraChoice;
use gs2e_source::Capture;
use gs2e_source::foreign::versions::VersionQuery;
use gs2e_source::foreign::{ExternalReport, TrajectoryPicture, colmap, opencv, readback, spread_evenly};
use gs2e_source::reconstruct::ProgramWorkspace;
use serde::Serialize;
use std::path::Path;

/// Parameters: the programs to ask.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct ExternalToolsStage {
    /// The camera, if it differs from the source's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraChoice>,
    /// Number of pictures that COLMAP registers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub colmap: Option<u32>,
    /// True if OpenCV is asked about poses.
    pub opencv: bool,
    /// True if other programs read the released files.
    pub readback: bool,
    /// The versions of the programs, or the first program whose version is not known.
    #[serde(skip)]
    pub versions: Result<String, VersionQuery>,
}

impl ExternalToolsStage {
    /// The stage for these checks; `None` if they ask no program. `version` returns the version of
    /// a program, if it is known.
    #[must_use]
    pub(crate) fn for_limits(
        checks: &Limits,
        camera: Option<CameraChoice>,
        version: &dyn Fn(VersionQuery) -> Option<String>,
    ) -> Option<Self> {
        let colmap = checks.pose_colmap.map(|limits| limits.frames.unwrap_or(colmap::PICTURES));
        let (opencv, readback) = (checks.pose_opencv.is_some(), checks.readback.is_some());
        let python = (opencv || readback).then_some(VersionQuery::Python);
        let asked = colmap.map(|_| VersionQuery::Colmap).into_iter().chain(python);
        // One version that is not known leaves the key unknown.
        let versions = asked.map(|program| version(program).ok_or(program)).collect::<Result<Vec<_>, _>>();
        let versions = versions.map(|versions| versions.join("; "));
        checks.asks_programs().then_some(Self { camera, colmap, opencv, readback, versions })
    }
}

/// Memory of COLMAP with one picture and the key points of the sample, bytes; an estimate.
const BYTES: u64 = 600 << 20;
/// Memory per byte of a compressed event file: an event takes about two bytes, and its time and
/// index are expanded.
const BYTES_A_STORED_BYTE: u64 = 16;

impl StageFacts for ExternalToolsStage {
    fn class(&self) -> Option<String> {
        self.versions.clone().ok()
    }

    fn unasked(&self) -> Option<&'static str> {
        self.versions.as_ref().err().map(|program| program.name())
    }

    fn need(&self, files: &[ArtifactFiles]) -> StepNeed {
        let events =
            // Events are the last input, if there are any.
            files.last().map_or(0, |files| files.iter().map(|(name, _)| of_events(files, name)).sum());
        StepNeed::for_memory([BYTES, BYTES_A_STORED_BYTE * events])
    }

    fn runs_known_programs(&self) -> bool {
        true
    }
}

impl Stage for ExternalToolsStage {
    const NAME: &'static str = "foreign";
    const REVISION: u32 = 1;
    type Inputs = (
        StepTarget<Capture>,
        StepTarget<TrajectoryProduct>,
        Option<StepTarget<PictureSet>>,
        Option<StepTarget<EventStreams>>,
    );
    type Output = ExternalReport;

    fn run(&self, inputs: OpenedInputs<Self>, cx: &mut StageContext<'_>) -> Result<(), StageError> {
        let (capture, motion, pictures, events) = inputs;
        let camera = super::choose_camera(self.camera, &capture, cx);
        let pictures = pictures.map_or_else(Vec::new, numbered_pictures);
        let trajectory = &motion.trajectory;
        let mut foreign = ExternalReport::default();
        if let Some(frames) = self.colmap {
            let chosen =
                spread_evenly(pictures.len(), frames as usize).into_iter().map(|i| pictures[i].clone());
            let chosen: Vec<TrajectoryPicture> = chosen.collect();
            let ask =
                |workspace: ProgramWorkspace<'_>| colmap::register_pictures(&chosen, &camera, workspace);
            let found = known_program("colmap", cx, ask)?;
            foreign.colmap = Some(found.map(|found| found.against(&trajectory.world_from_camera)));
        }
        if self.opencv {
            let released = opencv::ReleasedPoses::from_trajectory(&camera, trajectory, &pictures);
            let ask = |workspace: ProgramWorkspace<'_>| {
                opencv::measure_released(&released, &camera, trajectory, &pictures, workspace)
            };
            foreign.opencv = Some(known_program("opencv", cx, ask)?);
        }
        if self.readback {
            let streams = events.map_or_else(Vec::new, |events| events.files);
            let ask = |workspace: ProgramWorkspace<'_>| readback::read_back(&streams, &pictures, workspace);
            foreign.readback = Some(known_program("readback", cx, ask)?);
        }
        cx.write_record("foreign.json", &foreign)
    }
}

/// Bytes of an event file; 0 for other files.
fn of_events(files: &ArtifactFiles, name: &str) -> u64 {
    if Path::new(name).extension().is_some_and(|e| e == "h5") { files.size(name) } else { 0 }
}

/// Pictures by the indices in their names.
fn numbered_pictures(pictures: PictureSet) -> Vec<TrajectoryPicture> {
    // Other files of the product have no index in their names.
    let picture = |(name, file): (String, _)| {
        let pose = name.strip_suffix(".png")?.parse().ok()?;
        Some(TrajectoryPicture { pose, file })
    };
    pictures.files.into_iter().filter_map(picture).collect()
}
