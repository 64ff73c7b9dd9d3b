//! Files of a COLMAP model: where they lie, which form they have, and their records.

use super::{ColmapImage, ColmapPoint, ModelCamera, binary, text};
use crate::{SourceError, SourceWarning};
use gs2e_files::{FolderWalk, is_there};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Maximum depth below the given folder of a folder that is searched for `sparse/0`.
pub(super) const DEEPEST: usize = 3;

/// The two forms that models have on disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ModelForm {
    Binary,
    Text,
}

impl ModelForm {
    fn file(self, dir: &Path, stem: &str) -> PathBuf {
        dir.join(stem).with_extension(match self {
            Self::Binary => "bin",
            Self::Text => "txt",
        })
    }

    fn is_in(self, dir: &Path) -> bool {
        ["cameras", "images"].iter().all(|stem| is_there(&self.file(dir, stem)))
    }
}

/// A model that was found but not yet read.
#[derive(Debug, Clone)]
pub struct ColmapModel {
    place: ModelPlace,
    form: ModelForm,
}

/// Location of the files of a model.
#[derive(Debug, Clone)]
enum ModelPlace {
    /// A folder, under their usual names.
    Folder(PathBuf),
    /// Files of other names.
    Files { cameras: PathBuf, images: PathBuf, points: PathBuf },
}

impl ColmapModel {
    /// Finds the model in `dir`: in `dir` itself, in `sparse/0` or `sparse` below it, or in the
    /// only `sparse/0` up to three folders further down.
    ///
    /// # Errors
    /// There is no model, or there are several further down.
    pub fn find_model(dir: &Path) -> Result<Self, SourceError> {
        std::fs::read_dir(dir).map_err(SourceError::io_error(dir))?;
        if let Some(model) = Self::model_near(dir) {
            return Ok(model);
        }
        Self::model_below(dir)?.ok_or_else(|| SourceError::Absent {
            dir: dir.to_owned(),
            because: "no COLMAP model was found: wanted cameras and images, .bin or .txt, here, in sparse/0, or in one \
                      sparse/0 up to three folders down"
                .to_owned(),
        })
    }

    /// Finds the model in `dir` itself, or in `sparse/0` or `sparse` below it.
    pub(crate) fn model_near(dir: &Path) -> Option<Self> {
        [dir.to_owned(), dir.join("sparse/0"), dir.join("sparse")].into_iter().find_map(Self::model_at)
    }

    /// Finds the only `sparse/0` further down.
    pub(crate) fn model_below(dir: &Path) -> Result<Option<Self>, SourceError> {
        let mut models = Vec::new();
        for entry in FolderWalk::new(dir).to_depth(DEEPEST).entries(|entry| entry.file_type().is_dir()) {
            let entry = entry?;
            // The folder itself is the task of `model_near`.
            models.extend(Self::model_at(entry.path().join("sparse/0")).filter(|_| entry.depth() > 0));
        }
        let mut models = models.into_iter();
        match (models.next(), models.next()) {
            (Some(a), Some(b)) => {
                let [a, b] = [a, b].map(|model| model.dir().map(Path::to_owned).unwrap_or_default());
                let (a, b) = (a.display(), b.display());
                let because = format!("two COLMAP models were found, {a} and {b}: name one of them");
                Err(SourceError::Absent { dir: dir.to_owned(), because })
            }
            (model, _) => Ok(model),
        }
    }

    /// Finds the model whose files are in `dir` itself.
    pub(crate) fn model_at(dir: PathBuf) -> Option<Self> {
        let form = [ModelForm::Binary, ModelForm::Text].into_iter().find(|form| form.is_in(&dir))?;
        Some(Self { place: ModelPlace::Folder(dir), form })
    }

    /// The model in these files, of the binary form and of any names.
    #[must_use]
    pub fn from_files(cameras: PathBuf, images: PathBuf, points: PathBuf) -> Self {
        Self { place: ModelPlace::Files { cameras, images, points }, form: ModelForm::Binary }
    }

    /// The folder with its files, if they have their usual names.
    fn dir(&self) -> Option<&Path> {
        match &self.place {
            ModelPlace::Folder(dir) => Some(dir),
            ModelPlace::Files { .. } => None,
        }
    }

    pub(super) fn file(&self, stem: &str) -> PathBuf {
        match &self.place {
            ModelPlace::Folder(dir) => self.form.file(dir, stem),
            ModelPlace::Files { cameras, images, points } => match stem {
                "cameras" => cameras.clone(),
                "images" => images.clone(),
                _ => points.clone(),
            },
        }
    }

    /// Reads the cameras by id.
    ///
    /// # Errors
    /// The file is damaged, or the model of a camera is not supported.
    pub fn cameras(&self) -> Result<BTreeMap<u32, ModelCamera>, SourceError> {
        match self.form {
            ModelForm::Binary => binary::read_cameras(&self.file("cameras")),
            ModelForm::Text => text::read_cameras(&self.file("cameras")),
        }
    }

    /// Reads the registered images in file order.
    ///
    /// # Errors
    /// The file is damaged, or a pose is invalid.
    pub fn images(&self) -> Result<Vec<ColmapImage>, SourceError> {
        match self.form {
            ModelForm::Binary => binary::read_images(&self.file("images")),
            ModelForm::Text => text::read_images(&self.file("images")),
        }
    }

    /// Reads the points by id.
    ///
    /// # Errors
    /// The file is absent or damaged.
    pub fn points(&self) -> Result<BTreeMap<u64, ColmapPoint>, SourceError> {
        match self.form {
            ModelForm::Binary => binary::read_points(&self.file("points3D")),
            ModelForm::Text => text::read_points(&self.file("points3D")),
        }
    }

    /// Writes the model to the folder `to` in the binary form, with other names of the images. It
    /// must be in that form.
    ///
    /// # Errors
    /// A file cannot be read or written, or is damaged.
    pub(crate) fn write_renamed(
        &self,
        to: &Path,
        name_of: &dyn Fn(&str) -> String,
    ) -> Result<(), SourceError> {
        let put = |stem: &str, bytes: &[u8]| {
            let file = ModelForm::Binary.file(to, stem);
            std::fs::write(&file, bytes).map_err(SourceError::io_error(&file))
        };
        for stem in ["cameras", "points3D"] {
            let from = self.file(stem);
            put(
                stem,
                &gs2e_files::read(&from, gs2e_files::MAX_MODEL).map_err(SourceError::io_error(&from))?,
            )?;
        }
        put("images", &binary::rename_images(&self.file("images"), name_of)?)
    }

    /// Returns the existing files of the model, by name.
    #[must_use]
    pub fn files(&self) -> Vec<(String, PathBuf)> {
        let files = ["cameras", "images", "points3D"].map(|stem| self.file(stem)).into_iter();
        let named =
            |path: PathBuf| (path.file_name().unwrap_or_default().to_string_lossy().into_owned(), path);
        files.filter(|path| is_there(path)).map(named).collect()
    }

    /// Returns the folders that may contain `images`: the folder of the model or of its `sparse`
    /// folder, and the parent, as in DL3DV.
    pub(super) fn bases(&self) -> Vec<&Path> {
        let Some(mut base) = self.dir() else { return Vec::new() };
        // In this order, so that `x/sparse/0` and `x/sparse` both become `x`.
        for is_shell in [is_number as fn(&str) -> bool, |name| name == "sparse"] {
            if let Some(parent) =
                base.parent().filter(|_| base.file_name().and_then(|n| n.to_str()).is_some_and(is_shell))
            {
                base = parent;
            }
        }
        [Some(base), base.parent()].into_iter().flatten().collect()
    }

    /// Returns the folder to which photo names are relative.
    pub(super) fn photos(&self) -> Option<PathBuf> {
        self.bases().into_iter().map(|base| base.join("images")).find(|images| images.is_dir())
    }

    /// Compares the numbers of records if both forms exist.
    pub(super) fn disagreements(&self) -> Result<Vec<SourceWarning>, SourceError> {
        let mut warnings = Vec::new();
        let Some(dir) = self.dir() else { return Ok(warnings) };
        for (stem, lines_a_record) in [("cameras", 1), ("images", 2), ("points3D", 1)] {
            let (binary, text) = (ModelForm::Binary.file(dir, stem), ModelForm::Text.file(dir, stem));
            if is_there(&binary) && is_there(&text) {
                // Counts show a stale form without parsing both.
                let (found, other) =
                    (binary::count_records(&binary)?, text::count_records(&text, lines_a_record)?);
                if found != other {
                    warnings.push(SourceWarning::CountsDiffer { binary, found, text, other });
                }
            }
        }
        Ok(warnings)
    }
}

fn is_number(name: &str) -> bool {
    !name.is_empty() && name.bytes().all(|b| b.is_ascii_digit())
}
