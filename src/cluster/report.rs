//! The files that tasks write: their ends, their logs, and one line per step.

use super::ClusterError;
use super::queue::TaskId;
use super::submission::{RESULTS, Submission, io_error};
use crate::files;
use crate::programs;
use crate::store::Key;
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::PathBuf;

/// The files of one task.
#[derive(Debug, Clone)]
pub struct TaskReport {
    /// The task.
    pub id: TaskId,
    /// Path of the files, without their endings.
    stem: PathBuf,
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
    pub made: Vec<MadeStep>,
}

/// A step that a task made.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MadeStep {
    /// Its name, with the scene.
    pub step: String,
    /// Duration, s.
    pub seconds: f64,
    /// Cores.
    pub cores: f64,
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

impl MadeStep {
    /// Core-seconds, s.
    #[must_use]
    pub fn core_seconds(&self) -> f64 {
        self.seconds * self.cores
    }

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
        let folder = submission.folder.join(RESULTS);
        let entries = match std::fs::read_dir(&folder) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
            entries => entries.map_err(io_error(&folder))?,
        };
        let mut found = BTreeMap::new();
        for entry in entries {
            let path = entry.map_err(io_error(&folder))?.path();
            let id = path.file_stem().and_then(|stem| TaskId::parse(stem.to_str()?));
            found.extend(id.map(|id| (id, path.with_extension(""))));
        }
        Ok(found.into_iter().map(|(id, stem)| Self { id, stem }).collect())
    }

    /// Exit code of its last run; `None` if that was killed with its script.
    #[must_use]
    pub fn exit_code(&self) -> Option<i32> {
        let text = files::read_text(&self.stem.with_extension("end"), files::MAX_TEXT).ok()?;
        text.lines().last()?.trim().parse().ok()
    }

    /// The last lines of its log.
    #[must_use]
    pub fn last_lines(&self) -> Vec<String> {
        programs::last_lines(&self.stem.with_extension("log"), 0)
    }

    /// Its steps. A line that is cut off counts as absent, and so does an unreadable file.
    #[must_use]
    pub fn steps(&self) -> ReportedSteps {
        let text = files::read(&self.stem.with_extension("jsonl"), MAX_STEPS).unwrap_or_default();
        read_steps(&String::from_utf8_lossy(&text))
    }
}

fn read_steps(text: &str) -> ReportedSteps {
    let mut steps = ReportedSteps::default();
    for line in text.lines().filter_map(|line| serde_json::from_str::<ReportLine>(line).ok()) {
        let Some(scene) = line.scene else { continue };
        if line.level.as_deref() == Some("error") {
            steps.failures.insert(scene, line.message.unwrap_or_default());
        } else if matches!(line.state.as_deref(), Some("made" | "kept" | "adopted")) {
            if line.state.as_deref() == Some("made") {
                steps.made.push(MadeStep {
                    step: line.step.unwrap_or_default(),
                    seconds: line.seconds.unwrap_or_default(),
                    cores: line.cores.unwrap_or_default(),
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
    use crate::store::Digest;

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
        let step = MadeStep {
            step: "a/capture".to_owned(),
            seconds: 1.5,
            cores: 2.0,
            memory: 3,
            bytes: 4,
            host: "n1".to_owned(),
            job: String::new(),
            ended: "2026-01-02T03:04:05Z".to_owned(),
        };
        assert_eq!((step.kind(), step.core_seconds()), ("capture", 3.0));
        assert_eq!(steps.made, [step]);
        assert_eq!(read_steps("\0\0\0"), ReportedSteps::default());
    }
}
