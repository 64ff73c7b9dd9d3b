//! Scheduling of steps: ready, stale and running ones.

use super::group::{FinishedStep, StepGroup, run_group};
use super::job::{StaleStep, StepJob, StepResult};
use super::order::{StepRank, step_ranks};
use super::{
    ResourceBudget, RunEvent, RunObserver, RunOptions, RunSummary, StepError, StepFailure, StepOrigin,
};
use crate::artifact::ArtifactFiles;
use crate::plan::Plan;
use crate::plan::assess::{PlanError, StepAction, StepAssessment, StepProduct, StepReason, step_alone};
use crate::plan::past::past_costs;
use crate::stage::{StageError, StepId, StepNeed, checks, scene_checks};
use gs2e_store::{BlobState, Key, Store, StoreError};
use std::collections::{BTreeMap, BTreeSet};
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::thread::{Scope, ScopedJoinHandle};

/// A run in progress.
pub(super) struct RunExecutor<'scope, 'a> {
    plan: &'a Plan,
    store: &'a Store,
    options: RunOptions,
    cancel: &'a AtomicBool,
    observer: &'a dyn RunObserver,
    /// For each step, the number of inputs that are not available yet.
    missing: Vec<usize>,
    /// For each step, the consumers of its product.
    followers: Vec<Vec<StepId>>,
    /// For each key, the number of uses of its outputs that are still to come.
    uses: BTreeMap<Key, usize>,
    /// Steps with all inputs present that are not assessed yet.
    ready: BTreeSet<StepId>,
    ranks: Vec<StepRank>,
    /// Steps that must run, in order of rank.
    stale: BTreeMap<StepRank, StaleStep>,
    pub(super) running: BTreeMap<StepId, RunningStep<'scope>>,
    pub(super) summary: RunSummary,
}

/// A running step.
pub(super) struct RunningStep<'scope> {
    key: Key,
    /// Its resources, and its thread. Of steps that are made together, the last to be reported holds
    /// those of all.
    grant: Option<(StepNeed, ScopedJoinHandle<'scope, ()>)>,
}

impl<'scope, 'a> RunExecutor<'scope, 'a> {
    pub(super) fn new(
        plan: &'a Plan,
        store: &'a Store,
        options: RunOptions,
        cancel: &'a AtomicBool,
        observer: &'a dyn RunObserver,
    ) -> Result<Self, StoreError> {
        let ranks = step_ranks(plan, &past_costs(plan, store)?);
        let inputs: Vec<_> = plan.steps().iter().map(|s| s.step.inputs()).collect();
        let mut followers = vec![Vec::new(); inputs.len()];
        for (step, inputs) in inputs.iter().enumerate() {
            inputs.iter().for_each(|(_, input)| followers[input.0].push(StepId(step)));
        }
        // An input used twice counts twice, here and in `followers`.
        let missing: Vec<usize> = inputs.iter().map(Vec::len).collect();
        let ready = (0..missing.len()).filter(|step| missing[*step] == 0).map(StepId).collect();
        let (stale, running, uses) = (BTreeMap::new(), BTreeMap::new(), BTreeMap::new());
        Ok(Self {
            plan,
            store,
            options,
            cancel,
            observer,
            missing,
            followers,
            uses,
            ready,
            ranks,
            stale,
            running,
            summary: RunSummary::default(),
        })
    }

    fn stopped(&self) -> bool {
        let failed = !self.summary.failures.is_empty() && !self.options.keep_going;
        // Without space for one step, the next one would only take what the running ones still
        // need.
        failed || self.summary.is_full() || self.cancel.load(Ordering::Relaxed)
    }

    fn left(&self) -> ResourceBudget {
        self.options.budget.left(self.running.values().filter_map(|step| Some(&step.grant.as_ref()?.0)))
    }

    /// Settles every ready step that is up to date, and starts others while cores are free.
    pub(super) fn start_ready(
        &mut self,
        scope: &'scope Scope<'scope, '_>,
        sender: &mpsc::Sender<FinishedStep>,
    ) where
        'a: 'scope,
    {
        // All ready steps are assessed before any is started: a kept step makes its consumers
        // ready.
        while !self.stopped()
            && let Some(step) = self.ready.pop_first()
        {
            match self.assess(step) {
                Ok(Some(stale)) => drop(self.stale.insert(self.ranks[step.0], stale)),
                Ok(None) => {}
                Err(error) => self.fail(step, error.into()),
            }
        }
        while !self.stopped()
            && let Some(rank) = self.next_stale()
        {
            let stale = self.stale.remove(&rank).expect("the step was found among the stale");
            match self.is_mended(&stale) {
                Ok(true) => {
                    // The next assessment finds the bytes, and keeps the step.
                    self.ready.insert(rank.1);
                    return self.start_ready(scope, sender);
                }
                Ok(false) => {
                    let group = self.group(rank.1, stale);
                    self.start(group, scope, sender);
                }
                Err(error) => self.fail(rank.1, error.into()),
            }
        }
    }

    /// The next step to start. A step waits while another one with the same key runs, and will find
    /// its record. A step that is too large for the whole budget runs alone.
    fn next_stale(&self) -> Option<StepRank> {
        let left = self.left();
        // If nothing runs, waiting would free nothing.
        let fits = |stale: &StaleStep| left.holds(&stale.need) || self.running.is_empty();
        self.stale
            .iter()
            // A step that does not fit yet is passed over, so no core stays free for it while others could
            // run.
            .find(|(_, stale)| fits(stale) && !self.is_at_work(&stale.key))
            .map(|(rank, _)| *rank)
    }

    /// Returns true if a step with this key is running.
    fn is_at_work(&self, key: &Key) -> bool {
        self.running.values().any(|step| step.key == *key)
    }

    /// A step, and the other stale steps that one pass of the renderer can serve with it.
    fn group(&mut self, step: StepId, stale: StaleStep) -> StepGroup {
        let mut group = StepGroup::new(step, stale);
        let Some(pass) = group.pass(self.plan) else { return group };
        // Only the budget bounds a step that runs alone.
        let left = self.left();
        let ranks: Vec<StepRank> = self.stale.keys().copied().collect();
        for rank in ranks {
            let other = &self.stale[&rank];
            // As for a first step: a twin at work brings a record, and lost bytes may be there again by now.
            let is_free = !self.is_at_work(&other.key) && matches!(self.is_mended(other), Ok(false));
            let need = is_free.then(|| group.need_with(self.plan, &pass, rank.1, other)).flatten();
            if let Some(need) = need.filter(|need| left.holds(need)) {
                let other = self.stale.remove(&rank).expect("its rank was listed");
                group.add(rank.1, other, need);
            }
        }
        group
    }

    /// Returns true if another step has meanwhile made the lost bytes that were the reason to run
    /// this step.
    fn is_mended(&self, stale: &StaleStep) -> Result<bool, StoreError> {
        if !matches!(stale.reason, StepReason::BlobMissing { .. } | StepReason::BlobAltered { .. }) {
            return Ok(false);
        }
        let Some(record) = self.store.record(&stale.key)? else { return Ok(false) };
        for output in &record.outputs {
            if self.store.examine(output)? != BlobState::Sound {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Assesses a ready step. Returns `None` if it is up to date; the step is then recorded as
    /// kept.
    fn assess(&mut self, step: StepId) -> Result<Option<StaleStep>, PlanError> {
        let planned = &self.plan.steps()[step.0];
        let outputs_of = |id| Some(self.summary.products[&id].outputs.clone());
        let StepAssessment { action, reason, key, description, sources, outputs } =
            step_alone(self.plan, self.store, planned, &outputs_of)?;
        let key = key.expect("a step has a key once its inputs and its programs are known");
        let may_run = self.options.allow_commands || planned.step.facts().programs().is_empty();
        let chosen = || may_run && self.options.recheck.chooses(&key);
        let recheck = outputs.clone().filter(|_| chosen());
        if action != StepAction::Keep || recheck.is_some() {
            let files = self.open_inputs(step);
            let need = planned.step.facts().need(&files);
            return Ok(Some(StaleStep { key, description, sources, reason, recheck, files, need }));
        }
        // The step may have been made before this store had a shared one.
        self.store.share(&key).map_err(PlanError::from)?;
        let outputs = outputs.expect("a step that is kept has outputs");
        // Before `done`, which lets the files go at once if no later step uses them.
        self.store.hold(&key, &outputs);
        self.summary.kept += 1;
        self.observer.observe(&RunEvent::Kept { step, key: &key, outputs: &outputs });
        self.done(step, StepProduct { key, outputs, sources });
        Ok(None)
    }

    fn done(&mut self, step: StepId, product: StepProduct) {
        let planned = &self.plan.steps()[step.0];
        let key = product.key;
        self.store.note_last(self.plan.scene_of(planned), &planned.name, key);
        self.summary.products.insert(step, product);
        // The findings of checks are shown at the end of the build, which is one use more.
        let is_shown = [checks::NAME, scene_checks::NAME].contains(&planned.step.stage());
        // Added and not set, because several steps of a plan may have this key.
        *self.uses.entry(key).or_default() += self.followers[step.0].len() + usize::from(is_shown);
        let mut used = vec![key];
        for (_, input) in planned.step.inputs() {
            let key = self.summary.products[&input].key;
            self.uses.entry(key).and_modify(|uses| *uses -= 1);
            used.push(key);
        }
        used.iter().filter(|key| self.uses[key] == 0).for_each(|key| self.store.let_go(key));
        for follower in &self.followers[step.0] {
            self.missing[follower.0] -= 1;
            if self.missing[follower.0] == 0 {
                self.ready.insert(*follower);
            }
        }
    }

    fn start(
        &mut self,
        group: StepGroup,
        scope: &'scope Scope<'scope, '_>,
        sender: &mpsc::Sender<FinishedStep>,
    ) where
        'a: 'scope,
    {
        let StepGroup { members, need } = group;
        let whole = self.options.budget;
        // Every step has a thread for each core, and the system shares the cores between the threads that
        // have work: none is idle while there is some. A share that a step keeps for life would be.
        let (count, threads) = (members.len(), whole.cores);
        let cores = (threads * count).div_ceil(self.running.len() + count);
        for (step, stale) in &members {
            let (step, together) = (*step, count);
            self.observer.observe(&RunEvent::Started { step, reason: &stale.reason, cores, together });
            if need.memory > whole.memory {
                let (memory, budget) = (need.memory, whole.memory);
                self.observer.observe(&RunEvent::TooLarge { step, memory, budget });
            }
            self.running.insert(step, RunningStep { key: stale.key, grant: None });
        }
        let allows_commands = self.options.allow_commands;
        let (programs, kept_frames) = (self.options.programs.clone(), self.options.kept_frames);
        let job = StepJob {
            plan: self.plan,
            store: self.store,
            cancel: self.cancel,
            observer: self.observer,
            threads,
            memory: need.memory,
            allows_commands,
            programs,
            kept_frames,
            recheck: self.options.recheck,
        };
        // Results come in the order of the members, so the last one frees the resources of all.
        let (sender, last) = (sender.clone(), members[count - 1].0);
        let thread = scope.spawn(move || run_group(&job, members, &sender));
        let grant = Some((need, thread));
        self.running.get_mut(&last).expect("it was added above").grant = grant;
    }

    fn open_inputs(&self, step: StepId) -> Vec<ArtifactFiles> {
        let inputs = self.plan.steps()[step.0].step.inputs();
        inputs
            .iter()
            .map(|(_, id)| ArtifactFiles::from_outputs(&self.summary.products[id].outputs, self.store))
            .collect()
    }

    pub(super) fn finish(&mut self, finished: FinishedStep) {
        let FinishedStep { step, key, sources, is_recheck, result } = finished;
        if let Some((_, thread)) = self.running.remove(&step).and_then(|step| step.grant) {
            thread.join().expect("the last message of the thread is the outcome of its step");
        }
        // Steps with the same key are assessed again: they find the new record, or run if this step
        // failed.
        let twins: Vec<StepRank> =
            self.stale.iter().filter(|(_, s)| s.key == key).map(|(rank, _)| *rank).collect();
        for twin in twins {
            self.stale.remove(&twin);
            self.ready.insert(twin.1);
        }
        match result.unwrap_or_else(|panic| resume_unwind(panic)) {
            Ok(made) => {
                let StepResult { outputs, warnings, .. } = made;
                self.count(made.origin, is_recheck);
                self.observer.observe(&RunEvent::Made {
                    step,
                    key: &key,
                    outputs: &outputs,
                    seconds: made.seconds,
                    threads: made.threads,
                    core_seconds: made.core_seconds,
                    warnings: &warnings,
                    remark: made.remark.as_deref(),
                    saving: made.saving,
                    memory: made.memory,
                    origin: made.origin,
                });
                self.done(step, StepProduct { key, outputs, sources });
            }
            Err(StepError::Stage(StageError::Cancelled)) => self.summary.interrupted = true,
            Err(error) => self.fail(step, error),
        }
    }

    fn count(&mut self, origin: StepOrigin, is_recheck: bool) {
        if matches!(origin, StepOrigin::Elsewhere | StepOrigin::Confirmed) {
            self.summary.adopted += 1;
            self.summary.confirmed += usize::from(origin == StepOrigin::Confirmed);
        } else if is_recheck {
            self.summary.kept += 1;
            self.summary.rechecked += 1;
        } else {
            self.summary.made += 1;
            self.summary.twice += usize::from(origin == StepOrigin::Twice);
        }
    }

    fn fail(&mut self, step: StepId, error: StepError) {
        let failure = StepFailure { step, error };
        self.observer.observe(&RunEvent::Failed { failure: &failure });
        self.summary.failures.push(failure);
    }

    pub(super) fn close(mut self) -> RunSummary {
        self.summary.interrupted |= self.cancel.load(Ordering::Relaxed);
        // A cancelled step is in neither list, and counts as not reached.
        let ended = self.summary.products.len() + self.summary.failures.len();
        self.summary.unreached = self.plan.steps().len() - ended;
        self.summary
    }
}
