//! The kinds of sources, and detection of the kind of a capture from the files at a path.

use super::layout::CaptureLayout;
use super::{Capture, DiskCapture, SourceDataset, SourceError, SourceWarning};
use super::{colmap, dl3dv, model, mvimgnet, nerfstudio, photo, photos, video};
use std::path::Path;

/// The kinds of captures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum CaptureKind {
    /// A COLMAP model.
    Colmap,
    /// An instance of `MVImgNet`. It is a COLMAP model, and is treated as one unless the kind is
    /// named.
    Mvimgnet,
    /// A scene of DL3DV-10K, treated likewise.
    Dl3dv,
    /// A nerfstudio `transforms.json`.
    Nerfstudio,
    /// A 3DGS model folder.
    Model,
    /// A folder of photos without poses. It is never detected, because most captures contain one.
    Photos,
    /// A video, treated likewise.
    Video,
}

const WANTED: &str = "wanted a COLMAP model (cameras and images, .bin or .txt, here or in sparse/0), a transforms.json, \
                      or a 3DGS model folder (cameras.json)";

const WITHOUT_POSES: &str = "A recipe with source: { photos: { path: … } } has the poses found by COLMAP";

impl CaptureKind {
    /// All kinds.
    pub const ALL: [Self; 7] =
        [Self::Colmap, Self::Mvimgnet, Self::Dl3dv, Self::Nerfstudio, Self::Model, Self::Photos, Self::Video];

    /// The implementation of the kind. Everything that differs between kinds is behind it.
    pub(super) fn as_layout(self) -> &'static dyn CaptureLayout {
        match self {
            Self::Colmap => &colmap::ColmapLayout,
            Self::Mvimgnet => &mvimgnet::MvimgnetLayout,
            Self::Dl3dv => &dl3dv::Dl3dvLayout,
            Self::Nerfstudio => &nerfstudio::NerfstudioLayout,
            Self::Model => &model::ModelLayout,
            Self::Photos => &photos::PhotosLayout,
            Self::Video => &video::VideoLayout,
        }
    }

    /// Detects the kind of the file or folder at `path`.
    ///
    /// # Errors
    /// The path does not exist, or matches no kind or several kinds.
    pub fn kind_of(path: &Path) -> Result<Self, SourceError> {
        let found = Self::kinds_at(path)?;
        if let [kind] = found[..] {
            return Ok(kind);
        }
        let names: Vec<&str> = found.iter().map(|kind| kind.as_layout().words()).collect();
        let because = format!("it contains {}: name the one to use", names.join(" and "));
        Err(SourceError::Absent { dir: path.to_owned(), because })
    }

    /// Detects all kinds of the file or folder at `path`; at least one. Files in the folder itself or in
    /// its `sparse/0` take precedence over a COLMAP model further down.
    ///
    /// # Errors
    /// The path does not exist, or matches no kind.
    pub fn kinds_at(path: &Path) -> Result<Vec<Self>, SourceError> {
        let absent = |because| SourceError::Absent { dir: path.to_owned(), because };
        if !super::is_folder(path)? {
            let kind = Self::ALL.into_iter().find(|kind| kind.as_layout().is_file(path));
            return kind
                .map(|kind| vec![kind])
                .ok_or_else(|| absent(format!("a file with an unknown name, {WANTED}")));
        }
        std::fs::read_dir(path).map_err(SourceError::io_error(path))?;
        let found: Vec<Self> = Self::ALL.into_iter().filter(|kind| kind.as_layout().is_in(path)).collect();
        if !found.is_empty() {
            Ok(found)
        } else if colmap::ColmapModel::model_below(path)?.is_some() {
            Ok(vec![Self::Colmap])
        } else if photo::has_photos(path) || photo::has_photos(&path.join("images")) {
            Err(absent(format!("found photos without poses, {WANTED}. {WITHOUT_POSES}")))
        } else {
            Err(absent(format!("found no capture, {WANTED}")))
        }
    }

    /// Detects the kind of a capture with photos; `None` for one that has poses only. A COLMAP model
    /// comes before any other kind, because it has points.
    ///
    /// # Errors
    /// As [`Self::kind_of`].
    pub fn with_photos(path: &Path) -> Result<Option<Self>, SourceError> {
        if colmap::ColmapModel::find_model(path).is_ok() {
            return Ok(Some(Self::Colmap));
        }
        Self::kind_of(path).map(|kind| Some(kind).filter(|kind| *kind != Self::Model))
    }

    /// Name of the kind in recipes.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.as_layout().name()
    }

    /// The kind with this name.
    #[must_use]
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// The dataset whose layout this kind is.
    #[must_use]
    pub fn dataset(self) -> Option<&'static SourceDataset> {
        self.as_layout().dataset()
    }

    /// Returns true if a source of this kind has no poses, so that a step finds them.
    #[must_use]
    pub fn needs_poses(self) -> bool {
        self.as_layout().needs_poses()
    }

    /// Returns true for a video.
    #[must_use]
    pub fn is_video(self) -> bool {
        self.as_layout().is_video()
    }

    /// Returns true if a folder of this kind has the Gaussians of the scene, and no photos.
    #[must_use]
    pub fn has_gaussians(self) -> bool {
        self.as_layout().has_gaussians()
    }

    /// Patterns of the names of photos that are no views, in a dataset of this kind.
    #[must_use]
    pub fn leftovers(self) -> Vec<String> {
        let dataset = self.dataset().into_iter();
        dataset.flat_map(|dataset| dataset.leftovers).map(|pattern| (*pattern).to_owned()).collect()
    }

    /// Reads the source at `path` as this kind, and adds a warning about its lenses.
    ///
    /// # Errors
    /// The reader of this kind fails.
    pub fn read(self, path: &Path) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
        DiskCapture::all_views(self, path.to_owned()).read()
    }
}

/// The kinds of sources that recipes and releases name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum SourceKind {
    /// The built-in procedural scene, which belongs to this program.
    Procedural,
    /// A capture on disk: the owner's, or a dataset's.
    Captured(CaptureKind),
    /// No source: a scene file of the owner, and poses from the recipe.
    None,
}

impl SourceKind {
    /// Returns the name of the kind in recipes and in `scene.json`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Procedural => "procedural",
            Self::Captured(kind) => kind.name(),
            Self::None => "none",
        }
    }

    /// Returns the kind with this name.
    #[must_use]
    pub fn by_name(name: &str) -> Option<Self> {
        let others = [Self::Procedural, Self::None];
        let all = CaptureKind::ALL.into_iter().map(Self::Captured).chain(others);
        all.into_iter().find(|kind| kind.name() == name)
    }

    /// Returns true for the procedural scene, which shows nothing that exists.
    #[must_use]
    pub fn is_made_up(self) -> bool {
        self == Self::Procedural
    }

    /// The kind of capture, if the source is one.
    #[must_use]
    pub fn captured(self) -> Option<CaptureKind> {
        match self {
            Self::Captured(kind) => Some(kind),
            Self::Procedural | Self::None => None,
        }
    }

    /// The dataset whose layout this kind is.
    #[must_use]
    pub fn dataset(self) -> Option<&'static SourceDataset> {
        self.captured().and_then(CaptureKind::dataset)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLMAP: [&str; 2] = ["cameras.txt", "images.txt"];

    /// Detects the kind of a folder with these empty files, or returns the message.
    fn kind(files: &[String]) -> Result<CaptureKind, String> {
        let dir = tempfile::tempdir().unwrap();
        for file in files {
            let path = dir.path().join(file);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        CaptureKind::kind_of(dir.path())
            .map_err(|e| e.to_string().replace(dir.path().to_str().unwrap(), "DIR"))
    }

    fn model_in(folder: &str) -> Vec<String> {
        COLMAP.iter().map(|file| format!("{folder}{file}")).collect()
    }

    #[test]
    fn a_folder_is_known_by_its_files() {
        let t = |files: &[Vec<String>], wanted: CaptureKind| {
            assert_eq!(kind(&files.concat()), Ok(wanted), "{files:?}")
        };
        let transforms = || vec!["transforms.json".to_owned()];
        t(&[model_in("")], CaptureKind::Colmap);
        t(&[model_in("sparse/0/")], CaptureKind::Colmap);
        t(&[model_in("a/b/sparse/0/")], CaptureKind::Colmap);
        t(&[transforms()], CaptureKind::Nerfstudio);
        // The layout of ns-process-data: the nearer file wins.
        t(&[transforms(), model_in("colmap/sparse/0/")], CaptureKind::Nerfstudio);
        t(&[vec!["cameras.json".to_owned(), "cfg_args".to_owned()]], CaptureKind::Model);
    }

    #[test]
    fn what_is_of_no_kind_or_of_two_is_refused() {
        let t = |files: &[Vec<String>], wanted: &str| {
            let message = kind(&files.concat()).unwrap_err();
            assert!(message.starts_with(wanted), "{message}");
        };
        t(&[], "DIR: found no capture, wanted a COLMAP model");
        t(&[vec!["images.txt".to_owned()]], "DIR: found no capture");
        t(
            &[vec!["transforms.json".to_owned()], model_in("sparse/0/")],
            "DIR: it contains a COLMAP model and a transforms.json: name",
        );
        t(
            &[model_in("a/sparse/0/"), model_in("b/sparse/0/")],
            "DIR: two COLMAP models were found, DIR/a/sparse/0 and",
        );
    }

    #[test]
    fn a_file_is_known_by_its_name() {
        let dir = tempfile::tempdir().unwrap();
        let t = |name: &str, wanted: Option<CaptureKind>| {
            std::fs::write(dir.path().join(name), "").unwrap();
            assert_eq!(CaptureKind::kind_of(&dir.path().join(name)).ok(), wanted, "{name}");
        };
        t("transforms_train.json", Some(CaptureKind::Nerfstudio));
        t("cameras.json", Some(CaptureKind::Model));
        t("images.bin", None);
        assert!(matches!(CaptureKind::kind_of(&dir.path().join("gone")), Err(SourceError::Io { .. })));
    }
}
