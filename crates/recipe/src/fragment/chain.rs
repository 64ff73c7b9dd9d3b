//! A trajectory of a fragment, and the trajectories that it is drawn from.

use super::TrajectoryFragment;
use crate::TrajectoryRecipe;
use gs2e_source::CapturedView;
use gs2e_trajectory::flow::FlowMeter;
use gs2e_trajectory::novel::BaseTrajectory;
use gs2e_trajectory::path::PathInputs;
use gs2e_trajectory::speed::SpeedChoice;
use gs2e_trajectory::{NamedPose, PoseTiming, TrajectoryBuild, TrajectoryError};

/// The reason why a fragment has no such trajectory, or why it cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum ChainError {
    /// No trajectory has this name.
    #[error("the recipe has no trajectory `{name}`")]
    Unknown {
        /// The name.
        name: String,
        /// The names of all trajectories, in file order.
        names: Vec<String>,
    },
    /// The bases of a trajectory lead back to one of them.
    #[error("the trajectory `{name}` is drawn from itself")]
    Circular {
        /// Name of the trajectory.
        name: String,
    },
    /// The path cannot be made from its inputs.
    #[error("failed to make the trajectory `{name}`")]
    Make {
        /// Name of the trajectory: the one asked for, or one of its bases.
        name: String,
        /// Cause.
        source: TrajectoryError,
    },
}

/// A trajectory of a fragment and its bases. Each base precedes the trajectory that is drawn from it.
#[derive(Debug, Clone)]
pub struct TrajectoryChain<'a> {
    fragment: &'a TrajectoryFragment,
    links: Vec<&'a TrajectoryRecipe>,
}

impl TrajectoryFragment {
    /// The trajectory with this name, and its bases.
    ///
    /// # Errors
    /// There is none, or it is drawn from itself.
    pub fn chain(&self, name: &str) -> Result<TrajectoryChain<'_>, ChainError> {
        let mut last = self.trajectory(name)?;
        let mut links = vec![last];
        while let Some(base) = &last.base {
            last = self.trajectory(base)?;
            // A chain that returns to itself would never end.
            if links.iter().any(|link| link.name == last.name) {
                return Err(ChainError::Circular { name: last.name.clone() });
            }
            links.push(last);
        }
        links.reverse();
        Ok(TrajectoryChain { fragment: self, links })
    }

    fn trajectory(&self, name: &str) -> Result<&TrajectoryRecipe, ChainError> {
        self.trajectories.iter().find(|recipe| recipe.name == name).ok_or_else(|| ChainError::Unknown {
            name: name.to_owned(),
            names: self.trajectories.iter().map(|recipe| recipe.name.clone()).collect(),
        })
    }
}

impl TrajectoryChain<'_> {
    /// Name of the first trajectory that is made from the views of a capture. A base may need them
    /// even if its follower does not.
    #[must_use]
    pub fn needs_views(&self) -> Option<&str> {
        self.links.iter().find(|recipe| recipe.path.needs_views()).map(|recipe| recipe.name.as_str())
    }

    /// Name of the first trajectory whose speed is in pixels, which needs a flow meter.
    #[must_use]
    pub fn needs_meter(&self) -> Option<&str> {
        let in_pixels = |recipe: &&&TrajectoryRecipe| matches!(recipe.speed, SpeedChoice::Flow(_));
        self.links.iter().find(in_pixels).map(|recipe| recipe.name.as_str())
    }

    /// Makes the trajectory, and collects the warnings of its bases, each with the base's name. `views`
    /// are those of the capture; empty without one.
    ///
    /// # Errors
    /// The trajectory or one of its bases cannot be made.
    pub fn make(
        &self,
        views: &[CapturedView],
        mut meter: Option<&mut dyn FlowMeter>,
    ) -> Result<(TrajectoryBuild, Vec<String>), ChainError> {
        let views: Vec<NamedPose<'_>> = views
            .iter()
            .map(|view| NamedPose { name: &view.name, world_from_camera: view.world_from_camera })
            .collect();
        let (mut made, mut warnings): (Option<TrajectoryBuild>, Vec<String>) = (None, Vec::new());
        for (i, recipe) in self.links.iter().enumerate() {
            let base = made.take();
            // A base has no report of its own, so its warnings carry its name.
            let noticed = base.iter().flat_map(|base| &base.report.warnings);
            warnings.extend(noticed.map(|warning| format!("{}: {warning}", self.links[i - 1].name)));
            let base = base.as_ref().map(|made| BaseTrajectory {
                poses: &made.trajectory.world_from_camera,
                scale: made.report.scale_distance,
            });
            let TrajectoryFragment { rate, law, .. } = *self.fragment;
            let inputs = PathInputs { views: &views, base, scene: None };
            let timing = PoseTiming { speed: &recipe.speed, rate, law };
            // A reborrow of the meter for each link.
            let meter = meter.as_mut().map(|meter| &mut **meter as &mut dyn FlowMeter);
            let one = recipe.path.make(inputs, timing, meter);
            made = Some(one.map_err(|source| ChainError::Make { name: recipe.name.clone(), source })?);
        }
        Ok((made.expect("a chain holds the trajectory that was chosen"), warnings))
    }
}
