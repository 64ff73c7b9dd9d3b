//! Comparison of scenes of a release, byte for byte, with the same scenes made again from their
//! recipes.

use super::{AuditFault, FaultCode};
use gs2e_release::diff::{DiffReason, change_reasons};
use gs2e_release::manifest::{KeyIngredients, ManifestScene, ReleaseManifest};
use gs2e_release::{ManifestStep, checksum, loader, manifest};
use gs2e_tree::TreeError;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Reads the manifest of a release.
///
/// # Errors
/// The manifest is absent or of another form.
pub fn read_manifest(dir: &Path) -> Result<ReleaseManifest, TreeError> {
    gs2e_tree::read_manifest(dir)
}

/// Compares the files of one scene in two releases, where the second was made now. Reports files
/// that differ, and files that only one of the releases has.
///
/// # Errors
/// A manifest cannot be read, or does not have the scene. A file that cannot be read is a fault.
pub fn compare_scenes(dir: &Path, rebuilt: &Path, scene: &str) -> Result<Vec<AuditFault>, TreeError> {
    let [stated, made] = [read_manifest(dir)?, read_manifest(rebuilt)?];
    let (stated, made) = (of_scene(&stated, scene, dir)?, of_scene(&made, scene, rebuilt)?);
    let because = key_cause(stated, made);
    let fault = |path: &str, what: &str| {
        AuditFault::of_file(FaultCode::RebuiltDiffers, path, format!("{what}{because}")).in_scene(scene)
    };
    let sizes = |scene: &ManifestScene| -> BTreeMap<String, u64> {
        scene.files.iter().map(|file| (file.path.clone(), file.size)).collect()
    };
    let (listed, there) = (sizes(stated), sizes(made));
    let mut faults = Vec::new();
    for path in listed.keys().filter(|path| !there.contains_key(*path)) {
        faults.push(fault(path, "the rebuilt scene does not have this file"));
    }
    for path in there.keys().filter(|path| !listed.contains_key(*path)) {
        faults.push(fault(path, "only the rebuilt scene has this file"));
    }
    for path in listed.keys().filter(|path| there.contains_key(*path)) {
        // The bytes themselves are hashed, since digests in a manifest are only claims.
        let both = [dir, rebuilt].map(|dir| checksum::hash_file(&dir.join(path)));
        match both {
            [Ok(a), Ok(b)] if a == b => {}
            [Ok(_), Ok(_)] => faults.push(fault(path, "its bytes differ after a rebuild")),
            _ => faults.push(fault(path, "it cannot be read")),
        }
    }
    faults.extend(steps(stated, made));
    if (&stated.left_out, &stated.omitted) != (&made.left_out, &made.omitted) {
        let message = "the rebuilt scene skips other work";
        faults.push(AuditFault::of_file(FaultCode::RebuiltDiffers, manifest::NAME, message).in_scene(scene));
    }
    Ok(faults)
}

/// Compares the files at the top of two releases, where the second was made now. They follow from
/// all scenes, so they are compared only if the second release has all of them. The publisher's
/// words and the loader are always compared.
///
/// # Errors
/// A manifest cannot be read.
pub fn compare_tops(dir: &Path, rebuilt: &Path) -> Result<Vec<AuditFault>, TreeError> {
    let [stated, made] = [read_manifest(dir)?, read_manifest(rebuilt)?];
    let fault = |path: &str, message: &str| AuditFault::of_file(FaultCode::RebuiltDiffers, path, message);
    let words =
        |of: &ReleaseManifest| (of.name.clone(), of.version.clone(), of.publisher.clone(), of.splits.clone());
    let mut faults = Vec::new();
    if words(&stated) != words(&made) {
        faults.push(fault(
            manifest::NAME,
            "release.yaml has changed: its statements or splits differ from the release",
        ));
    }
    let ids = |of: &ReleaseManifest| of.scenes.iter().map(|scene| scene.id.clone()).collect::<Vec<_>>();
    let absent = |of: &ReleaseManifest| (of.taken_down, of.held_back.clone());
    let whole = ids(&stated) == ids(&made) && absent(&stated) == absent(&made);
    let paths = |of: &ReleaseManifest| of.files.iter().map(|file| file.path.clone()).collect::<BTreeSet<_>>();
    for path in paths(&stated).union(&paths(&made)).filter(|path| whole || *path == loader::NAME) {
        let both = [dir, rebuilt].map(|dir| checksum::hash_file(&dir.join(path)));
        match both {
            [Ok(a), Ok(b)] if a == b => {}
            [Ok(_), Ok(_)] => faults.push(fault(path, "its bytes differ after a rebuild")),
            [Err(_), Ok(_)] => faults.push(fault(path, "only the rebuilt release has this file")),
            _ => faults.push(fault(path, "the rebuilt release does not have this file")),
        }
    }
    Ok(faults)
}

/// Reports steps whose key or outputs differ from those of the scene made again.
fn steps(stated: &ManifestScene, made: &ManifestScene) -> Vec<AuditFault> {
    let names: BTreeSet<&String> = stated.steps.iter().chain(&made.steps).map(|step| &step.step).collect();
    let find =
        |of: &'_ ManifestScene, name: &String| of.steps.iter().find(|step| step.step == *name).cloned();
    let differs = |name: &&String| {
        let (stated, made) = (find(stated, name), find(made, name));
        let statement =
            |step: &ManifestStep| (step.stage.clone(), step.key, step.made_of.clone(), step.outputs.clone());
        stated.as_ref().map(statement) != made.as_ref().map(statement)
    };
    let because = key_cause(stated, made);
    let fault = |name: &String| {
        let message = format!("the rebuilt step {name} has another key or other outputs{because}");
        AuditFault::of_file(FaultCode::RebuiltDiffers, manifest::NAME, message).in_scene(&stated.id)
    };
    names.into_iter().filter(differs).map(fault).collect()
}

fn of_scene<'a>(
    manifest: &'a ReleaseManifest,
    scene: &str,
    dir: &Path,
) -> Result<&'a ManifestScene, TreeError> {
    let found = manifest.scenes.iter().find(|listed| listed.id == scene);
    found.ok_or_else(|| TreeError::new(dir.join(manifest::NAME), format!("it has no scene `{scene}`")))
}

/// Describes the ingredients that differ in the first step with another key. If all keys are the
/// same the text says so: the difference is then in the making.
fn key_cause(stated: &ManifestScene, made: &ManifestScene) -> String {
    let other = |step: &&ManifestStep| {
        let other = made.steps.iter().find(|other| other.step == step.step);
        other.is_none_or(|other| other.key != step.key)
    };
    let Some(step) = stated.steps.iter().find(other) else {
        return ", although every step has the same key".into();
    };
    let other = made.steps.iter().find(|other| other.step == step.step);
    match (other, &step.made_of) {
        (None, _) => format!("; the recipe no longer has step {}", step.step),
        (Some(other), Some(then)) => match &other.made_of {
            Some(now) => format!("; its step {} differs in {}", step.step, differing_line(then, now)),
            None => String::new(),
        },
        (Some(_), None) => format!("; its step {} has another key", step.step),
    }
}

fn differing_line(then: &KeyIngredients, now: &KeyIngredients) -> String {
    let text = |reason: &DiffReason| match reason {
        DiffReason::Revision { old, new } => format!("the revision of its stage ({new}, previously {old})"),
        DiffReason::Class { old, new } => {
            let [old, new] = [old, new].map(|class| class.as_deref().unwrap_or("none"));
            format!("the numerical class ({new}, previously {old})")
        }
        DiffReason::ParamsChanged => "its parameters".to_owned(),
        DiffReason::InputChanged { name, .. } => format!("the input {name}"),
        _ => "something else".to_owned(),
    };
    change_reasons(then, now).iter().map(text).collect::<Vec<_>>().join(", ")
}
