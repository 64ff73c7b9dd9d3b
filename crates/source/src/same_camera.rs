//! Groups of photos that were taken with one camera at one focal length: the photos of a group have
//! the same size and the same marks in EXIF.

use super::exif::camera_marks;
use super::photo::{PhotoScrutiny, read_photo};
use super::{SourceError, SourcePlace};
use gs2e_files as files;
use gs2e_image::Size;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::io::Read as _;
use std::path::{Path, PathBuf};

/// Bytes at the start of a photo that are searched for EXIF: the largest segment of a JPEG, and a
/// short one before it.
const HEAD: u64 = 1 << 17;

/// Photos of one camera.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct CameraGroup {
    /// Size of the photos, px.
    pub(crate) size: Size,
    /// Indices of the photos, ascending.
    pub(crate) photos: Vec<usize>,
}

/// Groups photos by camera, in the order of the first photo of each group.
///
/// # Errors
/// A photo cannot be read, or its size is unknown.
pub(crate) fn camera_groups(photos: &[(String, PathBuf)]) -> Result<Vec<CameraGroup>, SourceError> {
    let marks: Vec<(Size, Option<Vec<u8>>)> =
        photos.par_iter().map(|(_, path)| marks_of(path)).collect::<Result<_, _>>()?;
    let mut groups: Vec<CameraGroup> = Vec::new();
    let mut known = BTreeMap::new();
    for (index, (size, camera)) in marks.into_iter().enumerate() {
        let group = *known.entry(((size.width, size.height), camera)).or_insert_with(|| {
            groups.push(CameraGroup { size, photos: Vec::new() });
            groups.len() - 1
        });
        groups[group].photos.push(index);
    }
    Ok(groups)
}

fn marks_of(path: &Path) -> Result<(Size, Option<Vec<u8>>), SourceError> {
    let size = read_photo(path, PhotoScrutiny::Sizes)?.size.ok_or_else(|| SourceError::Content {
        path: path.to_owned(),
        place: SourcePlace::Byte { record: "the header".to_owned(), offset: 0 },
        because: "its size cannot be read: wanted a JPEG or a PNG".to_owned(),
    })?;
    let mut head = Vec::new();
    let file = files::open_at_most(path, files::MAX_PICTURE).map_err(SourceError::io_error(path))?;
    file.take(HEAD).read_to_end(&mut head).map_err(SourceError::io_error(path))?;
    Ok((size, camera_marks(&head)))
}
