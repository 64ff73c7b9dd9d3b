//! Survey: scenes that are up to date, found quickly, and a plan for the others.
//!
//! A scene is *settled* if its recipe, sources and products have the stat fields of its last build;
//! its recipe is then not even parsed. The other scenes are read, planned and compared with the
//! store as usual. A memo that is lost or outdated costs time only.

use super::assess::StepProduct;
use super::{Plan, RendererPolicy};
use crate::artifact::{Artifact as _, ArtifactFiles, VerdictsRecord};
use crate::stage::StepId;
use gs2e_recipe as recipe;
use gs2e_recipe::{Recipe, RecipeFaults, RecipeFile, TakedownEffect};
use gs2e_store::record::StoredOutput;
use gs2e_store::{Digest, Key, MemoGround, Store, StoreError};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// The state of some recipes before anything is run.
#[derive(Debug)]
pub struct PlanSurvey {
    /// Scenes that are up to date, sorted by id.
    pub settled: Vec<CurrentScene>,
    /// The steps of the other scenes.
    pub plan: Plan,
    /// The effect of the lists of scenes that are taken down.
    pub taken_down: TakedownEffect,
}

/// A scene that is up to date.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct CurrentScene {
    /// Its id.
    pub scene: String,
    /// Kind of its upstream, and its name there.
    source: (String, Option<String>),
    /// Names of its trajectories.
    trajectories: Vec<String>,
    /// Its steps, in the order of the plan.
    pub steps: Vec<CurrentStep>,
}

/// A step that is up to date.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct CurrentStep {
    /// Name within the scene.
    pub name: String,
    /// Its key.
    pub key: Key,
    /// Its outputs.
    pub outputs: Vec<StoredOutput>,
    /// See [`VerdictsRecord::sound_counts`]; `None` also for a step without findings. It saves reading them.
    pub sound: Option<[usize; 2]>,
}

/// The reason why recipes cannot be surveyed.
#[derive(Debug, thiserror::Error)]
pub enum SurveyError {
    /// They have faults.
    #[error("the recipes have faults")]
    Faults(Box<RecipeFaults>),
    /// The store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
}

impl From<RecipeFaults> for SurveyError {
    fn from(faults: RecipeFaults) -> Self {
        Self::Faults(Box::new(faults))
    }
}

impl PlanSurvey {
    /// A plan without settled scenes.
    #[must_use]
    pub fn of_plan(plan: Plan) -> Self {
        Self { settled: Vec::new(), plan, taken_down: TakedownEffect::default() }
    }

    /// Leaves out all scenes but these.
    pub fn keep_scenes(&mut self, ids: &BTreeSet<&str>, renderers: &dyn RendererPolicy) {
        self.settled.retain(|scene| ids.contains(scene.scene.as_str()));
        let scenes = std::mem::take(&mut self.plan).into_scenes();
        let kept = scenes.into_iter().filter(|recipe| ids.contains(recipe.scene.as_str()));
        self.plan = Plan::new(kept.collect(), renderers);
    }
}

/// Surveys the recipes in files and folders. `tag` identifies the program and those of its options
/// that may change a key: memos with another tag do not count.
///
/// # Errors
/// Every fault of the recipes, as [`recipe::read_all`], and of takedown lists; or the store cannot
/// be read.
pub fn survey_recipes(
    paths: &[PathBuf],
    renderers: &dyn RendererPolicy,
    store: &Store,
    tag: &Digest,
) -> Result<PlanSurvey, SurveyError> {
    // The slow path below finds the same faults, and reports them in full.
    let Ok(files) = recipe::find_all(paths) else { return plan_all(paths, renderers) };
    let names: Vec<String> = files.iter().map(RecipeFile::name).collect();
    let recalled: Vec<Option<CurrentScene>> = store.recall(&names, tag)?;
    let moved: Vec<RecipeFile> = files
        .iter()
        .zip(&recalled)
        .filter(|(_, settled)| settled.is_none())
        .map(|(f, _)| f.clone())
        .collect();
    let mut settled: Vec<CurrentScene> = recalled.into_iter().flatten().collect();
    // A fault of one recipe may be caused by another one, so all of them are read.
    let Ok(recipes) = recipe::read_files(&moved) else { return plan_all(paths, renderers) };
    // Settled recipes are not parsed, so a clash with one of them is only suspected here. Reading
    // all recipes decides.
    if may_clash(&settled, &recipes) {
        return plan_all(paths, renderers);
    }
    settled.sort_by(|a, b| a.scene.cmp(&b.scene));
    let takedown = recipe::takedown_of(paths, &files)?;
    let origin = |s: &CurrentScene| (s.scene.clone(), s.source.clone());
    let of_recipe = |recipe: &Recipe| {
        let (kind, upstream) = recipe.source.origin();
        (recipe.scene.clone(), (kind.to_owned(), upstream.map(str::to_owned)))
    };
    let origins: Vec<_> = settled.iter().map(origin).chain(recipes.iter().map(of_recipe)).collect();
    let origins = origins.iter().map(|(scene, (kind, id))| (scene.as_str(), kind.as_str(), id.as_deref()));
    // Before scenes are removed: entries that removed them would look unmatched.
    let unmatched = takedown.unmatched(origins);
    let all = settled.len();
    let (recipes, TakedownEffect { scenes: unread, .. }) = takedown.keep(recipes);
    settled.retain(|s| takedown.since(&s.scene, &s.source.0, s.source.1.as_deref()).is_none());
    let taken_down = TakedownEffect { scenes: unread + all - settled.len(), unmatched };
    Ok(PlanSurvey { settled, plan: Plan::new(recipes, renderers), taken_down })
}

/// Reads and plans every scene, without memos.
///
/// # Errors
/// Every fault of the recipes, as [`recipe::read_all`].
pub fn plan_all(paths: &[PathBuf], renderers: &dyn RendererPolicy) -> Result<PlanSurvey, SurveyError> {
    let recipes = recipe::read_all(paths)?;
    let (recipes, taken_down) = recipe::read_takedown(paths)?.keep(recipes);
    Ok(PlanSurvey { settled: Vec::new(), plan: Plan::new(recipes, renderers), taken_down })
}

/// Returns true if two scenes could claim one folder: the same id twice, or an id inside a
/// trajectory of another scene.
fn may_clash(settled: &[CurrentScene], recipes: &[Recipe]) -> bool {
    let known =
        settled.iter().map(|s| (s.scene.as_str(), s.trajectories.iter().map(String::as_str).collect()));
    let read =
        recipes.iter().map(|r| (r.scene.as_str(), r.trajectories.iter().map(|t| t.name.as_str()).collect()));
    let scenes: Vec<(&str, Vec<&str>)> = known.chain(read).collect();
    // Lower case, because some file systems do not distinguish case.
    let ids: BTreeSet<String> = scenes.iter().map(|(id, _)| id.to_lowercase()).collect();
    let claims = |(id, names): &(&str, Vec<&str>)| {
        names.iter().map(|name| format!("{id}/{name}").to_lowercase()).collect::<Vec<_>>()
    };
    let trajectories: BTreeSet<String> = scenes.iter().flat_map(claims).collect();
    let inside = |id: &String| {
        id.match_indices('/').any(|(at, _)| trajectories.contains(&id[..at])) || trajectories.contains(id)
    };
    ids.len() < scenes.len() || ids.iter().any(inside)
}

/// Stores a memo for every scene of a plan that is complete and stable, so that the next survey
/// finds it settled.
pub(crate) fn remember_settled(
    plan: &Plan,
    products: &BTreeMap<StepId, StepProduct>,
    store: &Store,
    tag: &Digest,
) {
    let mut scenes: Vec<Option<SceneState>> =
        plan.scenes().iter().map(|_| Some(SceneState::default())).collect();
    for (step, id) in plan.steps().iter().zip((0..).map(StepId)) {
        let scene = &mut scenes[step.scene];
        match products.get(&id) {
            Some(product) => scene.iter_mut().for_each(|scene| scene.add(&step.name, product, store)),
            // One step without a product, and the scene is not up to date.
            None => *scene = None,
        }
    }
    for (recipe, scene) in plan.scenes().iter().zip(scenes) {
        let Some(scene) = scene else { continue };
        // The versions of installed programs are part of the keys, and only planning finds them.
        if recipe.checks.asks_programs() || recipe.source.runs_programs() {
            continue;
        }
        store.note_recipe(&recipe.scene, &recipe.meta.merged.to_string());
        let SceneState { steps, mut sightings } = scene;
        // An edit of the recipe or of its defaults must unsettle the scene.
        sightings.extend(recipe.meta.sightings.iter().cloned());
        let blobs: BTreeSet<Digest> = steps.iter().flat_map(|s| s.outputs.iter().map(|o| o.digest)).collect();
        let blobs: Vec<Digest> = blobs.into_iter().collect();
        let trajectories = recipe.trajectories.iter().map(|t| t.name.clone()).collect();
        let (kind, upstream_id) = recipe.source.origin();
        let source = (kind.to_owned(), upstream_id.map(str::to_owned));
        let settled = CurrentScene { scene: recipe.scene.clone(), source, trajectories, steps };
        let ground = MemoGround { tag: *tag, files: &sightings, blobs: &blobs };
        store.remember(&recipe.meta.file.name(), ground, settled);
    }
}

/// The state of a scene, step by step.
#[derive(Default)]
struct SceneState {
    steps: Vec<CurrentStep>,
    sightings: Vec<(PathBuf, gs2e_files::stat::StatSighting)>,
}

impl SceneState {
    fn add(&mut self, name: &str, product: &StepProduct, store: &Store) {
        let StepProduct { key, outputs, sources } = product;
        let open = || VerdictsRecord::open(&ArtifactFiles::from_outputs(outputs, store)).ok();
        let verdicts = VerdictsRecord::is_of(name).then(open).flatten();
        let sound = verdicts.and_then(|verdicts| verdicts.sound_counts());
        self.steps.push(CurrentStep { name: name.to_owned(), key: *key, outputs: outputs.clone(), sound });
        self.sightings.extend(sources.sightings.iter().cloned());
    }
}
