//! The validation passes over a release tree: they read its own files, without the store that made
//! them.
//!
//! Sharp frames stand for the brightness that the sensors saw, to the rounding of their 8 bits;
//! flow or depth give the image motion; the sensors and the limits are those of the recipe in
//! `scene.json`. Passes that need other data (the account of the simulation, the fitted curve of
//! the path) report that. In addition, files that say the same thing are compared with each other:
//! [`gs2e_check::records`].

mod agreement;
mod anchors;
mod crossings;
mod image_motion;
mod inertial;
mod pictures;
mod trajectory;
mod unwritten;
mod walk;

use gs2e_check::{Finding, join_findings, records};
use gs2e_recipe::{Recipe, RecipeFaults};
use gs2e_release::composed::ReleaseTree;
use gs2e_release::scene::TrajectoryPart;
use gs2e_release::{ReleaseManifest, SceneRecord, layout, published};
use gs2e_scene::camera::stereo::Rectification;
use gs2e_tree::{ListedFiles, ReleaseFiles, ReleaseFolder, TrajectoryFiles, TreeError, json_of};
use pictures::ComposedPictures;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};
use trajectory::ReleasedTrajectory;
use unwritten::UnwrittenFiles;

/// Reason why a tree cannot be checked.
#[derive(Debug, thiserror::Error)]
pub enum RecheckError {
    /// A file is absent or does not have its format.
    #[error(transparent)]
    Unreadable(#[from] TreeError),
    /// A named scene is not in the release.
    #[error("the release has no scene `{0}`")]
    NoScene(String),
    /// The recipe in a `scene.json` is not valid.
    #[error("the recipe in the scene.json of {scene} cannot be read: {faults}")]
    Recipe {
        /// Scene id.
        scene: String,
        /// The faults.
        faults: RecipeFaults,
    },
}

/// Findings on a release tree.
#[derive(Debug, Clone, Default)]
pub struct TreeFindings {
    /// What the files show.
    pub measured: Vec<Finding>,
    /// The verdict on the release: these findings, joined with those that the build left in `checks.json`.
    pub joined: Vec<Finding>,
}

/// Runs the passes over the named scenes of the release in `dir`, or over all scenes if there are
/// no names.
///
/// # Errors
/// A named scene does not exist, or a file of a scene cannot be read. The audit also reports events
/// that cannot be read; here they are an error.
pub fn recheck_tree(dir: &Path, scenes: &[String]) -> Result<TreeFindings, RecheckError> {
    let composed = Mutex::default();
    let files: Arc<dyn ReleaseFiles> = Arc::new(ReleaseFolder(dir.to_owned()));
    let manifest: ReleaseManifest = json_of(&*files, gs2e_release::manifest::NAME)?;
    if let Some(absent) = scenes.iter().find(|id| manifest.scenes.iter().all(|scene| scene.id != **id)) {
        return Err(RecheckError::NoScene(absent.clone()));
    }
    if manifest.scenes.is_empty() {
        let none = vec![records::no_scenes(&manifest.name)];
        return Ok(TreeFindings { measured: none.clone(), joined: none });
    }
    let is_wanted = |id: &str| scenes.is_empty() || scenes.iter().any(|wanted| wanted == id);
    let mut found = TreeFindings::default();
    // Scenes come one after the other, so that the pictures of one are in memory at a time.
    for listed in manifest.scenes.iter().filter(|scene| is_wanted(&scene.id)) {
        let measured = of_scene(&files, &composed, &listed.id)?;
        found.joined.extend(stated(&*files, &listed.id)?);
        for (name, measured) in measured {
            let stated = stated(&*files, &format!("{}/{name}", listed.id))?;
            found.joined.extend(join_findings(stated, measured.clone()));
            found.measured.extend(measured);
        }
    }
    // Last, because the passes above name the pictures whose bytes are known, and those are not decoded
    // again.
    let agreement = agreement::compare_files(dir, &manifest, &is_wanted, &names_in(composed));
    let agreement = agreement.map_err(|e| TreeError::new(dir, e))?;
    found.measured.extend(agreement.iter().cloned());
    found.joined.extend(agreement);
    Ok(found)
}

/// The verdicts on the files of a scene.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct FileVerdicts {
    /// The findings of [`recheck_tree`] by trajectory, but for the agreement of files.
    pub findings: BTreeMap<String, Vec<Finding>>,
    /// Names of the pictures whose files are what this program writes for them.
    pub composed: BTreeSet<String>,
}

/// Judges the files of a scene that a release is going to write.
pub fn judge_unwritten(
    files: &ReleaseTree,
    id: &str,
    cancel: &AtomicBool,
) -> Result<FileVerdicts, RecheckError> {
    let composed = Mutex::default();
    let files: Arc<dyn ReleaseFiles> =
        Arc::new(UnwrittenFiles { files: ListedFiles(files.listed()), cancel });
    let findings = of_scene(&files, &composed, id)?.into_iter().collect();
    Ok(FileVerdicts { findings, composed: names_in(composed) })
}

fn names_in(composed: Mutex<BTreeSet<String>>) -> BTreeSet<String> {
    composed.into_inner().expect("no thread panics while it holds the names")
}

/// The findings that a folder of the release states; none without the file.
fn stated(files: &dyn ReleaseFiles, folder: &str) -> Result<Vec<Finding>, TreeError> {
    let name = format!("{folder}/{}", layout::CHECKS);
    let is_there = files.has(&name).map_err(|e| TreeError::new(files.display_path(&name), e))?;
    if is_there { json_of(files, &name) } else { Ok(Vec::new()) }
}

/// The findings by trajectory, in the order of `scene.json`.
fn of_scene<'a>(
    files: &Arc<dyn ReleaseFiles + 'a>,
    composed: &ComposedPictures,
    id: &str,
) -> Result<Vec<(String, Vec<Finding>)>, RecheckError> {
    let scene: SceneRecord = json_of(&**files, &format!("{id}/{}", layout::SCENE))?;
    let recipe = recipe_of(&scene)?;
    let photos = scene.images.iter().filter(|image| image.used).count();
    let mut findings = Vec::new();
    for part in &scene.trajectories {
        let files = &TrajectoryFiles::new(files.clone(), id, &part.name, scene.camera_of(part).camera())?;
        let name = &format!("{}/{}", scene.id, part.name);
        let pair = stereo_pair(&recipe, &scene, part);
        let released = ReleasedTrajectory { files, composed, name, recipe: &recipe, part, pair, photos };
        findings.push((part.name.clone(), released.findings()?));
    }
    Ok(findings)
}

/// The findings on the agreement of files in a release without a fault.
pub fn agreement_of_sound(manifest: &ReleaseManifest) -> Vec<Finding> {
    agreement::judge_faults(manifest, &|_| true, &[])
}

/// The stereo pair whose first camera sees along a trajectory.
fn stereo_pair(recipe: &Recipe, scene: &SceneRecord, part: &TrajectoryPart) -> Option<Rectification> {
    let mounted = recipe.mounted(&part.name)?;
    let name = format!("{}/{}", mounted.body, mounted.camera.second.as_ref()?.name);
    let second = scene.trajectories.iter().find(|part| part.name == name)?;
    let cameras = [part, second].map(|part| scene.camera_of(part).camera());
    Rectification::new(cameras, &mounted.camera.second_from_first()?).ok()
}

fn recipe_of(scene: &SceneRecord) -> Result<Recipe, RecheckError> {
    published::recipe(scene).map_err(|faults| RecheckError::Recipe { scene: scene.id.clone(), faults })
}
