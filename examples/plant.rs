//! Puts the files of an altered release into the store that made it, under the keys of the steps that made
//! the originals: `plant STORE RELEASE ALTERED`.
//!
//! `tests/hostile/planted.py` shows with it that `gs2e release` finds the same faults before anything is
//! written as `gs2e check --tree` finds in the files.

use gs2e::release::{ManifestStep, ReleaseManifest};
use gs2e::store::record::{StepProvenance, StepRecord};
use gs2e::store::{Digest, Key, Store, StoreAccess, StoreError, StoreOptions};
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
    // A key with intact outputs keeps them. All go before any is published: two steps may exchange theirs.
    for digest in changed.keys() {
        let place = store.path_of(digest);
        if place.exists() {
            fs::remove_file(place)?;
        }
    }
    let steps = manifest.scenes.iter().flat_map(|scene| &scene.steps);
    for step in steps.filter(|step| step.outputs.iter().any(|output| changed.contains_key(&output.digest))) {
        replace_outputs(&store, step, &changed)?;
    }
    store.flush()?;
    Ok(())
}

/// Publishes the outputs of a step once more, with the changed bytes.
fn replace_outputs(
    store: &Store,
    step: &ManifestStep,
    changed: &BTreeMap<Digest, Vec<u8>>,
) -> Result<(), Failure> {
    let workspace = store.workspace()?;
    for output in &step.outputs {
        let to = workspace.path().join(&output.name);
        fs::create_dir_all(to.parent().unwrap_or(Path::new(".")))?;
        match changed.get(&output.digest) {
            Some(bytes) => fs::write(to, bytes)?,
            None => drop(fs::copy(store.path_of(&output.digest), to)?),
        }
    }
    let record = StepRecord::new(Key(step.key), &step.stage, Vec::new(), StepProvenance::default());
    match store.publish(&workspace, record) {
        // The lost outputs were other ones.
        Err(StoreError::Nondeterministic(mismatch)) if mismatch.replaced => Ok(()),
        other => Ok(other.map(drop)?),
    }
}
