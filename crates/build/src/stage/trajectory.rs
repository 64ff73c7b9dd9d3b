//! Stage `trajectory`: makes a dense path at the prescribed speed, from captured views or other
//! inputs.

use super::{
    ExpectedSize, OpenedInputs, PathLength, Stage, StageContext, StageError, StageFacts, StepNeed, StepTarget,
};
use crate::artifact::{ArtifactFiles, TrajectoryProduct};
use gs2e_image::Size;
use gs2e_num::units::Hertz;
use gs2e_render::RenderChoice;
use gs2e_render::backend::Backend;
use gs2e_render::flow::PixelFlowMeter;
use gs2e_scene::Gaussians;
use gs2e_scene::camera::CameraChoice;
use gs2e_scene::survey::SceneSurvey;
use gs2e_source::Capture;
use gs2e_trajectory::flow::FlowMeter;
use gs2e_trajectory::mount::{CameraMount, MountedMeter};
use gs2e_trajectory::novel::BaseTrajectory;
use gs2e_trajectory::path::{CameraPath, PathInputs, SceneFraming};
use gs2e_trajectory::report::SpeedReport;
use gs2e_trajectory::sample::SummationRule;
use gs2e_trajectory::speed::SpeedChoice;
use gs2e_trajectory::{NamedPose, PoseTiming, Trajectory, picture};
use serde::Serialize;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::sync::Arc;

/// Parameters: path, speed, and frame rate.
#[derive(Debug, Serialize)]
pub(crate) struct TrajectoryStage {
    /// The path.
    pub path: CameraPath,
    /// The speed.
    pub speed: SpeedChoice,
    /// Summation of the speed law.
    pub law: SummationRule,
    /// Poses per second.
    pub rate: Hertz,
    /// Camera and rendering for a speed that is an image motion.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seeing: Option<ViewingSetup>,
    /// Camera for an orbit that is laid about the scene, which has no capture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub framing: Option<CameraChoice>,
}

/// A camera and its rendering.
#[derive(Debug, Serialize)]
pub(crate) struct ViewingSetup {
    /// The camera, if it differs from the source's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraChoice>,
    /// The rendering.
    pub render: RenderChoice,
    /// Place of the camera on a body whose path it measures, if there is a body.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mount: Option<CameraMount>,
    /// The back end.
    #[serde(skip)]
    pub backend: Backend,
}

/// Bytes of a pose in all files.
pub(super) const BYTES_A_POSE: f64 = 200.0;

impl StageFacts for TrajectoryStage {
    fn class(&self) -> Option<String> {
        self.seeing.as_ref().map(|seeing| seeing.backend.class())
    }

    fn need(&self, files: &[ArtifactFiles]) -> StepNeed {
        /// The images for the flow are small, whatever the camera.
        const SMALL: Size = Size { width: 160, height: 90 };
        match (&self.seeing, files) {
            // The scene is the last input.
            (Some(seeing), [others @ .., scene]) => {
                let need = StepNeed::for_memory([
                    super::small_stage_memory(others),
                    seeing.backend.memory(scene.bytes(), SMALL),
                ]);
                StepNeed { gpu: seeing.backend.takes_gpu(), ..need }
            }
            _ => StepNeed::for_memory([super::small_stage_memory(files)]),
        }
    }

    fn path_length(&self) -> Option<PathLength> {
        let poses = self.path.stated_poses(self.rate)?;
        Some(PathLength::at_rate(poses, self.rate.to_f64()))
    }

    fn expected_size(&self, path: PathLength) -> Option<ExpectedSize> {
        Some(ExpectedSize::of_text(path.poses, BYTES_A_POSE))
    }
}

impl Stage for TrajectoryStage {
    const NAME: &'static str = "trajectory";
    const REVISION: u32 = 2;
    /// The capture, the base trajectory of key poses, and the scene: each if path or speed needs
    /// it.
    type Inputs =
        (Option<StepTarget<Capture>>, Option<StepTarget<TrajectoryProduct>>, Option<StepTarget<Gaussians>>);
    type Output = TrajectoryProduct;

    fn run(&self, inputs: OpenedInputs<Self>, cx: &mut StageContext<'_>) -> Result<(), StageError> {
        let (capture, base, gaussians) = inputs;
        let views = capture.as_ref().map_or(&[][..], |capture| &capture.views);
        let views: Vec<NamedPose<'_>> = views
            .iter()
            .map(|v| NamedPose { name: &v.name, world_from_camera: v.world_from_camera })
            .collect();
        let base = base.as_ref().map(|motion| BaseTrajectory {
            poses: &motion.trajectory.world_from_camera,
            scale: motion.report.scale_distance,
        });
        let scene = self.framing(gaussians.as_ref());
        let mut meter = self.meter(capture.as_ref(), gaussians, cx)?;
        let mount = self.seeing.as_ref().and_then(|seeing| seeing.mount);
        let mut mounted = match (&mut meter, mount) {
            (Some(meter), Some(mount)) => Some(MountedMeter { meter, mount }),
            _ => None,
        };
        let meter = match &mut mounted {
            Some(mounted) => Some(mounted as &mut dyn FlowMeter),
            None => meter.as_mut().map(|meter| meter as &mut dyn FlowMeter),
        };
        let timing = PoseTiming { speed: &self.speed, rate: self.rate, law: self.law };
        let made = self.path.make(PathInputs { views: &views, base, scene }, timing, meter);
        let made = made.map_err(StageError::work_failed("make the trajectory"))?;
        cx.warnings.extend(made.report.warnings.iter().cloned());
        write_trajectory(&made.trajectory, &made.report, cx)
    }
}

/// Writes the files of a trajectory.
pub(super) fn write_trajectory(
    trajectory: &Trajectory,
    report: &SpeedReport,
    cx: &StageContext<'_>,
) -> Result<(), StageError> {
    let write = |name: &str, fill: &dyn Fn(&mut dyn Write) -> std::io::Result<()>| {
        let out = cx.out.join(name);
        let written = File::create(&out).map(BufWriter::new).and_then(|mut file| {
            fill(&mut file)?;
            // Dropping the writer would flush it too, but lose the error.
            file.flush()
        });
        written.map_err(StageError::io_error(&out))
    };
    write("poses.txt", &|file| trajectory.write_poses(file))?;
    write("timestamps_us.txt", &|file| trajectory.write_stamps(file))?;
    write("trajectory.svg", &|file| file.write_all(picture::trajectory_svg(trajectory, report).as_bytes()))?;
    cx.write_record("speed.json", report)
}

impl TrajectoryStage {
    /// The scene and its camera, if an orbit is laid about it.
    fn framing(&self, gaussians: Option<&Gaussians>) -> Option<SceneFraming> {
        let camera = self.framing?.resolve(None)?;
        Some(SceneFraming { survey: SceneSurvey::measure_scene(gaussians?), camera })
    }

    /// The meter of optical flow, if the speed is an image motion.
    fn meter(
        &self,
        capture: Option<&Capture>,
        gaussians: Option<Gaussians>,
        cx: &mut StageContext<'_>,
    ) -> Result<Option<PixelFlowMeter>, StageError> {
        let (Some(seeing), Some(capture), Some(gaussians)) = (&self.seeing, capture, gaussians) else {
            return Ok(None);
        };
        // Speeds are in pixels of this camera, although the meter renders small images.
        let camera = super::choose_camera(seeing.camera, capture, cx);
        let style = seeing.render.resolve(gaussians.antialiased);
        let renderer =
            seeing.backend.renderer(Arc::new(gaussians), style).map_err(StageError::work_failed("render"))?;
        Ok(Some(PixelFlowMeter::new(renderer, camera)))
    }
}
