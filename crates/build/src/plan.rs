//! Plans: from recipes to steps, and from steps and the store to the work that must run.

pub mod asked;
pub mod assess;
pub mod edits;
pub mod forecast;
pub mod kept;
pub mod lens;
pub mod past;
pub mod shard;
pub mod size;
pub mod survey;
pub mod warnings;
mod wire;

use crate::stage::{AnyStep, Stage, StepId, StepTarget, WiredStage};
use gs2e_recipe::Recipe;
use gs2e_render::OmissionPolicy;
use gs2e_render::backend::Backend;
use gs2e_source::foreign::versions::VersionQuery;

/// Choices that a plan takes from outside: what renders each scene, the work to leave out, and the
/// versions of other programs.
pub trait RendererPolicy {
    /// The back end of a scene.
    fn of(&self, recipe: &Recipe) -> Backend;

    /// Work left out of every scene.
    fn omit(&self) -> OmissionPolicy {
        OmissionPolicy::default()
    }

    /// The version of a program that judges trajectories; `None` if it is not known and must not be
    /// asked.
    fn version(&self, _: VersionQuery) -> Option<String> {
        None
    }
}

/// One back end for all scenes.
impl RendererPolicy for Backend {
    fn of(&self, _: &Recipe) -> Backend {
        self.clone()
    }
}

/// The steps of some scenes, inputs before their consumers.
#[derive(Debug, Default)]
pub struct Plan {
    scenes: Vec<Recipe>,
    steps: Vec<PlannedStep>,
}

/// One step of a plan.
#[derive(Debug)]
pub struct PlannedStep {
    /// Index of its scene.
    pub scene: usize,
    /// Name within the scene, for example `capture` or `base/events`.
    pub name: String,
    /// Its stage with inputs.
    pub step: Box<dyn AnyStep>,
}

impl Plan {
    /// Plans every scene. `recipes` are sorted by scene id, so the order of files does not matter.
    #[must_use]
    pub fn new(recipes: Vec<Recipe>, renderers: &dyn RendererPolicy) -> Self {
        let mut plan = Self::default();
        for (scene, recipe) in recipes.iter().enumerate() {
            wire::wire_scene(recipe, renderers, &mut SceneWiring { plan: &mut plan, scene });
        }
        plan.scenes = recipes;
        plan
    }

    /// A plan of steps without a recipe, all of the first scene.
    #[cfg(test)]
    pub(crate) fn of_steps(scenes: Vec<Recipe>, wire: impl FnOnce(&mut SceneWiring<'_>)) -> Self {
        let mut plan = Self { scenes, steps: Vec::new() };
        wire(&mut SceneWiring { plan: &mut plan, scene: 0 });
        plan
    }

    /// The scenes, in order of their ids.
    #[must_use]
    pub fn scenes(&self) -> &[Recipe] {
        &self.scenes
    }

    /// Returns the scenes.
    #[must_use]
    pub fn into_scenes(self) -> Vec<Recipe> {
        self.scenes
    }

    /// The steps, inputs before their consumers.
    #[must_use]
    pub fn steps(&self) -> &[PlannedStep] {
        &self.steps
    }

    /// Id of the scene of a step.
    #[must_use]
    pub fn scene_of(&self, step: &PlannedStep) -> &str {
        &self.scenes[step.scene].scene
    }

    /// The steps of one scene, with their indices.
    pub fn steps_of(&self, scene: usize) -> impl Iterator<Item = (StepId, &PlannedStep)> {
        let ids = (0..self.steps.len()).map(StepId);
        ids.zip(&self.steps).filter(move |(_, step)| step.scene == scene)
    }
}

/// Adds the steps of one scene.
#[derive(Debug)]
pub struct SceneWiring<'p> {
    plan: &'p mut Plan,
    scene: usize,
}

impl SceneWiring<'_> {
    /// Adds a step, and returns its product as a typed target.
    pub fn add<S>(&mut self, name: String, stage: S, inputs: S::Inputs) -> StepTarget<S::Output>
    where
        S: Stage + std::fmt::Debug + Send + Sync + 'static,
        S::Inputs: std::fmt::Debug + Send + Sync,
    {
        let id = StepId(self.plan.steps.len());
        let step = Box::new(WiredStage { stage, inputs });
        self.plan.steps.push(PlannedStep { scene: self.scene, name, step });
        StepTarget::new(id)
    }
}
