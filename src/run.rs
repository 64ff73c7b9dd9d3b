//! The executor: runs what is stale, in the order of the plan, on as many cores as it is given.
//!
//! A step is assessed when its inputs are known, so an input that was re-made with equal bytes gives its followers
//! the keys they had, and the wave stops. Two steps with one key run once. The clock is read here for durations
//! only; nothing read from it reaches a file of the release.

pub mod estimate;

use crate::artifact::Files;
use crate::plan::assess::{Action, Assessment, PlanError, Reason, Sources, read_sources, step_alone};
use crate::plan::{Plan, PlannedStep};
use crate::stage::{Context, StageError, StepId};
use crate::store::description::Value;
use crate::store::record::{Output, Provenance, Record};
use crate::store::space::{Space, is_full};
use crate::store::{Key, Store, StoreError, Workspace};
use std::collections::{BTreeMap, BTreeSet};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::thread::{self, Scope};
use std::time::Instant;

/// How a plan is run.
#[derive(Debug, Clone, Copy)]
pub struct Options {
    /// Cores for all steps together, at least 1.
    pub cores: usize,
    /// Go on with what does not depend on a failed step.
    pub keep_going: bool,
}

/// What an observer is told, as it happens.
#[derive(Debug)]
pub enum Event<'a> {
    /// A step starts.
    Started {
        /// Which.
        step: StepId,
        /// Why.
        reason: &'a Reason,
        /// The cores that it is given.
        cores: usize,
    },
    /// A step was made.
    Made {
        /// Which.
        step: StepId,
        /// Its key.
        key: &'a Key,
        /// What it made.
        outputs: &'a [Output],
        /// How long it took.
        seconds: f64,
        /// The cores that it was given.
        cores: usize,
        /// What it had to say.
        warnings: &'a [String],
        /// A word on the size of its product.
        remark: Option<&'a str>,
    },
    /// A step is up to date.
    Kept {
        /// Which.
        step: StepId,
        /// Its key.
        key: &'a Key,
        /// What it made when it ran.
        outputs: &'a [Output],
    },
    /// A step failed.
    Failed {
        /// Which.
        failure: &'a Failure,
    },
}

/// Told of the run's events, in the order they happen.
pub trait Observer {
    /// One event.
    fn tell(&self, event: &Event<'_>);
}

/// A step that failed.
#[derive(Debug)]
pub struct Failure {
    /// Which.
    pub step: StepId,
    /// Why.
    pub error: StepError,
}

/// Why a step failed.
#[derive(Debug, thiserror::Error)]
pub enum StepError {
    /// It could not be held against the store.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// Its own work failed.
    #[error("failed to {0}")]
    Stage(#[from] StageError),
    /// The store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A file that it reads changed meanwhile.
    #[error("{0} changed while it was read; nothing was recorded")]
    Moved(String),
    /// There is no room for its files.
    #[error("no space: {cause}")]
    Full {
        /// Bytes that it had written.
        wrote: u64,
        /// The file system, where the system tells of it.
        space: Option<Space>,
        /// What it was told when it went on writing.
        cause: String,
    },
}

/// What a run came to.
#[derive(Debug, Default)]
pub struct Summary {
    /// Steps that were made.
    pub made: usize,
    /// Steps that were up to date.
    pub kept: usize,
    /// Steps that failed.
    pub failures: Vec<Failure>,
    /// Steps that were not reached, because a step before them failed or the run was stopped.
    pub unreached: usize,
    /// Whether it was interrupted.
    pub interrupted: bool,
    /// Key and outputs of each step that was made or kept.
    pub outputs: BTreeMap<StepId, (Key, Vec<Output>)>,
}

impl Summary {
    /// Whether a step found no room for its files.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.failures.iter().any(|failure| matches!(failure.error, StepError::Full { .. }))
    }
}

/// Runs a plan.
///
/// # Errors
/// When the store itself can no longer be written; failures of steps are in the summary.
pub fn run(
    plan: &Plan,
    store: &Store,
    options: Options,
    cancel: &AtomicBool,
    observer: &dyn Observer,
) -> Result<Summary, StoreError> {
    let (sender, receiver) = mpsc::channel();
    let summary = thread::scope(|scope| {
        let mut executor = Executor::new(plan, store, options, cancel, observer);
        loop {
            executor.start_ready(scope, &sender);
            if executor.running.is_empty() {
                break executor.close();
            }
            let finished = receiver.recv().expect("the executor keeps a sender");
            executor.finish(finished);
        }
    });
    match store.flush() {
        // Told already, with the step; the records that are whole count without the database.
        Err(error) if summary.is_full() && error.is_full() => {}
        flushed => flushed?,
    }
    Ok(summary)
}

/// A step that must run.
struct Stale {
    key: Key,
    description: Value,
    /// The files outside the store as the key has them.
    sources: Sources,
    reason: Reason,
}

/// A step that came to its end.
struct Finished {
    step: StepId,
    key: Key,
    /// `Err` where the step panicked.
    result: thread::Result<Result<Made, StepError>>,
}

struct Made {
    outputs: Vec<Output>,
    seconds: f64,
    cores: usize,
    warnings: Vec<String>,
    remark: Option<String>,
}

struct Executor<'a> {
    plan: &'a Plan,
    store: &'a Store,
    options: Options,
    cancel: &'a AtomicBool,
    observer: &'a dyn Observer,
    /// For each step, how many inputs are not there yet.
    missing: Vec<usize>,
    /// For each step, the steps that take its product.
    followers: Vec<Vec<StepId>>,
    /// Steps whose inputs are there, not yet held against the store.
    ready: BTreeSet<StepId>,
    /// Steps that must run and wait for a core.
    stale: BTreeMap<StepId, Stale>,
    /// Running steps, with their key and the cores they hold.
    running: BTreeMap<StepId, (Key, usize)>,
    summary: Summary,
}

impl<'a> Executor<'a> {
    fn new(
        plan: &'a Plan,
        store: &'a Store,
        options: Options,
        cancel: &'a AtomicBool,
        observer: &'a dyn Observer,
    ) -> Self {
        let inputs: Vec<_> = plan.steps().iter().map(|s| s.step.inputs()).collect();
        let mut followers = vec![Vec::new(); inputs.len()];
        for (step, inputs) in inputs.iter().enumerate() {
            inputs.iter().for_each(|(_, input)| followers[input.0].push(StepId(step)));
        }
        let missing: Vec<usize> = inputs.iter().map(Vec::len).collect();
        let ready = (0..missing.len()).filter(|step| missing[*step] == 0).map(StepId).collect();
        Self {
            plan,
            store,
            options,
            cancel,
            observer,
            missing,
            followers,
            ready,
            stale: BTreeMap::new(),
            running: BTreeMap::new(),
            summary: Summary::default(),
        }
    }

    fn stopped(&self) -> bool {
        let failed = !self.summary.failures.is_empty() && !self.options.keep_going;
        // Where there is no room for one step, the next would only fill what the running ones still need.
        failed || self.summary.is_full() || self.cancel.load(Ordering::Relaxed)
    }

    fn free_cores(&self) -> usize {
        let taken: usize = self.running.values().map(|(_, cores)| cores).sum();
        self.options.cores.saturating_sub(taken)
    }

    /// Settles every ready step that is up to date, and starts the others while cores are free.
    fn start_ready<'scope>(&mut self, scope: &'scope Scope<'scope, '_>, sender: &mpsc::Sender<Finished>)
    where
        'a: 'scope,
    {
        while !self.stopped()
            && let Some(step) = self.ready.pop_first()
        {
            match self.assess(step) {
                Ok(Some(stale)) => drop(self.stale.insert(step, stale)),
                Ok(None) => {}
                Err(error) => self.fail(step, error.into()),
            }
        }
        while !self.stopped()
            && self.free_cores() > 0
            && let Some(step) = self.next_stale()
        {
            self.start(step, scope, sender);
        }
    }

    /// The next step to start. One whose key is at work already will find its record, and waits for it.
    fn next_stale(&self) -> Option<StepId> {
        let at_work = |key: &Key| self.running.values().any(|(running, _)| running == key);
        self.stale.iter().find(|(_, stale)| !at_work(&stale.key)).map(|(step, _)| *step)
    }

    /// Holds a ready step against the store: `None` where it is up to date, and noted so.
    fn assess(&mut self, step: StepId) -> Result<Option<Stale>, PlanError> {
        let planned = &self.plan.steps()[step.0];
        let outputs_of = |id| Some(self.summary.outputs[&id].1.clone());
        let Assessment { action, reason, key, description, sources, outputs } =
            step_alone(self.plan, self.store, planned, &outputs_of)?;
        let key = key.expect("a step alone has a key");
        if action != Action::Keep {
            return Ok(Some(Stale { key, description, sources, reason }));
        }
        let outputs = outputs.expect("a step that is kept has outputs");
        self.summary.kept += 1;
        self.observer.tell(&Event::Kept { step, key: &key, outputs: &outputs });
        self.done(step, key, outputs);
        Ok(None)
    }

    fn done(&mut self, step: StepId, key: Key, outputs: Vec<Output>) {
        let planned = &self.plan.steps()[step.0];
        self.store.note_last(self.plan.scene_of(planned), &planned.name, key);
        self.summary.outputs.insert(step, (key, outputs));
        for follower in &self.followers[step.0] {
            self.missing[follower.0] -= 1;
            if self.missing[follower.0] == 0 {
                self.ready.insert(*follower);
            }
        }
    }

    fn start<'scope>(
        &mut self,
        step: StepId,
        scope: &'scope Scope<'scope, '_>,
        sender: &mpsc::Sender<Finished>,
    ) where
        'a: 'scope,
    {
        let cores = self.free_cores().div_ceil(self.stale.len());
        let stale = self.stale.remove(&step).expect("the step was found among the stale");
        self.running.insert(step, (stale.key, cores));
        self.observer.tell(&Event::Started { step, reason: &stale.reason, cores });
        let files = self.open_inputs(step);
        let job = Job { plan: self.plan, store: self.store, cancel: self.cancel, cores };
        let sender = sender.clone();
        scope.spawn(move || {
            // A panic is carried to the thread that waits: it would wait for ever for a step that is gone.
            let result = catch_unwind(AssertUnwindSafe(|| job.run(step, &stale, &files)));
            // The receiver outlives the scope; if it were gone there would be nobody to tell.
            let _ = sender.send(Finished { step, key: stale.key, result });
        });
    }

    fn open_inputs(&self, step: StepId) -> Vec<Files> {
        let inputs = self.plan.steps()[step.0].step.inputs();
        inputs.iter().map(|(_, id)| Files::of(&self.summary.outputs[id].1, self.store)).collect()
    }

    fn finish(&mut self, finished: Finished) {
        let Finished { step, key, result } = finished;
        self.running.remove(&step);
        let twins: Vec<StepId> = self.stale.iter().filter(|(_, s)| s.key == key).map(|(id, _)| *id).collect();
        for twin in twins {
            self.stale.remove(&twin);
            self.ready.insert(twin);
        }
        match result.unwrap_or_else(|panic| resume_unwind(panic)) {
            Ok(Made { outputs, seconds, cores, warnings, remark }) => {
                self.summary.made += 1;
                self.observer.tell(&Event::Made {
                    step,
                    key: &key,
                    outputs: &outputs,
                    seconds,
                    cores,
                    warnings: &warnings,
                    remark: remark.as_deref(),
                });
                self.done(step, key, outputs);
            }
            Err(StepError::Stage(StageError::Cancelled)) => self.summary.interrupted = true,
            Err(error) => self.fail(step, error),
        }
    }

    fn fail(&mut self, step: StepId, error: StepError) {
        let failure = Failure { step, error };
        self.observer.tell(&Event::Failed { failure: &failure });
        self.summary.failures.push(failure);
    }

    fn close(mut self) -> Summary {
        self.summary.interrupted |= self.cancel.load(Ordering::Relaxed);
        let ended = self.summary.outputs.len() + self.summary.failures.len();
        self.summary.unreached = self.plan.steps().len() - ended;
        self.summary
    }
}

/// One step's work, on its own thread.
struct Job<'a> {
    plan: &'a Plan,
    store: &'a Store,
    cancel: &'a AtomicBool,
    cores: usize,
}

impl Job<'_> {
    fn run(&self, step: StepId, stale: &Stale, files: &[Files]) -> Result<Made, StepError> {
        if let Reason::BlobAltered { digest } = &stale.reason {
            self.store.discard(&digest.parse().expect("a reason holds a digest's text"))?;
        }
        let workspace = self.store.workspace().map_err(|e| self.with_space(e.into(), 0))?;
        self.make(step, stale, files, &workspace).map_err(|e| self.with_space(e, workspace.bytes()))
    }

    fn make(
        &self,
        step: StepId,
        stale: &Stale,
        files: &[Files],
        workspace: &Workspace<'_>,
    ) -> Result<Made, StepError> {
        let planned = &self.plan.steps()[step.0];
        let started = Instant::now();
        let mut cx = Context::new(workspace.path(), self.cancel);
        let worked = self.pool()?.install(|| planned.step.run(files, &mut cx));
        let seconds = started.elapsed().as_secs_f64();
        // Half of a file that somebody is writing is like a broken one: that it moves is the better word for it.
        if !matches!(worked, Err(StageError::Cancelled)) {
            self.refuse_moved(planned, &stale.sources)?;
        }
        worked?;
        let Context { warnings, remark, .. } = cx;
        let provenance = Provenance {
            tool: env!("CARGO_PKG_VERSION").to_owned(),
            seconds,
            threads: self.cores,
            warnings: warnings.clone(),
        };
        let record = Record::new(stale.key, planned.step.stage(), stale.description.lines(), provenance);
        let outputs = self.store.publish(workspace, record)?;
        Ok(Made { outputs, seconds, cores: self.cores, warnings, remark })
    }

    /// The error, or that there is no room where that is behind it: by its causes, else by what is left, because not
    /// every library passes on why it could not write.
    fn with_space(&self, error: StepError, wrote: u64) -> StepError {
        let may_have_written = match &error {
            StepError::Stage(StageError::Work { .. } | StageError::Io { .. }) => true,
            StepError::Store(error) => !matches!(error, StoreError::Nondeterministic { .. }),
            _ => false,
        };
        let space = self.store.space().ok();
        let is_used_up = may_have_written && space.as_ref().is_some_and(Space::is_used_up);
        if !is_used_up && !is_full(&error) {
            return error;
        }
        StepError::Full { wrote, space, cause: error.to_string() }
    }

    /// The bytes that were read must be those that the key holds: the step may have waited long for its start.
    fn refuse_moved(&self, planned: &PlannedStep, then: &Sources) -> Result<(), StepError> {
        let now = read_sources(self.plan, self.store, planned)?;
        now.moved_since(then).map_or(Ok(()), |path| Err(StepError::Moved(path)))
    }

    fn pool(&self) -> Result<rayon::ThreadPool, StageError> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.cores).build();
        pool.map_err(StageError::work("start threads"))
    }
}

#[cfg(test)]
mod tests;
