//! Steps that run together on one thread: one step, or several that one pass of the renderer serves.

use super::StepError;
use super::job::{StaleStep, StepJob, StepResult};
use crate::plan::Plan;
use crate::plan::assess::SourceFiles;
use crate::stage::pass::{SharedPass, shared_need};
use crate::stage::{AnyStep, StepId, StepNeed};
use gs2e_store::Key;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc;
use std::thread;

/// Memory of a pass, as a multiple of that of its largest step, up to which more steps join it: the
/// memory of a build stays near that of its largest step.
const MEMORY_FACTOR: f64 = 1.2;

/// Stale steps that run together.
pub(super) struct StepGroup {
    /// The steps. There is at least one.
    pub(super) members: Vec<(StepId, StaleStep)>,
    /// Resources for all of them.
    pub(super) need: StepNeed,
}

/// A finished step.
pub(super) struct FinishedStep {
    pub(super) step: StepId,
    pub(super) key: Key,
    pub(super) sources: SourceFiles,
    /// True if it was up to date.
    pub(super) is_recheck: bool,
    /// `Err` if the step panicked.
    pub(super) result: thread::Result<Result<StepResult, StepError>>,
}

impl StepGroup {
    /// A step alone.
    pub(super) fn new(step: StepId, stale: StaleStep) -> Self {
        let need = stale.need;
        Self { members: vec![(step, stale)], need }
    }

    /// The pass that others can share with the step. A step that is compared with its record is made
    /// alone: the comparison then also covers the sharing.
    pub(super) fn pass(&self, plan: &Plan) -> Option<SharedPass> {
        let [(step, stale)] = self.members.as_slice() else { return None };
        stale.recheck.is_none().then(|| SharedPass::of(step_of(plan, *step))).flatten()
    }

    /// The resources with another step. `None` if the step cannot join: it takes another pass, has the
    /// kind or the key of a member, or would take too much memory.
    pub(super) fn need_with(
        &self,
        plan: &Plan,
        pass: &SharedPass,
        step: StepId,
        stale: &StaleStep,
    ) -> Option<StepNeed> {
        let own = step_of(plan, step);
        if stale.recheck.is_some() || SharedPass::of(own).as_ref() != Some(pass) {
            return None;
        }
        let is_alike = |(id, member): &(StepId, StaleStep)| {
            step_of(plan, *id).stage() == own.stage() || member.key == stale.key
        };
        if self.members.iter().any(is_alike) {
            return None;
        }
        let steps: Vec<&dyn AnyStep> =
            self.members.iter().map(|(id, _)| step_of(plan, *id)).chain([own]).collect();
        let need = shared_need(&steps, &stale.files);
        let needs = self.members.iter().map(|(_, member)| member.need.memory);
        let largest = needs.fold(stale.need.memory, u64::max);
        (need.memory as f64 <= MEMORY_FACTOR * largest as f64).then_some(need)
    }

    /// Adds a step. `need` are the resources with it.
    pub(super) fn add(&mut self, step: StepId, stale: StaleStep, need: StepNeed) {
        self.members.push((step, stale));
        self.need = need;
    }
}

fn step_of(plan: &Plan, step: StepId) -> &dyn AnyStep {
    &*plan.steps()[step.0].step
}

/// Runs a group, and sends the result of each member.
pub(super) fn run_group(
    job: &StepJob<'_>,
    members: Vec<(StepId, StaleStep)>,
    sender: &mpsc::Sender<FinishedStep>,
) {
    // A panic is passed to the waiting thread, which would otherwise wait forever.
    let results = catch_unwind(AssertUnwindSafe(|| match members.as_slice() {
        [(step, stale)] => vec![job.run(*step, stale)],
        members => job.run_together(members),
    }));
    let send = |(step, stale): (StepId, StaleStep), result| {
        let StaleStep { key, sources, recheck, .. } = stale;
        // The receiver outlives the scope, so sending cannot fail.
        let _ = sender.send(FinishedStep { step, key, sources, is_recheck: recheck.is_some(), result });
    };
    match results {
        Ok(results) => members.into_iter().zip(results).for_each(|(member, result)| send(member, Ok(result))),
        Err(panic) => {
            // The run ends with the first message.
            let first = members.into_iter().next().expect("a group has a member");
            send(first, Err(panic));
        }
    }
}
