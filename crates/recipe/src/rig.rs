//! Rigs: the cameras on the body that follows each trajectory of a recipe.
//!
//! A trajectory of a recipe with a rig is that of the body. Each camera has a trajectory of its own below it,
//! with the name `<trajectory>/<camera>`.

use super::{OutputKind, Recipe, TrajectoryRecipe};
use gs2e_num::se3::Se3;
use gs2e_scene::camera::CameraChoice;
use gs2e_sensor::{SensorChoice, SensorSet};
use gs2e_trajectory::mount::CameraMount;
use std::collections::BTreeSet;

/// A camera of a rig.
#[derive(Debug, Clone, PartialEq)]
pub struct RigCamera {
    /// Its name.
    pub name: String,
    /// Its place on the body.
    pub mount: CameraMount,
    /// Size and intrinsics, if they differ from those of the source.
    pub camera: Option<CameraChoice>,
    /// Its own sensor, if it differs from those of the recipe.
    pub sensors: Option<SensorSet>,
    /// Its products.
    pub outputs: BTreeSet<OutputKind>,
    /// The second camera of the stereo pair whose first one it is.
    pub second: Option<StereoPartner>,
}

/// The second camera of a stereo pair.
#[derive(Debug, Clone, PartialEq)]
pub struct StereoPartner {
    /// Its name.
    pub name: String,
    /// Its place on the body.
    pub mount: CameraMount,
    /// Size and intrinsics, if they differ from those of the source.
    pub camera: Option<CameraChoice>,
}

impl RigCamera {
    /// The motion from this camera to the second one of its pair.
    #[must_use]
    pub fn second_from_first(&self) -> Option<Se3> {
        let second = self.second.as_ref()?.mount.body_from_camera().inverse();
        Some(second.compose(&self.mount.body_from_camera()))
    }
}

/// The camera whose path a trajectory is.
#[derive(Debug, Clone, PartialEq)]
pub struct MountedPath {
    /// Name of the trajectory of the body.
    pub body: String,
    /// The camera.
    pub camera: RigCamera,
}

impl TrajectoryRecipe {
    /// The trajectory of a camera on a body that follows this one.
    pub(super) fn of_camera(&self, camera: &RigCamera) -> Self {
        Self {
            name: format!("{}/{}", self.name, camera.name),
            mounted: Some(Box::new(MountedPath { body: self.name.clone(), camera: camera.clone() })),
            ..self.clone()
        }
    }
}

impl Recipe {
    /// The camera of a rig whose path a trajectory is; `None` for any other path.
    #[must_use]
    pub fn mounted(&self, trajectory: &str) -> Option<&MountedPath> {
        let named = self.trajectories.iter().find(|own| own.name == trajectory);
        named.and_then(|own| own.mounted.as_deref())
    }

    /// Returns true if a trajectory is that of a body that carries cameras.
    #[must_use]
    pub fn is_of_body(&self, trajectory: &str) -> bool {
        !self.rig.is_empty() && self.mounted(trajectory).is_none()
    }

    /// The camera that sees along a trajectory, if it differs from that of the source.
    #[must_use]
    pub fn camera_along(&self, trajectory: &str) -> Option<CameraChoice> {
        self.mounted(trajectory).map_or(self.camera, |mounted| mounted.camera.camera)
    }

    /// The sensors of the recipe, and those of single cameras.
    pub fn every_sensor(&self) -> impl Iterator<Item = (Option<&str>, &SensorChoice)> {
        let own = self.rig.iter().flat_map(|camera| &camera.sensors);
        std::iter::once(&self.sensors).chain(own).flat_map(SensorSet::iter)
    }

    /// The products of a trajectory. A body has those that are measured on its path, and its cameras the
    /// others.
    #[must_use]
    pub fn outputs_of(&self, trajectory: &str) -> BTreeSet<OutputKind> {
        match self.mounted(trajectory) {
            Some(mounted) => mounted.camera.outputs.clone(),
            None if self.rig.is_empty() => self.outputs.clone(),
            None => self.outputs.iter().copied().filter(|output| output.is_measured()).collect(),
        }
    }

    /// Returns true if events are simulated along a trajectory.
    #[must_use]
    pub fn has_events_along(&self, trajectory: &str) -> bool {
        self.outputs_of(trajectory).iter().any(|output| output.is_simulated())
    }
}
