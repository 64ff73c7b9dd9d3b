//! A COLMAP model and its photos as a capture.

use super::{ColmapImage, ColmapModel, ModelCamera};
use crate::photo::{PhotoInfo, PhotoScrutiny, SCALED};
use crate::{
    Capture, CapturedView, FoundView, SourceError, SourceWarning, UnusedPhoto, collect_views, photo,
};
use gs2e_image::Size;
use gs2e_num::se3::Se3;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Reads a model whose photos are listed by their names.
///
/// # Errors
/// A file is damaged; see [`read_capture`](super::read_capture).
pub(crate) fn read_listed(
    model: &ColmapModel,
    photos: &[(String, PathBuf)],
) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
    let from = Some(PhotoPlace::Listed(photos));
    let look = PhotoScrutiny::Bytes;
    read_model(model, ModelPhotos { from, sizing: PhotoSizing::AsStated, look })
}

/// The photos of a model.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ModelPhotos<'a> {
    /// Their place, if they exist.
    pub(crate) from: Option<PhotoPlace<'a>>,
    /// Treatment of photos whose size differs from the size of their camera.
    pub(crate) sizing: PhotoSizing,
    /// Depth of reading.
    pub(crate) look: PhotoScrutiny,
}

/// The place of photos.
#[derive(Debug, Clone, Copy)]
pub(crate) enum PhotoPlace<'a> {
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
pub(crate) enum PhotoSizing {
    /// The camera is kept, and a warning is returned.
    AsStated,
    /// The camera is scaled.
    ToPhoto,
}

/// Reads a model with its photos.
pub(crate) fn read_model(
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

/// Returns the files that [`read_model`] reads.
pub(crate) fn files_of(
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
