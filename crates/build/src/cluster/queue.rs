//! Tasks in the queue of a batch system.

use std::fmt;

/// A task of an array job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct TaskId {
    /// Number of the job. Later jobs have larger numbers.
    pub job: u64,
    /// Number of the task, from 1.
    pub task: u32,
}

impl fmt::Display for TaskId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}_{}", self.job, self.task)
    }
}

impl TaskId {
    /// Reads `JOB_TASK`.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let (job, task) = text.split_once('_')?;
        Some(Self { job: job.parse().ok()?, task: task.parse().ok()? })
    }
}

/// A task that has not ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LiveTask {
    /// The task.
    pub id: TaskId,
    /// Name of its job.
    pub name: String,
    /// The node on which it runs; `None` while it waits.
    pub node: Option<String>,
    /// Why it waits, in the words of the batch system; empty if it runs.
    pub reason: String,
}

/// How a task ended, as the batch system knows it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TaskEnd {
    /// It exceeded its memory.
    OutOfMemory,
    /// It exceeded its time.
    Timeout,
    /// Its node failed.
    NodeFailed,
    /// A person cancelled it.
    Cancelled,
    /// It ended with this exit code.
    Code(i32),
    /// A signal ended it.
    Signal(i32),
}

impl fmt::Display for TaskEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutOfMemory => f.write_str("it exceeded its memory"),
            Self::Timeout => f.write_str("it exceeded its time"),
            Self::NodeFailed => f.write_str("its node failed"),
            Self::Cancelled => f.write_str("it was cancelled"),
            Self::Code(code) => write!(f, "it ended with exit code {code}"),
            Self::Signal(signal) => write!(f, "signal {signal} ended it"),
        }
    }
}
