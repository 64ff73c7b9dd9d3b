//! Execution of plans: runs stale steps on the given cores, the longest chain of later work first.
//!
//! A step is assessed when its inputs are known, so an input that was made again with equal bytes
//! gives its consumers the same keys, and the wave of work stops. Two steps with one key run once.
//! The clock is read here for durations only; no reading reaches a file of the release.

pub mod backends;
pub mod estimate;
mod executor;
mod group;
mod job;
mod kept;
mod order;
mod recheck;
mod resources;

pub use job::monotonic_seconds;
pub use recheck::RecheckPolicy;
pub use resources::ResourceBudget;

use crate::plan::assess::{PlanError, StepProduct, StepReason};
use crate::plan::{Plan, survey};
use crate::stage::{StageError, StepId};
use executor::RunExecutor;
use gs2e_files::programs::ProgramFinder;
use gs2e_render::{GpuError, RenderError};
use gs2e_sampling::rendered::TimeSaved;
use gs2e_store::record::StoredOutput;
use gs2e_store::space::DiskSpace;
use gs2e_store::{Digest, Key, Store, StoreError};
use std::collections::BTreeMap;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

/// Options of a run.
#[derive(Debug, Clone)]
pub struct RunOptions {
    /// Resources for all steps together.
    pub budget: ResourceBudget,
    /// True if the run continues with steps that do not depend on a failed one.
    pub keep_going: bool,
    /// Choice of steps that are made again, to compare them with the record.
    pub recheck: RecheckPolicy,
    /// True if programs named by recipes may run. Otherwise a step that needs one fails, and one
    /// that is up to date is not made again.
    pub allow_commands: bool,
    /// The programs that can be run.
    pub programs: ProgramFinder,
    /// Bytes that the frames of all steps may take, if they are kept for later builds.
    pub kept_frames: Option<u64>,
}

/// An event for an observer.
#[derive(Debug)]
pub enum RunEvent<'a> {
    /// A step starts.
    Started {
        /// Index of the step.
        step: StepId,
        /// Reason.
        reason: &'a StepReason,
        /// Number of cores, if all running steps have equal shares of them.
        cores: usize,
        /// Number of steps that these cores make together, with this one.
        together: usize,
    },
    /// A step needs more memory than the total, and runs alone.
    TooLarge {
        /// Index of the step.
        step: StepId,
        /// Its estimate, bytes.
        memory: u64,
        /// The total, bytes.
        budget: u64,
    },
    /// A running step reports its state.
    Advanced {
        /// Index of the step.
        step: StepId,
        /// The state, in words for people.
        words: &'a str,
    },
    /// A step was made.
    Made {
        /// Index of the step.
        step: StepId,
        /// Its key.
        key: &'a Key,
        /// Its outputs.
        outputs: &'a [StoredOutput],
        /// Duration.
        seconds: f64,
        /// Number of threads.
        threads: usize,
        /// Processor time, s.
        core_seconds: f64,
        /// Warnings of the step.
        warnings: &'a [String],
        /// A short remark on the size of its product.
        remark: Option<&'a str>,
        /// Time saved by leaving work out, if it was measured.
        saving: Option<TimeSaved>,
        /// Memory granted, bytes; 0 for outputs that were copied.
        memory: u64,
        /// The machine that made the outputs.
        origin: StepOrigin,
    },
    /// A step is up to date.
    Kept {
        /// Index of the step.
        step: StepId,
        /// Its key.
        key: &'a Key,
        /// Its outputs.
        outputs: &'a [StoredOutput],
    },
    /// A step failed.
    Failed {
        /// The step and the cause.
        failure: &'a StepFailure,
    },
}

/// The machine that made the outputs of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StepOrigin {
    /// This one.
    Here,
    /// This one, and at the same time another one, which was first in the shared store.
    Twice,
    /// Another one: they were copied from the shared store.
    Elsewhere,
    /// Another one. They were made again here, with the same bytes.
    Confirmed,
}

/// Receives the events of a run: those of one step in order, from the thread of the run or of the
/// step.
pub trait RunObserver: Sync {
    /// Takes one event.
    fn observe(&self, event: &RunEvent<'_>);
}

/// A step that failed.
#[derive(Debug)]
pub struct StepFailure {
    /// Index of the step.
    pub step: StepId,
    /// Cause.
    pub error: StepError,
}

/// Reason why a step failed.
#[derive(Debug, thiserror::Error)]
pub enum StepError {
    /// It could not be assessed.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// Its work failed.
    #[error("failed to {0}")]
    Stage(#[from] StageError),
    /// The store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A file that it reads has changed during the run.
    #[error("{0} changed while it was read; nothing was recorded")]
    Moved(String),
    /// There is no space for its files.
    #[error("no space: {cause}")]
    Full {
        /// Bytes that it had written.
        wrote: u64,
        /// The file system, if it is known.
        space: Option<DiskSpace>,
        /// The error of the failed write.
        cause: String,
    },
}

/// The result of a run.
#[derive(Debug, Default)]
pub struct RunSummary {
    /// Number of steps made.
    pub made: usize,
    /// Number of these that another machine made at the same time.
    pub twice: usize,
    /// Number of steps whose outputs the shared store had.
    pub adopted: usize,
    /// Number of these that were made again, with the same result.
    pub confirmed: usize,
    /// Number of steps up to date.
    pub kept: usize,
    /// Number of steps up to date that were made again with the same result.
    pub rechecked: usize,
    /// Steps that failed.
    pub failures: Vec<StepFailure>,
    /// Number of steps not reached, because an earlier step failed or the run was stopped.
    pub unreached: usize,
    /// True if it was interrupted.
    pub interrupted: bool,
    /// The state of each step that was made or kept.
    pub products: BTreeMap<StepId, StepProduct>,
}

impl StepFailure {
    /// The GPU error that caused this failure, if any.
    #[must_use]
    pub fn of_gpu(&self) -> Option<&GpuError> {
        let StepError::Stage(error) = &self.error else { return None };
        let mut cause: Option<&(dyn std::error::Error + 'static)> = Some(error);
        while let Some(error) = cause {
            if let Some(RenderError::Gpu(because)) = error.downcast_ref() {
                return Some(because);
            }
            // The stage that rendered may have wrapped the error.
            cause = error.source();
        }
        None
    }
}

impl RunSummary {
    /// Adds a later run that started where this one ended.
    #[must_use]
    pub fn then(self, second: Self) -> Self {
        Self {
            made: self.made + second.made,
            twice: self.twice + second.twice,
            adopted: self.adopted + second.adopted,
            confirmed: self.confirmed + second.confirmed,
            // The steps that the first run made are up to date in the second.
            kept: second.kept.saturating_sub(self.made + self.adopted),
            rechecked: self.rechecked + second.rechecked,
            // The second run judged every step again, so the rest of its summary is complete.
            ..second
        }
    }

    /// Returns true if a step ran out of disk space.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.failures.iter().any(|failure| matches!(failure.error, StepError::Full { .. }))
    }
}

/// Longest time before finished steps are synced and indexed, if there are few.
const BATCH: Duration = Duration::from_secs(2);

/// Stores memos for the result of a run, so that the next one finds it quickly, and syncs
/// everything.
///
/// # Errors
/// The store can no longer be written.
pub fn settle_run(plan: &Plan, summary: &RunSummary, store: &Store, tag: &Digest) -> Result<(), StoreError> {
    survey::remember_settled(plan, &summary.products, store, tag);
    store.flush()
}

/// Runs a plan. Products are synced, and found quickly, after [`settle_run`].
///
/// # Errors
/// The store itself can no longer be written. Failures of steps are in the summary.
pub fn run_plan(
    plan: &Plan,
    store: &Store,
    options: RunOptions,
    cancel: &AtomicBool,
    observer: &dyn RunObserver,
) -> Result<RunSummary, StoreError> {
    // If this process is killed, the next one waits for the end of its programs before it empties
    // their folders.
    let programs = match store.share_lock()? {
        Some(lock) => options.programs.holding(lock),
        None => options.programs,
    };
    let options = RunOptions { programs, ..options };
    let (sender, receiver) = mpsc::channel();
    thread::scope(|scope| {
        let mut executor = RunExecutor::new(plan, store, options, cancel, observer)?;
        let mut flushed = Instant::now();
        loop {
            executor.start_ready(scope, &sender);
            if executor.running.is_empty() {
                break Ok(executor.close());
            }
            let finished = receiver.recv().expect("the executor keeps a sender");
            executor.finish(finished);
            // In groups, because a sync takes longer than a short step.
            if store.is_due() || flushed.elapsed() >= BATCH {
                match store.flush() {
                    // The failure was reported with the step. Running steps are allowed to finish.
                    Err(error) if executor.summary.is_full() && error.is_full() => {}
                    flushed => flushed?,
                }
                flushed = Instant::now();
            }
        }
    })
}

#[cfg(test)]
mod tests;
