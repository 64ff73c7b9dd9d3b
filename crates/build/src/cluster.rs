//! Scenes that the tasks of a batch system build, with a shared store between them.
//!
//! ```text
//! shared store/  gs2e-plans/<digest>/  plan.json  shard-0001.json …  task.sh  results/<job>_<task>/
//! ```
//! An array job has a folder with its plan: which scenes each task builds. These files never change. A task
//! reads the file of its own share, and writes `steps.jsonl`, `log` and `end` in a folder of its own. The
//! digest is in the name of the job, so the queue of the batch system tells which plans are at work, and
//! nothing else has to be kept.
//!
//! The records of the shared store alone decide which work is finished. The files of tasks say why something
//! is not finished, and are lost without harm.

pub mod finished;
pub mod page;
pub mod queue;
pub mod report;
pub mod scene_state;
pub mod script;
mod shell;
pub mod slurm;
pub mod submission;

use gs2e_files::PathError;
use gs2e_files::programs::EndKind;
use std::path::PathBuf;

/// Reason why a batch system or a plan cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ClusterError {
    /// A program of the batch system is not installed.
    #[error("there is no program `{program}` in PATH")]
    Absent {
        /// Its name.
        program: &'static str,
    },
    /// A program of the batch system failed.
    #[error("`{program}` failed: {how}")]
    Failed {
        /// Its name.
        program: &'static str,
        /// Kind of failure.
        how: EndKind,
        /// Its output.
        said: String,
    },
    /// A program of the batch system printed something else than expected.
    #[error("`{program}` printed `{said}`, wanted {wanted}")]
    Unread {
        /// Its name.
        program: &'static str,
        /// Its output.
        said: String,
        /// The output that was wanted.
        wanted: &'static str,
    },
    /// A file of a plan cannot be read or written.
    #[error("failed to use {0}")]
    Io(#[source] PathError),
    /// A file of a plan has another form.
    #[error("{} is not a plan of this gs2e: {because}", path.display())]
    Plan {
        /// The file.
        path: PathBuf,
        /// The difference.
        because: String,
    },
    /// A file of a plan has other bytes than the one that was submitted.
    #[error("{} was altered after it was submitted", path.display())]
    Altered {
        /// The file.
        path: PathBuf,
    },
}
