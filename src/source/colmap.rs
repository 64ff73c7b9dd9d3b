//! COLMAP models (GitHub colmap/colmap, `doc/format.rst`): `cameras`, `images` and `points3D`, as
//! `.bin` or `.txt`.
//!
//! Poses are stored as world to camera with quaternion w first. Pixel centres lie at half-integers,
//! as in this program. If both forms exist, the binary form is read.

mod binary;
mod lenses;
mod reprojection;
mod text;
pub mod write;

pub use reprojection::ReprojectionStats;

use super::layout::CaptureLayout;
use super::photo::{self, PhotoInfo, PhotoScrutiny, SCALED};
use super::{
    Capture, CapturedView, DiskCapture, FoundView, SourceError, SourcePlace, SourceWarning, UnusedPhoto,
    collect_views,
};
use crate::camera::Camera;
use crate::files::{FolderWalk, MAX_DEPTH, is_there};
use crate::image::Size;
use crate::se3::{self, Se3};
use glam::{DQuat, DVec3};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// A camera of a model.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelCamera {
    /// Pinhole part.
    pub camera: Camera,
    /// Lens distortion.
    pub lens: super::LensModel,
}

/// A registered image of a model.
#[derive(Debug, Clone, PartialEq)]
pub struct ColmapImage {
    /// Name, which may contain folders.
    pub name: String,
    /// Id of its camera.
    pub camera_id: u32,
    /// Rotation, unit quaternion, world to camera, with the deviation of the stored rotation.
    pub rotation: se3::ScreenedRotation,
    /// Translation, world to camera.
    pub translation: DVec3,
    /// Key points.
    pub observations: Vec<KeyPoint>,
    /// Place in the file.
    pub place: SourcePlace,
}

/// A key point of an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KeyPoint {
    /// Position, px.
    pub xy: [f64; 2],
    /// Id of its point, if one was triangulated.
    pub point: Option<u64>,
}

/// A triangulated point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColmapPoint {
    /// Position in the world.
    pub xyz: DVec3,
    /// Colour.
    pub rgb: [u8; 3],
    /// Mean reprojection error, px, as stored by COLMAP.
    pub error: f64,
}

/// Maximum depth below the given folder of a folder that is searched for `sparse/0`.
const DEEPEST: usize = 3;

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
    pub(super) fn model_near(dir: &Path) -> Option<Self> {
        [dir.to_owned(), dir.join("sparse/0"), dir.join("sparse")].into_iter().find_map(Self::model_at)
    }

    /// Finds the only `sparse/0` further down.
    pub(super) fn model_below(dir: &Path) -> Result<Option<Self>, SourceError> {
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
    pub(super) fn model_at(dir: PathBuf) -> Option<Self> {
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

    fn file(&self, stem: &str) -> PathBuf {
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
    pub fn write_renamed(&self, to: &Path, name_of: &dyn Fn(&str) -> String) -> Result<(), SourceError> {
        let put = |stem: &str, bytes: &[u8]| {
            let file = ModelForm::Binary.file(to, stem);
            std::fs::write(&file, bytes).map_err(SourceError::io_error(&file))
        };
        for stem in ["cameras", "points3D"] {
            let from = self.file(stem);
            put(
                stem,
                &crate::files::read(&from, crate::files::MAX_MODEL).map_err(SourceError::io_error(&from))?,
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
    fn bases(&self) -> Vec<&Path> {
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
    fn photos(&self) -> Option<PathBuf> {
        self.bases().into_iter().map(|base| base.join("images")).find(|images| images.is_dir())
    }

    /// Compares the numbers of records if both forms exist.
    fn disagreements(&self) -> Result<Vec<SourceWarning>, SourceError> {
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

/// Reads a file of points in the order of their ids. The file name determines the form.
///
/// # Errors
/// The file is absent or damaged.
pub fn read_points(file: &Path) -> Result<Vec<ColmapPoint>, SourceError> {
    let is_text = file.extension().is_some_and(|extension| extension == "txt");
    let points = if is_text { text::read_points(file) } else { binary::read_points(file) }?;
    Ok(points.into_values().collect())
}

fn is_number(name: &str) -> bool {
    !name.is_empty() && name.bytes().all(|b| b.is_ascii_digit())
}

/// Returns the folders whose listing determines [`source_files`].
#[must_use]
pub fn source_folders(dir: &Path) -> Vec<PathBuf> {
    // A model lies in `sparse/0` of the deepest folder that is looked into, and no deeper.
    let mut folders: Vec<PathBuf> = folders_below(dir, DEEPEST + 2).collect();
    if let Ok(model) = ColmapModel::find_model(dir) {
        folders.extend(model.bases().into_iter().map(photo::or_here));
        let photos = model.photos().into_iter();
        folders.extend(photos.flat_map(|images| folders_below(&images, MAX_DEPTH).collect::<Vec<_>>()));
    }
    folders.sort();
    folders.dedup();
    folders
}

/// A folder and the folders below it, down to a depth. Folders that cannot be walked are left out.
pub(super) fn folders_below(root: &Path, depth: usize) -> impl Iterator<Item = PathBuf> {
    let entries = FolderWalk::new(root).to_depth(depth).entries(|_| true).filter_map(Result::ok);
    entries.filter(|entry| entry.file_type().is_dir()).map(walkdir::DirEntry::into_path)
}

/// COLMAP models.
pub(super) struct ColmapLayout;

impl CaptureLayout for ColmapLayout {
    fn name(&self) -> &'static str {
        "colmap"
    }

    fn words(&self) -> &'static str {
        "a COLMAP model"
    }

    fn is_in(&self, folder: &Path) -> bool {
        ColmapModel::model_near(folder).is_some()
    }

    fn read(
        &self,
        captured: &DiskCapture,
        look: PhotoScrutiny,
    ) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
        look_at(&captured.path, look)
    }

    fn files(&self, captured: &DiskCapture) -> Result<Vec<(String, PathBuf)>, SourceError> {
        source_files(&captured.path)
    }

    fn folders(&self, captured: &DiskCapture) -> Vec<PathBuf> {
        source_folders(&captured.path)
    }

    fn model(&self, captured: &DiskCapture) -> Option<ColmapModel> {
        ColmapModel::find_model(&captured.path).ok()
    }
}

/// Reads the model found in `dir` as a capture.
///
/// # Errors
/// No model or more than one is found, a file is damaged, the model of a camera is not supported,
/// or two images have the same name.
pub fn read_capture(dir: &Path) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
    look_at(dir, PhotoScrutiny::Bytes)
}

/// Reads the model found in `dir`, with the given depth of reading for photos.
pub(super) fn look_at(dir: &Path, look: PhotoScrutiny) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
    let model = ColmapModel::find_model(dir)?;
    let folder = model.photos();
    let from = folder.as_deref().map(PhotoPlace::Folder);
    read_model(&model, ModelPhotos { from, sizing: PhotoSizing::AsStated, look })
}

/// Reads a model whose photos are listed by their names.
///
/// # Errors
/// A file is damaged; see [`read_capture`].
pub(super) fn read_listed(
    model: &ColmapModel,
    photos: &[(String, PathBuf)],
) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
    let from = Some(PhotoPlace::Listed(photos));
    let look = PhotoScrutiny::Bytes;
    read_model(model, ModelPhotos { from, sizing: PhotoSizing::AsStated, look })
}

/// The photos of a model.
#[derive(Debug, Clone, Copy)]
pub(super) struct ModelPhotos<'a> {
    /// Their place, if they exist.
    pub(super) from: Option<PhotoPlace<'a>>,
    /// Treatment of photos whose size differs from the size of their camera.
    pub(super) sizing: PhotoSizing,
    /// Depth of reading.
    pub(super) look: PhotoScrutiny,
}

/// The place of photos.
#[derive(Debug, Clone, Copy)]
pub(super) enum PhotoPlace<'a> {
    /// The folder to which their names are relative.
    Folder(&'a Path),
    /// Names with paths.
    Listed(&'a [(String, PathBuf)]),
}

impl PhotoPlace<'_> {
    fn find(self, name: &str) -> Option<PathBuf> {
        match self {
            Self::Folder(folder) => photo::find_photo(folder, name),
            Self::Listed(photos) => {
                photos.iter().find(|(listed, _)| listed == name).map(|(_, path)| path.clone())
            }
        }
    }

    /// All names, in natural order.
    fn names(self) -> Result<Vec<String>, SourceError> {
        match self {
            Self::Folder(folder) => photo::list_photos(folder),
            Self::Listed(photos) => Ok(photos.iter().map(|(name, _)| name.clone()).collect()),
        }
    }
}

/// Treatment of a photo whose size differs from the size of its camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PhotoSizing {
    /// The camera is kept, and a warning is returned.
    AsStated,
    /// The camera is scaled.
    ToPhoto,
}

/// Reads a model with its photos.
pub(super) fn read_model(
    model: &ColmapModel,
    photos: ModelPhotos<'_>,
) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
    let ModelPhotos { from, sizing, look } = photos;
    let mut warnings = model.disagreements()?;
    let (cameras, images) = (model.cameras()?, model.images()?);
    let find =
        |name: &str| from.and_then(|from| from.find(name)).map(|p| photo::read_photo(&p, look)).transpose();
    // Every byte of a photo may be hashed, so photos are read in parallel.
    let photos: Vec<Option<PhotoInfo>> =
        images.par_iter().map(|image| find(&image.name)).collect::<Result<_, _>>()?;
    let unused: Vec<UnusedPhoto> = unregistered_photos(from, &images)?
        .into_par_iter()
        .map(|name| Ok(UnusedPhoto::not_registered(find(&name)?, name)))
        .collect::<Result<_, SourceError>>()?;
    let of_views = images.iter().map(|image| image.name.as_str()).zip(photos.iter().map(Option::as_ref));
    if let Some(PhotoPlace::Folder(folder)) = from {
        warnings.extend(photo::missing_warning(folder, of_views));
    }
    let path = model.file("images");
    let mut found = Vec::with_capacity(images.len());
    for (image, photo) in images.into_iter().zip(photos) {
        let fault =
            |because| SourceError::Content { path: path.clone(), place: image.place.clone(), because };
        let Some(taken) = cameras.get(&image.camera_id) else {
            let name = &image.name;
            return Err(fault(format!(
                "`{name}` uses camera {}, which the model does not have",
                image.camera_id
            )));
        };
        let mut camera = taken.camera;
        let other = photo.as_ref().and_then(|p| p.size).filter(|&size| size != camera.size);
        if let Some(size) = other.filter(|_| sizing == PhotoSizing::ToPhoto) {
            camera = photo::fit_camera(&camera, size).map_err(|e| fault(format!("`{}`: {e}", image.name)))?;
        }
        warnings.extend(image_warnings(&image, taken, other, sizing));
        // The lens stays as it is: its coefficients are relative to the focal length.
        let view = CapturedView { camera, ..image_view(&image, taken, photo) };
        found.push(FoundView { view, place: image.place });
    }
    Ok((Capture { unused, ..collect_views(&path, found)? }, warnings))
}

/// The photos for which a model has no pose.
fn unregistered_photos(
    from: Option<PhotoPlace<'_>>,
    images: &[ColmapImage],
) -> Result<Vec<String>, SourceError> {
    let registered: BTreeSet<&str> = images.iter().map(|image| image.name.as_str()).collect();
    let mut names = from.map_or_else(|| Ok(Vec::new()), PhotoPlace::names)?;
    names.retain(|name| !registered.contains(name.as_str()));
    Ok(names)
}

fn image_warnings(
    image: &ColmapImage,
    taken: &ModelCamera,
    other: Option<Size>,
    sizing: PhotoSizing,
) -> Vec<SourceWarning> {
    let name = || image.name.clone();
    let size = other.map(|photo| SourceWarning::PhotoSize {
        image: name(),
        photo,
        stated: taken.camera.size,
        action: match sizing {
            PhotoSizing::AsStated => "the camera is used as stated",
            PhotoSizing::ToPhoto => SCALED,
        },
    });
    let turned = image.rotation;
    let turned =
        turned.projected.then(|| SourceWarning::Projected { image: name(), deviation: turned.deviation });
    size.into_iter().chain(turned).collect()
}

fn image_view(image: &ColmapImage, taken: &ModelCamera, photo: Option<PhotoInfo>) -> CapturedView {
    let camera_from_world = Se3 { rotation: image.rotation.rotation, translation: image.translation };
    CapturedView {
        name: image.name.clone(),
        world_from_camera: camera_from_world.inverse(),
        camera: taken.camera,
        lens: taken.lens.clone(),
        sha256: photo.and_then(|p| p.sha256),
    }
}

/// Returns the files that [`read_capture`] reads, each with its name within the source: the files
/// of the model's form, and the existing photos, with or without a pose.
///
/// # Errors
/// The model is absent, or the images that name the photos cannot be read; see [`read_capture`].
pub fn source_files(dir: &Path) -> Result<Vec<(String, PathBuf)>, SourceError> {
    let model = ColmapModel::find_model(dir)?;
    let folder = model.photos();
    files_of(&model, folder.as_deref())
}

/// Returns the files that [`read_model`] reads.
pub(super) fn files_of(
    model: &ColmapModel,
    folder: Option<&Path>,
) -> Result<Vec<(String, PathBuf)>, SourceError> {
    let mut files = model.files();
    if let Some(folder) = folder {
        let images = model.images()?;
        let unregistered = unregistered_photos(Some(PhotoPlace::Folder(folder)), &images)?;
        let names = images.into_iter().map(|image| image.name).chain(unregistered);
        files.extend(
            names.filter_map(|name| Some((format!("images/{name}"), photo::find_photo(folder, &name)?))),
        );
    }
    Ok(files)
}

/// Converts the seven numbers of a pose that COLMAP stores.
fn image_pose([w, x, y, z, tx, ty, tz]: [f64; 7]) -> Result<(se3::ScreenedRotation, DVec3), String> {
    let translation = DVec3::new(tx, ty, tz);
    if !translation.is_finite() {
        return Err(format!("the translation is {translation}, wanted finite numbers"));
    }
    // COLMAP stores `w` first.
    let rotation = se3::rotation_from_quaternion(DQuat::from_xyzw(x, y, z, w)).map_err(|e| e.to_string())?;
    Ok((rotation, translation))
}
