//! A careful forger: rewrites every digest in a release after a change, so that only the files'
//! contents show it.

use gs2e_release::{ManifestFile, ManifestScene, ReleaseManifest, SceneRecord};
use gs2e_store::Digest;
use gs2e_store::record::{StoredOutput, content_digest};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use sha2::{Digest as _, Sha256};
use std::collections::BTreeMap;
use std::path::Path;

/// All files below a folder by path.
pub(crate) fn read(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let files = walkdir::WalkDir::new(folder).into_iter().map(Result::unwrap);
    let files = files.filter(|entry| entry.file_type().is_file());
    let below = |path: &Path| path.strip_prefix(folder).unwrap().to_str().unwrap().to_owned();
    files.map(|entry| (below(entry.path()), std::fs::read(entry.path()).unwrap())).collect()
}

/// Writes JSON as the program does: indented, with a final newline.
pub(crate) fn write_json(path: &Path, value: &impl Serialize) {
    let mut bytes = serde_json::to_vec_pretty(value).unwrap();
    bytes.push(b'\n');
    std::fs::write(path, bytes).unwrap();
}

/// Changes a JSON file, and keeps the order of keys of its format.
pub(crate) fn edit(folder: &Path, path: &str, change: impl FnOnce(&mut Value)) {
    let place = folder.join(path);
    let mut value: Value = serde_json::from_slice(&std::fs::read(&place).unwrap()).unwrap();
    change(&mut value);
    let written = match path.rsplit('/').next().unwrap() {
        "manifest.json" => write_as::<ReleaseManifest>(&place, &value),
        "scene.json" => write_as::<SceneRecord>(&place, &value),
        "checks.json" => write_as::<Vec<gs2e_check::Finding>>(&place, &value),
        "speed.json" => write_as::<gs2e_trajectory::report::SpeedReport>(&place, &value),
        _ => false,
    };
    if !written {
        write_json(&place, &value);
    }
}

fn write_as<T: DeserializeOwned + Serialize>(path: &Path, value: &Value) -> bool {
    let typed: Option<T> = serde_json::from_value(value.clone()).ok();
    typed.inspect(|typed| write_json(path, typed)).is_some()
}

/// Rewrites `manifest.json` with its steps, the sum in `croissant.json`, `B3SUMS` and `SHA256SUMS`.
pub(crate) fn reseal(folder: &Path) {
    let manifest = folder.join("manifest.json");
    let typed =
        std::fs::read(&manifest).ok().and_then(|b| serde_json::from_slice::<ReleaseManifest>(&b).ok());
    if let Some(mut typed) = typed {
        reseal_index(folder, &typed);
        reseal_manifest(folder, &mut typed);
        write_json(&manifest, &typed);
    }
    reseal_sums(folder);
}

/// Rewrites `B3SUMS` and `SHA256SUMS`.
pub(crate) fn reseal_sums(folder: &Path) {
    let listed = read(folder).into_iter().filter(|(path, _)| path != "B3SUMS" && path != "SHA256SUMS");
    let line = |(path, bytes): (String, Vec<u8>)| format!("{}  {path}\n", blake3::hash(&bytes).to_hex());
    std::fs::write(folder.join("B3SUMS"), listed.map(line).collect::<String>()).unwrap();
    resum(folder);
}

/// Rewrites `SHA256SUMS`.
pub(crate) fn resum(folder: &Path) {
    let files = read(folder).into_iter().filter(|(path, _)| path != "SHA256SUMS");
    let text: String = files.map(|(path, bytes)| format!("{}  {path}\n", sha256(&bytes))).collect();
    std::fs::write(folder.join("SHA256SUMS"), text).unwrap();
}

fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect()
}

/// Updates sum and size in `croissant.json` of an index that was changed.
fn reseal_index(folder: &Path, manifest: &ReleaseManifest) {
    let (Ok(index), Ok(text)) =
        (std::fs::read(folder.join("index.parquet")), std::fs::read(folder.join("croissant.json")))
    else {
        return;
    };
    let stated = manifest.files.iter().find(|file| file.path == "index.parquet");
    if stated.is_none_or(|file| file.blake3 == Digest::of_bytes(&index)) {
        return;
    }
    let Ok(mut value) = serde_json::from_slice::<Value>(&text) else { return };
    let node = value.pointer_mut("/distribution/0").filter(|node| node["@id"] == "index.parquet");
    let Some(node) = node else { return };
    (node["sha256"], node["contentSize"]) = (sha256(&index).into(), format!("{} B", index.len()).into());
    write_json(&folder.join("croissant.json"), &value);
}

fn reseal_manifest(folder: &Path, manifest: &mut ReleaseManifest) {
    let mut files = read(folder);
    files.retain(|path, _| !["SHA256SUMS", "B3SUMS", "manifest.json"].contains(&path.as_str()));
    for scene in &mut manifest.scenes {
        reseal_steps(scene, &files);
        let prefix = format!("{}/", scene.id);
        let below = files.keys().filter(|path| path.starts_with(&prefix)).cloned().collect::<Vec<_>>();
        scene.files = below.into_iter().map(|path| listed(&path, &files.remove(&path).unwrap())).collect();
    }
    manifest.files = files.iter().map(|(path, bytes)| listed(path, bytes)).collect();
}

fn listed(path: &str, bytes: &[u8]) -> ManifestFile {
    ManifestFile { path: path.to_owned(), size: bytes.len() as u64, blake3: Digest::of_bytes(bytes) }
}

/// Updates outputs to the digests of the released files, inputs to those of the outputs, and then
/// the keys.
fn reseal_steps(scene: &mut ManifestScene, files: &BTreeMap<String, Vec<u8>>) {
    let contents = |scene: &ManifestScene| -> Vec<Digest> {
        scene.steps.iter().map(|step| content_digest(&step.outputs)).collect()
    };
    let before = contents(scene);
    for step in &mut scene.steps {
        let Some((trajectory, kind)) = step.step.rsplit_once('/') else {
            reseal_scene(&scene.id, &mut step.outputs, files);
            continue;
        };
        let folder = format!("{}/{trajectory}", scene.id);
        let released = released(&folder, kind, files);
        let is_there = |output: &StoredOutput| released.iter().any(|other| other.name == output.name);
        let whole = files.keys().any(|path| path.starts_with(&format!("{folder}/sharp/")));
        // Outputs that are not released stay. In a withheld scene, those are most.
        step.outputs.retain(|output| !whole || !is_released(kind, &output.name) || is_there(output));
        for output in released {
            match step.outputs.iter_mut().find(|other| other.name == output.name) {
                Some(other) => *other = output,
                None => step.outputs.push(output),
            }
        }
        step.outputs.sort();
    }
    let after: BTreeMap<Digest, Digest> = before.into_iter().zip(contents(scene)).collect();
    for step in &mut scene.steps {
        let stage = step.stage.clone();
        if let Some(of) = &mut step.made_of {
            of.inputs.values_mut().for_each(|digest| *digest = after.get(digest).copied().unwrap_or(*digest));
            step.key = of.key(&stage);
        }
    }
}

/// Updates the only released output of the steps of a scene itself.
fn reseal_scene(scene: &str, outputs: &mut Vec<StoredOutput>, files: &BTreeMap<String, Vec<u8>>) {
    const PICTURE: &str = "held_out.png";
    let now = files.get(&format!("{scene}/{PICTURE}"));
    outputs.retain(|output| output.name != PICTURE || now.is_some());
    for (output, bytes) in outputs.iter_mut().filter(|output| output.name == PICTURE).zip(now) {
        (output.digest, output.size) = (Digest::of_bytes(bytes), bytes.len() as u64);
    }
}

/// Returns true if a step's file is released.
fn is_released(kind: &str, name: &str) -> bool {
    match kind {
        "trajectory" => true,
        "events" => name.ends_with(".h5"),
        "sharp" | "blur" | "checks" => name.ends_with(".png"),
        "depth" | "flow" | "disparity" => name.ends_with(".npy"),
        "segmentation" | "imu" => true,
        _ => false,
    }
}

/// The outputs of a step that are in the trajectory's folder.
fn released(folder: &str, kind: &str, files: &BTreeMap<String, Vec<u8>>) -> Vec<StoredOutput> {
    let below = |prefix: String| {
        files.iter().filter_map(move |(path, bytes)| Some((path.strip_prefix(&prefix)?.to_owned(), bytes)))
    };
    let output = |(name, bytes): (String, &Vec<u8>)| StoredOutput {
        name,
        digest: Digest::of_bytes(bytes),
        size: bytes.len() as u64,
    };
    match kind {
        "trajectory" => {
            let own = ["poses.txt", "speed.json", "timestamps_us.txt", "trajectory.svg"];
            below(format!("{folder}/")).filter(|(name, _)| own.contains(&name.as_str())).map(output).collect()
        }
        "events" => {
            let one = below(format!("{folder}/")).filter(|(name, _)| name == "events.h5");
            let named =
                below(format!("{folder}/events/")).map(|(name, bytes)| (format!("events-{name}"), bytes));
            one.chain(named).map(output).collect()
        }
        "sharp" | "blur" | "depth" | "flow" | "checks" | "disparity" | "segmentation" | "imu" => {
            below(format!("{folder}/{kind}/"))
                .filter(|(name, _)| is_released(kind, name))
                .map(output)
                .collect()
        }
        _ => Vec::new(),
    }
}
