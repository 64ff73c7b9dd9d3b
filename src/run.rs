//! The executor: runs what is stale, in the order of the plan, on as many cores as it is given.
//!
//! A step is assessed when its inputs are known, so an input that was re-made with equal bytes gives its followers
//! the keys they had, and the wave stops. Two steps with one key run once. The clock is read here for durations
//! only; nothing read from it reaches a file of the release.

pub mod estimate;
mod executor;
mod job;
mod order;
mod resources;

pub use resources::Budget;

use crate::frames::rendered::Saving;
use crate::plan::assess::{PlanError, Product, Reason};
use crate::plan::past::past;
use crate::plan::{Plan, survey};
use crate::programs::Programs;
use crate::render::RenderError;
use crate::render::gpu::GpuError;
use crate::stage::{StageError, StepId};
use crate::store::record::Output;
use crate::store::space::Space;
use crate::store::{Digest, Key, Store, StoreError};
use executor::Executor;
use std::collections::BTreeMap;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

/// How a plan is run.
#[derive(Debug, Clone)]
pub struct Options {
    /// What all steps together may use.
    pub budget: Budget,
    /// Go on with what does not depend on a failed step.
    pub keep_going: bool,
    /// Make again what is up to date, to hold it against what is on record.
    pub recheck: Option<Recheck>,
    /// Run the programs that recipes name. Without it a step fails that would, and none that is up to date is made again.
    pub allow_commands: bool,
    /// The programs that can be run.
    pub programs: Programs,
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
        /// What leaving out saved, where it was measured.
        saving: Option<Saving>,
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

impl Failure {
    /// What befell the GPU, where that is why.
    #[must_use]
    pub fn of_gpu(&self) -> Option<&GpuError> {
        let StepError::Stage(error) = &self.error else { return None };
        let mut cause: Option<&(dyn std::error::Error + 'static)> = Some(error);
        while let Some(error) = cause {
            if let Some(RenderError::Gpu(because)) = error.downcast_ref() {
                return Some(because);
            }
            cause = error.source();
        }
        None
    }
}

impl Summary {
    /// The whole of two runs, the second of which began where this one ended.
    #[must_use]
    pub fn then(self, second: Self) -> Self {
        Self {
            made: self.made + second.made,
            // What the first made the second found up to date.
            kept: second.kept.saturating_sub(self.made),
            rechecked: self.rechecked + second.rechecked,
            ..second
        }
    }

    /// Whether a step found no room for its files.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.failures.iter().any(|failure| matches!(failure.error, StepError::Full { .. }))
    }
}

/// The longest time before what was made is synced and indexed, if it is not much.
const BATCH: Duration = Duration::from_secs(2);

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
    // If this process is killed, the next waits for the end of its programs before it empties their folders.
    let programs = match store.share_lock()? {
        Some(lock) => options.programs.holding(lock),
        None => options.programs,
    };
    let options = Options { programs, ..options };
    let (sender, receiver) = mpsc::channel();
    let ranks = order::ranks(plan, &past(plan, store)?);
    thread::scope(|scope| {
        let mut executor = Executor::new(plan, store, options, cancel, observer, ranks);
        let mut flushed = Instant::now();
        loop {
            executor.start_ready(scope, &sender);
            if executor.running.is_empty() {
                break Ok(executor.close());
            }
            let finished = receiver.recv().expect("the executor keeps a sender");
            executor.finish(finished);
            if store.is_due() || flushed.elapsed() >= BATCH {
                match store.flush() {
                    // Told already, with the step; what runs is let come to its end.
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
