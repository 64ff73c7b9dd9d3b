//! The inertial data of a release against its poses and its recipe.

use super::trajectory::ReleasedTrajectory;
use gs2e_build::artifact::TrajectoryProduct;
use gs2e_check::Finding;
use gs2e_check::records::inertial::{InertialBytes, judge_inertial};
use gs2e_tree::TreeError;

impl ReleasedTrajectory<'_> {
    /// Compares the inertial data with the poses. `None` if the recipe asks for none, or a file is absent,
    /// which the audit of the tree reports.
    pub(super) fn inertial(&self, motion: &TrajectoryProduct) -> Result<Option<Finding>, TreeError> {
        let Some(model) = &self.recipe.imu else { return Ok(None) };
        let name = |file: &str| format!("imu/{file}");
        for file in InertialBytes::NAMES {
            if !self.files.has(&name(file))? {
                return Ok(None);
            }
        }
        let [samples, states, sensor] = InertialBytes::NAMES.map(|file| self.files.read(&name(file)));
        let (samples, states, sensor) = (samples?, states?, sensor?);
        let files = InertialBytes([&samples, &states, &sensor]);
        let found = judge_inertial(self.name, model, files, &motion.trajectory);
        found.map(Some).map_err(|fault| self.files.refusal(&name(fault.file), fault.because))
    }
}
