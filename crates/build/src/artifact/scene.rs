//! Artifacts of a scene before anything moves: capture, poses, Gaussians and their fidelity.

use super::{Artifact, ArtifactError, ArtifactFiles};
use gs2e_scene::Gaussians;
use gs2e_scene::dynamic::file::{DynamicsRecord, open_files};
use gs2e_scene::motion::SceneMotion;
use gs2e_source::Capture;
use gs2e_source::colmap::ColmapModel;
use gs2e_train::fidelity::PhotoFidelity;
use std::path::{Path, PathBuf};
use std::sync::Arc;

impl Artifact for Capture {
    const KIND: &'static str = "capture";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        files.json("capture.json")
    }
}

/// Name of the records of the objects, next to a scene that has some. Products of every store have this name,
/// so it stays what it was when objects were called parts.
pub(crate) const SCENE_OBJECTS: &str = "parts.json";

/// Name of the record of the change of a scene that changes with time, next to the scene.
pub(crate) const SCENE_TIME: &str = "time.json";

/// Name of the record of a training, next to the scene that it made.
pub const TRAINING_FILE: &str = "training.json";

/// A COLMAP model that was made for photos without poses.
#[derive(Debug)]
pub struct SolvedModel {
    /// The model.
    pub model: ColmapModel,
    /// Its points.
    pub points: PathBuf,
}

impl Artifact for SolvedModel {
    const KIND: &'static str = "model";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        let file = |name| files.path(name).map(Path::to_owned);
        let points = file("points3D.bin")?;
        let model = ColmapModel::from_files(file("cameras.bin")?, file("images.bin")?, points.clone());
        Ok(Self { model, points })
    }
}

impl Artifact for Gaussians {
    const KIND: &'static str = "gaussians";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        let path = files.path("scene.ply")?;
        if files.size(SCENE_TIME) > 0 {
            let record: DynamicsRecord = files.json(SCENE_TIME)?;
            let failed = |because: String| ArtifactError { name: SCENE_TIME.into(), because };
            let listed = record.names().map(|name| files.path(&name).map(Path::to_owned));
            let listed: Vec<PathBuf> = listed.collect::<Result<_, _>>()?;
            return open_files(&record, &listed).map_err(|e| failed(e.to_string()));
        }
        let scene = gs2e_scene::read_file(path)
            .map_err(|e| ArtifactError { name: "scene.ply".into(), because: e.to_string() })?;
        if files.size(SCENE_OBJECTS) == 0 {
            return Ok(scene);
        }
        let motion = SceneMotion::prepare(files.json(SCENE_OBJECTS)?)
            .map_err(|e| ArtifactError { name: SCENE_OBJECTS.into(), because: e.to_string() })?;
        let starts = motion.records().map(|object| object.first);
        if !starts.is_sorted() || motion.records().any(|object| object.first > scene.len()) {
            let because = format!("a part begins outside of the {} Gaussians of the scene", scene.len());
            return Err(ArtifactError { name: SCENE_OBJECTS.into(), because });
        }
        Ok(Self { motion: Some(Arc::new(motion)), ..scene })
    }
}

/// The files of a scene, for a step that seldom reads them.
#[derive(Debug)]
pub struct SceneFiles(ArtifactFiles);

impl SceneFiles {
    /// Reads the scene.
    ///
    /// # Errors
    /// A file cannot be read.
    pub fn read(&self) -> Result<Gaussians, ArtifactError> {
        Gaussians::open(&self.0)
    }
}

impl Artifact for SceneFiles {
    const KIND: &'static str = Gaussians::KIND;

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        Ok(Self(files.clone()))
    }
}

/// The picture of held-out views next to `fidelity.json`, if there are any.
pub const HELD_OUT_PICTURE: &str = "held_out.png";

impl Artifact for PhotoFidelity {
    const KIND: &'static str = "fidelity";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        files.json("fidelity.json")
    }
}
