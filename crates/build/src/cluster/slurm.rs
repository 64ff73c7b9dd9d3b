//! Slurm: `sbatch`, `squeue`, `scontrol` and `scancel`. No accounting database is needed.
//!
//! `squeue --array` prints one line per task. `scontrol --oneliner show job` shows the ends of tasks for
//! `MinJobAge` (300 s by default) after the end; afterwards only the files of a task tell.

use super::ClusterError;
use super::queue::{LiveTask, TaskEnd, TaskId};
use gs2e_files::programs::{EndKind, ProgramCall, ProgramEnd, ProgramFinder};
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// The programs of Slurm.
#[derive(Debug, Clone)]
pub struct Slurm {
    programs: ProgramFinder,
}

/// Maximum bytes that are read of an answer: 100,000 tasks.
const MAX_ANSWER: u64 = 1 << 24;
/// Seconds that a program may take. A busy controller answers within its timeout of 100 s or fails.
const MAX_SECONDS: u32 = 150;
/// Fields of `squeue`: job, task, state, node, name, reason.
const FORMAT: &str = "--format=%F|%K|%T|%N|%j|%r";

impl Slurm {
    /// Uses the programs on this path.
    #[must_use]
    pub fn new(programs: ProgramFinder) -> Self {
        Self { programs }
    }

    /// Checks that jobs can be submitted from here.
    ///
    /// # Errors
    /// A program is absent.
    pub fn require(&self) -> Result<(), ClusterError> {
        for program in ["sbatch", "squeue"] {
            self.programs.find(Path::new(program)).map_err(|_| ClusterError::Absent { program })?;
        }
        Ok(())
    }

    /// Submits a batch script, and returns the number of the job.
    ///
    /// # Errors
    /// `sbatch` is absent or refuses it.
    pub fn submit(&self, script: &Path) -> Result<u64, ClusterError> {
        let said = self.run("sbatch", &["--parsable".into(), script.into()])?;
        // A federation prints `JOB;CLUSTER`. Warnings are lines of their own.
        let number = said.lines().find_map(|line| line.split(';').next()?.trim().parse().ok());
        let wanted = "the number of a job";
        number.ok_or_else(|| ClusterError::Unread { program: "sbatch", said: said.trim().to_owned(), wanted })
    }

    /// The tasks of jobs with these names that have not ended.
    ///
    /// # Errors
    /// `squeue` is absent or fails: its controller may be starting.
    pub fn live(&self, names: &[&str]) -> Result<Vec<LiveTask>, ClusterError> {
        if names.is_empty() {
            return Ok(Vec::new());
        }
        let names = format!("--name={}", names.join(","));
        let said =
            self.run("squeue", &["--noheader".into(), "--array".into(), FORMAT.into(), names.into()])?;
        Ok(said.lines().filter_map(live_task).collect())
    }

    /// The ends of the tasks of a job, as far as Slurm still knows them.
    ///
    /// # Errors
    /// `scontrol` is absent.
    pub fn ends(&self, job: u64) -> Result<BTreeMap<u32, TaskEnd>, ClusterError> {
        let arguments = ["--oneliner".into(), "show".into(), "job".into(), OsString::from(job.to_string())];
        match self.run("scontrol", &arguments) {
            // It fails for a job that it has forgotten.
            Err(ClusterError::Failed { .. }) => Ok(BTreeMap::new()),
            said => Ok(said?.lines().filter_map(task_end).collect()),
        }
    }

    /// Cancels tasks.
    ///
    /// # Errors
    /// `scancel` is absent or fails.
    pub fn cancel(&self, tasks: &[TaskId]) -> Result<(), ClusterError> {
        let tasks: Vec<OsString> = tasks.iter().map(|task| task.to_string().into()).collect();
        self.run("scancel", &tasks).map(drop)
    }

    fn run(&self, program: &'static str, arguments: &[OsString]) -> Result<String, ClusterError> {
        let call = ProgramCall {
            program: program.into(),
            arguments: arguments.to_vec(),
            environment: BTreeMap::new(),
            // Where no stranger can put files that a program would read.
            folder: PathBuf::from("/"),
        };
        let (said, ended) = self.programs.output_of(&call, MAX_ANSWER, MAX_SECONDS);
        match ended {
            Ok(()) => Ok(said),
            Err(ProgramEnd::Failed(EndKind::NotStarted(e))) if e.kind() == ErrorKind::NotFound => {
                Err(ClusterError::Absent { program })
            }
            Err(ProgramEnd::Failed(how)) => Err(ClusterError::Failed { program, how, said }),
            // Nothing asks it to stop.
            Err(ProgramEnd::Stopped) => {
                Err(ClusterError::Failed { program, how: EndKind::TooLong(MAX_SECONDS), said })
            }
        }
    }
}

/// A line of `squeue`; `None` for other lines, such as warnings, and for tasks that have ended.
fn live_task(line: &str) -> Option<LiveTask> {
    // The reason is the last of six fields, so a separator in its words does no harm.
    let mut fields = line.trim().splitn(6, '|');
    let mut next = || fields.next();
    let (job, task, state, node, name) = (next()?, next()?, next()?, next()?, next()?);
    let id = TaskId { job: job.parse().ok()?, task: task.parse().ok()? };
    // From the state codes in the manual of squeue: a task in any state but these and the next ones has
    // ended.
    let waits = ["PENDING", "REQUEUED", "REQUEUE_HOLD", "SPECIAL_EXIT", "RESV_DEL_HOLD", "REQUEUE_FED"];
    let runs = [
        "RUNNING",
        "COMPLETING",
        "CONFIGURING",
        "SUSPENDED",
        "STAGE_OUT",
        "SIGNALING",
        "STOPPED",
        "RESIZING",
    ];
    if waits.contains(&state) {
        let reason = fields.next().unwrap_or_default().to_owned();
        return Some(LiveTask { id, name: name.to_owned(), node: None, reason });
    }
    let node = runs.contains(&state).then(|| node.to_owned());
    node.map(|node| LiveTask { id, name: name.to_owned(), node: Some(node), reason: String::new() })
}

/// A line of `scontrol --oneliner show job`; `None` for a task that has not ended, or that ended well.
fn task_end(line: &str) -> Option<(u32, TaskEnd)> {
    let field =
        |name: &str| line.split_whitespace().find_map(|word| word.strip_prefix(name)?.strip_prefix('='));
    let task = field("ArrayTaskId")?.parse().ok()?;
    // Signal and code, as `CODE:SIGNAL`.
    let (code, signal) = field("ExitCode")?.split_once(':')?;
    let (code, signal): (i32, i32) = (code.parse().ok()?, signal.parse().ok()?);
    let end = match field("JobState")? {
        "OUT_OF_MEMORY" => TaskEnd::OutOfMemory,
        "TIMEOUT" | "DEADLINE" => TaskEnd::Timeout,
        "NODE_FAIL" | "BOOT_FAIL" | "PREEMPTED" => TaskEnd::NodeFailed,
        "CANCELLED" => TaskEnd::Cancelled,
        "FAILED" if signal != 0 => TaskEnd::Signal(signal),
        "FAILED" => TaskEnd::Code(code),
        _ => return None,
    };
    Some((task, end))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_the_queue_are_read() {
        let t = |line: &str, wanted: Option<(&str, Option<&str>, &str)>| {
            let found = live_task(line);
            let id = found.as_ref().map(|task| task.id.to_string()).unwrap_or_default();
            let shown = found.as_ref().map(|t| (id.as_str(), t.node.as_deref(), t.reason.as_str()));
            assert_eq!(shown, wanted, "{line}");
        };
        // As printed by Slurm 22.05.
        t("12|3|RUNNING|n2|gs2e-0123456789ab|None", Some(("12_3", Some("n2"), "")));
        t("12|4|PENDING||gs2e-0123456789ab|Resources", Some(("12_4", None, "Resources")));
        t("12|5|PENDING||a|launch failed requeued held", Some(("12_5", None, "launch failed requeued held")));
        t("12|6|COMPLETED|n1|a|None", None);
        t("12|N/A|RUNNING|n1|a|None", None);
        t("squeue: warning: something", None);
        t("", None);
    }

    #[test]
    fn ends_of_tasks_are_read() {
        let t = |state: &str, code: &str, wanted: Option<TaskEnd>| {
            let line = format!(
                "JobId=13 ArrayJobId=12 ArrayTaskId=4 JobName=gs2e-a UserId=ada(1) JobState={state} \
                 Reason=None Dependency=(null) Requeue=1 Restarts=0 BatchFlag=1 Reboot=0 ExitCode={code} \
                 RunTime=00:00:02"
            );
            assert_eq!(task_end(&line), wanted.map(|end| (4, end)), "{line}");
        };
        t("OUT_OF_MEMORY", "0:125", Some(TaskEnd::OutOfMemory));
        t("TIMEOUT", "0:0", Some(TaskEnd::Timeout));
        t("NODE_FAIL", "1:0", Some(TaskEnd::NodeFailed));
        t("FAILED", "7:0", Some(TaskEnd::Code(7)));
        t("FAILED", "0:53", Some(TaskEnd::Signal(53)));
        t("CANCELLED", "0:15", Some(TaskEnd::Cancelled));
        t("COMPLETED", "0:0", None);
        t("RUNNING", "0:0", None);
        assert_eq!(task_end("slurm_load_jobs error: Invalid job id specified"), None);
    }
}
