//! DL3DV-10K (GitHub DL3DV-10K/Dataset): a scene is a folder with a name of 64 hexadecimal digits.
//!
//! The bulk sets contain `transforms.json` and one folder of photos: `images_4` at 960P, `images_8`
//! at 480P, `images_2` at 2K, `images` at 4K. The samples contain the file and all sizes in a
//! folder `colmap` of the scene, with a COLMAP model in `colmap/sparse/0`. The benchmark has the
//! same layout in a folder `nerfstudio`. `transforms.json` always names `images` and the size of
//! the photos there. The reader adapts names and cameras to the photos that exist.
//!
//! The two forms of the poses may have different world frames. The Gaussians of a scene belong to
//! one of them.

use super::colmap::{self, ColmapModel, PhotoPlace, PhotoSizing};
use super::inventory::{ScenePath, list_subfolders};
use super::layout::CaptureLayout;
use super::photo::{PhotoScrutiny, or_here};
use super::{Capture, DiskCapture, PoseFile, SourceDataset, SourceError, SourceWarning, nerfstudio};
use gs2e_files::{MAX_DEPTH, is_there};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Possible folders of a scene's files, relative to the scene.
const HOMES: [&str; 3] = ["", "colmap", "nerfstudio"];

/// Folders of photos, the largest first.
const PHOTOS: [&str; 4] = ["images", "images_2", "images_4", "images_8"];

static DATASET: SourceDataset = SourceDataset {
    name: "DL3DV-10K",
    url: "https://github.com/DL3DV-10K/Dataset",
    scale: "large",
    leftovers: &[],
    has_classes: false,
    has_two_poses: true,
};

/// Scenes of the dataset.
pub(super) struct Dl3dvLayout;

impl CaptureLayout for Dl3dvLayout {
    fn name(&self) -> &'static str {
        "dl3dv"
    }

    fn words(&self) -> &'static str {
        "a scene of DL3DV"
    }

    fn read(
        &self,
        captured: &DiskCapture,
        look: PhotoScrutiny,
    ) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
        let Dl3dvFiles { poses, photos } = Dl3dvFiles::of(captured)?;
        let (capture, mut warnings) = match poses {
            PoseSource::Colmap(model) => {
                let from = photos.as_deref().map(PhotoPlace::Folder);
                let photos = colmap::ModelPhotos { from, sizing: PhotoSizing::ToPhoto, look };
                colmap::read_model(&model, photos)
            }
            PoseSource::Transforms(file) => {
                nerfstudio::read_file(&file, named_photos(photos.as_deref()), look)
            }
        }?;
        // The layout of the dataset always has this difference, so a warning would be noise.
        warnings.retain(|warning| !matches!(warning, SourceWarning::PhotoSize { .. }));
        Ok((capture, warnings))
    }

    fn files(&self, captured: &DiskCapture) -> Result<Vec<(String, PathBuf)>, SourceError> {
        let Dl3dvFiles { poses, photos } = Dl3dvFiles::of(captured)?;
        match poses {
            PoseSource::Colmap(model) => colmap::files_of(&model, photos.as_deref()),
            PoseSource::Transforms(file) => nerfstudio::files_of(&file, named_photos(photos.as_deref())),
        }
    }

    fn folders(&self, captured: &DiskCapture) -> Vec<PathBuf> {
        colmap::folders_below(&captured.path, MAX_DEPTH).collect()
    }

    fn model(&self, captured: &DiskCapture) -> Option<ColmapModel> {
        match Dl3dvFiles::of(captured).ok()?.poses {
            PoseSource::Colmap(model) => Some(model),
            PoseSource::Transforms(_) => None,
        }
    }

    fn scenes(&self, root: &Path, _: &BTreeSet<String>) -> Result<Vec<ScenePath>, SourceError> {
        hash_folders(root)
    }

    fn dataset(&self) -> Option<&'static SourceDataset> {
        Some(&DATASET)
    }

    fn upstream_id(&self, path: &Path) -> Option<String> {
        let name = path.iter().next_back()?.to_str()?;
        is_scene(name).then(|| name.to_owned())
    }
}

/// Returns true if the name of a folder is that of a scene: 64 hexadecimal digits.
fn is_scene(name: &str) -> bool {
    name.len() == 64 && name.bytes().all(|b| b.is_ascii_hexdigit())
}

/// The files of a scene, found but not yet read.
struct Dl3dvFiles {
    poses: PoseSource,
    photos: Option<PathBuf>,
}

enum PoseSource {
    Colmap(ColmapModel),
    Transforms(PathBuf),
}

impl Dl3dvFiles {
    /// Finds the requested poses; by default the COLMAP model, and otherwise `transforms.json`.
    fn of(captured: &DiskCapture) -> Result<Self, SourceError> {
        let (scene, wanted) = (captured.path.as_path(), captured.selection.poses);
        std::fs::read_dir(scene).map_err(SourceError::io_error(scene))?;
        let homes = || HOMES.iter().map(|home| or_here(&scene.join(home)));
        let transforms = homes().map(|home| home.join("transforms.json")).find(|file| is_there(file));
        // Models further down are not looked for if `transforms.json` is requested: two of them
        // would be an error.
        let model = match (wanted, ColmapModel::model_near(scene)) {
            (Some(PoseFile::Transforms), _) => None,
            (_, Some(model)) => Some(model),
            (_, None) => ColmapModel::model_below(scene)?,
        };
        let poses = match (wanted, model, transforms) {
            (_, Some(model), _) => PoseSource::Colmap(model),
            (None | Some(PoseFile::Transforms), None, Some(file)) => PoseSource::Transforms(file),
            (wanted, ..) => {
                let what = match wanted {
                    Some(PoseFile::Colmap) => {
                        "it contains no COLMAP model: wanted sparse/0, up to three folders down"
                    }
                    Some(PoseFile::Transforms) => {
                        "no transforms.json here or in the subfolders colmap and nerfstudio"
                    }
                    None => "it contains no poses: wanted a COLMAP model or a transforms.json",
                };
                return Err(SourceError::Absent { dir: scene.to_owned(), because: what.to_owned() });
            }
        };
        let photos = homes().flat_map(|home| PHOTOS.map(|name| home.join(name))).find(|dir| dir.is_dir());
        Ok(Self { poses, photos })
    }
}

fn named_photos(photos: Option<&Path>) -> nerfstudio::PhotoLocation<'_> {
    photos.map_or(nerfstudio::PhotoLocation::AsNamed, nerfstudio::PhotoLocation::In)
}

/// Finds folders with a hash as their name, in the tree or one level below; other folders are
/// ignored.
fn hash_folders(root: &Path) -> Result<Vec<ScenePath>, SourceError> {
    let mut found = Vec::new();
    let mut add = |name: String, path| found.push(ScenePath { name, path, misnamed: None });
    for (name, path) in list_subfolders(root)? {
        if is_scene(&name) {
            add(name, path);
        } else {
            list_subfolders(&path)?
                .into_iter()
                .filter(|(name, _)| is_scene(name))
                .for_each(|(n, p)| add(n, p));
        }
    }
    Ok(found)
}
