//! A scene as the files of its folder describe it. Card, datasheet, index, catalogue entry and
//! report are composed from this alone, by the release that writes them and by the audit that
//! compares them.

use super::built::BuiltScene;
use super::left_out::OmissionRow;
use super::manifest::ManifestFile;
use super::scene::{SceneRecord, TrajectoryPart};
use gs2e_build::artifact::TrajectoryProduct;
use gs2e_check::Finding;
use gs2e_recipe::{Recipe, RecipeFaults, read_recipe_text};
use gs2e_sampling::exposure;
use gs2e_scene::camera::Camera;
use gs2e_sensor::SensorChoice;
use gs2e_source::licence;
use gs2e_source::licence::{ComposedTerms, Redistributability, StatedTerms};
use gs2e_trajectory::transforms;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Finds the bytes of a file of the tree by its path; `None` for a file that is absent.
pub(super) type StoredPlaces<'a> = &'a (dyn Fn(&str) -> Option<PathBuf> + Sync);

/// A scene.
#[derive(Debug)]
pub struct PublishedScene {
    /// The recipe in `scene.json`.
    pub recipe: Recipe,
    /// Its terms.
    pub licence: ComposedTerms,
    /// Content of `scene.json`.
    pub file: SceneRecord,
    /// The findings of its own `checks.json`, where it has one.
    pub findings: Option<Vec<Finding>>,
    /// In the order of `scene.json`.
    pub trajectories: Vec<PublishedTrajectory>,
    /// Its files but for exports, sorted by path.
    pub files: Vec<ManifestFile>,
}

/// A trajectory.
#[derive(Debug)]
pub struct PublishedTrajectory {
    /// `poses.txt` and `speed.json`.
    pub motion: TrajectoryProduct,
    /// `checks.json`.
    pub findings: Vec<Finding>,
    /// `omitted` of `manifest.json`.
    pub left_out: Vec<OmissionRow>,
}

impl PublishedScene {
    /// A scene that was just composed, with the listing of its files but for exports.
    pub fn of(built: BuiltScene<'_>, file: SceneRecord, files: Vec<ManifestFile>) -> Self {
        let trajectories = built.trajectories.into_iter().map(|built| PublishedTrajectory {
            motion: built.motion,
            findings: built.findings,
            left_out: built.left_out,
        });
        Self {
            recipe: built.recipe.clone(),
            licence: built.licence,
            file,
            findings: built.photographed.map(|photographed| photographed.findings),
            trajectories: trajectories.collect(),
            files,
        }
    }

    /// The findings on the scene, then those on its trajectories.
    pub(super) fn all_findings(&self) -> impl Iterator<Item = &Finding> {
        let own = self.findings.iter().flatten();
        own.chain(self.trajectories.iter().flat_map(|trajectory| &trajectory.findings))
    }

    /// Returns true if upstream forbids passing on anything that shows the scene.
    pub fn is_withheld(&self) -> bool {
        self.licence.passing == Redistributability::Withheld
    }

    /// Its trajectories, with their parts of `scene.json`.
    pub fn paths(&self) -> impl Iterator<Item = (&TrajectoryPart, &PublishedTrajectory)> {
        self.file.trajectories.iter().zip(&self.trajectories)
    }

    /// The files in a folder of a trajectory.
    pub fn in_folder(&self, trajectory: &str, folder: &str) -> impl Iterator<Item = &str> {
        let prefix = format!("{}/{trajectory}/{folder}/", self.file.id);
        self.files.iter().map(|file| file.path.as_str()).filter(move |path| path.starts_with(&prefix))
    }

    /// The sensors whose events were simulated along a trajectory, by name where there are several.
    pub(super) fn streams(&self, part: &TrajectoryPart) -> Vec<(Option<&str>, &SensorChoice)> {
        let made = |name: Option<&str>| match name {
            None => part.sensor.is_some(),
            Some(name) => part.sensors.contains_key(name),
        };
        self.recipe.sensors_of(&part.name).iter().filter(|(name, _)| made(*name)).collect()
    }
}

/// The names of a trajectory's event streams. The stream of a single sensor has no name.
pub fn stream_names(part: &TrajectoryPart) -> Vec<Option<&str>> {
    let one = part.sensor.iter().map(|_| None);
    one.chain(part.sensors.keys().map(|name| Some(name.as_str()))).collect()
}

/// Opening and closing time of the shutter for each blurred frame of a trajectory, microseconds, by
/// the number of its pose.
pub(super) fn exposures(part: &TrajectoryPart, motion: &TrajectoryProduct) -> BTreeMap<usize, [i64; 2]> {
    let frames = part.blur.as_ref().and_then(|blur| blur["frames"].as_u64());
    // The number comes from a file, and 0 would panic.
    let Some(frames) = frames.and_then(|n| u32::try_from(n).ok()).filter(|n| *n > 0) else {
        return BTreeMap::new();
    };
    let seconds = motion.seconds();
    let centres = exposure::exposure_centres(seconds.len(), frames);
    centres.into_iter().map(|pose| (pose, exposure::open_us(&seconds, pose, frames))).collect()
}

/// The terms of a scene by its recipe. `redistribution` is the releaser's reason why restricted
/// material may be passed on.
///
/// # Panics
/// As [`licence::compose_terms`].
pub fn terms(recipe: &Recipe, redistribution: Option<&str>) -> ComposedTerms {
    licence::compose_terms(&StatedTerms {
        kind: recipe.source.kind(),
        url: recipe.source.upstream().and_then(|upstream| upstream.url.as_deref()),
        owner: recipe.licence.as_ref().map(|l| (l.expression.as_str(), l.holder.as_str())),
        grant: recipe.licence.as_ref().and_then(|l| l.grant.as_ref()),
        redistribution,
    })
}

/// Reads the recipe that a scene carries. JSON is YAML.
///
/// # Errors
/// It is not a valid recipe.
pub fn recipe(scene: &SceneRecord) -> Result<Recipe, RecipeFaults> {
    // JSON is YAML, so the reader of recipes takes it with all of its checks. The path is for messages only.
    read_recipe_text(scene.recipe.to_string(), Path::new("recipe"))
}

/// `transforms.json` of a trajectory; `sharp` are the names of its sharp frames, sorted, and `readout_us` is
/// their readout if their shutter rolls.
pub fn transforms_of(
    camera: &Camera,
    part: &TrajectoryPart,
    readout_us: Option<u32>,
    motion: &TrajectoryProduct,
    sharp: &[&str],
) -> serde_json::Value {
    let blurred = &exposures(part, motion);
    transforms::compose_transforms(
        camera,
        &motion.trajectory,
        &transforms::PictureLinks { sharp, readout_us, blurred },
    )
}
