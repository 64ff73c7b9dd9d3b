//! Photos of a source, found by name and never outside the source's folder. Only their hash and
//! size are used.

use super::{SourceError, SourceWarning, UnusedPhoto, UnusedReason};
use gs2e_files as files;
use gs2e_files::{FolderWalk, natural};
use gs2e_image::Size;
use gs2e_scene::camera::Camera;
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Component, Path, PathBuf};

/// Properties of an existing photo.
pub(super) struct PhotoInfo {
    /// SHA-256 of its bytes, hexadecimal, if they were read.
    pub(super) sha256: Option<String>,
    /// Size; `None` for a format whose size cannot be read.
    pub(super) size: Option<Size>,
}

impl UnusedPhoto {
    /// Creates the entry of a photo without a pose in the source.
    pub(super) fn not_registered(photo: Option<PhotoInfo>, name: String) -> Self {
        let (sha256, size) = photo.map_or((None, None), |photo| (photo.sha256, photo.size));
        Self { name, sha256, size, why: UnusedReason::NotRegistered }
    }
}

/// Returns a warning if some photos of views exist in `folder` and others do not.
pub(super) fn missing_warning<'a>(
    folder: &Path,
    photos: impl Iterator<Item = (&'a str, Option<&'a PhotoInfo>)>,
) -> Option<SourceWarning> {
    let (mut count, mut of, mut first) = (0, 0, None);
    for (name, photo) in photos {
        of += 1;
        if photo.is_none() {
            count += 1;
            first = first.or(Some(name));
        }
    }
    // A source without any photos is complete in itself: only poses are needed.
    let first = first.filter(|_| count < of)?.to_owned();
    Some(SourceWarning::PhotosMissing { dir: folder.to_owned(), count, of, first })
}

/// Depth of reading for photos.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PhotoScrutiny {
    /// Only the sizes, from the first bytes.
    Sizes,
    /// Every byte, for the hash.
    Bytes,
}

/// Path of the photo with this name, if the photo exists. A name may contain folders, but neither
/// `..` nor control characters. A dangling link and a FIFO count as existing, so that opening them
/// reports the fault.
pub(super) fn find_photo(folder: &Path, name: &str) -> Option<PathBuf> {
    let inside = |c: Component<'_>| matches!(c, Component::Normal(_) | Component::CurDir);
    let path = folder.join(name);
    let is_name = !name.is_empty() && !name.contains(char::is_control);
    (is_name && Path::new(name).components().all(inside) && files::is_there(&path) && !path.is_dir())
        .then_some(path)
}

/// Extensions of photos. Files with other extensions are ignored.
const ENDINGS: [&str; 7] = ["jpg", "jpeg", "png", "webp", "tif", "tiff", "bmp"];

fn is_photo(path: &Path) -> bool {
    let ending = path.extension().and_then(|ending| ending.to_str());
    ending.is_some_and(|ending| ENDINGS.iter().any(|known| ending.eq_ignore_ascii_case(known)))
}

/// Refuses a photo beyond the limit, by its length. Other files and faults are left to their readers.
pub(super) fn check_length(path: &Path) -> Result<(), SourceError> {
    let length = || std::fs::metadata(path).map_or(0, |about| about.len());
    if !is_photo(path) || length() <= files::MAX_PICTURE {
        return Ok(());
    }
    open(path).map(drop)
}

/// Returns true if a folder itself has a photo. A folder that cannot be listed has none.
pub(super) fn has_photos(folder: &Path) -> bool {
    let entries = std::fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok);
    entries.map(|entry| entry.path()).any(|path| is_photo(&path) && !path.is_dir())
}

/// The names of all photos in a folder and below it, `/` between folders, in natural order.
///
/// # Errors
/// A folder cannot be listed, the walk leaves its bounds, or a name has a control character.
pub(super) fn list_photos(folder: &Path) -> Result<Vec<String>, SourceError> {
    // A name that is not UTF-8 is skipped: no source can refer to it.
    let name = |path: &Path| {
        let parts = path.strip_prefix(folder).ok()?.iter().map(|part| part.to_str());
        Some(parts.collect::<Option<Vec<_>>>()?.join("/"))
    };
    let mut names = Vec::new();
    for entry in FolderWalk::new(folder).entries(|_| true) {
        let entry = entry.map_err(SourceError::from)?;
        let path = entry.path();
        if is_photo(path) && !path.is_dir() {
            names.extend(name(path));
        }
    }
    if let Some(odd) = names.iter().find(|name| name.contains(char::is_control)) {
        let because = format!("the name of the photo {odd:?} holds a control character");
        return Err(SourceError::Absent { dir: folder.to_owned(), because });
    }
    names.sort_by(|a, b| natural::compare_names(a, b));
    Ok(names)
}

/// Action in the message about a camera that was scaled to its photo.
pub(super) const SCALED: &str = "the camera is scaled to the photo";

/// Maximum relative difference between the aspect ratios of photo and stated size.
const MAX_ASPECT_ERROR: f64 = 0.005;

/// Scales a camera to its photo, because the stated size may be that of the full-size photo.
///
/// # Errors
/// The aspect ratios of the two differ.
pub(super) fn fit_camera(stated: &Camera, photo: Size) -> Result<Camera, String> {
    // The factors may differ a little, because the sides of a scaled photo are whole numbers.
    let kx = f64::from(photo.width) / f64::from(stated.size.width);
    let ky = f64::from(photo.height) / f64::from(stated.size.height);
    if (kx / ky - 1.0).abs() > MAX_ASPECT_ERROR {
        return Err(format!(
            "the photo is {photo}, but the camera states {}: their aspect ratios differ by more than 0.5 %",
            stated.size
        ));
    }
    Ok(Camera::pinhole(photo, [stated.fx * kx, stated.fy * ky, stated.cx * kx, stated.cy * ky]))
}

/// Converts an empty path to the current folder, as the system expects.
pub(super) fn or_here(folder: &Path) -> PathBuf {
    if folder.as_os_str().is_empty() { PathBuf::from(".") } else { folder.to_owned() }
}

/// Reads a photo.
pub(super) fn read_photo(path: &Path, look: PhotoScrutiny) -> Result<PhotoInfo, SourceError> {
    let sha256 = match look {
        PhotoScrutiny::Sizes => None,
        PhotoScrutiny::Bytes => Some(file_sha256(path)?),
    };
    // Opened once more, because the hash has read its file to the end.
    let file = open(path)?;
    Ok(PhotoInfo { sha256, size: imagesize::reader_size(BufReader::new(file)).ok().and_then(image_size) })
}

fn open(path: &Path) -> Result<File, SourceError> {
    files::open_at_most(path, files::MAX_PICTURE).map_err(SourceError::io_error(path))
}

fn file_sha256(path: &Path) -> Result<String, SourceError> {
    let mut file = open(path)?;
    let mut hash = Sha256::new();
    let mut buffer = vec![0; 1 << 16];
    loop {
        match file.read(&mut buffer).map_err(SourceError::io_error(path))? {
            0 => break,
            n => hash.update(&buffer[..n]),
        }
    }
    Ok(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}

fn image_size(found: imagesize::ImageSize) -> Option<Size> {
    Some(Size { width: found.width.try_into().ok()?, height: found.height.try_into().ok()? })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photos_are_looked_for_inside_the_folder_only() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("images");
        std::fs::create_dir_all(folder.join("sub folder")).unwrap();
        std::fs::write(dir.path().join("secret"), "abc").unwrap();
        std::fs::write(folder.join("sub folder/a b.jpg"), "abc").unwrap();
        let outside = dir.path().join("secret");
        for name in
            ["../secret", "sub folder/../../secret", outside.to_str().unwrap(), "", "sub folder", "gone"]
        {
            assert_eq!(find_photo(&folder, name), None, "{name}");
        }
        let photo =
            read_photo(&find_photo(&folder, "./sub folder/a b.jpg").unwrap(), PhotoScrutiny::Bytes).unwrap();
        // The test vector of FIPS 180-2 for "abc".
        let wanted = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(photo.sha256.as_deref(), Some(wanted));
        assert_eq!(photo.size, None);
    }
}
