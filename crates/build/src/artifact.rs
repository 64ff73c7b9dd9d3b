//! The interface between domain formats and the store: the files of each artifact, and how it is
//! opened.
//!
//! An artifact is a small set of named files. Small files are read whole. Large ones (events,
//! pictures) are opened as handles, and consumers stream their bytes.

mod events;
mod pictures;
mod scene;
mod trajectory;
mod verdicts;

pub use events::{EventStream, EventStreams, SimulationRecord};
pub use pictures::{BlurredFrames, DisparityPictures, OBJECT_PLACES, PictureSet, SharpFrames};
pub use scene::{HELD_OUT_PICTURE, SceneFiles, SolvedModel, TRAINING_FILE};
pub(crate) use scene::{SCENE_OBJECTS, SCENE_TIME};
pub use trajectory::{ImuRecording, TrajectoryProduct};
pub use verdicts::VerdictsRecord;

use gs2e_files as files;
use gs2e_store::record::{StoredOutput, content_digest};
use gs2e_store::{Digest, Store};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, BufWriter, Read as _, Write};
use std::path::{Path, PathBuf};

/// The files of an artifact by name, with their paths in the store.
#[derive(Debug, Clone, Default)]
pub struct ArtifactFiles {
    files: BTreeMap<String, StoredFile>,
}

/// A file in the store.
#[derive(Debug, Clone)]
struct StoredFile {
    path: PathBuf,
    digest: Digest,
    size: u64,
}

impl ArtifactFiles {
    /// The files of a step, with their paths in the store.
    #[must_use]
    pub fn from_outputs(outputs: &[StoredOutput], store: &Store) -> Self {
        let stored = |o: &StoredOutput| {
            let StoredOutput { digest, size, .. } = *o;
            StoredFile { path: store.path_of(&digest), digest, size }
        };
        Self { files: outputs.iter().map(|o| (o.name.clone(), stored(o))).collect() }
    }

    /// The digest of the names and bytes of all files.
    #[must_use]
    pub fn digest(&self) -> Digest {
        let outputs = self.files.iter().map(|(name, file)| {
            let StoredFile { digest, size, .. } = *file;
            StoredOutput { name: name.clone(), digest, size }
        });
        content_digest(&outputs.collect::<Vec<_>>())
    }

    /// Sum of the file sizes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.files.values().map(|file| file.size).sum()
    }

    /// Size of the file with this name, bytes; 0 if the artifact has no such file.
    #[must_use]
    pub fn size(&self, name: &str) -> u64 {
        self.files.get(name).map_or(0, |file| file.size)
    }

    /// Path of the file with this name.
    ///
    /// # Errors
    /// The artifact has no such file.
    pub fn path(&self, name: &str) -> Result<&Path, ArtifactError> {
        let found = self.files.get(name).map(|file| file.path.as_path());
        found.ok_or_else(|| ArtifactError {
            name: name.to_owned(),
            because: "the artifact has no such file".into(),
        })
    }

    /// All names and paths, sorted by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Path)> {
        self.files.iter().map(|(name, file)| (name.as_str(), file.path.as_path()))
    }

    fn read<T, E: ToString>(
        &self,
        name: &str,
        parse: impl FnOnce(BufReader<File>) -> Result<T, E>,
    ) -> Result<T, ArtifactError> {
        let failed = |because: String| ArtifactError { name: name.to_owned(), because };
        let file = files::open(self.path(name)?).map_err(|e| failed(e.to_string()))?;
        parse(BufReader::new(file)).map_err(|e| failed(e.to_string()))
    }

    /// Reads a JSON file.
    ///
    /// # Errors
    /// The file is absent or has another form.
    pub fn json<T: serde::de::DeserializeOwned>(&self, name: &str) -> Result<T, ArtifactError> {
        // From memory: a parser asks a reader for every byte. The program wrote the file, so it is small.
        self.read(name, |mut file| {
            let mut bytes = Vec::new();
            file.read_to_end(&mut bytes)?;
            serde_json::from_slice(&bytes).map_err(std::io::Error::from)
        })
    }
}

/// The reason why a stored artifact cannot be opened: it was altered, or another version wrote it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("open {name} in the store: {because}")]
pub struct ArtifactError {
    name: String,
    because: String,
}

/// Writes `value` as readable JSON: indented, with a final newline.
///
/// # Errors
/// The file cannot be written.
pub fn write_json<T: serde::Serialize>(path: &Path, value: &T) -> std::io::Result<()> {
    let mut file = BufWriter::new(File::create(path)?);
    serde_json::to_writer_pretty(&mut file, value)?;
    file.write_all(b"\n")?;
    // Dropping the writer would flush it too, but lose the error.
    file.flush()
}

/// A product that steps pass to one another through the store.
pub trait Artifact: Sized {
    /// Name of the kind; also the role of the input that takes it.
    const KIND: &'static str;

    /// Opens the artifact.
    ///
    /// # Errors
    /// A file is absent or cannot be read.
    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError>;
}
