//! The inertial data of a release against its poses.

use super::RecheckError;
use super::trajectory::ReleasedTrajectory;
use crate::artifact::TrajectoryProduct;
use crate::check::{Finding, records};
use crate::imu::consistency::{InertialLines, compare_inertial};
use crate::imu::files::{SAMPLES, SAMPLES_HEAD, SENSOR, STATES, STATES_HEAD, read_gravity, read_lines};

impl ReleasedTrajectory<'_> {
    /// Compares the inertial data with the poses. `None` if the recipe asks for none, or a file is absent, which the
    /// audit of the tree reports.
    pub(super) fn inertial(&self, motion: &TrajectoryProduct) -> Result<Option<Finding>, RecheckError> {
        let Some(model) = &self.recipe.imu else { return Ok(None) };
        let name = |file: &str| format!("{}/imu/{file}", self.folder);
        for file in [SAMPLES, STATES, SENSOR] {
            if !self.tree.has(&name(file))? {
                return Ok(None);
            }
        }
        let lines = |file: &str, head: &str| -> Result<InertialLines, RecheckError> {
            let name = name(file);
            read_lines(&self.tree.read(&name)?, head).map_err(|e| self.tree.refusal(&name, e))
        };
        let (samples, states) = (lines(SAMPLES, SAMPLES_HEAD)?, lines(STATES, STATES_HEAD)?);
        let sensor = self.tree.read(&name(SENSOR))?;
        let gravity = read_gravity(&sensor).map_err(|e| self.tree.refusal(&name(SENSOR), e))?;
        let mut faults = match compare_inertial(model, (&samples, &states), gravity, &motion.trajectory) {
            Err(because) => vec![because],
            Ok(found) => found.iter().filter(|d| !d.is_allowed()).map(ToString::to_string).collect(),
        };
        if (gravity.length() - model.gravity).abs() > 1e-9 {
            faults.push(format!(
                "the gravity of imu/{SENSOR} is not the {} m/s^2 of the recipe",
                model.gravity
            ));
        }
        Ok(Some(records::judge_agreement(self.name, "imu", "poses, states and samples of imu/", &faults)))
    }
}
