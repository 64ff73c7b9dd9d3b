//! The work of one step on its own thread, from its inputs to a record.

use super::kept::KeptStep;
use super::{RecheckPolicy, RunEvent, RunObserver, StepError, StepOrigin};
use crate::artifact::ArtifactFiles;
use crate::plan::assess::{SourceFiles, StepReason, read_sources};
use crate::plan::{Plan, PlannedStep};
use crate::stage::pass::{PassStep, run_pass};
use crate::stage::{AnyStep, StageContext, StageError, StepId, StepNeed, StepProgress};
use gs2e_files::programs::ProgramFinder;
use gs2e_sampling::rendered::{ReaderSeconds, TimeSaved};
use gs2e_store::description::DescribedValue;
use gs2e_store::record::{StepProvenance, StepRecord, StoredOutput};
use gs2e_store::space::{DiskSpace, is_full};
use gs2e_store::{Key, StepWorkspace, Store, StoreError};
use rustix::time::{ClockId, clock_gettime};
use std::sync::OnceLock;
use std::sync::atomic::AtomicBool;
use std::thread::{self, JoinHandle};
use std::time::Instant;

/// Seconds since the first call.
pub fn monotonic_seconds() -> f64 {
    static BEGAN: OnceLock<Instant> = OnceLock::new();
    BEGAN.get_or_init(Instant::now).elapsed().as_secs_f64()
}

/// A step that must run.
pub(super) struct StaleStep {
    pub(super) key: Key,
    pub(super) description: DescribedValue,
    /// The files outside the store, as in the key.
    pub(super) sources: SourceFiles,
    pub(super) reason: StepReason,
    /// The recorded outputs, if the step is up to date and only compared with its record.
    pub(super) recheck: Option<Vec<StoredOutput>>,
    pub(super) files: Vec<ArtifactFiles>,
    pub(super) need: StepNeed,
}

/// The result of a step.
pub(super) struct StepResult {
    pub(super) outputs: Vec<StoredOutput>,
    pub(super) seconds: f64,
    pub(super) threads: usize,
    pub(super) core_seconds: f64,
    pub(super) warnings: Vec<String>,
    pub(super) remark: Option<String>,
    pub(super) saving: Option<TimeSaved>,
    /// Memory granted, bytes; 0 for outputs that were copied.
    pub(super) memory: u64,
    pub(super) origin: StepOrigin,
}

/// The work of one step on its own thread.
pub(super) struct StepJob<'a> {
    pub(super) plan: &'a Plan,
    pub(super) store: &'a Store,
    pub(super) cancel: &'a AtomicBool,
    pub(super) observer: &'a dyn RunObserver,
    pub(super) threads: usize,
    /// Memory granted, bytes.
    pub(super) memory: u64,
    pub(super) allows_commands: bool,
    pub(super) programs: ProgramFinder,
    /// Bytes that kept frames may take; `None` to keep none.
    pub(super) kept_frames: Option<u64>,
    pub(super) recheck: RecheckPolicy,
}

/// A step before its work.
enum PreparedStep<'a> {
    /// Another machine made it.
    Adopted(Box<StepResult>),
    /// An empty folder for its files.
    Workspace(StepWorkspace<'a>),
}

/// The end of a step's work.
struct StepWork {
    worked: Result<(), StageError>,
    seconds: f64,
    /// Processor time.
    core_seconds: f64,
    /// An estimate of the seconds that it takes alone, if others shared its work.
    alone: Option<f64>,
    warnings: Vec<String>,
    remark: Option<String>,
    saving: Option<TimeSaved>,
}

impl<'a> StepJob<'a> {
    pub(super) fn run(&self, step: StepId, stale: &StaleStep) -> Result<StepResult, StepError> {
        match self.prepare(step, stale)? {
            PreparedStep::Adopted(adopted) => Ok(*adopted),
            PreparedStep::Workspace(workspace) => {
                // The free space is read while the folder still exists. Dropping it would free the space that
                // was lacking.
                self.make(step, stale, &workspace).map_err(|e| self.with_space(e, workspace.bytes()))
            }
        }
    }

    /// Makes steps of one pass together. A step that the pass could not serve is made alone.
    pub(super) fn run_together(&self, members: &[(StepId, StaleStep)]) -> Vec<Result<StepResult, StepError>> {
        let mut results: Vec<Option<Result<StepResult, StepError>>> = Vec::new();
        let mut places = Vec::new();
        for (at, (_, stale)) in members.iter().enumerate() {
            results.push(match self.prepare(members[at].0, stale) {
                Ok(PreparedStep::Adopted(adopted)) => Some(Ok(*adopted)),
                Ok(PreparedStep::Workspace(workspace)) => {
                    places.push((at, workspace));
                    None
                }
                Err(error) => Some(Err(error)),
            });
        }
        // A single step that is left has no need of a pass.
        if places.len() > 1 {
            for (at, result) in self.make_together(members, &places) {
                results[at] = Some(result);
            }
        }
        // Half-made files go first: each step below gets a new folder, and may need their space.
        drop(places);
        let alone = |(result, (step, stale)): (Option<_>, &(StepId, StaleStep))| {
            result.unwrap_or_else(|| self.run(*step, stale))
        };
        results.into_iter().zip(members).map(alone).collect()
    }

    /// The results of the steps that a pass served, by their place among the members.
    fn make_together(
        &self,
        members: &[(StepId, StaleStep)],
        places: &[(usize, StepWorkspace<'_>)],
    ) -> Vec<(usize, Result<StepResult, StepError>)> {
        let (mut steps, mut kept) = (Vec::new(), Vec::new());
        for (at, workspace) in places {
            let (step, stale) = &members[*at];
            let step = &*self.plan.steps()[step.0].step;
            let mut cx = self.context(stale, workspace);
            // A step whose frames cannot be opened renders them.
            let own = self.kept(step, stale).ok().flatten();
            cx.kept = own.as_ref().map(|kept| kept.frames.clone());
            kept.push(own);
            steps.push(PassStep { step, cx });
        }
        let files = &members[places[0].0].1.files;
        // Without threads there is no pass, and each step alone reports why.
        let Ok((ends, spent)) = self.in_threads(|| run_pass(&mut steps, files, monotonic_seconds)) else {
            return Vec::new();
        };
        // Each has the same share of the processor time as of the clock's.
        let whole: f64 = ends.iter().map(|end| end.seconds.share).sum();
        let cores = if whole > 0.0 { spent / whole } else { 1.0 };
        let mut results = Vec::new();
        let ends = ends.into_iter().zip(steps).zip(kept);
        for (((end, PassStep { cx, .. }), kept), (at, workspace)) in ends.zip(places) {
            let Some(worked) = end.made else { continue };
            let StageContext { warnings, remark, saving, .. } = cx;
            let remark = self.end_kept(kept, worked.is_ok(), remark);
            let ReaderSeconds { share: seconds, alone, .. } = end.seconds;
            let (core_seconds, alone) = (seconds * cores, Some(alone));
            let work = StepWork { worked, seconds, core_seconds, alone, warnings, remark, saving };
            let (step, stale) = &members[*at];
            let result = self.conclude(*step, stale, workspace, work);
            results.push((*at, result.map_err(|e| self.with_space(e, workspace.bytes()))));
        }
        results
    }

    /// Takes the outputs of another machine, or makes a folder for a step.
    fn prepare(&self, step: StepId, stale: &StaleStep) -> Result<PreparedStep<'a>, StepError> {
        if let StepReason::BlobAltered { digest } = &stale.reason {
            // The altered file has the name of the right bytes, and must not be taken for them.
            self.store.discard(&digest.parse().expect("a reason holds a digest's text"))?;
        }
        if stale.recheck.is_some() {
            // It is compared with the record of the own store.
        } else if self.doubts(step, stale) {
            self.store.inspect_shared(&stale.key)?;
        } else if let Some(adopted) = self.adopted(&stale.key).map_err(|e| self.with_space(e, 0))? {
            return Ok(PreparedStep::Adopted(Box::new(adopted)));
        }
        // Even an empty folder cannot be created on a full disk.
        let workspace = self.store.workspace().map_err(|e| self.with_space(e.into(), 0))?;
        Ok(PreparedStep::Workspace(workspace))
    }

    /// Returns true if a step that another machine may have made is made here, to compare the bytes.
    fn doubts(&self, step: StepId, stale: &StaleStep) -> bool {
        let step = &*self.plan.steps()[step.0].step;
        // The record of the own store says which bytes are right.
        let is_known =
            matches!(stale.reason, StepReason::BlobMissing { .. } | StepReason::BlobAltered { .. });
        let may_run = self.allows_commands || step.facts().programs().is_empty();
        !is_known && may_run && self.recheck.chooses_adopted(&stale.key, step)
    }

    /// The facilities for a step.
    fn context<'w>(&'w self, stale: &StaleStep, workspace: &'w StepWorkspace<'_>) -> StageContext<'w> {
        let mut cx = StageContext::new(workspace.path(), self.cancel);
        // A step that is made again for comparison must do all of its work again.
        cx.resume = stale.recheck.is_none().then(|| self.store.resume_of(&stale.key));
        // A clock without a date: no product may depend on the time of the build.
        cx.clock = Some(monotonic_seconds);
        cx.allows_commands = self.allows_commands;
        cx.programs = self.programs.clone();
        cx
    }

    fn make(
        &self,
        step: StepId,
        stale: &StaleStep,
        workspace: &StepWorkspace<'_>,
    ) -> Result<StepResult, StepError> {
        let planned = &self.plan.steps()[step.0];
        let started = Instant::now();
        let report = |words: &str| self.observer.observe(&RunEvent::Advanced { step, words });
        let mut cx = self.context(stale, workspace);
        cx.progress = Some(StepProgress(&report));
        let runs_commands = self.allows_commands && !planned.step.facts().programs().is_empty();
        if runs_commands || planned.step.facts().runs_known_programs() {
            cx.log = Some(self.store.log_of(&stale.key)?);
        }
        let kept = self.kept(&*planned.step, stale)?;
        cx.kept = kept.as_ref().map(|kept| kept.frames.clone());
        let (worked, spent) = self.in_threads(|| planned.step.run(&stale.files, &mut cx))?;
        let seconds = started.elapsed().as_secs_f64();
        // The time of other programs is not known, but while they run, they have a core at least.
        let core_seconds = if cx.log.is_some() { spent.max(seconds) } else { spent };
        let StageContext { warnings, remark, saving, .. } = cx;
        let remark = self.end_kept(kept, worked.is_ok(), remark);
        self.conclude(
            step,
            stale,
            workspace,
            StepWork { worked, seconds, core_seconds, alone: None, warnings, remark, saving },
        )
    }

    /// The frames that the step shares with others, if they are kept.
    fn kept(&self, step: &dyn AnyStep, stale: &StaleStep) -> Result<Option<KeptStep>, StoreError> {
        let open = |limit| KeptStep::open(step, stale, self.store, limit);
        Ok(self.kept_frames.map(open).transpose()?.flatten())
    }

    /// Ends the work with kept frames. Returns the remark of the step with that of its frames.
    fn end_kept(&self, kept: Option<KeptStep>, is_made: bool, remark: Option<String>) -> Option<String> {
        let Some(kept) = kept else { return remark };
        // The step has its product. Frames that cannot be kept cost time, and nothing else.
        let of_frames =
            kept.end(is_made, self.store).unwrap_or_else(|e| Some(format!("frames not kept: {e}")));
        let words: Vec<String> = remark.into_iter().chain(of_frames).collect();
        (!words.is_empty()).then(|| words.join(", "))
    }

    /// Records a step after its work.
    fn conclude(
        &self,
        step: StepId,
        stale: &StaleStep,
        workspace: &StepWorkspace<'_>,
        work: StepWork,
    ) -> Result<StepResult, StepError> {
        let planned = &self.plan.steps()[step.0];
        let StepWork { worked, seconds, core_seconds, alone, warnings, remark, saving } = work;
        // A file that is half written looks broken. The message that it changes is the better one.
        if !matches!(worked, Err(StageError::Cancelled)) {
            self.refuse_moved(planned, &stale.sources)?;
        }
        worked?;
        let provenance = StepProvenance {
            tool: env!("CARGO_PKG_VERSION").to_owned(),
            seconds,
            alone_seconds: alone,
            threads: self.threads,
            core_seconds: Some(core_seconds),
            memory: self.memory,
            warnings: warnings.clone(),
        };
        let record = StepRecord::new(stale.key, planned.step.stage(), stale.description.lines(), provenance);
        let outputs = match &stale.recheck {
            None => self.store.publish(workspace, record)?,
            Some(outputs) => self.store.compare(workspace, record).map(|()| outputs.clone())?,
        };
        // Only after the record: a process that is killed before can still continue from this state.
        self.store.forget_resume(&stale.key)?;
        let was_there = self.store.share(&stale.key)?;
        // A step that is made again for comparison is there by intention.
        let origin = match was_there && stale.recheck.is_none() {
            true if self.doubts(step, stale) => StepOrigin::Confirmed,
            true => StepOrigin::Twice,
            false => StepOrigin::Here,
        };
        let memory = stale.need.memory;
        let threads = self.threads;
        Ok(StepResult { outputs, seconds, threads, core_seconds, warnings, remark, saving, memory, origin })
    }

    /// The outputs of another machine.
    fn adopted(&self, key: &Key) -> Result<Option<StepResult>, StepError> {
        let started = Instant::now();
        Ok(self.store.adopt(key)?.map(|record| StepResult {
            outputs: record.outputs,
            seconds: started.elapsed().as_secs_f64(),
            threads: 1,
            core_seconds: 0.0,
            warnings: record.provenance.warnings,
            remark: Some("from the shared store".to_owned()),
            saving: None,
            memory: 0,
            origin: StepOrigin::Elsewhere,
        }))
    }

    /// Returns the error, or the lack of disk space if that is the cause. The cause is known from
    /// the chain of errors, or else from the free space, because not every library passes it on.
    fn with_space(&self, error: StepError, wrote: u64) -> StepError {
        let may_have_written = match &error {
            StepError::Stage(StageError::Work { .. } | StageError::Io { .. } | StageError::Program(_)) => {
                true
            }
            StepError::Store(error) => {
                !matches!(error, StoreError::Nondeterministic(_) | StoreError::SharedMismatch(_))
            }
            _ => false,
        };
        let space = self.store.space().ok();
        let is_used_up = may_have_written && space.as_ref().is_some_and(DiskSpace::is_used_up);
        if !is_used_up && !is_full(&error) {
            return error;
        }
        StepError::Full { wrote, space, cause: error.to_string() }
    }

    /// Checks that the files that were read are those of the key: the step may have waited long for
    /// its start.
    fn refuse_moved(&self, planned: &PlannedStep, then: &SourceFiles) -> Result<(), StepError> {
        let now = read_sources(self.plan, self.store, planned)?;
        now.moved_since(then).map_or(Ok(()), |name| Err(StepError::Moved(name)))
    }

    /// Does the work in separate threads and waits for their end. Only then does the allocator give
    /// the memory of ended threads to the next ones. Otherwise one more set of kept pages would be
    /// in use, which no estimate includes. The second value is the processor time of the threads, s.
    fn in_threads<T: Send>(&self, work: impl FnOnce() -> T + Send) -> Result<(T, f64), StageError> {
        let mut threads: Vec<JoinHandle<f64>> = Vec::with_capacity(self.threads);
        let start = |worker: rayon::ThreadBuilder| {
            let run = || {
                worker.run();
                thread_seconds()
            };
            threads.push(thread::Builder::new().spawn(run)?);
            Ok(())
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.threads).spawn_handler(start).build();
        let pool = pool.map_err(StageError::work_failed("start threads"))?;
        let worked = pool.install(work);
        // The threads end only after the pool is dropped, so joining them before this line would wait
        // forever.
        drop(pool);
        let seconds =
            threads.into_iter().map(|thread| thread.join().expect("the pool passes on a panic of the work"));
        Ok((worked, seconds.sum()))
    }
}

/// Processor time of this thread, s.
fn thread_seconds() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}
