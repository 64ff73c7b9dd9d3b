//! A capture in the form that trainers read: a folder with `images` and, in `sparse/0`, a COLMAP
//! model with pinhole cameras and the points of the source.
//!
//! Photos are copied, never linked, so that a program cannot modify the user's files. They are
//! numbered in capture order, so that a trainer that holds out photos by counting names holds out
//! the same views as this program.

use crate::colmap::write::{WrittenImage, write_model};
use crate::colmap::{ColmapPoint, read_points};
use crate::lens::NEGLIGIBLE_PX;
use crate::undistort::undistort_photo;
use crate::{Capture, CapturedView, SourceError};
use gs2e_files as files;
use gs2e_files::PathError;
use gs2e_image::{GreyImage, Image, Size, jpeg, png, to_byte};
use rayon::prelude::*;
use std::fs::{self, File};
use std::io::{self, BufWriter, Cursor};
use std::path::{Path, PathBuf};

/// Version of the layout, part of the key of trainings. It must be raised when the same capture is
/// laid out in different bytes.
pub const LAYOUT: u32 = 1;

/// The reason why a capture cannot be prepared for a trainer.
#[derive(Debug, thiserror::Error)]
pub enum LayoutError {
    /// An operation on a file or folder failed.
    #[error("use {0}")]
    Io(PathError),
    /// A photo cannot be read.
    #[error("read the photo {}: {because}", path.display())]
    Photo {
        /// The photo.
        path: PathBuf,
        /// Cause.
        because: String,
    },
    /// The source's points cannot be read.
    #[error("read the points: {0}")]
    Points(#[from] SourceError),
    /// No view is left for training.
    #[error(
        "find a photo to train on: {views} views, {without_photo} of them without a photo, {held_out} held out"
    )]
    Nothing {
        /// Number of all views.
        views: usize,
        /// Number of views without a photo.
        without_photo: usize,
        /// Number of held-out views.
        held_out: usize,
    },
    /// The work was asked to stop.
    #[error("finish: it was interrupted")]
    Stopped,
}

fn layout_error(path: &Path) -> impl FnOnce(io::Error) -> LayoutError {
    move |source| LayoutError::Io(PathError::new(path, source))
}

/// Summary of a prepared capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct LaidOutCapture {
    /// Number of views that were left out because their photos are missing.
    pub(super) without_photo: usize,
}

/// Returns the estimated memory of a trainer in bytes: the photos of a capture as 32-bit colours,
/// and the rest.
#[must_use]
pub fn photo_memory(capture: &Capture) -> u64 {
    const COLOUR_BYTES: u64 = 12;
    const ELSE: u64 = 2 << 30;
    let pixels = |view: &CapturedView| u64::from(view.camera.size.width) * u64::from(view.camera.size.height);
    capture.views.iter().map(|view| COLOUR_BYTES * pixels(view)).fold(ELSE, u64::saturating_add)
}

/// Writes a capture to the new folder `to`. `files` are the files of its source, by their names in
/// the source.
pub(super) fn lay_out(
    capture: &Capture,
    files: &[(String, PathBuf)],
    hold_out: Option<u32>,
    to: &Path,
    goes_on: &(dyn Fn() -> bool + Sync),
) -> Result<LaidOutCapture, LayoutError> {
    let (images, model) = (to.join("images"), to.join("sparse/0"));
    for folder in [&images, &model] {
        fs::create_dir_all(folder).map_err(layout_error(folder))?;
    }
    let is_held_out = |index: usize| hold_out.is_some_and(|every| index.is_multiple_of(every as usize));
    let used: Vec<(usize, &CapturedView)> =
        capture.views.iter().enumerate().filter(|(index, _)| !is_held_out(*index)).collect();
    let photos: Vec<(usize, &CapturedView, &Path)> =
        used.iter().filter_map(|(index, view)| Some((*index, *view, find_photo(view, files)?))).collect();
    let without_photo = used.len() - photos.len();
    if photos.is_empty() {
        let views = capture.views.len();
        return Err(LayoutError::Nothing { views, without_photo, held_out: views - used.len() });
    }
    let put = |(index, view, photo): &(usize, &CapturedView, &Path)| {
        // A capture may have thousands of photos, so the work can stop between two of them.
        if goes_on() { place_photo(*index, view, photo, &images) } else { Err(LayoutError::Stopped) }
    };
    let taken: Vec<WrittenImage> = photos.par_iter().map(put).collect::<Result<_, _>>()?;
    write_model(&model, &taken, &model_points(files)?).map_err(layout_error(&model))?;
    Ok(LaidOutCapture { without_photo })
}

/// Returns the photo of a view, if it exists. `files` are the files of a source, by their names in
/// the source.
#[must_use]
pub fn find_photo<'f>(view: &CapturedView, files: &'f [(String, PathBuf)]) -> Option<&'f Path> {
    // COLMAP sources list their photos below `images`, the others under the name of the view.
    let is_its = |name: &str| name == view.name || name.strip_prefix("images/") == Some(&view.name);
    files.iter().find(|(name, _)| is_its(name)).map(|(_, path)| path.as_path())
}

/// Returns the points of the source's COLMAP model, if it has one. `files` are the files of the
/// source, by their names in the source.
///
/// # Errors
/// The file of the points cannot be read.
pub fn model_points(files: &[(String, PathBuf)]) -> Result<Vec<ColmapPoint>, SourceError> {
    let file = files.iter().find(|(name, _)| ["points3D.bin", "points3D.txt"].contains(&name.as_str()));
    file.map(|(_, path)| read_points(path)).transpose().map(Option::unwrap_or_default)
}

/// Writes a photo to the folder `images`, undistorted if its lens has distortion.
fn place_photo(
    index: usize,
    view: &CapturedView,
    photo: &Path,
    images: &Path,
) -> Result<WrittenImage, LayoutError> {
    let is_bent = view.lens.max_displacement_px(&view.camera) > NEGLIGIBLE_PX;
    let name = if is_bent {
        write_undistorted(index, view, photo, images)?
    } else {
        let name = match photo.extension().and_then(|extension| extension.to_str()) {
            Some(extension) => format!("{index:06}.{}", extension.to_lowercase()),
            None => format!("{index:06}"),
        };
        let mut from = files::open_at_most(photo, files::MAX_PICTURE).map_err(layout_error(photo))?;
        let to = images.join(&name);
        File::create_new(&to).and_then(|mut to| io::copy(&mut from, &mut to)).map_err(layout_error(&to))?;
        name
    };
    let CapturedView { world_from_camera, camera, .. } = *view;
    Ok(WrittenImage { name, world_from_camera, camera })
}

/// Writes the undistorted photo and returns its file name.
fn write_undistorted(
    index: usize,
    view: &CapturedView,
    photo: &Path,
    images: &Path,
) -> Result<String, LayoutError> {
    let unreadable = |because: String| LayoutError::Photo { path: photo.to_owned(), because };
    let taken = decode_photo(photo, view.camera.size).map_err(unreadable)?;
    let straight = undistort_photo(&taken, &view.camera, &view.lens);
    // PNG is lossless: the resampling remains the only change to the photo.
    let name = format!("{index:06}.png");
    let file = images.join(&name);
    File::create(&file)
        .and_then(|out| png::write_image(&*straight, BufWriter::new(out)))
        .map_err(layout_error(&file))?;
    Ok(name)
}

/// Decodes the colours of a PNG or a JPEG, which must have the size of its camera, because the lens
/// bends it. A grey picture becomes three equal channels.
fn decode_photo(photo: &Path, camera: Size) -> Result<Image<[u8; 3]>, String> {
    let bytes = files::read(photo, files::MAX_PICTURE).map_err(|e| e.to_string())?;
    // The first bytes decide, because an extension may be wrong.
    let shades = if bytes.starts_with(b"\x89PNG") {
        png::read_colours(Cursor::new(&bytes), Some(camera)).map_err(|e| e.to_string())?
    } else {
        jpeg::read_colours(&bytes, Some(camera)).map_err(|e| e.to_string())?
    };
    let GreyImage { luminance, colours } = shades;
    let size = luminance.size();
    let pixels = match colours {
        Some(colours) => colours.into_pixels().into_iter().map(|rgb| rgb.map(sample_byte)).collect(),
        None => luminance.into_pixels().into_iter().map(|grey| [sample_byte(grey); 3]).collect(),
    };
    Ok(Image::from_vec(size, pixels))
}

/// Scales a sample to 0..255.
fn sample_byte(sample: f32) -> u8 {
    to_byte(sample / 255.0)
}
