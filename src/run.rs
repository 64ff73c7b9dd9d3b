//! The executor: runs what is stale, in the order of the plan, on as many cores as it is given.
//!
//! A step is assessed when its inputs are known, so an input that was re-made with equal bytes gives its followers
//! the keys they had, and the wave stops. Two steps with one key run once. The clock is read here for durations
//! only; nothing read from it reaches a file of the release.

pub mod estimate;
mod order;
mod resources;

pub use resources::Budget;

use crate::artifact::Files;
use crate::plan::assess::{
    Action, Assessment, PlanError, Product, Reason, Sources, read_sources, step_alone,
};
use crate::plan::past::past;
use crate::plan::{Plan, PlannedStep, survey};
use crate::stage::{Context, Need, StageError, StepId};
use crate::store::description::Value;
use crate::store::record::{Output, Provenance, Record};
use crate::store::space::{Space, is_full};
use crate::store::{BlobState, Digest, Key, Store, StoreError, Workspace};
use order::Rank;
use resources::Grant;
use std::collections::{BTreeMap, BTreeSet};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::thread::{self, Scope};
use std::time::{Duration, Instant};

/// How a plan is run.
#[derive(Debug, Clone, Copy)]
pub struct Options {
    /// What all steps together may use.
    pub budget: Budget,
    /// Go on with what does not depend on a failed step.
    pub keep_going: bool,
    /// Make again what is up to date, to hold it against what is on record.
    pub recheck: Option<Recheck>,
}

/// Which of the steps that are up to date are made again.
#[derive(Debug, Clone, Copy)]
pub struct Recheck {
    /// This share of them, 0 to 1.
    pub share: f64,
    /// Another seed chooses others.
    pub seed: u64,
}

impl Recheck {
    /// Whether this step is among them.
    fn chooses(&self, key: &Key) -> bool {
        let bytes = [&key.0.as_bytes()[..], &self.seed.to_le_bytes()].concat();
        let drawn = Digest::of(&bytes).as_bytes().first_chunk().map_or(0, |b| u64::from_le_bytes(*b));
        // 2^64: a share of 1 is above every draw.
        (drawn as f64) < self.share * 18_446_744_073_709_551_616.0
    }
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
    /// A step needs more memory than all may use, and runs alone.
    TooLarge {
        /// Which.
        step: StepId,
        /// What it needs, by its estimate, bytes.
        memory: u64,
        /// What there is, bytes.
        budget: u64,
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
    /// How many of those were made again, and came out the same.
    pub rechecked: usize,
    /// Steps that failed.
    pub failures: Vec<Failure>,
    /// Steps that were not reached, because a step before them failed or the run was stopped.
    pub unreached: usize,
    /// Whether it was interrupted.
    pub interrupted: bool,
    /// What each step that was made or kept stands at.
    pub products: BTreeMap<StepId, Product>,
}

impl Summary {
    /// Whether a step found no room for its files.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.failures.iter().any(|failure| matches!(failure.error, StepError::Full { .. }))
    }
}

/// The most steps that are made, and the longest time, before what was made is synced and indexed.
const BATCH: (usize, Duration) = (256, Duration::from_secs(2));

/// Remembers what a run came to, so that the next one finds it at a glance, and has all of it on disk.
///
/// # Errors
/// When the store can no longer be written.
pub fn settle(plan: &Plan, summary: &Summary, store: &Store, tag: &Digest) -> Result<(), StoreError> {
    survey::remember(plan, &summary.products, store, tag);
    store.flush()
}

/// Runs a plan. What is made is on disk, and found at a glance, after [`settle`].
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
    let ranks = order::ranks(plan, &past(plan, store)?);
    thread::scope(|scope| {
        let mut executor = Executor::new(plan, store, options, cancel, observer, ranks);
        let (mut made, mut flushed) = (0, Instant::now());
        loop {
            executor.start_ready(scope, &sender);
            if executor.running.is_empty() {
                break Ok(executor.close());
            }
            let finished = receiver.recv().expect("the executor keeps a sender");
            executor.finish(finished);
            made += 1;
            if made >= BATCH.0 || flushed.elapsed() >= BATCH.1 {
                store.flush()?;
                (made, flushed) = (0, Instant::now());
            }
        }
    })
}

/// A step that must run.
struct Stale {
    key: Key,
    description: Value,
    /// The files outside the store as the key has them.
    sources: Sources,
    reason: Reason,
    /// Whether it is up to date, and only held against itself.
    recheck: Option<Vec<Output>>,
    files: Vec<Files>,
    need: Need,
}

/// A step that came to its end.
struct Finished {
    step: StepId,
    key: Key,
    sources: Sources,
    /// Whether it was up to date.
    is_recheck: bool,
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
    ranks: Vec<Rank>,
    /// Steps that must run and wait for their turn, in that order.
    stale: BTreeMap<Rank, Stale>,
    /// Running steps, with their key and what they hold.
    running: BTreeMap<StepId, (Key, Grant)>,
    summary: Summary,
}

impl<'a> Executor<'a> {
    fn new(
        plan: &'a Plan,
        store: &'a Store,
        options: Options,
        cancel: &'a AtomicBool,
        observer: &'a dyn Observer,
        ranks: Vec<Rank>,
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
            ranks,
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

    fn left(&self) -> Budget {
        self.options.budget.left(self.running.values().map(|(_, grant)| grant))
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
                    self.ready.insert(rank.1);
                    return self.start_ready(scope, sender);
                }
                Ok(false) => self.start(rank.1, stale, scope, sender),
                Err(error) => self.fail(rank.1, error.into()),
            }
        }
    }

    /// The next step to start. One whose key is at work already will find its record, and waits for it. One that is
    /// too large for the whole budget runs alone.
    fn next_stale(&self) -> Option<Rank> {
        let left = self.left();
        let at_work = |key: &Key| self.running.values().any(|(running, _)| running == key);
        let fits = |stale: &Stale| left.holds(&stale.need) || self.running.is_empty();
        self.stale.iter().find(|(_, stale)| fits(stale) && !at_work(&stale.key)).map(|(rank, _)| *rank)
    }

    /// Whether another step has meanwhile made the lost bytes for which this one was to run.
    fn is_mended(&self, stale: &Stale) -> Result<bool, StoreError> {
        if !matches!(stale.reason, Reason::BlobMissing { .. } | Reason::BlobAltered { .. }) {
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

    /// Holds a ready step against the store: `None` where it is up to date, and noted so.
    fn assess(&mut self, step: StepId) -> Result<Option<Stale>, PlanError> {
        let planned = &self.plan.steps()[step.0];
        let outputs_of = |id| Some(self.summary.products[&id].outputs.clone());
        let Assessment { action, reason, key, description, sources, outputs } =
            step_alone(self.plan, self.store, planned, &outputs_of)?;
        let key = key.expect("a step alone has a key");
        let recheck = outputs.clone().filter(|_| self.options.recheck.is_some_and(|r| r.chooses(&key)));
        if action != Action::Keep || recheck.is_some() {
            let files = self.open_inputs(step);
            let need = planned.step.need(&files);
            return Ok(Some(Stale { key, description, sources, reason, recheck, files, need }));
        }
        let outputs = outputs.expect("a step that is kept has outputs");
        self.summary.kept += 1;
        self.observer.tell(&Event::Kept { step, key: &key, outputs: &outputs });
        self.done(step, Product { key, outputs, sources });
        Ok(None)
    }

    fn done(&mut self, step: StepId, product: Product) {
        let planned = &self.plan.steps()[step.0];
        self.store.note_last(self.plan.scene_of(planned), &planned.name, product.key);
        self.summary.products.insert(step, product);
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
        stale: Stale,
        scope: &'scope Scope<'scope, '_>,
        sender: &mpsc::Sender<Finished>,
    ) where
        'a: 'scope,
    {
        let Need { memory, .. } = stale.need;
        let whole = self.options.budget;
        let cores = self.left().cores.div_ceil(self.stale.len() + 1).max(1);
        self.running.insert(step, (stale.key, Grant { cores, need: stale.need }));
        self.observer.tell(&Event::Started { step, reason: &stale.reason, cores });
        if memory > whole.memory {
            self.observer.tell(&Event::TooLarge { step, memory, budget: whole.memory });
        }
        let job = Job { plan: self.plan, store: self.store, cancel: self.cancel, cores };
        let sender = sender.clone();
        scope.spawn(move || {
            // A panic is carried to the thread that waits: it would wait for ever for a step that is gone.
            let result = catch_unwind(AssertUnwindSafe(|| job.run(step, &stale)));
            // The receiver outlives the scope; if it were gone there would be nobody to tell.
            let Stale { key, sources, recheck, .. } = stale;
            let _ = sender.send(Finished { step, key, sources, is_recheck: recheck.is_some(), result });
        });
    }

    fn open_inputs(&self, step: StepId) -> Vec<Files> {
        let inputs = self.plan.steps()[step.0].step.inputs();
        inputs.iter().map(|(_, id)| Files::of(&self.summary.products[id].outputs, self.store)).collect()
    }

    fn finish(&mut self, finished: Finished) {
        let Finished { step, key, sources, is_recheck, result } = finished;
        self.running.remove(&step);
        let twins: Vec<Rank> =
            self.stale.iter().filter(|(_, s)| s.key == key).map(|(rank, _)| *rank).collect();
        for twin in twins {
            self.stale.remove(&twin);
            self.ready.insert(twin.1);
        }
        match result.unwrap_or_else(|panic| resume_unwind(panic)) {
            Ok(Made { outputs, seconds, cores, warnings, remark }) => {
                if is_recheck {
                    self.summary.kept += 1;
                    self.summary.rechecked += 1;
                } else {
                    self.summary.made += 1;
                }
                self.observer.tell(&Event::Made {
                    step,
                    key: &key,
                    outputs: &outputs,
                    seconds,
                    cores,
                    warnings: &warnings,
                    remark: remark.as_deref(),
                });
                self.done(step, Product { key, outputs, sources });
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
        let ended = self.summary.products.len() + self.summary.failures.len();
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
    fn run(&self, step: StepId, stale: &Stale) -> Result<Made, StepError> {
        if let Reason::BlobAltered { digest } = &stale.reason {
            self.store.discard(&digest.parse().expect("a reason holds a digest's text"))?;
        }
        let workspace = self.store.workspace().map_err(|e| self.with_space(e.into(), 0))?;
        self.make(step, stale, &workspace).map_err(|e| self.with_space(e, workspace.bytes()))
    }

    fn make(&self, step: StepId, stale: &Stale, workspace: &Workspace<'_>) -> Result<Made, StepError> {
        let planned = &self.plan.steps()[step.0];
        let started = Instant::now();
        let mut cx = Context::new(workspace.path(), self.cancel);
        let worked = self.pool()?.install(|| planned.step.run(&stale.files, &mut cx));
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
            memory: stale.need.memory,
            warnings: warnings.clone(),
        };
        let record = Record::new(stale.key, planned.step.stage(), stale.description.lines(), provenance);
        let outputs = match &stale.recheck {
            None => self.store.publish(workspace, record)?,
            Some(outputs) => self.store.compare(workspace, record).map(|()| outputs.clone())?,
        };
        Ok(Made { outputs, seconds, cores: self.cores, warnings, remark })
    }

    /// The error, or that there is no room where that is behind it: by its causes, else by what is left, because not
    /// every library passes on why it could not write.
    fn with_space(&self, error: StepError, wrote: u64) -> StepError {
        let may_have_written = match &error {
            StepError::Stage(StageError::Work { .. } | StageError::Io { .. }) => true,
            StepError::Store(error) => !matches!(error, StoreError::Nondeterministic(_)),
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
        now.moved_since(then).map_or(Ok(()), |name| Err(StepError::Moved(name)))
    }

    fn pool(&self) -> Result<rayon::ThreadPool, StageError> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.cores).build();
        pool.map_err(StageError::work("start threads"))
    }
}

#[cfg(test)]
mod tests;
