//! Pictures along a trajectory.

use super::{Artifact, ArtifactError, ArtifactFiles};
use gs2e_sampling::exposure::ExposureRecord;
use std::path::PathBuf;

/// Name of the places of the objects, next to the segmentation.
pub const OBJECT_PLACES: &str = "objects.csv";

/// Pictures by name: PNG files or arrays of numbers.
#[derive(Debug)]
pub struct PictureSet {
    /// Name and path, sorted by name.
    pub files: Vec<(String, PathBuf)>,
}

impl Artifact for PictureSet {
    const KIND: &'static str = "pictures";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        Ok(Self { files: files.iter().map(|(name, path)| (name.to_owned(), path.to_owned())).collect() })
    }
}

/// Disparity images of a stereo pair. A kind of its own, so that a step can read them next to depth images.
#[derive(Debug)]
pub struct DisparityPictures(pub PictureSet);

impl Artifact for DisparityPictures {
    const KIND: &'static str = "disparity";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        PictureSet::open(files).map(Self)
    }
}

/// Sharp frames. A kind of its own, so that a step can read them next to depth images.
#[derive(Debug)]
pub struct SharpFrames(pub PictureSet);

impl Artifact for SharpFrames {
    const KIND: &'static str = "sharp";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        PictureSet::open(files).map(Self)
    }
}

/// Blurred frames: PNG files, and the record of each exposure.
#[derive(Debug)]
pub struct BlurredFrames {
    /// Records in the order of poses.
    pub exposures: Vec<ExposureRecord>,
}

impl BlurredFrames {
    /// Name of the file with the records.
    pub const EXPOSURES: &str = "exposures.json";
}

impl Artifact for BlurredFrames {
    const KIND: &'static str = "blurred";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        Ok(Self { exposures: files.json(Self::EXPOSURES)? })
    }
}
