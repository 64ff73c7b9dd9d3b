//! Stage `blur`: blurred frames, one PNG per exposure.

use super::shot::{Ready, Shot, record_work};
use super::{Context, Need, Stage, StageError, Target};
use crate::artifact::{Blurred, Files, Motion, write_json};
use crate::image::png;
use crate::sampling::exposure::{self, Course, ExposeError, Exposed, Exposer, Shutter};
use crate::scene::Gaussians;
use crate::source::Capture;
use serde::Serialize;
use std::fs::File;
use std::io::BufWriter;

/// Parameters: camera, rendering and shutter.
#[derive(Debug, Serialize)]
pub struct Exposing {
    /// Camera and rendering.
    #[serde(flatten)]
    pub shot: Shot,
    /// The shutter.
    #[serde(flatten)]
    pub shutter: Shutter,
}

/// Bytes per pixel: sums of three colours in 64 bits, a picture in 32 bits, its flow, and the
/// encoder.
const BYTES_A_PIXEL: u64 = 72;

impl Stage for Exposing {
    const NAME: &'static str = "blur";
    const REVISION: u32 = 1;
    type Inputs = (Target<Capture>, Target<Gaussians>, Target<Motion>);
    type Output = Blurred;

    fn class(&self) -> Option<String> {
        Some(self.shot.backend.class())
    }

    fn need(&self, files: &[Files]) -> Need {
        self.shot.need(files, BYTES_A_PIXEL)
    }

    fn run(
        &self,
        (capture, gaussians, motion): (Capture, Gaussians, Motion),
        cx: &mut Context<'_>,
    ) -> Result<(), StageError> {
        let Ready { camera, mut renderer } = self.shot.ready(&capture, gaussians, &motion, cx)?;
        let (poses, seconds) = (&motion.trajectory.world_from_camera, motion.seconds());
        let centres = exposure::exposure_centres(poses.len(), self.shutter.frames);
        if centres.is_empty() {
            return Err(exposure::TooShort { poses: poses.len(), frames: self.shutter.frames })
                .map_err(StageError::work_failed("expose"));
        }
        let course = Course { camera, poses, seconds: &seconds };
        let exposer = Exposer::new(&mut *renderer, course, self.shutter);
        let mut exposer = exposer.map_err(StageError::work_failed("join the poses by a path"))?;
        let mut exposures = Vec::with_capacity(centres.len());
        for pose in centres {
            let exposed = exposer.expose(pose, &|| !cx.is_cancelled());
            let Exposed { exposure, picture } = exposed.map_err(|error| match error {
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
        let out = cx.out.join(Blurred::EXPOSURES);
        write_json(&out, &exposures).map_err(StageError::io_error(&out))?;
        record_work(&exposer.work, cx)
    }
}
