//! Layouts of captures on disk, and detection of the layout from the files at a path.

use super::{Capture, DiskCapture, SourceError, SourceWarning, colmap, model, nerfstudio};
use crate::files::is_there;
use std::path::Path;

/// The kinds of captures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CaptureKind {
    /// A COLMAP model.
    Colmap,
    /// A nerfstudio `transforms.json`.
    Nerfstudio,
    /// A 3DGS model folder.
    Model,
    /// An instance of `MVImgNet`. It is a COLMAP model, and is treated as one unless the kind is
    /// named.
    Mvimgnet,
    /// A scene of DL3DV-10K, treated likewise.
    Dl3dv,
}

const WANTED: &str = "wanted a COLMAP model (cameras and images, .bin or .txt, here or in sparse/0), a transforms.json, \
                      or a 3DGS model folder (cameras.json)";

impl CaptureKind {
    /// Detects the kind of the file or folder at `path`. Files in the folder itself or in its
    /// `sparse/0` take precedence over a COLMAP model further down.
    ///
    /// # Errors
    /// The path does not exist, or matches no kind or several kinds.
    pub fn kind_of(path: &Path) -> Result<Self, SourceError> {
        let absent = |because| SourceError::Absent { dir: path.to_owned(), because };
        if !super::is_folder(path)? {
            return Self::of_file(path)
                .ok_or_else(|| absent(format!("a file with an unknown name, {WANTED}")));
        }
        std::fs::read_dir(path).map_err(SourceError::io_error(path))?;
        // Folders of MVImgNet and DL3DV are read by their general layout, unless their kind is
        // named.
        let kinds = [
            (Self::Colmap, colmap::ColmapModel::model_near(path).is_some()),
            (Self::Nerfstudio, is_there(&nerfstudio::locate_transforms(path))),
            (Self::Model, is_there(&model::locate_cameras(path))),
        ];
        let found: Vec<Self> = kinds.into_iter().filter_map(|(kind, is)| is.then_some(kind)).collect();
        match found[..] {
            [kind] => Ok(kind),
            [] if colmap::ColmapModel::model_below(path)?.is_some() => Ok(Self::Colmap),
            [] => Err(absent(format!("found no capture, {WANTED}"))),
            _ => {
                let names: Vec<&str> = found.iter().map(|kind| kind.words()).collect();
                Err(absent(format!("it contains {}: name the one to use", names.join(" and "))))
            }
        }
    }

    /// Detects the kind of a file by its name. COLMAP models are folders.
    fn of_file(path: &Path) -> Option<Self> {
        let named = |name: &str| path.file_name().is_some_and(|found| found == name);
        let json = path.extension().is_some_and(|extension| extension == "json");
        // A `transforms.json` may have any name, for example `transforms_train.json`.
        if named("cameras.json") { Some(Self::Model) } else { json.then_some(Self::Nerfstudio) }
    }

    fn words(self) -> &'static str {
        match self {
            Self::Colmap => "a COLMAP model",
            Self::Nerfstudio => "a transforms.json",
            Self::Model => "a cameras.json",
            Self::Mvimgnet => "an instance of MVImgNet",
            Self::Dl3dv => "a scene of DL3DV",
        }
    }

    /// Name of the kind in recipes.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Colmap => "colmap",
            Self::Nerfstudio => "nerfstudio",
            Self::Model => "model",
            Self::Mvimgnet => "mvimgnet",
            Self::Dl3dv => "dl3dv",
        }
    }

    /// Reads the source at `path` as this kind, and adds a warning about its lenses.
    ///
    /// # Errors
    /// The reader of this kind fails.
    pub fn read(self, path: &Path) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
        DiskCapture::all_views(self, path.to_owned()).read()
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
            let told = kind(&files.concat()).unwrap_err();
            assert!(told.starts_with(wanted), "{told}");
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
