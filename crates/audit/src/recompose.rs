//! Composes files once more from the others and compares them byte for byte: everything that people
//! read or run. The composers are those that write a release.

mod compared;
mod products;

use super::{AuditFault, FaultCode, TrustedTree};
use gs2e_build::artifact::TrajectoryProduct;
use gs2e_files as files;
use gs2e_files::LinkRule;
use gs2e_release::composed::FileContent;
use gs2e_release::diff::{ValueChange, value_changes};
use gs2e_release::facts::ReleaseFacts;
use gs2e_release::manifest::{ManifestFile, ManifestScene, ReleaseManifest};
use gs2e_release::products::SHARP;
use gs2e_release::published::{PublishedScene, PublishedTrajectory};
use gs2e_release::scene::{SceneRecord, TrajectoryPart};
use gs2e_release::{calibration, checksum, layout, loader, manifest, path_picture, published, scene};
use gs2e_trajectory::picture;
use gs2e_trajectory::sample::PoseSchedule;
use gs2e_trajectory::speed::SpeedChoice;
use gs2e_tree::{TrajectoryFiles, TreeError, json_of};
use serde_json::Value;
use std::path::Path;
use std::sync::Arc;

/// Reads a scene back from its files. Returns `None` if one of them cannot be read, which other
/// parts of the audit report.
pub(super) fn read(
    tree: &TrustedTree<'_>,
    listed: &ManifestScene,
    file: &SceneRecord,
    faults: &mut Vec<AuditFault>,
) -> Option<PublishedScene> {
    let path = |name: &str| format!("{}/{name}", file.id);
    let recipe = match published::recipe(file) {
        Ok(recipe) => recipe,
        Err(e) => {
            let message = format!("the recipe in it cannot be read: {e}");
            faults.push(
                AuditFault::of_file(FaultCode::Unreadable, &path(layout::SCENE), message).in_scene(&file.id),
            );
            return None;
        }
    };
    let names = |names: Vec<&str>| names.join(", ");
    let asked = names(recipe.trajectories.iter().map(|asked| asked.name.as_str()).collect());
    let found = names(file.trajectories.iter().map(|part| part.name.as_str()).collect());
    if asked != found {
        let message = format!("its trajectories are {found}, its own recipe has {asked}");
        faults.push(
            AuditFault::of_file(FaultCode::ClaimsDisagree, &path(layout::SCENE), message).in_scene(&file.id),
        );
        return None;
    }
    let own = path(layout::CHECKS);
    // Not every scene has checks of its own; `contents` reports where they are missing.
    let findings = if tree.has(&own) { Some(json_of(&tree, &own).ok()?) } else { None };
    let of = |part: &TrajectoryPart| -> Option<PublishedTrajectory> {
        let files = files_of(tree, file, part).ok()?;
        Some(PublishedTrajectory {
            motion: TrajectoryProduct { trajectory: files.poses().ok()?, report: files.speeds().ok()? },
            findings: files.json(layout::CHECKS).ok()?,
            left_out: listed.omitted.get(&part.name).cloned().unwrap_or_default(),
        })
    };
    let trajectories = file.trajectories.iter().map(of).collect::<Option<_>>()?;
    let licence = published::terms(&recipe, file.licence.redistribution.as_deref());
    let is_own = |file: &&ManifestFile| !layout::is_export(&listed.id, &file.path);
    let files = listed.files.iter().filter(is_own).cloned().collect();
    Some(PublishedScene { recipe, licence, file: file.clone(), findings, trajectories, files })
}

/// The files of a trajectory.
pub(super) fn files_of<'a>(
    tree: &'a TrustedTree<'_>,
    scene: &SceneRecord,
    part: &TrajectoryPart,
) -> Result<TrajectoryFiles<'a>, TreeError> {
    TrajectoryFiles::new(Arc::new(tree), &scene.id, &part.name, scene.camera_of(part).camera())
}

/// Returns the faults of a scene's own files, as they follow from each other.
pub(super) fn scene(
    tree: &TrustedTree<'_>,
    listed: &ManifestScene,
    scene: &PublishedScene,
) -> Vec<AuditFault> {
    let id = &scene.file.id;
    let mut faults = described(scene);
    for (part, of) in scene.paths() {
        let path = |name: &str| format!("{id}/{}/{name}", part.name);
        faults.extend(
            trajectory(tree, scene, part, &of.motion)
                .into_iter()
                .filter_map(|(name, wanted)| compare(tree, &path(&name), &wanted)),
        );
        faults.extend(products::faults(tree, scene, part, &of.motion));
    }
    faults.extend(counts(listed, scene));
    faults.into_iter().map(|fault| fault.in_scene(id)).collect()
}

/// Returns the values of `scene.json` that its recipe and the other files contradict.
fn described(scene: &PublishedScene) -> Vec<AuditFault> {
    // Maximum number of listed differences: many values follow from one wrong value of a recipe.
    const MAX_LISTED: usize = 8;
    let mut files = [scene.file.clone(), scene::recompose(scene)];
    // As values, the list of photos takes ten times its memory, and mostly it was copied.
    if files[0].images == files[1].images {
        files.iter_mut().for_each(|file| file.images.clear());
    }
    let [found, wanted] = files.map(|file| serde_json::to_value(file).expect("a description is plain data"));
    let path = format!("{}/{}", scene.file.id, layout::SCENE);
    let fault = |message: String| AuditFault::of_file(FaultCode::NotComposed, &path, message);
    let differences = value_changes(&found, &wanted);
    if differences.is_empty() && found != wanted {
        return vec![fault(
            "its lists have another order than the recipe and the other files give".to_owned(),
        )];
    }
    let shown = |value: &Option<Value>| brief(&value.as_ref().unwrap_or(&Value::Null).to_string());
    let differs = |ValueChange { path, old, new }: ValueChange| {
        let (found, wanted) = (shown(&old), shown(&new));
        fault(format!("its {path} is {found}, the recipe and the other files give {wanted}"))
    };
    differences.into_iter().take(MAX_LISTED).map(differs).collect()
}

/// Composes the files of a trajectory that follow from its poses, its speeds and `scene.json`.
fn trajectory(
    tree: &TrustedTree<'_>,
    scene: &PublishedScene,
    part: &TrajectoryPart,
    motion: &TrajectoryProduct,
) -> Vec<(String, Vec<u8>)> {
    let text = |write: &dyn Fn(&mut Vec<u8>) -> std::io::Result<()>| {
        let mut bytes = Vec::new();
        write(&mut bytes).expect("a Vec takes any bytes");
        bytes
    };
    let camera = scene.file.camera_of(part).camera();
    let frames = SHARP.name();
    let sharp = scene.in_folder(&part.name, frames).filter_map(|path| path.rsplit('/').next());
    // The tree lacks the frames of a withheld scene, but its `transforms.json` lists their poses.
    let planned = super::contents::pictures_planned(tree, &scene.file, part);
    let planned = planned.iter().filter_map(|name| name.strip_prefix(frames)?.strip_prefix('/'));
    let sharp: Vec<&str> = if scene.is_withheld() { planned.collect() } else { sharp.collect() };
    let readout_us = scene.recipe.readout_us;
    let transforms = gs2e_release::published::transforms_of(&camera, part, readout_us, motion, &sharp);
    // The path of a camera follows from that of its body.
    let carried = scene.recipe.mounted(&part.name).and_then(|mounted| {
        let (_, body) = scene.paths().find(|(other, _)| other.name == mounted.body)?;
        Some(body.motion.trajectory.of_mounted(&mounted.camera.mount))
    });
    let path = carried.as_ref().unwrap_or(&motion.trajectory);
    let calibration = calibration::compose(&scene.recipe, &scene.file, part);
    let mut wanted: Vec<(String, Vec<u8>)> = calibration.into_iter().collect();
    let mut want = |name: &str, bytes: Vec<u8>| wanted.push((name.to_owned(), bytes));
    want("poses.txt", text(&|out| path.write_poses(out)));
    want("timestamps_us.txt", text(&|out| path.write_stamps(out)));
    if part.cameras.is_empty() {
        want(layout::TRANSFORMS, FileContent::json_bytes(&transforms));
    }
    let asked = scene.recipe.trajectories.iter().find(|asked| asked.name == part.name);
    // A speed in pixels depends on the rendered scene, so the tree alone does not give its
    // schedule.
    let known = asked.filter(|asked| !matches!(asked.speed, SpeedChoice::Flow(_)));
    let poses = &motion.trajectory.world_from_camera;
    let law = scene.recipe.law;
    let schedule = known.and_then(|asked| PoseSchedule::new(&asked.speed, poses.len(), law).ok());
    let speed = motion.report.remeasured(poses, schedule.as_ref());
    // No trajectory of these poses has a report with another number of steps. The report cannot be
    // drawn, and the empty bytes wanted here make it a fault.
    let Some(speed) = speed else {
        want("speed.json", Vec::new());
        return wanted;
    };
    want("speed.json", FileContent::json_bytes(&speed));
    want("trajectory.svg", picture::trajectory_svg(&motion.trajectory, &motion.report).into_bytes());
    path_picture::compose_picture(motion).into_iter().for_each(|picture| want(path_picture::NAME, picture));
    wanted
}

/// Compares the manifest's counts of a scene's findings with the findings.
fn counts(listed: &ManifestScene, scene: &PublishedScene) -> Vec<AuditFault> {
    let findings = || scene.trajectories.iter().flat_map(|trajectory| &trajectory.findings);
    let mut faults = Vec::new();
    let mut fault = |what: &str| {
        let message = format!("its {what} of {} do not match the files of the scene", listed.id);
        faults.push(AuditFault::of_file(FaultCode::NotComposed, manifest::NAME, message));
    };
    if listed.checks != manifest::verdicts(findings()) {
        fault("verdicts");
    }
    if listed.waivers != manifest::waivers(findings()) {
        fault("waivers");
    }
    // The rows come from records that stay in the store, so only the trajectories are compared.
    let names = |map: Vec<&String>| map.into_iter().cloned().collect::<std::collections::BTreeSet<_>>();
    let known = scene.file.trajectories.iter().map(|part| &part.name).collect();
    if names(listed.omitted.keys().collect()) != names(known) {
        fault("trajectories under omitted");
    }
    faults
}

/// Compares the files at the top that follow from the scenes. All scenes must be given.
pub(super) fn top(
    tree: &TrustedTree<'_>,
    manifest: &ReleaseManifest,
    scenes: &[PublishedScene],
) -> Vec<AuditFault> {
    let Some(info) = manifest.info() else {
        let message = "it lacks the field `publisher`, which this version writes";
        return vec![AuditFault::of_file(FaultCode::NotComposed, manifest::NAME, message)];
    };
    let licence = gs2e_release::top::terms_of(scenes);
    let (taken_down, held_back) = (manifest.taken_down, manifest.held_back.as_slice());
    let facts = ReleaseFacts { scenes, info: &info, taken_down, held_back, licence: &licence };
    let composed = gs2e_release::top::compose_top(&facts, &|path| tree.intact_path(path));
    let compare = |(path, content): (String, FileContent)| match content {
        FileContent::Bytes(bytes) => compare(tree, &path, &bytes),
        // Files at the top are composed; none of them is a blob.
        FileContent::Blob { .. } => None,
    };
    composed.into_files().into_iter().filter_map(compare).collect()
}

/// Compares the loader and the licence texts of the SPDX list, which are the same for all scenes.
pub(super) fn constants(tree: &TrustedTree<'_>) -> Vec<AuditFault> {
    let ids = tree.intact.keys().filter_map(|path| layout::licence_id(path));
    // A text that is not on the list names the holders, who follow from the scenes.
    let listed = ids.filter(|id| gs2e_source::licence::is_listed(id));
    let texts =
        listed.map(|id| (layout::licence_text(id), gs2e_source::licence::licence_text(id, &[]).into_bytes()));
    let loader = [(loader::NAME.to_owned(), loader::TEXT.as_bytes().to_vec())];
    texts.chain(loader).filter_map(|(path, wanted)| compare(tree, &path, &wanted)).collect()
}

/// Compares a JSON file with its one spelling, which is that of the value that was read.
pub(super) fn spelling<T: serde::Serialize>(
    tree: &TrustedTree<'_>,
    path: &str,
    value: &T,
) -> Option<AuditFault> {
    compare(tree, path, &FileContent::json_bytes(value))
}

/// Compares a file with the wanted bytes. Returns `None` for a file that is absent or not whole,
/// which is another fault.
fn compare(tree: &TrustedTree<'_>, path: &str, wanted: &[u8]) -> Option<AuditFault> {
    let found = tree.intact.get(path)?;
    // The hash of the first pass is enough for equal files; a different one is read again to name the place.
    if *found == checksum::sha256_hex(wanted) {
        return None;
    }
    let place = first_difference(&tree.path_of(path), wanted);
    let message = format!("it differs from what this program composes from the other files: {place}");
    Some(AuditFault::of_file(FaultCode::NotComposed, path, message))
}

/// Describes the first difference between a file and the wanted bytes, for people.
fn first_difference(path: &Path, wanted: &[u8]) -> String {
    let Ok(found) = files::read_with(path, LinkRule::Refuse, files::MAX_DOCUMENT) else {
        return "it cannot be read".into();
    };
    let (Ok(found_text), Ok(wanted_text)) = (std::str::from_utf8(&found), std::str::from_utf8(wanted)) else {
        let at = found.iter().zip(wanted).position(|(a, b)| a != b).unwrap_or(found.len().min(wanted.len()));
        return format!("byte {at} differs; found {} bytes, wanted {}", found.len(), wanted.len());
    };
    let (mut found, mut wanted) = (found_text.split('\n'), wanted_text.split('\n'));
    for line in 1.. {
        match (found.next(), wanted.next()) {
            (None, None) => break,
            (a, b) if a == b => {}
            (a, b) => {
                let [a, b] =
                    [a, b].map(|line| line.map_or("nothing".to_owned(), |line| brief(&format!("{line:?}"))));
                return format!("line {line}: found {a}, wanted {b}");
            }
        }
    }
    "its bytes differ".into()
}

/// The beginning of a text.
pub(super) fn brief(text: &str) -> String {
    const MAX_CHARACTERS: usize = 100;
    match text.char_indices().nth(MAX_CHARACTERS) {
        Some((at, _)) => format!("{}…", &text[..at]),
        None => text.to_owned(),
    }
}
