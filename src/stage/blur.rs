//! Stage `blur`: blurred frames, one PNG per exposure.

use super::shot::{ReadyShot, ShotParameters, record_work};
use super::{Stage, StageContext, StageError, StepNeed, StepTarget};
use crate::artifact::{ArtifactFiles, BlurredFrames, TrajectoryProduct, write_json};
use crate::image::png;
use crate::sampling::exposure::{
    self, ExposeError, ExposedFrame, ExposureCourse, FrameExposer, ShutterSettings,
};
use crate::scene::Gaussians;
use crate::source::Capture;
use serde::Serialize;
use std::fs::File;
use std::io::BufWriter;

/// Parameters: camera, rendering and shutter.
#[derive(Debug, Serialize)]
pub struct BlurStage {
    /// Camera and rendering.
    #[serde(flatten)]
    pub shot: ShotParameters,
    /// The shutter.
    #[serde(flatten)]
    pub shutter: ShutterSettings,
}

/// Bytes per pixel: sums of three colours in 64 bits, a picture in 32 bits, its flow, and the
/// encoder.
const BYTES_A_PIXEL: u64 = 72;

impl Stage for BlurStage {
    const NAME: &'static str = "blur";
    const REVISION: u32 = 1;
    type Inputs = (StepTarget<Capture>, StepTarget<Gaussians>, StepTarget<TrajectoryProduct>);
    type Output = BlurredFrames;

    fn class(&self) -> Option<String> {
        Some(self.shot.backend.class())
    }

    fn need(&self, files: &[ArtifactFiles]) -> StepNeed {
        self.shot.need(files, BYTES_A_PIXEL)
    }

    fn run(
        &self,
        (capture, gaussians, motion): (Capture, Gaussians, TrajectoryProduct),
        cx: &mut StageContext<'_>,
    ) -> Result<(), StageError> {
        let ReadyShot { camera, mut renderer } = self.shot.ready(&capture, gaussians, &motion, cx)?;
        let (poses, seconds) = (&motion.trajectory.world_from_camera, motion.seconds());
        let centres = exposure::exposure_centres(poses.len(), self.shutter.frames);
        if centres.is_empty() {
            return Err(exposure::TooShort { poses: poses.len(), frames: self.shutter.frames })
                .map_err(StageError::work_failed("expose"));
        }
        let course = ExposureCourse { camera, poses, seconds: &seconds };
        let exposer = FrameExposer::new(&mut *renderer, course, self.shutter);
        let mut exposer = exposer.map_err(StageError::work_failed("join the poses by a path"))?;
        let mut exposures = Vec::with_capacity(centres.len());
        for pose in centres {
            let exposed = exposer.expose(pose, &|| !cx.is_cancelled());
            let ExposedFrame { exposure, picture } = exposed.map_err(|error| match error {
                ExposeError::Interrupted => StageError::Cancelled,
                error @ ExposeError::Render(_) => StageError::work_failed("render")(error),
            })?;
            let out = cx.out.join(format!("{pose:06}.png"));
            let written = File::create(&out)
                .and_then(|file| png::write_image(&png::to_bytes(&picture), BufWriter::new(file)));
            written.map_err(StageError::io_error(&out))?;
            exposures.push(exposure);
        }
        cx.warnings.extend(exposure::ghost_warning(&exposures));
        let out = cx.out.join(BlurredFrames::EXPOSURES);
        write_json(&out, &exposures).map_err(StageError::io_error(&out))?;
        record_work(&exposer.work, cx)
    }
}
