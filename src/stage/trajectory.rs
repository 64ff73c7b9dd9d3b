//! Stage `trajectory`: from captured views to a dense path at the prescribed speed.

use super::{Context, Stage, StageError, Target};
use crate::artifact::{Motion, write_json};
use crate::source::Capture;
use crate::speed::Speed;
use crate::trajectory::refine::{Refine, refine};
use crate::trajectory::{NamedPose, picture};
use crate::units::Hertz;
use serde::Serialize;
use std::fs::File;
use std::io::{BufWriter, Write};

/// Parameters: how the path is made, how fast it is followed, and how often it is sampled.
#[derive(Debug, Serialize)]
pub struct Moving {
    /// The path.
    pub refine: Refine,
    /// The speed.
    pub speed: Speed,
    /// Poses a second.
    pub rate: Hertz,
}

impl Stage for Moving {
    const NAME: &'static str = "trajectory";
    const REVISION: u32 = 1;
    type Inputs = Target<Capture>;
    type Output = Motion;

    fn run(&self, capture: Capture, cx: &mut Context<'_>) -> Result<(), StageError> {
        let views: Vec<NamedPose<'_>> = capture
            .views
            .iter()
            .map(|v| NamedPose { name: &v.name, world_from_camera: v.world_from_camera })
            .collect();
        let refined = refine(&views, &self.refine, &self.speed, self.rate)
            .map_err(StageError::work("refine the trajectory"))?;
        cx.warnings.extend(refined.report.warnings.iter().cloned());
        let write = |name: &str, fill: &dyn Fn(&mut dyn Write) -> std::io::Result<()>| {
            let out = cx.out.join(name);
            let written = File::create(&out).map(BufWriter::new).and_then(|mut file| {
                fill(&mut file)?;
                file.flush()
            });
            written.map_err(StageError::io(&out))
        };
        write("poses.txt", &|file| refined.trajectory.write_poses(file))?;
        write("timestamps_us.txt", &|file| refined.trajectory.write_stamps(file))?;
        write("trajectory.svg", &|file| {
            file.write_all(picture::svg(&refined.trajectory, &refined.report).as_bytes())
        })?;
        let out = cx.out.join("speed.json");
        write_json(&out, &refined.report).map_err(StageError::io(&out))
    }
}
