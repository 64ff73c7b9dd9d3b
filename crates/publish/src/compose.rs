//! The files of a release, composed in memory.

use super::exports::ReleaseExports;
use super::{ReleaseContext, ReleaseError, file_checks, standing};
use gs2e_audit::recheck::{FileVerdicts, agreement_of_sound};
use gs2e_check::{Finding, join_findings};
use gs2e_recipe::ReleaseInfo;
use gs2e_release::built::{BuiltScene, BuiltTrajectory};
use gs2e_release::composed::{FileContent, ReleaseTree};
use gs2e_release::facts::ReleaseFacts;
use gs2e_release::held_back::HeldBackScene;
use gs2e_release::manifest::{Publisher, ReleaseManifest};
use gs2e_release::published::PublishedScene;
use gs2e_release::scene::{SceneRecord, SplitPart, TrajectoryPart};
use gs2e_release::top::{compose_top, terms_of};
use gs2e_release::{TOOL, calibration, layout, manifest, path_picture, products, published, scene, split};
use gs2e_source::licence::Redistributability;
use gs2e_store::record::StoredOutput;
use gs2e_store::{Key, Store};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// A tree without the sums.
#[derive(Debug)]
pub(super) struct ComposedTree {
    pub(super) tree: ReleaseTree,
    /// The scenes as their files describe them.
    pub(super) scenes: Vec<PublishedScene>,
    /// The findings on the agreement of its files, which the audit of the written tree proves.
    pub(super) agreement: Vec<Finding>,
    /// Pictures whose files are known to be what this program writes for them.
    pub(super) pictures: BTreeSet<String>,
    /// Keys of the records of its exports and of the verdicts on its files.
    pub(super) records: Vec<Key>,
}

/// A scene with its files but for exports, as the passes of `gs2e check --tree` judge them.
#[derive(Debug)]
pub(super) struct JudgedScene<'a> {
    pub(super) scene: BuiltScene<'a>,
    file: SceneRecord,
    files: ReleaseTree,
    /// Pictures whose files are known to be what this program writes for them.
    composed: BTreeSet<String>,
    /// Key of the record of the verdicts on the files.
    verdicts: Key,
}

/// Composes the files of the scenes and judges them. Findings on files join those of the build.
pub(super) fn judge_scenes<'a>(
    scenes: Vec<BuiltScene<'a>>,
    context: &ReleaseContext,
    store: &Store,
    cancel: &AtomicBool,
) -> Result<Vec<JudgedScene<'a>>, ReleaseError> {
    let described = describe_all(&scenes, &context.info)?;
    let judge = |(mut scene, file): (BuiltScene<'a>, SceneRecord)| {
        let mut files = scene_files(&scene, &file, store);
        let (verdicts, FileVerdicts { mut findings, composed }) =
            file_checks::judge_files(&file.id, &files, store, cancel)?;
        for trajectory in &mut scene.trajectories {
            let found = findings.remove(&trajectory.name).unwrap_or_default();
            trajectory.findings = join_findings(std::mem::take(&mut trajectory.findings), found);
            let name = format!("{}/{}/{}", file.id, trajectory.name, layout::CHECKS);
            // After the judgement, because this file has the verdicts and must not be one of their grounds.
            files.add(name, FileContent::json(&trajectory.findings));
        }
        Ok(JudgedScene { scene, file, files, composed, verdicts })
    };
    scenes.into_iter().zip(described).map(judge).collect()
}

/// Composes the tree without the sums.
pub(super) fn compose_tree(
    scenes: Vec<JudgedScene<'_>>,
    held_back: &[HeldBackScene],
    exports: ReleaseExports<'_>,
    context: &ReleaseContext,
) -> Result<ComposedTree, ReleaseError> {
    let info = &context.info;
    let (mut tree, mut listed, mut published) = (ReleaseTree::default(), Vec::new(), Vec::new());
    let (mut keys, mut pictures) = (Vec::new(), BTreeSet::new());
    for JudgedScene { scene, file, mut files, composed, verdicts } in scenes {
        let own = files.listing();
        pictures.extend(composed);
        let (exported, made) = exports.of_scene(&file, &files)?;
        keys.push(verdicts);
        keys.extend(made);
        files.extend(exported);
        let described = manifest::manifest_scene(&scene, files.listing());
        published.push(PublishedScene::of(scene, file, own));
        listed.push(described);
        tree.extend(files);
    }
    let licence = terms_of(&published);
    let taken_down = context.taken_down;
    let facts = ReleaseFacts { scenes: &published, info, taken_down, held_back, licence: &licence };
    let top = compose_top(&facts, &|path| tree.place(path).map(Path::to_owned));
    let manifest = ReleaseManifest {
        format: standing::FORMAT,
        name: info.name.clone(),
        version: info.version.clone(),
        publisher: Some(Publisher::of(info)),
        tool: TOOL.into(),
        licence: licence.expression,
        taken_down,
        held_back: held_back.to_vec(),
        splits: info.splits.clone(),
        include: info.include.clone(),
        scenes: listed,
        // The manifest is not among them: it cannot contain its own digest.
        files: top.listing(),
    };
    tree.extend(top);
    tree.add(manifest::NAME.into(), FileContent::json(&manifest));
    let agreement = agreement_of_sound(&manifest);
    Ok(ComposedTree { tree, scenes: published, agreement, pictures, records: keys })
}

/// Describes the scenes, and deals them into splits if the release has splits.
fn describe_all(scenes: &[BuiltScene<'_>], info: &ReleaseInfo) -> Result<Vec<SceneRecord>, ReleaseError> {
    let mut described: Vec<SceneRecord> = scenes.iter().map(describe_release).collect::<Result<_, _>>()?;
    // Afterwards, because the split follows from the description.
    if let Some(splits) = &info.splits {
        for file in &mut described {
            file.split = Some(split::split_part(file, splits));
        }
    }
    let leaks = split::find_leaks(&described);
    if leaks.is_empty() { Ok(described) } else { Err(ReleaseError::Leaks(leaks)) }
}

/// Warnings for splits without a scene.
pub(super) fn empty_splits(scenes: &[PublishedScene], info: &ReleaseInfo) -> Vec<String> {
    // Groups are dealt by a hash, so a small release may leave a split empty.
    let names = info.splits.iter().flat_map(|splits| splits.shares.keys());
    let splits: Vec<&SplitPart> = scenes.iter().filter_map(|scene| scene.file.split.as_ref()).collect();
    let has = |name: &str| splits.iter().any(|split| split.name == name);
    names.filter(|name| !has(name)).map(|name| format!("no scene is in the split {name}")).collect()
}

fn describe_release(scene: &BuiltScene<'_>) -> Result<SceneRecord, ReleaseError> {
    // Only the file of the Gaussians is read for it.
    let path = || scene.gaussians.as_ref().map(|gaussians| gaussians.path.clone()).unwrap_or_default();
    scene::compose_scene(scene).map_err(|error| super::failed(&path())(error))
}

/// The files of a scene but for the verdicts on its trajectories, which the files decide.
fn scene_files(scene: &BuiltScene<'_>, file: &SceneRecord, store: &Store) -> ReleaseTree {
    let id = &scene.recipe.scene;
    let mut tree = ReleaseTree::default();
    // These two show nothing of the scene, and are written for withheld scenes as well.
    tree.add(format!("{id}/{}", layout::SCENE), FileContent::json(file));
    if let Some(photographed) = &scene.photographed {
        tree.add(format!("{id}/{}", layout::CHECKS), FileContent::json(&photographed.findings));
    }
    let is_released =
        |name: &str| scene.licence.passing != Redistributability::Withheld || products::is_metadata(name);
    if let Some((name, output)) =
        layout::made_of_scene(|step| scene.scene_outputs(step)).filter(|of| is_released(of.0))
    {
        tree.add(format!("{id}/{name}"), stored_file(output, store));
    }
    for (trajectory, part) in scene.trajectories.iter().zip(&file.trajectories) {
        let at = |name: &str| format!("{id}/{}/{name}", trajectory.name);
        for (name, content) in trajectory_files(scene, file, trajectory, part, store) {
            if is_released(&name) {
                tree.add(at(&name), content);
            }
        }
    }
    tree
}

/// An output of a step as a file of the tree.
fn stored_file(output: &StoredOutput, store: &Store) -> FileContent {
    let StoredOutput { digest, size, .. } = *output;
    FileContent::Blob { path: store.path_of(&digest), digest, size }
}

/// The files of a trajectory by their names in its folder. Internal files of the store (the
/// brightness that the sensor saw, the counts of the simulation) stay there.
fn trajectory_files(
    scene: &BuiltScene<'_>,
    file: &SceneRecord,
    trajectory: &BuiltTrajectory,
    part: &TrajectoryPart,
    store: &Store,
) -> BTreeMap<String, FileContent> {
    let outputs = |step: &str| scene.outputs(&trajectory.name, step);
    let made = layout::made(outputs, &published::stream_names(part));
    let mut files: BTreeMap<String, FileContent> =
        made.into_iter().map(|(name, output)| (name, stored_file(output, store))).collect();
    let path = path_picture::compose_picture(&trajectory.motion).map(FileContent::Bytes);
    files.extend(path.map(|picture| (path_picture::NAME.to_owned(), picture)));
    let sharp: Vec<&str> = outputs(products::SHARP.name()).iter().map(|o| o.name.as_str()).collect();
    let readout_us = scene.recipe.readout_us;
    let calibration = calibration::compose(scene.recipe, file, part);
    files.extend(calibration.into_iter().map(|(name, bytes)| (name, FileContent::Bytes(bytes))));
    // A body sees nothing.
    if part.cameras.is_empty() {
        let camera = scene.camera_along(&trajectory.name);
        let transforms = published::transforms_of(&camera, part, readout_us, &trajectory.motion, &sharp);
        files.insert(layout::TRANSFORMS.into(), FileContent::json(&transforms));
    }
    files
}
