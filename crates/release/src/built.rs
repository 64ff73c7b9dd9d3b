//! Products of a build, gathered from the store for a release.

use super::left_out::{self, OmissionRow};
use super::{products, published};
use gs2e_build::artifact::{
    Artifact, ArtifactError, ArtifactFiles, BlurredFrames, EventStream, EventStreams, SimulationRecord,
    TRAINING_FILE, TrajectoryProduct, VerdictsRecord,
};
use gs2e_build::plan::Plan;
use gs2e_build::plan::assess::{StepProduct, describe_step};
use gs2e_build::run::RunSummary;
use gs2e_check::Finding;
use gs2e_recipe::{Recipe, SourceTerms};
use gs2e_scene::camera::{Camera, CameraChoice};
use gs2e_scene::{Gaussians, SceneScreening, camera};
use gs2e_source::Capture;
use gs2e_source::licence::ComposedTerms;
use gs2e_store::description::DescribedValue;
use gs2e_store::record::StoredOutput;
use gs2e_store::{Key, Store};
use gs2e_train::TrainingRecord;
use gs2e_train::fidelity::PhotoFidelity;
use std::path::PathBuf;

/// A scene whose steps are all made.
#[derive(Debug)]
pub struct BuiltScene<'a> {
    /// Its recipe.
    pub recipe: &'a Recipe,
    pub(super) capture: Capture,
    /// Present if something is rendered.
    pub gaussians: Option<SceneSummary>,
    /// Its terms.
    pub licence: ComposedTerms,
    /// Present if it has photos.
    pub photographed: Option<PhotoFindings>,
    /// In the order of the recipe.
    pub trajectories: Vec<BuiltTrajectory>,
    pub(super) steps: Vec<BuiltStep>,
}

/// Findings on a scene from its photos and its capture.
#[derive(Debug)]
pub struct PhotoFindings {
    /// Present if there is a scene to compare the photos with.
    pub(super) fidelity: Option<PhotoFidelity>,
    /// Findings of the checks of the scene.
    pub findings: Vec<Finding>,
}

/// Summary of the Gaussians.
#[derive(Debug)]
pub struct SceneSummary {
    /// Their file in the store.
    pub path: PathBuf,
    pub(super) count: u64,
    pub(super) sh_degree: u8,
    pub(super) antialiased: Option<bool>,
    pub(super) screening: SceneScreening,
    /// Present if the program trained it.
    pub(super) training: Option<TrainingRecord>,
}

/// A trajectory whose steps are all made.
#[derive(Debug)]
pub struct BuiltTrajectory {
    /// Its name in the recipe.
    pub name: String,
    /// Poses and speeds.
    pub motion: TrajectoryProduct,
    pub(super) events: Option<EventStreams>,
    pub(super) blur: Option<BlurredFrames>,
    pub(super) left_out: Vec<OmissionRow>,
    /// Findings of its checks.
    pub findings: Vec<Finding>,
    pub(super) peaks_ev_per_ms: Vec<u64>,
}

impl BuiltTrajectory {
    pub(super) fn simulation(&self) -> Option<&SimulationRecord> {
        self.events.as_ref().map(|streams| &streams.simulation)
    }

    /// Its event streams.
    pub(super) fn streams(&self) -> &[EventStream] {
        self.simulation().map_or(&[], |simulation| &simulation.streams)
    }
}

/// The record of a step, for the manifest.
#[derive(Debug)]
pub(super) struct BuiltStep {
    pub(super) name: String,
    pub(super) stage: &'static str,
    pub(super) key: Key,
    pub(super) description: DescribedValue,
    pub(super) outputs: Vec<StoredOutput>,
}

/// Reason why something built cannot be gathered.
#[derive(Debug, thiserror::Error)]
pub enum GatherError {
    /// A step of the scene was not made.
    #[error("{scene}/{step} is not built")]
    NotBuilt {
        /// Scene id.
        scene: String,
        /// Step name.
        step: String,
    },
    /// A product cannot be opened.
    #[error("{scene}/{step}: failed to {because}")]
    Unreadable {
        /// Scene id.
        scene: String,
        /// Step name.
        step: String,
        /// Reason.
        because: String,
    },
}

/// Finds the products of one scene's steps.
struct BuiltProducts<'a> {
    scene: &'a str,
    store: &'a Store,
    steps: Vec<BuiltStep>,
}

impl BuiltProducts<'_> {
    fn find(&self, name: &str) -> Option<&[StoredOutput]> {
        self.steps.iter().find(|s| s.name == name).map(|s| s.outputs.as_slice())
    }

    fn open<A: Artifact>(&self, name: &str) -> Result<A, GatherError> {
        let outputs = self
            .find(name)
            .ok_or_else(|| GatherError::NotBuilt { scene: self.scene.to_owned(), step: name.to_owned() })?;
        A::open(&ArtifactFiles::from_outputs(outputs, self.store)).map_err(|e| self.unreadable(name, &e))
    }

    /// Work that the steps of a trajectory left out.
    fn left_out(&self, trajectory: &str) -> Result<Vec<OmissionRow>, GatherError> {
        let own =
            // Not by a prefix: `base/left` is a trajectory too.
            |step: &&BuiltStep| step.name.rsplit_once('/').is_some_and(|(of, _)| of == trajectory);
        let mut rows = Vec::new();
        for step in self.steps.iter().filter(own) {
            let class = match &step.description {
                DescribedValue::Record(fields) => fields.get("class").map(ToString::to_string),
                _ => None,
            };
            let files = ArtifactFiles::from_outputs(&step.outputs, self.store);
            let left_out = left_out::of_step(step.stage, class.as_deref(), &files);
            rows.extend(left_out.map_err(|e| self.unreadable(&step.name, &e))?);
        }
        Ok(rows)
    }

    /// The summary of the scene, with what its step left next to it.
    fn summarize(&self, gaussians: &Gaussians) -> Result<SceneSummary, GatherError> {
        const STEP: &str = "reconstruct";
        let files = ArtifactFiles::from_outputs(self.find(STEP).unwrap_or_default(), self.store);
        let unreadable = |e: ArtifactError| self.unreadable(STEP, &e);
        let is_trained = files.iter().any(|(name, _)| name == TRAINING_FILE);
        let training = is_trained.then(|| files.json(TRAINING_FILE)).transpose();
        Ok(SceneSummary {
            path: files.path("scene.ply").map_err(unreadable)?.to_owned(),
            count: gaussians.len() as u64,
            sh_degree: gaussians.sh_degree,
            antialiased: gaussians.antialiased,
            screening: gaussians.screening,
            training: training.map_err(unreadable)?,
        })
    }

    fn unreadable(&self, step: &str, error: &ArtifactError) -> GatherError {
        GatherError::Unreadable {
            scene: self.scene.to_owned(),
            step: step.to_owned(),
            because: error.to_string(),
        }
    }

    fn open_optional<A: Artifact>(&self, name: &str) -> Result<Option<A>, GatherError> {
        if self.find(name).is_some() { self.open(name).map(Some) } else { Ok(None) }
    }
}

/// Gathers one scene.
pub fn gather_scene<'a>(
    plan: &'a Plan,
    index: usize,
    summary: &RunSummary,
    store: &Store,
    terms: &SourceTerms,
) -> Result<BuiltScene<'a>, GatherError> {
    let recipe = &plan.scenes()[index];
    let not_built = |step: &str| GatherError::NotBuilt { scene: recipe.scene.clone(), step: step.to_owned() };
    let mut steps = Vec::new();
    let outputs_of = |id| summary.products.get(&id).map(|product| product.outputs.clone());
    for (id, planned) in plan.steps_of(index) {
        let StepProduct { key, outputs, sources } =
            summary.products.get(&id).ok_or_else(|| not_built(&planned.name))?;
        let description = describe_step(planned, sources, &outputs_of);
        let (name, stage, outputs) = (planned.name.clone(), planned.step.stage(), outputs.clone());
        steps.push(BuiltStep { name, stage, key: *key, description, outputs });
    }
    let shelf = BuiltProducts { scene: &recipe.scene, store, steps };
    let capture = shelf.open("capture")?;
    // Only the summary stays in memory, because a release gathers all of its scenes before it judges them.
    let gaussians = shelf.open_optional("reconstruct")?.map(|gaussians| shelf.summarize(&gaussians));
    let gaussians = gaussians.transpose()?;
    let photographed = photo_findings(&shelf)?;
    let names = recipe.trajectories.iter().map(|t| t.name.as_str());
    let trajectories = names.map(|name| gather_trajectory(&shelf, name)).collect::<Result<_, _>>()?;
    let allowed = terms.get(recipe.source.kind().name()).map(|stated| stated.because.as_str());
    let licence = published::terms(recipe, allowed);
    Ok(BuiltScene { recipe, capture, gaussians, licence, photographed, trajectories, steps: shelf.steps })
}

fn photo_findings(shelf: &BuiltProducts<'_>) -> Result<Option<PhotoFindings>, GatherError> {
    let Some(verdicts) = shelf.open_optional::<VerdictsRecord>("checks")? else { return Ok(None) };
    let fidelity = shelf.open_optional("fidelity")?;
    Ok(Some(PhotoFindings { fidelity, findings: verdicts.findings_of_scene(shelf.scene) }))
}

fn gather_trajectory(shelf: &BuiltProducts<'_>, name: &str) -> Result<BuiltTrajectory, GatherError> {
    let step = |step: &str| format!("{name}/{step}");
    let verdicts: VerdictsRecord = shelf.open(&step("checks"))?;
    Ok(BuiltTrajectory {
        name: name.to_owned(),
        motion: shelf.open(&step("trajectory"))?,
        events: shelf.open_optional(&step(products::EVENTS.name()))?,
        left_out: shelf.left_out(name)?,
        blur: shelf.open_optional(&step(products::BLUR.name()))?,
        peaks_ev_per_ms: verdicts.peaks_ev_per_ms.clone(),
        findings: verdicts.findings_of(shelf.scene, name),
    })
}

impl BuiltScene<'_> {
    /// The findings of all checks of the scene and of its trajectories.
    pub fn findings(&self) -> impl Iterator<Item = &Finding> {
        let own = self.photographed.iter().flat_map(|photographed| &photographed.findings);
        own.chain(self.trajectories.iter().flat_map(|trajectory| &trajectory.findings))
    }

    /// The outputs of a step of a trajectory; empty if there is no step of that name.
    pub fn outputs(&self, trajectory: &str, step: &str) -> &[StoredOutput] {
        self.scene_outputs(&format!("{trajectory}/{step}"))
    }

    /// The outputs of a step of the scene, by its whole name.
    pub fn scene_outputs(&self, name: &str) -> &[StoredOutput] {
        self.steps.iter().find(|step| step.name == name).map_or(&[], |step| &step.outputs)
    }

    /// The camera that was used for rendering; of a rig, the first one.
    pub(super) fn camera(&self) -> Camera {
        self.chosen(self.recipe.camera)
    }

    /// The camera that sees along a trajectory.
    pub fn camera_along(&self, trajectory: &str) -> Camera {
        self.chosen(self.recipe.camera_along(trajectory))
    }

    fn chosen(&self, choice: Option<CameraChoice>) -> Camera {
        let own = self.capture.camera().map(|(own, _)| own);
        camera::choose_camera(choice, own.as_ref()).expect("recipes without views write a whole camera")
    }
}
