//! Files that have no place in a release, even if the sums list them: the format names every file
//! that can exist.

use super::{AuditFault, FaultCode, TrustedTree, exports};
use gs2e_release::manifest::{FileOwners, ManifestScene, ReleaseManifest};
use gs2e_release::products::FOLDERS;
use gs2e_release::published::stream_names;
use gs2e_release::scene::{SceneRecord, TrajectoryPart};
use gs2e_release::{calibration, checksum, layout, path_picture};
use std::collections::{BTreeMap, BTreeSet};

/// Reports files at the top and in scenes that the format does not have, and required files at the
/// top that are absent. `scenes` are those that could be read; files of other scenes are not
/// judged.
pub(super) fn audit(
    tree: &TrustedTree<'_>,
    manifest: &ReleaseManifest,
    scenes: &[SceneRecord],
) -> Vec<AuditFault> {
    let owners = FileOwners::new(manifest);
    let allowed: BTreeMap<&str, BTreeSet<String>> =
        scenes.iter().map(|scene| (scene.id.as_str(), of_scene(tree, scene, &owners))).collect();
    let folders: BTreeMap<&str, Vec<String>> = scenes
        .iter()
        .map(|scene| {
            (scene.id.as_str(), exports::folders(manifest, scene).map(|place| place.folder).collect())
        })
        .collect();
    let exported = |id: &str, path: &'_ str| {
        folders.get(id)?.iter().find_map(|folder| path.strip_prefix(folder.as_str())).map(exports::may_have)
    };
    let mut faults: Vec<AuditFault> = Vec::new();
    for path in tree.intact.keys() {
        match owners.of(path) {
            None if !layout::is_top(path) => faults.push(stray(path, "at the top of a release")),
            Some(scene) if exported(&scene.id, path) == Some(true) => {}
            Some(scene) if exported(&scene.id, path).is_some() => {
                faults.push(stray(path, "in an export").in_scene(&scene.id));
            }
            Some(scene) if allowed.get(scene.id.as_str()).is_some_and(|paths| !paths.contains(*path)) => {
                faults.push(stray(path, "in this scene").in_scene(&scene.id));
            }
            _ => {}
        }
    }
    faults.extend(missing_files(tree));
    faults
}

/// Reports required files at the top that are absent.
pub(super) fn missing_files(tree: &TrustedTree<'_>) -> impl Iterator<Item = AuditFault> {
    // The audit of the sums and of the bytes reports the absence of these two.
    let others = [checksum::NAME, checksum::B3_NAME];
    let lacking = layout::top().filter(move |path| !others.contains(path) && !tree.has(path));
    let message = "every release has this file; it is missing or damaged";
    lacking.map(move |path| AuditFault::of_file(FaultCode::Missing, path, message))
}

fn stray(path: &str, place: &str) -> AuditFault {
    AuditFault::of_file(FaultCode::Stray, path, format!("the release format has no such file {place}"))
}

/// Returns every path that a scene can have.
fn of_scene(tree: &TrustedTree<'_>, scene: &SceneRecord, owners: &FileOwners<'_>) -> BTreeSet<String> {
    let listed = owners.scene(&scene.id);
    let made = listed.and_then(|listed| layout::made_of_scene(|step| listed.scene_outputs(step)));
    let own = [layout::SCENE, layout::CHECKS].into_iter().chain(made.map(|(name, _)| name));
    let own = own.map(|name| format!("{}/{name}", scene.id));
    let paths = scene.trajectories.iter().flat_map(|part| {
        let names = of_trajectory(tree, scene, part, listed);
        names.into_iter().map(|name| format!("{}/{}/{name}", scene.id, part.name))
    });
    own.chain(paths).collect()
}

/// Returns the names of the files that a trajectory can have: those of the format, those that its
/// recipe asks for, and the pictures of checks that its steps made.
fn of_trajectory(
    tree: &TrustedTree<'_>,
    scene: &SceneRecord,
    part: &TrajectoryPart,
    listed: Option<&ManifestScene>,
) -> BTreeSet<String> {
    let streams = stream_names(part);
    let outputs = |step: &str| listed.map_or(&[][..], |listed| listed.outputs(&part.name, step));
    let made = layout::made(outputs, &streams);
    let pictures = super::contents::pictures_wanted(tree, scene, part);
    let composed = [layout::CHECKS, layout::TRANSFORMS, path_picture::NAME].into_iter().chain(layout::MOTION);
    let is_counted =
        |name: &String| FOLDERS.iter().any(|product| name.starts_with(&format!("{}/", product.name())));
    // Poses and recipe give the number of pictures. Without poses every output of a step is
    // accepted.
    let uncounted = !tree.has(&format!("{}/{}/poses.txt", scene.id, part.name));
    let made = made.into_keys().filter(|name| uncounted || !is_counted(name));
    let calibration = calibration::names(scene, part);
    composed.map(str::to_owned).chain(calibration).chain(pictures).chain(made).collect()
}
