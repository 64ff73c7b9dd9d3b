//! The validation passes over a release tree: they read its own files, without the store that made
//! them.
//!
//! Passes that need data that a release does not contain (the brightness that the sensor saw
//! between the frames, depth, the account of the simulation) report that. The others judge the
//! released bytes by the limits of the recipe in `scene.json`.

mod crossings;
mod geometry;
mod pictures;

use super::published::{self, RecipeError};
use super::scene::CameraPart;
use super::{ReleaseManifest, SceneRecord};
use crate::artifact::{EventStream, TrajectoryProduct};
use crate::camera::Camera;
use crate::check::tally::{StreamObserver, TallyReference};
use crate::check::{Finding, StreamTally, TrajectorySubject, judge_trajectory};
use crate::event::{EventSource, h5};
use crate::files;
use crate::image::Size;
use crate::recipe::{Recipe, RecipeFaults, SceneSource};
use crate::trajectory::Trajectory;
use crate::trajectory::path::CameraPath;
use crate::trajectory::report::SpeedReport;
use crate::units::{Hertz, Ratio};
use crossings::measure_crossings;
use geometry::measure_geometry;
use pictures::ReleasedPictures;
use serde::de::DeserializeOwned;
use std::io;
use std::path::{Path, PathBuf};

/// Reason why a tree cannot be checked.
#[derive(Debug, thiserror::Error)]
pub enum RecheckError {
    /// A file is absent or does not have its format.
    #[error("{}: {because}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The fault.
        because: String,
    },
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

fn unreadable_file(path: &Path, because: impl std::fmt::Display) -> RecheckError {
    RecheckError::Unreadable { path: path.to_owned(), because: because.to_string() }
}

/// Runs the passes over the named scenes of the release in `dir`, or over all scenes if there are
/// no names.
///
/// # Errors
/// A named scene does not exist, or a file of a scene cannot be read. The audit also reports events
/// that cannot be read; here they are an error.
pub fn recheck_tree(dir: &Path, scenes: &[String]) -> Result<Vec<Finding>, RecheckError> {
    let tree = AuditedTree { dir };
    let manifest: ReleaseManifest = tree.json(super::manifest::NAME)?;
    if let Some(absent) = scenes.iter().find(|id| manifest.scenes.iter().all(|scene| scene.id != **id)) {
        return Err(RecheckError::NoScene(absent.clone()));
    }
    let mut findings = Vec::new();
    for listed in manifest.scenes.iter().filter(|scene| scenes.is_empty() || scenes.contains(&scene.id)) {
        findings.extend(of_scene(tree, &listed.id)?);
    }
    Ok(findings)
}

/// The files of a release that another party may have made. Nothing outside its folder is read.
#[derive(Clone, Copy)]
struct AuditedTree<'a> {
    dir: &'a Path,
}

impl AuditedTree<'_> {
    fn path_of(self, name: &str) -> PathBuf {
        self.dir.join(name)
    }

    /// Reads a file. Its name may come from another file of the tree.
    fn read(self, name: &str) -> Result<Vec<u8>, RecheckError> {
        files::read_below(self.dir, Path::new(name), files::MAX_DOCUMENT)
            .map_err(|e| unreadable_file(&self.path_of(name), e))
    }

    fn json<T: DeserializeOwned>(self, name: &str) -> Result<T, RecheckError> {
        serde_json::from_slice(&self.read(name)?).map_err(|e| unreadable_file(&self.path_of(name), e))
    }

    /// Returns true for a regular file, and false if there is nothing of this name. Everything else
    /// is an error.
    fn has(self, name: &str) -> Result<bool, RecheckError> {
        match files::open_below(self.dir, Path::new(name)) {
            Ok(_) => Ok(true),
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(false),
            Err(e) => Err(unreadable_file(&self.path_of(name), e)),
        }
    }
}

fn of_scene(tree: AuditedTree<'_>, id: &str) -> Result<Vec<Finding>, RecheckError> {
    let scene: SceneRecord = tree.json(&format!("{id}/scene.json"))?;
    let recipe = recipe_of(&scene)?;
    let CameraPart { width, height, fx, fy, cx, cy, .. } = scene.camera;
    let camera = Camera { size: Size { width, height }, fx, fy, cx, cy };
    let photos = scene.images.iter().filter(|image| image.used).count();
    let mut findings = Vec::new();
    for part in &scene.trajectories {
        let folder = format!("{id}/{}", part.name);
        let name = format!("{}/{}", scene.id, part.name);
        findings.extend(of_trajectory((tree, &folder), &name, (&recipe, camera, photos))?);
    }
    Ok(findings)
}

fn of_trajectory(
    (tree, folder): (AuditedTree<'_>, &str),
    name: &str,
    (recipe, camera, photos): (&Recipe, Camera, usize),
) -> Result<Vec<Finding>, RecheckError> {
    let poses = format!("{folder}/poses.txt");
    let trajectory = Trajectory::read_poses(tree.read(&poses)?.as_slice())
        .map_err(|e| unreadable_file(&tree.path_of(&poses), e))?;
    let speed = format!("{folder}/speed.json");
    let report: SpeedReport = tree.json(&speed)?;
    let rate = Hertz(report.rate.parse::<Ratio>().map_err(|e| unreadable_file(&tree.path_of(&speed), e))?);
    let motion = TrajectoryProduct { trajectory, report };
    let (trajectory, report) = (&motion.trajectory, &motion.report);
    let released = ReleasedPictures { tree, folder, camera, motion: &motion };
    let geometry = measure_geometry(&released)?;
    let end_us = trajectory.stamps_us.last().copied().unwrap_or(0);
    let mut counted = Vec::new();
    for (stream, sensor) in recipe.sensors.iter() {
        let events = format!("{folder}/{}", EventStream::released_name(stream));
        // Also checks that no link leads out of the tree: the reader below opens by path.
        if tree.has(&events)? {
            let path = tree.path_of(&events);
            // Without the simulation, the dead time is all that the stream can be compared with.
            let against = TallyReference { dead_us: sensor.dead_us(), ..TallyReference::default() };
            let tally = count_stream(&path, StreamObserver::new(camera.size, rate, end_us, against))
                .map_err(|e| unreadable_file(&path, e))?;
            let name = stream.map_or_else(|| name.to_owned(), |stream| format!("{name}/{stream}"));
            let crossings = measure_crossings(&released, &path, (sensor, recipe))?;
            counted.push((name, sensor, tally, crossings));
        }
    }
    // Fields without data in a release are `None`, and their passes report that they were not run.
    let whole = TrajectorySubject {
        name,
        rate,
        trajectory,
        speed: Some(report),
        sensor: None,
        account: None,
        tally: None,
        resampled: None,
        views: views_of(recipe, folder.rsplit('/').next().unwrap_or(folder), photos),
        geometry: Some(&geometry),
        crossings: None,
        foreign: None,
        flow: None,
        tolerance: None,
        coverage: None,
        doubtful_share: None,
        limits: &recipe.checks.of_trajectory(),
    };
    let streams: Vec<TrajectorySubject<'_>> = counted
        .iter()
        .map(|(name, sensor, tally, crossings)| TrajectorySubject {
            name,
            sensor: Some(sensor),
            tally: Some(tally),
            crossings: Some(crossings),
            ..whole
        })
        .collect();
    Ok(judge_trajectory(&whole, &streams))
}

/// Number of views or key poses that the path of a trajectory follows, if the files say so.
fn views_of(recipe: &Recipe, name: &str, photos: usize) -> Option<usize> {
    let path = &recipe.trajectories.iter().find(|trajectory| trajectory.name == name)?.path;
    match (path, &recipe.source) {
        (CameraPath::Keyframes(path), _) => Some(path.poses.len()),
        (CameraPath::Refine(_), SceneSource::Procedural(scene)) => usize::try_from(scene.views).ok(),
        (CameraPath::Refine(_), _) => Some(photos).filter(|n| *n > 0),
        // An orbit follows no views; a novel trajectory's report has its key poses.
        (CameraPath::Orbit(_) | CameraPath::Novel(_), _) => None,
    }
}

fn count_stream(path: &Path, mut observer: StreamObserver<'_>) -> Result<StreamTally, String> {
    let mut reader = h5::Reader::open(path).map_err(|e| e.to_string())?;
    let mut chunk = Vec::new();
    while reader.next_chunk(&mut chunk).map_err(|e| e.to_string())? {
        observer.append(&chunk);
    }
    Ok(observer.finish())
}

fn recipe_of(scene: &SceneRecord) -> Result<Recipe, RecheckError> {
    published::recipe(scene).map_err(|e| match e {
        RecipeError::Io(e) => unreadable_file(Path::new("a temporary file"), e),
        RecipeError::Faults(faults) => RecheckError::Recipe { scene: scene.id.clone(), faults },
    })
}
