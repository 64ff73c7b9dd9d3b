//! Assessment of steps: compares the key of each step with the store to decide if it must run, and
//! finds the reason.

mod change;
mod verdict;

pub use change::DescriptionChange;
pub(crate) use change::changed_lines;

pub use verdict::{PlanError, StepAction, StepAssessment, StepReason};

use super::{Plan, PlannedStep};
use crate::stage::capture::CaptureStage;
use crate::stage::reconstruct::ReconstructStage;
use crate::stage::{Stage, StageError, StepId};
use gs2e_files::stat::StatSighting;
use gs2e_store::description::DescribedValue;
use gs2e_store::record::{StoredOutput, content_digest};
use gs2e_store::{BlobState, Digest, Key, Store, StoreError};
use std::path::PathBuf;

/// The files outside the store that a step reads, at one moment.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SourceFiles {
    /// Digests by role, as in the description.
    pub digests: Vec<(String, Digest)>,
    /// Observations of every folder that was listed to find the files, and of every file, from
    /// before it was read.
    pub sightings: Vec<(PathBuf, StatSighting)>,
}

impl SourceFiles {
    /// The name of a file that has changed since `then`, if there is one. A file that was rewritten
    /// with equal bytes counts, because a reader may have seen other bytes in between. A folder
    /// counts by the files that it leads to.
    #[must_use]
    pub(crate) fn moved_since(&self, then: &Self) -> Option<String> {
        let is_in = |list: &Self, (name, path, sighting): &(&str, &PathBuf, &StatSighting)| {
            list.files().any(|(other, at, then)| other == *name && at == *path && then.stat == sighting.stat)
        };
        // Both directions: a file may have been added or removed.
        let moved =
            self.files().find(|now| !is_in(then, now)).or_else(|| then.files().find(|f| !is_in(self, f)));
        moved.map(|(name, ..)| name.to_owned())
    }

    /// Each file by its name within the source.
    fn files(&self) -> impl Iterator<Item = (&str, &PathBuf, &StatSighting)> {
        // Folders come first in `seen`, and have no digest.
        let folders = self.sightings.len() - self.digests.len();
        let names = self.digests.iter().map(|(role, _)| role.trim_start_matches("file "));
        names.zip(&self.sightings[folders..]).map(|(name, (path, sighting))| (name, path, sighting))
    }
}

/// The present state of a step.
#[derive(Debug, Clone, PartialEq)]
pub struct StepProduct {
    /// Its key.
    pub key: Key,
    /// Its outputs.
    pub outputs: Vec<StoredOutput>,
    /// Files that it read outside the store.
    pub sources: SourceFiles,
}

/// Compares a whole plan with the store, and runs nothing.
///
/// # Errors
/// A source is absent or unreadable, or the store fails.
pub fn assess_plan(plan: &Plan, store: &Store) -> Result<Vec<StepAssessment>, PlanError> {
    let mut done: Vec<StepAssessment> = Vec::with_capacity(plan.steps.len());
    for step in &plan.steps {
        // Inputs come before their consumers, so `done` has them already.
        let waiting = step.step.inputs().into_iter().find(|(_, id)| done[id.0].outputs.is_none());
        let outputs_of = |id: StepId| done[id.0].outputs.clone();
        let waiting =
            waiting.map(|(_, id)| StepReason::InputMayChange { step: plan.steps[id.0].name.clone() });
        let unasked =
            || step.step.facts().unasked().map(|name| StepReason::NotAsked { program: name.to_owned() });
        let assessed = match waiting.or_else(unasked) {
            Some(reason) => step_behind(plan, store, step, reason, &outputs_of)?,
            None => step_alone(plan, store, step, &outputs_of)?,
        };
        done.push(assessed);
    }
    Ok(done)
}

/// Compares one step with the store, given the outputs of its inputs. The programs in its key must
/// have been asked.
///
/// # Errors
/// The same as [`assess_plan`].
pub(crate) fn step_alone(
    plan: &Plan,
    store: &Store,
    step: &PlannedStep,
    outputs_of: &dyn Fn(StepId) -> Option<Vec<StoredOutput>>,
) -> Result<StepAssessment, PlanError> {
    let sources = read_sources(plan, store, step)?;
    let description = describe_step(step, &sources, outputs_of);
    let key = Key::of_description(&description);
    let (reason, outputs) = match store.record(&key)? {
        Some(record) => match find_damage(store, &record.outputs)? {
            None => (StepReason::UpToDate, Some(record.outputs)),
            Some(reason) => (reason, None),
        },
        None => (find_difference(plan, store, step, &description)?, None),
    };
    let action = if outputs.is_some() { StepAction::Keep } else { StepAction::Run };
    Ok(StepAssessment { action, reason, key: Some(key), description, sources, outputs })
}

/// Assesses a step whose key is not known yet, from what is known already.
fn step_behind(
    plan: &Plan,
    store: &Store,
    step: &PlannedStep,
    reason: StepReason,
    outputs_of: &dyn Fn(StepId) -> Option<Vec<StoredOutput>>,
) -> Result<StepAssessment, PlanError> {
    // Read although the key stays unknown: a missing file is reported by the plan, before any step
    // runs.
    let sources = read_sources(plan, store, step)?;
    Ok(StepAssessment {
        action: StepAction::MayRun,
        reason,
        key: None,
        description: describe_step(step, &sources, outputs_of),
        sources,
        outputs: None,
    })
}

/// A step with its known inputs.
pub fn describe_step(
    step: &PlannedStep,
    sources: &SourceFiles,
    outputs_of: &dyn Fn(StepId) -> Option<Vec<StoredOutput>>,
) -> DescribedValue {
    let made = step.step.inputs().into_iter();
    let made = made.filter_map(|(role, id)| Some((role.to_owned(), content_digest(&outputs_of(id)?))));
    let inputs: Vec<(String, Digest)> = made.chain(sources.digests.iter().cloned()).collect();
    step.step.describe(&inputs)
}

/// Reads the files outside the store that a step reads, if their stat fields have changed.
///
/// # Errors
/// A file is absent or unreadable.
pub fn read_sources(plan: &Plan, store: &Store, step: &PlannedStep) -> Result<SourceFiles, PlanError> {
    let scene = || plan.scene_of(step).to_owned();
    let places = &plan.scenes()[step.scene].meta.named_at;
    let named_at = || match step.step.stage() {
        CaptureStage::NAME => places.source.clone(),
        ReconstructStage::NAME => places.reconstruct.clone(),
        _ => None,
    };
    let failed = |cause| match cause {
        StageError::Missing { path } => {
            PlanError::Missing { scene: scene(), step: step.name.clone(), path, named_at: named_at() }
        }
        cause => PlanError::Source { scene: scene(), step: step.name.clone(), cause },
    };
    let unreadable = |path: &PathBuf, e: std::io::Error| match e.kind() {
        std::io::ErrorKind::NotFound => failed(StageError::Missing { path: path.clone() }),
        _ => failed(StageError::io_error(path)(e)),
    };
    let mut sources = SourceFiles::default();
    // Observed before they are listed: an entry that is added later changes their stat fields.
    for folder in step.step.facts().source_folders() {
        match store.sight(&folder) {
            Ok(sighting) => sources.sightings.push((folder, sighting)),
            // A missing folder is reported by `sources()` below.
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {}
            Err(e) => return Err(unreadable(&folder, e)),
        }
    }
    for source in step.step.facts().sources().map_err(failed)? {
        let entry = store.look(&source.path).map_err(|e| unreadable(&source.path, e))?;
        // The prefix keeps the names of files apart from the roles of made inputs.
        sources.digests.push((format!("file {}", source.name), entry.digest));
        sources.sightings.push((source.path, entry.sighting));
    }
    Ok(sources)
}

fn find_damage(store: &Store, outputs: &[StoredOutput]) -> Result<Option<StepReason>, StoreError> {
    for output in outputs {
        let digest = output.digest.to_string();
        match store.examine(output)? {
            BlobState::Sound => {}
            BlobState::Missing => return Ok(Some(StepReason::BlobMissing { digest })),
            BlobState::Altered => return Ok(Some(StepReason::BlobAltered { digest })),
        }
    }
    Ok(None)
}

/// The difference from the last time the step was made.
fn find_difference(
    plan: &Plan,
    store: &Store,
    step: &PlannedStep,
    now: &DescribedValue,
) -> Result<StepReason, StoreError> {
    let last = store.last_key(plan.scene_of(step), &step.name);
    let record = last.map(|key| store.full_record(&key)).transpose()?.flatten();
    // Lines are ranked, so the first one is the most telling difference.
    let first = record.and_then(|record| changed_lines(&record.description, &now.lines()).into_iter().next());
    Ok(first.map_or(StepReason::NoRecord, DescriptionChange::reason))
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_store::description::ExplanationLine;

    fn lines(text: &str) -> Vec<ExplanationLine> {
        let split = text.split(';').filter_map(|line| line.trim().split_once('='));
        split.map(|(path, text)| ExplanationLine { path: path.into(), text: text.into() }).collect()
    }

    /// The differences as `path: old -> new`.
    fn change_lines(old: &str, new: &str) -> Vec<String> {
        let changes = changed_lines(&lines(old), &lines(new)).into_iter();
        changes.map(|c| format!("{}: {} -> {}", c.path, c.old, c.new)).collect()
    }

    #[test]
    fn differences_are_told_with_the_most_telling_first() {
        let t = |old: &str, new: &str, wanted: &[&str]| {
            assert_eq!(change_lines(old, new), wanted, "{old} | {new}")
        };
        t("params.a=1; params.b=2", "params.b=2; params.a=1", &[]);
        t("params.a=1", "params.a=2", &["params.a: 1 -> 2"]);
        t("params.a=1", "params.b=1", &["params.a: 1 -> ", "params.b:  -> 1"]);
        t(
            "inputs.x=d; params.a=1; revision=1; class=cpu/1",
            "inputs.x=e; params.a=2; revision=2; class=cpu/2",
            &["class: cpu/1 -> cpu/2", "revision: 1 -> 2", "params.a: 1 -> 2", "inputs.x: d -> e"],
        );
    }

    #[test]
    fn a_difference_gives_its_reason() {
        let t = |path: &str, code: &str, name: Option<&str>| {
            let change = DescriptionChange { path: path.into(), old: "1".into(), new: "2".into() };
            let reason = serde_json::to_value(change.reason()).unwrap();
            let wanted = [Some(code), name, Some("1"), Some("2")];
            assert_eq!(["code", "name", "old", "new"].map(|field| reason[field].as_str()), wanted, "{path}");
        };
        t("revision", "revision", None);
        t("class", "class", None);
        t("params.sensor.k.0", "param-changed", Some("sensor.k.0"));
        t("inputs.capture", "input-changed", Some("capture"));
        t("inputs.file scene", "input-changed", Some("file scene"));
    }
}
