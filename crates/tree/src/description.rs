//! What the descriptions of a release state: `manifest.json` of the whole, and `scene.json` of each scene.

use crate::files::{ReleaseFolder, TreeError};
use crate::trajectory::TrajectoryFiles;
use gs2e_files as files;
use gs2e_image::Size;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::lens::Distortion;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Name of the description of a release.
const MANIFEST: &str = "manifest.json";

/// A release in a folder.
#[derive(Debug)]
pub struct Release {
    /// Its files.
    pub files: ReleaseFolder,
    /// Content of `manifest.json`.
    pub manifest: Value,
}

/// A scene, as `scene.json` describes it. [`Release::scene`] leaves out what is not for readers of the data.
#[derive(Debug, Clone, Deserialize)]
pub struct ReleasedScene {
    /// Scene id.
    pub id: String,
    /// The camera that was rendered; of a rig, the first one.
    pub camera: CameraPart,
    /// The recipe, with defaults filled in.
    pub recipe: Value,
    /// The trajectories, in the order of the recipe.
    pub trajectories: Vec<ReleasedTrajectory>,
}

/// A trajectory, as `scene.json` describes it.
#[derive(Debug, Clone, Deserialize)]
pub struct ReleasedTrajectory {
    /// Its name.
    pub name: String,
    /// The camera of a rig, if the path is that of one.
    #[serde(default)]
    pub mounted: Option<MountedCamera>,
    /// The sensor, if there are events of one.
    #[serde(default)]
    pub sensor: Option<Value>,
    /// The sensors by name, if several saw the scene.
    #[serde(default)]
    pub sensors: BTreeMap<String, Value>,
}

/// A camera of a rig.
#[derive(Debug, Clone, Deserialize)]
pub struct MountedCamera {
    /// The camera.
    pub camera: CameraPart,
}

/// The camera that was rendered.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraPart {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Focal length, px.
    pub fx: f64,
    /// Focal length, px.
    pub fy: f64,
    /// Principal point, px.
    pub cx: f64,
    /// Principal point, px.
    pub cy: f64,
    /// The lens, if it distorts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lens: Option<Distortion>,
    /// The distortion of the capture's photos, which the rendered camera does not have.
    pub undistorted_from: Option<Value>,
}

impl CameraPart {
    /// The part of a camera.
    #[must_use]
    pub fn new(camera: Camera, undistorted_from: Option<Value>) -> Self {
        let Camera { size, fx, fy, cx, cy, lens } = camera;
        Self { width: size.width, height: size.height, fx, fy, cx, cy, lens, undistorted_from }
    }

    /// The camera.
    #[must_use]
    pub fn camera(&self) -> Camera {
        let size = Size { width: self.width, height: self.height };
        Camera { size, fx: self.fx, fy: self.fy, cx: self.cx, cy: self.cy, lens: self.lens }
    }
}

impl Release {
    /// Opens the release in `dir`.
    ///
    /// # Errors
    /// As [`read_manifest`].
    pub fn open(dir: &Path) -> Result<Self, TreeError> {
        Ok(Self { manifest: read_manifest(dir)?, files: ReleaseFolder(dir.to_owned()) })
    }

    /// The ids of the scenes, sorted.
    pub fn scene_ids(&self) -> impl Iterator<Item = &str> {
        let scenes = self.manifest["scenes"].as_array().map_or(&[][..], Vec::as_slice);
        scenes.iter().filter_map(|scene| scene["id"].as_str())
    }

    /// The description of a scene.
    ///
    /// # Errors
    /// As [`read_scene`].
    pub fn scene(&self, id: &str) -> Result<ReleasedScene, TreeError> {
        read_scene(&self.files.0, id)
    }

    /// The files of a trajectory of a scene.
    ///
    /// # Errors
    /// As [`TrajectoryFiles::new`].
    pub fn trajectory(
        &self,
        scene: &ReleasedScene,
        part: &ReleasedTrajectory,
    ) -> Result<TrajectoryFiles<'static>, TreeError> {
        let camera = part.mounted.as_ref().map_or(&scene.camera, |mounted| &mounted.camera);
        TrajectoryFiles::new(Arc::new(self.files.clone()), &scene.id, &part.name, camera.camera())
    }
}

impl ReleasedTrajectory {
    /// The names of its streams of events. The stream of a single sensor has no name.
    pub fn streams(&self) -> impl Iterator<Item = Option<&str>> {
        let one = self.sensor.iter().map(|_| None);
        one.chain(self.sensors.keys().map(|name| Some(name.as_str())))
    }
}

/// Reads the manifest of the release in `dir`, as a value or in the types of the release.
///
/// # Errors
/// The folder is not a release of format 1.
pub fn read_manifest<T: DeserializeOwned>(dir: &Path) -> Result<T, TreeError> {
    #[derive(Deserialize)]
    struct StatedFormat {
        format: u32,
    }
    let no_release =
        |path: &Path, found: &str| TreeError::new(path, format!("found {found}, wanted a release folder"));
    // These two checks are for the message; reading the manifest would fail as well.
    if !dir.is_dir() {
        return Err(no_release(dir, if files::is_there(dir) { "a file" } else { "nothing" }));
    }
    if !files::is_there(&dir.join(MANIFEST)) {
        return Err(no_release(dir, "a folder without manifest.json"));
    }
    let wanted = "the manifest of a release of format 1";
    let manifest = read_json(dir, MANIFEST, wanted)?;
    match read_json(dir, MANIFEST, wanted)? {
        StatedFormat { format: 1 } => Ok(manifest),
        StatedFormat { format } => {
            Err(TreeError::new(dir.join(MANIFEST), format!("found format {format}, wanted format 1")))
        }
    }
}

/// Reads the description of a scene of the release in `dir`, in the types of [`ReleasedScene`] or of the
/// release.
///
/// # Errors
/// It cannot be read.
pub fn read_scene<T: DeserializeOwned>(dir: &Path, id: &str) -> Result<T, TreeError> {
    read_json(dir, &format!("{id}/scene.json"), "the description of a scene")
}

/// Reads a file of a release. Nothing outside its folder is opened.
fn read_json<T: DeserializeOwned>(dir: &Path, name: &str, wanted: &str) -> Result<T, TreeError> {
    let failed = |found: String| TreeError::new(dir.join(name), format!("found {found}, wanted {wanted}"));
    let bytes = files::read_below(dir, Path::new(name), files::MAX_DOCUMENT)
        .map_err(|e| failed(format!("an unreadable file ({e})")))?;
    serde_json::from_slice(&bytes).map_err(|e| failed(format!("other JSON ({e})")))
}
