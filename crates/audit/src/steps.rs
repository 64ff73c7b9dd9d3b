//! The steps of the manifest. Each key is that of its ingredients. Each input was made by a step of
//! the scene. Each file that a step made has the bytes of its output.

use super::{AuditFault, FaultCode};
use gs2e_release::manifest::{ManifestFile, ManifestScene, ReleaseManifest};
use gs2e_release::products::is_metadata;
use gs2e_release::published::stream_names;
use gs2e_release::scene::SceneRecord;
use gs2e_release::{calibration, layout, manifest};
use gs2e_store::Digest;
use gs2e_store::record::{StoredOutput, content_digest};
use std::collections::{BTreeMap, BTreeSet};

/// Prefix of the role of an input that is a file of the source.
const SOURCE: &str = "file ";

pub(super) fn audit(
    manifest: &ReleaseManifest,
    listed: &ManifestScene,
    scene: &SceneRecord,
) -> Vec<AuditFault> {
    let mut faults = keys(listed);
    faults.extend(outputs(listed, scene));
    // Releases of other versions may lack the ingredients.
    if manifest.tool == gs2e_release::TOOL {
        let silent = listed.steps.iter().filter(|step| step.made_of.is_none());
        faults.extend(silent.map(|step| fault(listed, format!("step {} lacks its ingredients", step.step))));
    }
    faults
}

fn fault(listed: &ManifestScene, message: String) -> AuditFault {
    AuditFault::of_file(FaultCode::StepDisagrees, manifest::NAME, message).in_scene(&listed.id)
}

fn keys(listed: &ManifestScene) -> Vec<AuditFault> {
    let made: BTreeSet<Digest> = listed.steps.iter().map(|step| content_digest(&step.outputs)).collect();
    let mut faults = Vec::new();
    for (step, of) in listed.steps.iter().filter_map(|step| Some((step, step.made_of.as_ref()?))) {
        let key = of.key(&step.stage);
        if key != step.key {
            faults.push(fault(
                listed,
                format!("the key of step {} is {}, its ingredients give {key}", step.step, step.key),
            ));
        }
        // A release holds no files of the source, so their digests cannot be checked.
        let unknown =
            of.inputs.iter().find(|(role, digest)| !role.starts_with(SOURCE) && !made.contains(digest));
        faults.extend(unknown.map(|(role, digest)| {
            fault(listed, format!("the input {role} of step {} is {digest}, which no step made", step.step))
        }));
    }
    faults
}

/// Compares the files that steps made with the manifest's own listing of the scene.
fn outputs(listed: &ManifestScene, scene: &SceneRecord) -> Vec<AuditFault> {
    let files: BTreeMap<&str, &ManifestFile> =
        listed.files.iter().map(|file| (file.path.as_str(), file)).collect();
    let mut faults = Vec::new();
    // A withheld scene has only those files that show nothing of it.
    let is_released = |name: &str| !scene.licence.withheld || is_metadata(name);
    let compare = |path: &str, output: &StoredOutput| match files.get(path) {
        Some(file) if file.blake3 == output.digest && file.size == output.size => None,
        Some(_) => Some(step_disagrees(path, "manifest.json lists other bytes than its step made")),
        None => Some(step_disagrees(path, "its step made it, but manifest.json does not list it")),
    };
    let own = layout::made_of_scene(|step| listed.scene_outputs(step)).filter(|of| is_released(of.0));
    faults.extend(own.and_then(|(name, output)| compare(&format!("{}/{name}", scene.id), output)));
    for part in &scene.trajectories {
        let made = layout::made(|step| listed.outputs(&part.name, step), &stream_names(part));
        let mut known = BTreeSet::new();
        for (name, output) in made.into_iter().filter(|(name, _)| is_released(name)) {
            let path = format!("{}/{}/{name}", scene.id, part.name);
            faults.extend(compare(&path, output));
            known.insert(path);
        }
        // The release composes these files, so they are outputs of no step.
        let composed = [layout::CHECKS, layout::TRANSFORMS, gs2e_release::path_picture::NAME]
            .map(str::to_owned)
            .into_iter()
            .chain(calibration::names(scene, part));
        let composed: BTreeSet<String> =
            composed.map(|name| format!("{}/{}/{name}", scene.id, part.name)).collect();
        let folder = format!("{}/{}/", scene.id, part.name);
        let own = files.keys().filter(|path| path.starts_with(&folder) && !composed.contains(**path));
        // The files of the cameras of a body are those of other trajectories.
        let cameras: Vec<String> = part.cameras.iter().map(|name| format!("{folder}{name}/")).collect();
        let own = own.filter(|path| !cameras.iter().any(|camera| path.starts_with(camera)));
        // Exports have keys of their own, outside of the steps.
        let own = own.filter(|path| !layout::is_export(&scene.id, path));
        let unmade = own.filter(|path| !known.contains(**path));
        faults.extend(unmade.map(|path| step_disagrees(path, "no step in manifest.json made it")));
    }
    faults.into_iter().map(|fault| fault.in_scene(&scene.id)).collect()
}

fn step_disagrees(path: &str, message: &str) -> AuditFault {
    AuditFault::of_file(FaultCode::StepDisagrees, path, message)
}
