//! Puts the files of an altered release into the store that made it, under the keys of the steps that made
//! the originals: `plant STORE RELEASE ALTERED`.
//!
//! `tests/hostile/planted.py` shows with it that `gs2e release` finds the same faults before anything is
//! written as `gs2e check --tree` finds in the files.

use gs2e_release::{ManifestStep, ReleaseManifest};
use gs2e_store::record::{StepProvenance, StepRecord, StoredOutput};
use gs2e_store::{Digest, Key, Store, StoreAccess, StoreError, StoreOptions};
use std::collections::BTreeMap;
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};

type Failure = Box<dyn Error>;

fn main() -> Result<(), Failure> {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [store, release, altered] = arguments.as_slice() else {
        return Err("usage: plant STORE RELEASE ALTERED".into());
    };
    let store = Store::open(store, StoreOptions::from(StoreAccess::Write), &mut |_| {})?;
    let manifest: ReleaseManifest = serde_json::from_slice(&fs::read(release.join("manifest.json"))?)?;
    let files = manifest.scenes.iter().flat_map(|scene| &scene.files);
    let mut changed = BTreeMap::new();
    for file in files {
        let bytes = fs::read(altered.join(&file.path))?;
        if Digest::of_bytes(&bytes) != file.blake3 {
            changed.insert(file.blake3, bytes);
        }
    }
    let steps = manifest.scenes.iter().flat_map(|scene| &scene.steps);
    let is_altered = |step: &&ManifestStep| step.outputs.iter().any(|o| changed.contains_key(&o.digest));
    let altered: Vec<&ManifestStep> = steps.filter(is_altered).collect();
    // By way of bytes that no other step has, since two steps may exchange theirs.
    for step in &altered {
        replace_outputs(&store, step, |output| {
            changed.contains_key(&output.digest).then(|| (output.digest, own(step, output)))
        })?;
    }
    for step in &altered {
        replace_outputs(&store, step, |output| {
            let bytes = changed.get(&output.digest)?.clone();
            Some((Digest::of_bytes(&own(step, output)), bytes))
        })?;
    }
    store.flush()?;
    Ok(())
}

/// Bytes that only this output of this step has.
fn own(step: &ManifestStep, output: &StoredOutput) -> Vec<u8> {
    format!("{} {}", step.key, output.name).into_bytes()
}

/// Publishes the outputs of a step once more. `change` returns the digest of the bytes that an output has,
/// and new ones; `None` keeps them.
fn replace_outputs(
    store: &Store,
    step: &ManifestStep,
    change: impl Fn(&StoredOutput) -> Option<(Digest, Vec<u8>)>,
) -> Result<(), Failure> {
    let workspace = store.workspace()?;
    let mut lost = Vec::new();
    for output in &step.outputs {
        let to = workspace.path().join(&output.name);
        fs::create_dir_all(to.parent().unwrap_or(Path::new(".")))?;
        if let Some((digest, bytes)) = change(output) {
            fs::write(to, bytes)?;
            lost.push(store.path_of(&digest));
        } else {
            fs::copy(store.path_of(&output.digest), to)?;
        }
    }
    // A key with intact outputs keeps them.
    for place in lost.iter().filter(|place| place.exists()) {
        fs::remove_file(place)?;
    }
    let record = StepRecord::new(Key(step.key), &step.stage, Vec::new(), StepProvenance::default());
    match store.publish(&workspace, record) {
        // The lost outputs were other ones.
        Err(StoreError::Nondeterministic(mismatch)) if mismatch.replaced => Ok(()),
        other => Ok(other.map(drop)?),
    }
}
