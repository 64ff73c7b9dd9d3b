//! The files that tasks write: their ends, their logs, and one line per step.
//!
//! Each run of a task has a folder, `<job>_<task>`; a run after a restart has its number at the end, as in
//! `41_1.2`.

use super::ClusterError;
use super::queue::TaskId;
use super::submission::{RESULTS, Submission, io_error};
use gs2e_files as files;
use gs2e_files::below::FolderBelow;
use gs2e_files::programs;
use gs2e_store::{Key, PLANS};
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};

/// The files of one task.
#[derive(Debug, Clone)]
pub struct TaskReport {
    /// The task.
    pub id: TaskId,
    /// The shared store.
    shared: PathBuf,
    /// The folders of its runs, relative to the shared store, in their order.
    runs: Vec<PathBuf>,
}

/// Largest file of steps that is read, bytes.
const MAX_STEPS: u64 = 1 << 28;

/// The steps of a task, as far as they are reported.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ReportedSteps {
    /// The last error of each scene.
    pub failures: BTreeMap<String, String>,
    /// Keys of the finished steps, by scene.
    pub finished: BTreeMap<String, BTreeSet<Key>>,
    /// The steps that it made itself, in their order.
    pub made: Vec<TaskStep>,
}

/// A step that a task made.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TaskStep {
    /// Its name, with the scene.
    pub step: String,
    /// Duration, s.
    pub seconds: f64,
    /// Cores.
    pub cores: f64,
    /// Processor time, s.
    pub core_seconds: f64,
    /// Granted memory, bytes.
    pub memory: u64,
    /// Size of its outputs, bytes.
    pub bytes: u64,
    /// The machine.
    pub host: String,
    /// The task of the batch system.
    pub job: String,
    /// The time of its end, as `YYYY-MM-DDThh:mm:ssZ`.
    pub ended: String,
}

impl TaskStep {
    /// The last part of its name, such as `events`.
    #[must_use]
    pub fn kind(&self) -> &str {
        self.step.rsplit('/').next().unwrap_or_default()
    }
}

/// A line of the file of steps. Other fields are for people and other programs.
#[derive(Deserialize)]
struct ReportLine {
    scene: Option<String>,
    state: Option<String>,
    key: Option<String>,
    level: Option<String>,
    message: Option<String>,
    step: Option<String>,
    seconds: Option<f64>,
    cores: Option<f64>,
    core_seconds: Option<f64>,
    memory: Option<u64>,
    bytes: Option<u64>,
    host: Option<String>,
    job: Option<String>,
    ended: Option<String>,
}

impl TaskReport {
    /// The tasks of a plan that wrote something, in the order of their numbers.
    ///
    /// # Errors
    /// The folder cannot be read.
    pub fn all(submission: &Submission) -> Result<Vec<Self>, ClusterError> {
        let below = submission.below().join(RESULTS);
        let path = submission.shared.join(&below);
        let names = match results_of(submission) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
            names => names.map_err(io_error(&path))?,
        };
        // Sorted by numbers and not by names: as text, the tenth restart would come before the second.
        let mut found: BTreeMap<TaskId, BTreeMap<u32, PathBuf>> = BTreeMap::new();
        for name in names {
            let Some((id, restart)) = name.to_str().and_then(run_of) else { continue };
            found.entry(id).or_default().insert(restart, below.join(name));
        }
        let report = |(id, runs): (TaskId, BTreeMap<u32, PathBuf>)| Self {
            id,
            shared: submission.shared.clone(),
            runs: runs.into_values().collect(),
        };
        Ok(found.into_iter().map(report).collect())
    }

    /// A file of a run. Others can write to the shared store, so no link is followed.
    fn read(&self, run: &Path, name: &str, limit: u64) -> io::Result<Vec<u8>> {
        files::read_below(&self.shared, &run.join(name), limit)
    }

    /// Exit code of its last run; `None` if that was killed with its script.
    #[must_use]
    pub(crate) fn exit_code(&self) -> Option<i32> {
        let text = self.read(self.runs.last()?, "end", files::MAX_TEXT).ok()?;
        String::from_utf8(text).ok()?.trim().parse().ok()
    }

    /// The last lines of the log of its last run.
    #[must_use]
    pub fn last_lines(&self) -> Vec<String> {
        let log = self.runs.last().and_then(|run| files::open_below(&self.shared, &run.join("log")).ok());
        log.map(|log| programs::last_lines_in(log, 0)).unwrap_or_default()
    }

    /// Its steps. A line that is cut off counts as absent, and so does an unreadable file.
    #[must_use]
    pub fn steps(&self) -> ReportedSteps {
        let texts = self.runs.iter().filter_map(|run| self.read(run, "steps.jsonl", MAX_STEPS).ok());
        // A line may be cut off within a character, and the other lines of the file must not be lost with it.
        let texts: Vec<String> = texts.map(|text| String::from_utf8_lossy(&text).into_owned()).collect();
        // A run that was killed may have ended within a line.
        read_steps(&texts.join("\n"))
    }
}

fn results_of(submission: &Submission) -> io::Result<Vec<OsString>> {
    let mut folder = FolderBelow::open(&submission.shared)?;
    for name in [PLANS, &submission.digest.short(), RESULTS] {
        folder = folder.enter(name)?;
    }
    folder.names()
}

/// The task and the number of restarts in the name of a folder.
fn run_of(name: &str) -> Option<(TaskId, u32)> {
    let (task, restart) = name.split_once('.').unwrap_or((name, "0"));
    Some((TaskId::parse(task)?, restart.parse().ok()?))
}

fn read_steps(text: &str) -> ReportedSteps {
    let mut steps = ReportedSteps::default();
    for line in text.lines().filter_map(|line| serde_json::from_str::<ReportLine>(line).ok()) {
        let Some(scene) = line.scene else { continue };
        if line.level.as_deref() == Some("error") {
            steps.failures.insert(scene, line.message.unwrap_or_default());
        } else if matches!(line.state.as_deref(), Some("made" | "kept" | "adopted")) {
            if line.state.as_deref() == Some("made") {
                let (seconds, cores) = (line.seconds.unwrap_or_default(), line.cores.unwrap_or_default());
                steps.made.push(TaskStep {
                    step: line.step.unwrap_or_default(),
                    seconds,
                    cores,
                    // Cores of older versions were those of the step, and of no other one.
                    core_seconds: line.core_seconds.unwrap_or(seconds * cores),
                    memory: line.memory.unwrap_or_default(),
                    bytes: line.bytes.unwrap_or_default(),
                    host: line.host.unwrap_or_default(),
                    job: line.job.unwrap_or_default(),
                    ended: line.ended.unwrap_or_default(),
                });
            }
            let key = line.key.and_then(|key| key.parse().ok()).map(Key);
            steps.finished.entry(scene).or_default().extend(key);
        }
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_store::Digest;

    #[test]
    fn lines_are_read_up_to_a_cut() {
        let key = Digest::of_bytes(b"key");
        let made = format!(
            r#"{{"scene":"a","step":"a/capture","state":"made","key":"{key}","seconds":1.5,"cores":2,"memory":3,"bytes":4,"host":"n1","job":null,"ended":"2026-01-02T03:04:05Z"}}"#
        );
        let error =
            r#"{"level":"error","code":"step-failed","message":"a/base: no","scene":"a","step":"base"}"#;
        let text = format!("{made}\n{error}\n{}", &made[..40]);
        let steps = read_steps(&text);
        assert_eq!(steps.failures, BTreeMap::from([("a".to_owned(), "a/base: no".to_owned())]));
        assert_eq!(steps.finished, BTreeMap::from([("a".to_owned(), BTreeSet::from([Key(key)]))]));
        let step = TaskStep {
            step: "a/capture".to_owned(),
            seconds: 1.5,
            cores: 2.0,
            core_seconds: 3.0,
            memory: 3,
            bytes: 4,
            host: "n1".to_owned(),
            job: String::new(),
            ended: "2026-01-02T03:04:05Z".to_owned(),
        };
        assert_eq!(step.kind(), "capture");
        assert_eq!(steps.made, [step]);
        let newer = made.replace("\"cores\":2", "\"cores\":2,\"core_seconds\":2.5");
        assert!(read_steps(&newer).made.iter().all(|step| (step.core_seconds - 2.5).abs() < 1e-12));
        assert_eq!(read_steps("\0\0\0"), ReportedSteps::default());
    }
}
