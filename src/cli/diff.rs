//! `gs2e diff`: the differences of two release trees, each with its reason.

use super::{Console, ExitKind, VerbError};
use gs2e_release::diff::{
    DiffReason, FileChange, ReleaseDifference, SceneChange, SceneSize, ValueChange, diff_releases,
};
use gs2e_store::Digest;
use serde_json::{Value, json};
use std::path::PathBuf;

/// Arguments of `diff`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Reads manifest.json and scene.json of both releases and no other file; `gs2e audit` verifies a \
    release. Differences are not a failure: the exit code is 0 in both cases."
)]
pub(super) struct DiffArgs {
    /// Folder of the older release
    #[arg(value_name = "DIR")]
    old: PathBuf,
    /// Folder of the newer release
    #[arg(value_name = "DIR")]
    new: PathBuf,
}

impl DiffArgs {
    pub(super) fn run(self, console: &Console) -> Result<ExitKind, VerbError> {
        let difference = diff_releases(&self.old, &self.new).map_err(|error| {
            VerbError::usage("not-a-release", error.to_string())
                .help("pass two folders that `gs2e release --to DIR` wrote")
        })?;
        if console.json {
            console.result(&json!(difference));
        } else {
            difference_lines(&difference).iter().for_each(|line| console.print(line));
        }
        let ReleaseDifference { added, removed, changed, unchanged, .. } = &difference;
        let [added, removed, changed] = [added.len(), removed.len(), changed.len()];
        console.note(&format!(
            "scenes: {added} added, {removed} removed, {changed} changed, {unchanged} unchanged"
        ));
        Ok(ExitKind::Done)
    }
}

/// Maximum number of changed files named per scene; `--json` names all.
const FILES_NAMED: usize = 12;

fn difference_lines(difference: &ReleaseDifference) -> Vec<String> {
    let mut lines: Vec<String> =
        difference.release.iter().map(|c| format!("release  {}: {}", c.path, change_arrow(c))).collect();
    lines.extend(file_lines(&difference.files).into_iter().map(|line| format!("file     {line}")));
    let whole = |SceneSize { id, files, bytes }: &SceneSize| {
        format!("{id}  ({files} files, {:.1} MB)", *bytes as f64 * 1e-6)
    };
    lines.extend(difference.added.iter().map(|scene| format!("added    {}", whole(scene))));
    lines.extend(difference.removed.iter().map(|scene| format!("removed  {}", whole(scene))));
    for scene in &difference.changed {
        lines.push(format!("changed  {}", scene.id));
        lines.extend(scene_lines(scene).into_iter().map(|line| format!("  {line}")));
    }
    lines
}

fn scene_lines(scene: &SceneChange) -> Vec<String> {
    let of = |kind: &str, changes: &[ValueChange]| -> Vec<String> {
        changes.iter().map(|c| format!("{kind:7}  {}: {}", c.path, change_arrow(c))).collect()
    };
    let mut lines = of("recipe", &scene.recipe);
    lines.extend(of("photo", &scene.photos));
    lines.extend(of("claim", &scene.claims));
    for step in &scene.steps {
        let reasons: Vec<String> = step.reasons.iter().map(|r| reason_words(r, scene)).collect();
        let same = if step.same_bytes { " (equal bytes)" } else { "" };
        lines.push(format!("step     {}: {}{same}", step.step, reasons.join("; ")));
    }
    lines.extend(file_lines(&scene.files).into_iter().map(|line| format!("file     {line}")));
    lines
}

fn file_lines(changes: &[FileChange]) -> Vec<String> {
    let size = |size: Option<u64>| size.map_or("absent".to_owned(), |bytes| format!("{bytes} bytes"));
    let named = changes.iter().take(FILES_NAMED);
    let mut lines: Vec<String> = named
        .map(|FileChange { path, old, new }| match (old, new) {
            // Only changed files are listed, so equal sizes mean other content.
            (Some(a), Some(b)) if a == b => format!("{path}: different content, same size: {a} bytes"),
            _ => format!("{path}: {} -> {}", size(*old), size(*new)),
        })
        .collect();
    if changes.len() > FILES_NAMED {
        lines.push(format!("and {} more; --json lists them", changes.len() - FILES_NAMED));
    }
    lines
}

fn change_arrow(change: &ValueChange) -> String {
    let text = |value: &Option<Value>| value.as_ref().map_or("absent".to_owned(), Value::to_string);
    format!("{} -> {}", text(&change.old), text(&change.new))
}

fn reason_words(reason: &DiffReason, scene: &SceneChange) -> String {
    let brief = |digest: &Option<Digest>| digest.map_or("absent".to_owned(), |digest| digest.short());
    match reason {
        DiffReason::StepAdded => "new".to_owned(),
        DiffReason::StepRemoved => "removed".to_owned(),
        DiffReason::Revision { old, new } => format!("revision {old} -> {new}"),
        DiffReason::Class { old, new } => {
            let text = |class: &Option<String>| class.clone().unwrap_or_else(|| "none".to_owned());
            format!("numerical class {} -> {}", text(old), text(new))
        }
        // The recipe has no edit, so another version of this program read the same text
        // differently.
        DiffReason::ParamsChanged if scene.recipe.is_empty() => {
            "parameters: another version of gs2e read the same recipe differently".to_owned()
        }
        DiffReason::ParamsChanged => "parameters".to_owned(),
        DiffReason::InputChanged { name, old, new } => {
            format!("input `{name}` changed: {} -> {}", brief(old), brief(new))
        }
        DiffReason::Nondeterministic => "same key, different bytes: the step is not deterministic".to_owned(),
        DiffReason::Untold => "different key; the releases do not state the reason".to_owned(),
    }
}
