//! Stage `mount`: the path of a camera on a body, from the path of the body.

use super::trajectory::BYTES_A_POSE;
use super::{ExpectedSize, PathLength, Stage, StageContext, StageError, StageFacts, StepTarget};
use crate::artifact::TrajectoryProduct;
use gs2e_trajectory::mount::CameraMount;
use serde::Serialize;
use std::io;

/// Parameters: the place of the camera on the body.
#[derive(Debug, Serialize)]
pub(crate) struct MountStage {
    /// The place.
    #[serde(flatten)]
    pub mount: CameraMount,
}

impl StageFacts for MountStage {
    fn expected_size(&self, path: PathLength) -> Option<ExpectedSize> {
        Some(ExpectedSize::of_text(path.poses, BYTES_A_POSE))
    }
}

impl Stage for MountStage {
    const NAME: &'static str = "mount";
    const REVISION: u32 = 1;
    /// The path of the body.
    type Inputs = StepTarget<TrajectoryProduct>;
    type Output = TrajectoryProduct;

    fn run(&self, body: TrajectoryProduct, cx: &mut StageContext<'_>) -> Result<(), StageError> {
        let trajectory = body.trajectory.of_mounted(&self.mount);
        let report = body.report.of_mounted(&trajectory.world_from_camera);
        let unfit = || io::Error::other("the speeds of the body do not fit its poses");
        let report =
            report.ok_or_else(unfit).map_err(StageError::work_failed("measure the path of the camera"))?;
        super::trajectory::write_trajectory(&trajectory, &report, cx)
    }
}
