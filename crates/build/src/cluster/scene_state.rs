//! The state of each scene: done, running, queued, failed or open.

use super::ClusterError;
use super::finished::SceneProgress;
use super::queue::{LiveTask, TaskEnd, TaskId};
use super::report::{ReportedSteps, TaskReport, TaskStep};
use super::slurm::Slurm;
use super::submission::{FoundPlans, Submission};
use gs2e_store::{Digest, Key};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::Path;

/// A scene whose state is asked.
#[derive(Debug, Clone)]
pub struct AskedScene {
    /// Its id.
    pub scene: String,
    /// Digest of its recipe; see [`super::submission::SubmittedScene`].
    pub recipe: Digest,
    /// Its steps in the shared store.
    pub progress: SceneProgress,
}

/// The state of a scene.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SceneState {
    /// The shared store has all of its steps.
    Done,
    /// A task that builds it runs on this node.
    Running {
        /// The task.
        task: TaskId,
        /// The node.
        node: String,
    },
    /// A task that builds it waits.
    Queued {
        /// The task.
        task: TaskId,
        /// Why it waits, in the words of the batch system.
        reason: String,
    },
    /// The task that built it last ended without it.
    Failed(SceneFailure),
    /// No task has tried to build it.
    Open,
}

impl fmt::Display for SceneState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Done => f.write_str("done"),
            Self::Running { task, node } => write!(f, "running {task} on {node}"),
            Self::Queued { task, reason } => write!(f, "queued {task} ({reason})"),
            Self::Failed(failure) => write!(f, "failed {}", failure.task),
            Self::Open => f.write_str("open"),
        }
    }
}

/// Numbers of scenes by their state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StateCounts {
    /// Number of done scenes.
    pub done: usize,
    /// Number of running scenes.
    pub running: usize,
    /// Number of queued scenes.
    pub queued: usize,
    /// Number of failed scenes.
    pub failed: usize,
    /// Number of open scenes.
    pub open: usize,
}

impl StateCounts {
    /// Counts the states.
    pub fn of<'a>(states: impl IntoIterator<Item = &'a SceneState>) -> Self {
        let mut counts = Self::default();
        for state in states {
            *match state {
                SceneState::Done => &mut counts.done,
                SceneState::Running { .. } => &mut counts.running,
                SceneState::Queued { .. } => &mut counts.queued,
                SceneState::Failed(_) => &mut counts.failed,
                SceneState::Open => &mut counts.open,
            } += 1;
        }
        counts
    }
}

impl fmt::Display for StateCounts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { done, running, queued, failed, open } = self;
        let all = done + running + queued + failed + open;
        write!(
            f,
            "{all} scenes: done {done}, running {running}, queued {queued}, failed {failed}, open {open}"
        )
    }
}

/// Why a scene is not done.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SceneFailure {
    /// The task that built it last.
    pub task: TaskId,
    /// The error of its step, or the end of the task.
    pub because: String,
    /// Last lines of the log of the task, if the error of a step is not known.
    pub last: Vec<String>,
    /// Memory of the task, MB.
    pub memory_mb: u64,
    /// True if the task exceeded its memory.
    pub is_out_of_memory: bool,
}

/// A plan with what its tasks left.
#[derive(Debug)]
struct ReportedPlan {
    submission: Submission,
    reports: Vec<TaskReport>,
}

/// Plans, tasks and reports at one moment.
#[derive(Debug)]
pub struct ClusterView {
    plans: Vec<ReportedPlan>,
    /// Reasons why other plans are not used. Their scenes may be at work.
    refused: Vec<ClusterError>,
    live: Vec<LiveTask>,
    /// Ends of tasks that Slurm still knows, by job.
    ends: BTreeMap<u64, BTreeMap<u32, TaskEnd>>,
}

/// Number that a shell adds to that of the signal that ended a program.
const SIGNALLED: i32 = 128;
/// Number of the signal by which the kernel ends a program that exceeds its memory.
const KILLED: i32 = 9;

impl ClusterView {
    /// Looks at the plans of these scenes. Without `slurm`, nothing is queued or running.
    ///
    /// # Errors
    /// The plans cannot be listed, or Slurm does not answer.
    pub fn look(shared: &Path, slurm: Option<&Slurm>, scenes: &[AskedScene]) -> Result<Self, ClusterError> {
        let asked: BTreeSet<&Digest> = scenes.iter().map(|scene| &scene.recipe).collect();
        let mut plans = Vec::new();
        let FoundPlans { sound, mut refused } = Submission::all(shared)?;
        for submission in sound {
            if submission.plan.tasks.iter().flatten().any(|scene| asked.contains(&scene.recipe)) {
                // Without the results, a scene that failed is shown as open.
                let reports = TaskReport::all(&submission).unwrap_or_else(|error| {
                    refused.push(error);
                    Vec::new()
                });
                plans.push(ReportedPlan { reports, submission });
            }
        }
        let names: Vec<String> = plans.iter().map(|plan| plan.submission.name()).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        // The queue before the ends: a report lists folders, and reads `end` only when it is asked. A task
        // that ends in between therefore counts as running, and not as one without a report.
        let live = slurm.map(|slurm| slurm.live(&names)).transpose()?.unwrap_or_default();
        let mut view = Self { plans, refused, live, ends: BTreeMap::new() };
        if let Some(slurm) = slurm {
            for job in view.ended_badly() {
                view.ends.insert(job, slurm.ends(job)?);
            }
        }
        Ok(view)
    }

    /// Reasons why plans or their results are not used.
    #[must_use]
    pub fn refused(&self) -> &[ClusterError] {
        &self.refused
    }

    /// Jobs with tasks that are not live and did not end well.
    fn ended_badly(&self) -> BTreeSet<u64> {
        let reports = self.plans.iter().flat_map(|plan| &plan.reports);
        let bad = reports.filter(|report| !self.is_live(report.id) && report.exit_code() != Some(0));
        bad.map(|report| report.id.job).collect()
    }

    fn is_live(&self, id: TaskId) -> bool {
        self.live.iter().any(|task| task.id == id)
    }

    /// The tasks that have not ended, with the plan of each.
    pub fn live(&self) -> impl Iterator<Item = (&LiveTask, &Submission)> {
        let plan = |task: &LiveTask| self.plans.iter().find(|plan| plan.submission.name() == task.name);
        self.live.iter().filter_map(move |task| Some((task, &plan(task)?.submission)))
    }

    /// Cores of the tasks that run.
    #[must_use]
    pub fn cores_at_work(&self) -> u64 {
        let running = self.live().filter(|(task, _)| task.node.is_some());
        running.map(|(_, submission)| u64::from(submission.plan.cores)).sum()
    }

    /// The steps that the tasks made, in the order of plans and tasks.
    #[must_use]
    pub fn steps_made(&self) -> Vec<TaskStep> {
        let reports = self.plans.iter().flat_map(|plan| &plan.reports);
        reports.flat_map(|report| report.steps().made).collect()
    }

    /// The state of a scene. `is_recorded` returns true for the key of a record in the shared store.
    #[must_use]
    pub fn state(&self, scene: &AskedScene, is_recorded: &dyn Fn(&Key) -> bool) -> SceneState {
        if scene.progress.is_done() {
            return SceneState::Done;
        }
        // A task that runs tells more than one that waits.
        let covering = self.live().filter(|(task, plan)| builds(plan, task.id, scene));
        let mut covering: Vec<&LiveTask> = covering.map(|(task, _)| task).collect();
        covering.sort_by_key(|task| (task.node.is_none(), task.id));
        if let Some(task) = covering.first() {
            return match &task.node {
                Some(node) => SceneState::Running { task: task.id, node: node.clone() },
                None => SceneState::Queued { task: task.id, reason: task.reason.clone() },
            };
        }
        let built = self.plans.iter().flat_map(|plan| plan.reports.iter().map(move |report| (plan, report)));
        let last = built
            .filter(|(plan, report)| builds(&plan.submission, report.id, scene))
            .max_by_key(|(_, report)| report.id);
        let Some((plan, report)) = last else { return SceneState::Open };
        let steps = report.steps();
        if plan.submission.plan.by_report && is_reported_done(&steps, report, &scene.scene, is_recorded) {
            return SceneState::Done;
        }
        self.failure(&plan.submission, report, steps, &scene.scene)
    }

    fn failure(
        &self,
        plan: &Submission,
        report: &TaskReport,
        mut steps: ReportedSteps,
        scene: &str,
    ) -> SceneState {
        let known = self.ends.get(&report.id.job).and_then(|ends| ends.get(&report.id.task)).cloned();
        let code = report.exit_code();
        // The kernel may have ended the program for its memory. Slurm knows better, while it remembers.
        let is_out_of_memory = match &known {
            Some(end) => *end == TaskEnd::OutOfMemory,
            None => code == Some(SIGNALLED + KILLED),
        };
        let end = match known {
            Some(TaskEnd::Code(code)) => Some(end_of_code(code)),
            None => code.map(end_of_code),
            known => known,
        };
        let (because, last) = match (steps.failures.remove(scene), end) {
            (Some(error), _) => (error, Vec::new()),
            // It ended well, so what it built is what the recipe was at that time.
            (None, Some(TaskEnd::Code(0))) => return SceneState::Open,
            (None, Some(end)) => (end.to_string(), report.last_lines()),
            (None, None) => ("it ended without a report".to_owned(), report.last_lines()),
        };
        let memory_mb = plan.plan.memory_mb;
        SceneState::Failed(SceneFailure { task: report.id, because, last, memory_mb, is_out_of_memory })
    }
}

/// The end that an exit code means. An interrupted build ends with 130 by itself.
fn end_of_code(code: i32) -> TaskEnd {
    const INTERRUPTED: i32 = 130;
    if code > SIGNALLED && code != INTERRUPTED {
        TaskEnd::Signal(code - SIGNALLED)
    } else {
        TaskEnd::Code(code)
    }
}

/// Returns true if this task of the plan builds the scene.
fn builds(plan: &Submission, id: TaskId, scene: &AskedScene) -> bool {
    let task = usize::try_from(id.task).ok().and_then(|task| plan.plan.tasks.get(task.checked_sub(1)?));
    task.is_some_and(|scenes| scenes.iter().any(|s| s.scene == scene.scene && s.recipe == scene.recipe))
}

/// Returns true if a task reported all steps of a scene, and the shared store still has them. The submitter
/// cannot know the keys of steps that a GPU of another machine makes.
fn is_reported_done(
    steps: &ReportedSteps,
    report: &TaskReport,
    scene: &str,
    is_recorded: &dyn Fn(&Key) -> bool,
) -> bool {
    // Without an error of the scene, a task that ended by itself made all of it. Code 1 is a failed step of
    // another scene, and 3 a fault that a check found.
    let ended = matches!(report.exit_code(), Some(0 | 1 | 3)) && !steps.failures.contains_key(scene);
    let keys = steps.finished.get(scene);
    ended && keys.is_some_and(|keys| !keys.is_empty() && keys.iter().all(is_recorded))
}
