//! Stage `capture`: reads a source and normalises it.

use super::{Context, SourceFile, Stage, StageError};
use crate::artifact::write_json;
use crate::scene::procedural::{self, StillLife};
use crate::source::{Capture, colmap, model, nerfstudio};
use serde::Serialize;
use std::path::PathBuf;

/// Parameters: which source. Paths stay out of the key, the content of the files goes in.
#[derive(Debug, Clone, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Capturing {
    /// The capture of the embedded scene, whatever the number of its Gaussians.
    Procedural {
        /// Number of key views.
        views: u32,
        /// Extent of the arc in degrees.
        arc: f64,
        /// Seed of the capture's unevenness.
        seed: u64,
    },
    /// A COLMAP model.
    Colmap {
        /// Its folder.
        #[serde(skip)]
        dir: PathBuf,
    },
    /// A nerfstudio `transforms.json`.
    Nerfstudio {
        /// The file, or its folder.
        #[serde(skip)]
        path: PathBuf,
    },
    /// A 3DGS model folder.
    Model {
        /// The folder, or its `cameras.json`.
        #[serde(skip)]
        path: PathBuf,
    },
    /// No source: a capture without views.
    None,
}

impl Capturing {
    /// The capture of an embedded scene.
    #[must_use]
    pub fn procedural(still_life: &StillLife) -> Self {
        let StillLife { views, arc, seed, .. } = *still_life;
        Self::Procedural { views, arc, seed }
    }
}

/// Endings of the files of a source that are no photos.
const NO_PHOTOS: [&str; 3] = ["bin", "txt", "json"];

impl Capturing {
    /// Those of its files that are photos.
    ///
    /// # Errors
    /// When the source cannot be listed.
    pub(super) fn photos(&self) -> Result<Vec<SourceFile>, StageError> {
        let mut files = self.sources()?;
        files.retain(|f| !f.path.extension().is_some_and(|ending| NO_PHOTOS.iter().any(|no| ending == *no)));
        Ok(files)
    }
}

impl Stage for Capturing {
    const NAME: &'static str = "capture";
    const REVISION: u32 = 1;
    type Inputs = ();
    type Output = Capture;

    fn sources(&self) -> Result<Vec<SourceFile>, StageError> {
        let (root, listed) = match self {
            Self::Procedural { .. } | Self::None => return Ok(Vec::new()),
            Self::Colmap { dir } => (dir, colmap::files(dir)),
            Self::Nerfstudio { path } => (path, nerfstudio::files(path)),
            Self::Model { path } => (path, model::files(path)),
        };
        if !root.exists() {
            return Err(StageError::Missing { path: root.clone() });
        }
        let listed = listed.map_err(StageError::work("read the source"))?;
        Ok(listed.into_iter().map(|(name, path)| SourceFile { name, path }).collect())
    }

    fn source_folders(&self) -> Vec<PathBuf> {
        match self {
            Self::Procedural { .. } | Self::None => Vec::new(),
            Self::Colmap { dir } => colmap::folders(dir),
            Self::Nerfstudio { path } => nerfstudio::folders(path),
            Self::Model { path } => model::folders(path),
        }
    }

    fn run(&self, (): (), cx: &mut Context<'_>) -> Result<(), StageError> {
        let (capture, warnings) = match self {
            Self::Procedural { views, arc, seed } => {
                let still_life = StillLife { views: *views, arc: *arc, seed: *seed, ..StillLife::default() };
                (procedural::capture(&still_life), Vec::new())
            }
            Self::Colmap { dir } => colmap::read(dir).map_err(StageError::work("read the source"))?,
            Self::Nerfstudio { path } => {
                nerfstudio::read(path).map_err(StageError::work("read the source"))?
            }
            Self::Model { path } => model::read(path).map_err(StageError::work("read the source"))?,
            Self::None => (Capture { views: Vec::new() }, Vec::new()),
        };
        cx.warnings.extend(warnings.iter().chain(&capture.distortion()).map(ToString::to_string));
        let out = cx.out.join("capture.json");
        write_json(&out, &capture).map_err(StageError::io(&out))
    }
}
