//! Resources used by earlier steps: the basis of all estimates of time, disk and memory.

use super::{Plan, PlannedStep};
use crate::stage::blur::BlurStage;
use crate::stage::events::EventsStage;
use crate::stage::geometry::{DepthQuantity, FlowQuantity, PixelQuantity as _};
use crate::stage::pass::SharedPass;
use crate::stage::sharp::SharpStage;
use crate::stage::trajectory::TrajectoryStage;
use crate::stage::{Stage as _, StepId};
use gs2e_recipe::Recipe;
use gs2e_store::record::RecordSummary;
use gs2e_store::{Store, StoreError};
use std::collections::BTreeMap;

/// Resources used by a step, or expected from earlier steps of its stage.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PastCosts {
    /// Processor time, s. Of a step that was made together with others, its share.
    pub core_seconds: f64,
    /// The same for the step alone.
    pub alone_core_seconds: f64,
    /// Bytes of its outputs.
    pub bytes: f64,
    /// Number of its pictures.
    pub pictures: f64,
    /// Granted memory, bytes.
    pub memory: f64,
}

impl PastCosts {
    fn from_record(record: &RecordSummary) -> Self {
        let bytes: u64 = record.outputs.iter().map(|o| o.size).sum();
        let is_picture = |name: &str| name.ends_with(".png") || name.ends_with(".npy");
        let pictures = record.outputs.iter().filter(|o| is_picture(&o.name)).count();
        Self {
            core_seconds: record.core_seconds(),
            alone_core_seconds: record.alone_core_seconds(),
            bytes: bytes as f64,
            pictures: pictures as f64,
            memory: record.memory as f64,
        }
    }
}

/// For each step of a plan, the resources used by the same step of the same scene when it was last
/// made. Otherwise the mean of its stage over all records, with the maximum for memory. `None` if
/// its stage was never run.
///
/// # Errors
/// A record cannot be read.
pub fn past_costs(plan: &Plan, store: &Store) -> Result<Vec<Option<PastCosts>>, StoreError> {
    let own = |step: &PlannedStep| {
        let key = store.last_key(plan.scene_of(step), &step.name);
        let record = key.map(|key| store.record(&key)).transpose()?.flatten();
        Ok(record.map(|record| PastCosts::from_record(&record)))
    };
    let own: Vec<Option<PastCosts>> = plan.steps().iter().map(own).collect::<Result<_, StoreError>>()?;
    if own.iter().all(Option::is_some) {
        return Ok(own);
    }
    // Means take all records of the store, so they are read only if they are needed.
    let means = stage_means(store);
    let of_stage = |stage: &str| means.get(stage).copied();
    let or_mean =
        |(own, step): (Option<PastCosts>, &PlannedStep)| own.or_else(|| of_stage(step.step.stage()));
    Ok(own.into_iter().zip(plan.steps()).map(or_mean).collect())
}

/// For each step of a plan, whether a run of the steps for which `runs` is true would make it together
/// with others, in one pass of the renderer.
#[must_use]
pub fn sharing_steps(plan: &Plan, runs: &[bool]) -> Vec<bool> {
    let mut passes: BTreeMap<Vec<StepId>, Vec<(usize, SharedPass)>> = BTreeMap::new();
    for (at, planned) in plan.steps().iter().enumerate().filter(|(at, _)| runs[*at]) {
        if let Some(pass) = SharedPass::of(&*planned.step) {
            // Steps of one pass have the same inputs, so only few are compared.
            let inputs = planned.step.inputs().into_iter().map(|(_, input)| input).collect();
            passes.entry(inputs).or_default().push((at, pass));
        }
    }
    let mut shares = vec![false; runs.len()];
    for steps in passes.values() {
        for (at, pass) in steps {
            shares[*at] = steps.iter().any(|(other, others)| other != at && others == pass);
        }
    }
    shares
}

/// The numerical class in which a scene was last rendered; `None` if it was not rendered, or
/// nothing is known.
///
/// # Errors
/// A record cannot be read.
pub(crate) fn last_class(recipe: &Recipe, store: &Store) -> Result<Option<String>, StoreError> {
    // Steps that would take longest to make again come first.
    let steps = [
        EventsStage::NAME,
        BlurStage::NAME,
        SharpStage::NAME,
        DepthQuantity::NAME,
        FlowQuantity::NAME,
        TrajectoryStage::NAME,
    ];
    for step in steps {
        for trajectory in &recipe.trajectories {
            let key = store.last_key(&recipe.scene, &format!("{}/{step}", trajectory.name));
            let record = key.map(|key| store.full_record(&key)).transpose()?.flatten();
            let lines = record.map(|record| record.description).unwrap_or_default();
            if let Some(line) = lines.into_iter().find(|line| line.path == "class") {
                return Ok(Some(line.text));
            }
        }
    }
    Ok(None)
}

/// Means over all records of each stage; for memory, the maximum.
fn stage_means(store: &Store) -> BTreeMap<String, PastCosts> {
    let mut sums: BTreeMap<String, (f64, PastCosts)> = BTreeMap::new();
    for record in store.records() {
        let past = PastCosts::from_record(&record);
        let (count, sum) = sums.entry(record.stage).or_default();
        *count += 1.0;
        sum.core_seconds += past.core_seconds;
        sum.alone_core_seconds += past.alone_core_seconds;
        sum.bytes += past.bytes;
        sum.pictures += past.pictures;
        // Memory is a peak: the mean would be too low for many steps of the stage.
        sum.memory = sum.memory.max(past.memory);
    }
    let mean = |(stage, (count, sum)): (String, (f64, PastCosts))| {
        let PastCosts { core_seconds, alone_core_seconds, bytes, pictures, memory } = sum;
        let [core_seconds, alone_core_seconds, bytes, pictures] =
            [core_seconds, alone_core_seconds, bytes, pictures].map(|sum| sum / count);
        (stage, PastCosts { core_seconds, alone_core_seconds, bytes, pictures, memory })
    };
    sums.into_iter().map(mean).collect()
}
