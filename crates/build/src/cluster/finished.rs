//! The finished steps of each scene: those with a record in the shared store.

use crate::plan::Plan;
use crate::plan::assess::{PlanError, StepAction, step_alone};
use crate::plan::past::{PastCosts, past_costs};
use crate::stage::StepId;
use gs2e_store::Store;
use gs2e_store::record::{RecordSummary, StoredOutput};
use std::collections::BTreeMap;

/// The number of steps of a scene, and of those that are finished.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SceneProgress {
    /// All steps.
    pub steps: usize,
    /// Steps with a record in the shared store.
    pub finished: usize,
}

impl SceneProgress {
    /// Returns true if no step is missing.
    #[must_use]
    pub(crate) fn is_done(self) -> bool {
        self.finished == self.steps
    }
}

/// The progress of all scenes, and what the missing steps are expected to need.
#[derive(Debug, Clone, Default)]
pub struct PlanProgress {
    /// For each scene, in the order of the plan.
    pub scenes: Vec<SceneProgress>,
    /// Core-seconds of the missing steps whose stage ran before, s.
    pub core_seconds: f64,
    /// Largest memory of a step like the missing ones, bytes. `None` if no such step ran before.
    pub memory: Option<f64>,
}

/// The progress of each scene of a plan, in its order. `store` has the shared store. With `offer`, steps that
/// only the own store has are offered to the shared one first; `store` must then be open for building.
///
/// # Errors
/// A source is absent or unreadable, or a store fails.
pub fn scene_progress(plan: &Plan, store: &Store, offer: bool) -> Result<PlanProgress, PlanError> {
    let mut scenes = vec![SceneProgress::default(); plan.scenes().len()];
    let mut costs = StageCosts::default();
    let mut done: Vec<Option<Vec<StoredOutput>>> = Vec::with_capacity(plan.steps().len());
    for step in plan.steps() {
        // Without a key nothing can be looked up, so such a step counts as missing, and so do all that follow
        // it.
        let is_ready = step.step.facts().unasked().is_none()
            && step.step.inputs().iter().all(|(_, id)| done[id.0].is_some());
        let mut outputs = None;
        if is_ready {
            let assessed = step_alone(plan, store, step, &|id: StepId| done[id.0].clone())?;
            if let Some(key) = assessed.key {
                if offer && assessed.action == StepAction::Keep {
                    store.share(&key)?;
                }
                let record = store.shared_record(&key)?;
                record.iter().for_each(|record| costs.add(record));
                // Those of the shared store: tasks take their inputs from there, so the keys of later steps
                // follow from them.
                outputs = record.map(|record| record.outputs);
            }
        }
        let scene = &mut scenes[step.scene];
        scene.steps += 1;
        scene.finished += usize::from(outputs.is_some());
        done.push(outputs);
    }
    let mut progress = PlanProgress { scenes, ..PlanProgress::default() };
    let missing = past_costs(plan, store)?.into_iter().zip(plan.steps()).zip(&done);
    for ((past, step), _) in missing.filter(|(_, outputs)| outputs.is_none()) {
        if let Some(past) = past.or_else(|| costs.mean(step.step.stage())) {
            progress.core_seconds += past.core_seconds;
            progress.memory = Some(progress.memory.unwrap_or(0.0).max(past.memory));
        }
    }
    Ok(progress)
}

/// Resources of the finished steps, by stage.
#[derive(Debug, Default)]
struct StageCosts(BTreeMap<String, (f64, PastCosts)>);

impl StageCosts {
    fn add(&mut self, record: &RecordSummary) {
        let (count, sum) = self.0.entry(record.stage.clone()).or_default();
        *count += 1.0;
        sum.core_seconds += record.core_seconds();
        sum.memory = sum.memory.max(record.memory as f64);
    }

    /// The mean, and for memory the maximum.
    fn mean(&self, stage: &str) -> Option<PastCosts> {
        let (count, sum) = self.0.get(stage)?;
        Some(PastCosts { core_seconds: sum.core_seconds / count, ..*sum })
    }
}
