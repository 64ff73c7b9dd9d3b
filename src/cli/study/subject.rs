//! The subject of a study: a recipe's scene and one of its trajectories, from the store.

use crate::cli::CommonArgs;
use crate::cli::build::store_options;
use crate::cli::problem::VerbError;
use gs2e_build::artifact::{Artifact, ArtifactFiles, TrajectoryProduct};
use gs2e_build::plan::Plan;
use gs2e_build::plan::assess::{StepAssessment, assess_plan};
use gs2e_recipe as recipe;
use gs2e_recipe::Recipe;
use gs2e_scene::camera::Camera;
use gs2e_scene::{Gaussians, camera};
use gs2e_sensor::SensorSet;
use gs2e_sensor::voltmeter::VoltmeterModel;
use gs2e_source::Capture;
use gs2e_store::{Store, StoreAccess};
use std::path::Path;
use std::sync::Arc;

/// The only recipe of a file or folder.
pub(super) fn single_recipe(path: &Path) -> Result<Recipe, VerbError> {
    let mut recipes = recipe::read_all(std::slice::from_ref(&path.to_owned()))?;
    match (recipes.pop(), recipes.len()) {
        (Some(recipe), 0) => Ok(recipe),
        (_, others) => {
            let what = format!("{} holds {} recipes, wanted one", path.display(), others + 1);
            Err(VerbError::usage("recipe", what).help("name one recipe file"))
        }
    }
}

/// The name of the requested trajectory of a camera; the first one by default.
pub(super) fn trajectory_name(recipe: &Recipe, wanted: Option<&str>) -> Result<String, VerbError> {
    let names = recipe.trajectories.iter().map(|t| t.name.as_str());
    let names: Vec<&str> = names.filter(|name| !recipe.is_of_body(name)).collect();
    let wanted = wanted.unwrap_or(names[0]);
    if names.contains(&wanted) {
        return Ok(wanted.to_owned());
    }
    let what = format!("{} has no trajectory `{wanted}`; it has {}", recipe.scene, names.join(", "));
    Err(VerbError::usage("no-trajectory", what))
}

/// The only sensor of the recipe along a trajectory, which must be a voltmeter.
pub(super) fn single_voltmeter(recipe: &Recipe, trajectory: &str) -> Result<VoltmeterModel, VerbError> {
    match recipe.sensors_of(trajectory) {
        SensorSet::One(sensor) => sensor.as_voltmeter().cloned().ok_or_else(|| {
            let what = format!("the sensor of {} is {}, wanted a voltmeter", recipe.scene, sensor.name());
            VerbError::usage("sensor", what)
        }),
        SensorSet::Named(_) => {
            let what = format!("{} has several sensors, wanted one", recipe.scene);
            Err(VerbError::usage("sensor", what).help("use a recipe with `sensor`"))
        }
    }
}

/// The products of a trajectory in the store.
pub(super) struct StudySubject {
    pub(super) camera: Camera,
    pub(super) gaussians: Arc<Gaussians>,
    pub(super) motion: TrajectoryProduct,
}

impl StudySubject {
    pub(super) fn open_subject(
        recipe: Recipe,
        trajectory: &str,
        common: &CommonArgs,
    ) -> Result<Self, VerbError> {
        let store = Store::open(&common.store, store_options(common, StoreAccess::Read), &mut |_| {})?;
        let (scene, camera) = (recipe.scene.clone(), recipe.camera_along(trajectory));
        let plan = Plan::new(vec![recipe], &common.renderers()?.knowing(&store));
        let assessed = assess_plan(&plan, &store)?;
        let shelf = StudyProducts { scene: &scene, plan: &plan, assessed: &assessed, store: &store };
        let capture: Capture = shelf.open("capture")?;
        let own = capture.camera().map(|(own, _)| own);
        Ok(Self {
            camera: camera::choose_camera(camera, own.as_ref())
                .expect("recipes without views write a whole camera"),
            gaussians: Arc::new(shelf.open("reconstruct")?),
            motion: shelf.open(&format!("{trajectory}/trajectory"))?,
        })
    }
}

/// The products of one scene.
struct StudyProducts<'a> {
    scene: &'a str,
    plan: &'a Plan,
    assessed: &'a [StepAssessment],
    store: &'a Store,
}

impl StudyProducts<'_> {
    fn open<A: Artifact>(&self, name: &str) -> Result<A, VerbError> {
        let found = self.plan.steps().iter().zip(self.assessed).find(|(step, _)| step.name == name);
        // Older outputs belong to another recipe, so a study of them would mislead.
        let Some(outputs) = found.and_then(|(_, assessed)| assessed.outputs.as_ref()) else {
            let message = format!("{}/{name} is not built, or no longer up to date", self.scene);
            return Err(VerbError::failed("not-built", message).step(self.scene, name).help("gs2e build"));
        };
        A::open(&ArtifactFiles::from_outputs(outputs, self.store))
            .map_err(|e| VerbError::failed("unreadable", format!("failed to {e}")))
    }
}
