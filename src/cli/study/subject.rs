//! The subject of a study: a recipe's scene and one of its trajectories, from the store.

use crate::cli::build::read_store;
use crate::cli::problem::not_built;
use crate::cli::{CommonArgs, RecipeTargets, VerbError};
use gs2e_build::artifact::{Artifact, ArtifactFiles, TrajectoryProduct};
use gs2e_build::plan::Plan;
use gs2e_build::plan::assess::{StepAssessment, assess_plan};
use gs2e_num::seed::{Seed, StreamPurpose};
use gs2e_recipe::{self as recipe, Recipe};
use gs2e_render::RenderStyle;
use gs2e_render::backend::Backend;
use gs2e_scene::Gaussians;
use gs2e_scene::camera::{self, Camera};
use gs2e_sensor::SensorSet;
use gs2e_sensor::voltmeter::VoltmeterModel;
use gs2e_source::Capture;
use gs2e_store::Store;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The scene of a study.
#[derive(Debug, clap::Args)]
pub(super) struct SubjectArgs {
    /// Recipe of a scene that is built
    #[arg(value_name = "RECIPE", default_value = RecipeTargets::DEFAULT)]
    pub(super) recipe: PathBuf,
    /// Trajectory [default: the first]
    #[arg(long, value_name = "NAME")]
    trajectory: Option<String>,
}

impl SubjectArgs {
    /// Reads the recipe, and opens the products of the trajectory.
    pub(super) fn open(&self, common: &CommonArgs) -> Result<StudySubject, VerbError> {
        let recipe = single_recipe(&self.recipe)?;
        let trajectory = trajectory_name(&recipe, self.trajectory.as_deref())?;
        let sensor = single_voltmeter(&recipe, &trajectory)?;
        common.limit_cores();
        let (backend, scene, render) = (common.backend()?, recipe.scene.clone(), recipe.render);
        // The seed of a build, so that the noise is that of the released events.
        let seed = Seed::for_stream(recipe.seed, &scene, &trajectory, StreamPurpose::Sensor);
        let camera = recipe.camera_along(&trajectory);
        let store = read_store(common)?;
        let plan = Plan::new(vec![recipe], &common.renderers()?.knowing(&store));
        let assessed = assess_plan(&plan, &store)?;
        let shelf = StudyProducts { scene: &scene, plan: &plan, assessed: &assessed, store: &store };
        let capture: Capture = shelf.open("capture")?;
        let own = capture.camera().map(|(own, _)| own);
        let camera = camera::choose_camera(camera, own.as_ref());
        let gaussians: Gaussians = shelf.open("reconstruct")?;
        Ok(StudySubject {
            camera: camera.expect("recipes without views write a whole camera"),
            style: render.resolve(gaussians.antialiased),
            gaussians: Arc::new(gaussians),
            motion: shelf.open(&format!("{trajectory}/trajectory"))?,
            scene,
            trajectory,
            sensor,
            seed,
            backend,
        })
    }
}

/// The only recipe of a file or folder.
fn single_recipe(path: &Path) -> Result<Recipe, VerbError> {
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
fn trajectory_name(recipe: &Recipe, wanted: Option<&str>) -> Result<String, VerbError> {
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
fn single_voltmeter(recipe: &Recipe, trajectory: &str) -> Result<VoltmeterModel, VerbError> {
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

/// A scene with the products of a trajectory, and its settings.
pub(super) struct StudySubject {
    pub(super) scene: String,
    trajectory: String,
    pub(super) sensor: VoltmeterModel,
    pub(super) seed: Seed,
    pub(super) backend: Backend,
    pub(super) style: RenderStyle,
    pub(super) camera: Camera,
    pub(super) gaussians: Arc<Gaussians>,
    pub(super) motion: TrajectoryProduct,
}

impl StudySubject {
    /// Scene and trajectory.
    pub(super) fn name(&self) -> String {
        format!("{}/{}", self.scene, self.trajectory)
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
        let outputs = found.and_then(|(_, assessed)| assessed.outputs.as_ref());
        let outputs = outputs.ok_or_else(|| not_built(self.scene, name))?;
        A::open(&ArtifactFiles::from_outputs(outputs, self.store))
            .map_err(|e| VerbError::failed("unreadable", format!("failed to {e}")))
    }
}
