//! The engine within this process, over any file operations.

use crate::place::{Place, Products};
use gs2e_build::plan::assess::{StepAction, assess_plan};
use gs2e_build::plan::survey::{PlanSurvey, survey_recipes};
use gs2e_build::run::{
    RecheckPolicy, ResourceBudget, RunEvent, RunObserver, RunOptions, run_plan, settle_run,
};
use gs2e_build::stage::StepId;
use gs2e_files::programs::ProgramFinder;
use gs2e_render::backend::Backend;
use gs2e_store::fs::Fs;
use gs2e_store::record::StoredOutput;
use gs2e_store::{Digest, Store, StoreAccess, StoreOptions};
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

struct Silent;

impl RunObserver for Silent {
    fn observe(&self, _: &RunEvent<'_>) {}
}

/// Steps by `scene/step`, with their outputs.
pub(crate) type Outputs = Vec<(String, Vec<StoredOutput>)>;

/// Outcome of a build within this process.
#[derive(Debug)]
pub(crate) enum BuildOutcome {
    /// The build reports that everything is there.
    Done {
        outputs: Outputs,
        /// Number of steps made; `settled` is the number of scenes known at a glance.
        made: usize,
        settled: usize,
    },
    /// The error message: the program would exit with 1.
    Failed(String),
    Panicked,
}

/// Settings of a build.
#[derive(Debug, Clone)]
pub(crate) struct Engine {
    pub(crate) recipes: Vec<PathBuf>,
    pub(crate) fs: Arc<dyn Fs>,
    pub(crate) verify: bool,
    /// The shared store, if there is one.
    pub(crate) shared: Option<PathBuf>,
}

impl Engine {
    /// An engine over all recipes of a place.
    pub(crate) fn new(place: &Place, fs: Arc<dyn Fs>) -> Self {
        Self { recipes: vec![place.path("recipes")], fs, verify: false, shared: None }
    }

    fn store(&self, place: &Place, access: StoreAccess) -> Result<Store, String> {
        let Self { fs, verify, shared, .. } = self.clone();
        let opening = StoreOptions { verify, fs, shared, ..access.into() };
        Store::open(&place.store(), opening, &mut |_| {}).map_err(|e| e.to_string())
    }

    fn survey(&self, store: &Store) -> Result<(PlanSurvey, Outputs), String> {
        let survey = survey_recipes(&self.recipes, &Backend::Cpu, store, &tag())
            .map_err(|faults| format!("{faults:?}"))?;
        let steps = survey.settled.iter().flat_map(|scene| {
            scene.steps.iter().map(|step| (format!("{}/{}", scene.scene, step.name), step.outputs.clone()))
        });
        let settled = steps.collect();
        Ok((survey, settled))
    }

    /// Builds on one core, as `gs2e build -j 1` does.
    pub(crate) fn build(&self, place: &Place) -> BuildOutcome {
        match catch_unwind(AssertUnwindSafe(|| self.build_unguarded(place))) {
            Err(_) => BuildOutcome::Panicked,
            Ok(built) => built.unwrap_or_else(BuildOutcome::Failed),
        }
    }

    fn build_unguarded(&self, place: &Place) -> Result<BuildOutcome, String> {
        let store = self.store(place, StoreAccess::Write)?;
        let (PlanSurvey { settled, plan, .. }, mut outputs) = self.survey(&store)?;
        let settled = settled.len();
        if plan.steps().is_empty() {
            return Ok(BuildOutcome::Done { outputs, made: 0, settled });
        }
        // As in the command, missing or unreadable inputs are reported before any step runs.
        assess_plan(&plan, &store).map_err(|e| e.to_string())?;
        let budget = ResourceBudget { cores: 1, memory: u64::MAX, gpus: 0 };
        let options = RunOptions {
            budget,
            keep_going: false,
            recheck: RecheckPolicy::default(),
            allow_commands: false,
            kept_frames: None,
            programs: ProgramFinder::default(),
        };
        let summary =
            run_plan(&plan, &store, options, &AtomicBool::new(false), &Silent).map_err(|e| e.to_string())?;
        settle_run(&plan, &summary, &store, &tag()).map_err(|e| e.to_string())?;
        if let Some(failure) = summary.failures.first() {
            return Err(failure.error.to_string());
        }
        for (step, id) in plan.steps().iter().zip((0..).map(StepId)) {
            let product =
                summary.products.get(&id).ok_or_else(|| format!("{} was not reached", step.name))?;
            outputs.push((format!("{}/{}", plan.scene_of(step), step.name), product.outputs.clone()));
        }
        Ok(BuildOutcome::Done { outputs, made: summary.made, settled })
    }

    /// The products that a read-only look at the store reports as up to date. Each product is read.
    pub(crate) fn look(&self, place: &Place) -> Result<Products, String> {
        let store = self.store(place, StoreAccess::Read)?;
        let (PlanSurvey { plan, .. }, mut outputs) = self.survey(&store)?;
        let assessed = assess_plan(&plan, &store).map_err(|e| e.to_string())?;
        for (step, a) in plan.steps().iter().zip(assessed).filter(|(_, a)| a.action == StepAction::Keep) {
            outputs.push((format!("{}/{}", plan.scene_of(step), step.name), a.outputs.unwrap_or_default()));
        }
        products(place, &outputs)
    }
}

/// A name for this program, as the command names itself.
fn tag() -> Digest {
    Digest::of_bytes(b"the fault tests")
}

impl BuildOutcome {
    /// Reads the products of a build that must have ended well.
    pub(crate) fn products(&self, place: &Place) -> Result<Products, String> {
        match self {
            Self::Done { outputs, .. } => products(place, outputs),
            other => Err(format!("{other:?}")),
        }
    }
}

/// Reads the products that are there. Each must have the bytes that its record states.
fn products(place: &Place, steps: &[(String, Vec<StoredOutput>)]) -> Result<Products, String> {
    let mut products = Products::new();
    for (name, outputs) in steps {
        for output in outputs {
            let digest = output.digest.to_string();
            let path = place.store().join("cas").join(&digest[..2]).join(&digest);
            let bytes = fs::read(&path).map_err(|e| format!("{name}/{} is on record: {e}", output.name))?;
            if Digest::of_bytes(&bytes) != output.digest {
                return Err(format!("{name}/{} is on record with other bytes", output.name));
            }
            products.insert(format!("{name}/{}", output.name), output.digest);
        }
    }
    Ok(products)
}
