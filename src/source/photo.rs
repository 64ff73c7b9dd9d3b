//! Photos of a source, found by name and never outside the source's folder. Only their hash and
//! size are used.

use super::{SourceError, Unused, Warning, Why, natural};
use crate::camera::Camera;
use crate::image::Size;
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::Read;
use std::path::{Component, Path, PathBuf};
use walkdir::WalkDir;

/// Properties of an existing photo.
pub(super) struct Photo {
    /// SHA-256 of its bytes, hexadecimal, if they were read.
    pub(super) sha256: Option<String>,
    /// Size; `None` for a format whose size cannot be read.
    pub(super) size: Option<Size>,
}

impl Unused {
    /// Creates the entry of a photo without a pose in the source.
    pub(super) fn not_registered(photo: Option<Photo>, name: String) -> Self {
        let (sha256, size) = photo.map_or((None, None), |photo| (photo.sha256, photo.size));
        Self { name, sha256, size, why: Why::NotRegistered }
    }
}

/// Returns a warning if some photos of views exist in `folder` and others do not.
pub(super) fn missing<'a>(
    folder: &Path,
    photos: impl Iterator<Item = (&'a str, Option<&'a Photo>)>,
) -> Option<Warning> {
    let (mut count, mut of, mut first) = (0, 0, None);
    for (name, photo) in photos {
        of += 1;
        if photo.is_none() {
            count += 1;
            first = first.or(Some(name));
        }
    }
    let first = first.filter(|_| count < of)?.to_owned();
    Some(Warning::PhotosMissing { dir: folder.to_owned(), count, of, first })
}

/// Depth of reading for photos.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Look {
    /// Only the sizes, from the first bytes.
    Sizes,
    /// Every byte, for the hash.
    Bytes,
}

/// Finds the photo with this name. A name may contain folders but no path upward.
pub(super) fn find(folder: &Path, name: &str) -> Option<PathBuf> {
    let inside = |c: Component<'_>| matches!(c, Component::Normal(_) | Component::CurDir);
    let path = folder.join(name);
    (!name.is_empty() && Path::new(name).components().all(inside) && path.is_file()).then_some(path)
}

/// Extensions of photos. Files with other extensions are ignored.
const ENDINGS: [&str; 7] = ["jpg", "jpeg", "png", "webp", "tif", "tiff", "bmp"];

/// Returns the names of all photos in a folder and its subfolders, `/` between folders, in natural
/// order.
pub(super) fn list(folder: &Path) -> Vec<String> {
    let is_photo = |path: &Path| {
        let ending = path.extension().and_then(|ending| ending.to_str());
        ending.is_some_and(|ending| ENDINGS.iter().any(|known| ending.eq_ignore_ascii_case(known)))
    };
    let entries = WalkDir::new(folder).into_iter().filter_map(Result::ok);
    let files = entries.filter(|entry| entry.path().is_file() && is_photo(entry.path()));
    let name = |entry: walkdir::DirEntry| {
        let parts = entry.path().strip_prefix(folder).ok()?.iter().map(|part| part.to_str());
        Some(parts.collect::<Option<Vec<_>>>()?.join("/"))
    };
    let mut names: Vec<String> = files.filter_map(name).collect();
    names.sort_by(|a, b| natural::compare(a, b));
    names
}

/// Action in the message about a camera that was scaled to its photo.
pub(super) const SCALED: &str = "the camera is scaled to the photo";

/// Maximum relative difference between the aspect ratios of photo and stated size.
const MOST_ASPECT_ERROR: f64 = 0.005;

/// Scales a camera to its photo, because the stated size may be that of the full-size photo.
///
/// # Errors
/// The aspect ratios of the two differ.
pub(super) fn fitted(stated: &Camera, photo: Size) -> Result<Camera, String> {
    let kx = f64::from(photo.width) / f64::from(stated.size.width);
    let ky = f64::from(photo.height) / f64::from(stated.size.height);
    if (kx / ky - 1.0).abs() > MOST_ASPECT_ERROR {
        return Err(format!(
            "the photo is {photo}, the camera says {}: their shapes differ by more than 0.5 %",
            stated.size
        ));
    }
    Ok(Camera { size: photo, fx: stated.fx * kx, fy: stated.fy * ky, cx: stated.cx * kx, cy: stated.cy * ky })
}

/// Converts an empty path to the current folder, as the system expects.
pub(super) fn or_here(folder: &Path) -> PathBuf {
    if folder.as_os_str().is_empty() { PathBuf::from(".") } else { folder.to_owned() }
}

/// Reads a photo.
pub(super) fn read(path: &Path, look: Look) -> Result<Photo, SourceError> {
    let sha256 = match look {
        Look::Sizes => None,
        Look::Bytes => Some(sha256(path)?),
    };
    Ok(Photo { sha256, size: imagesize::size(path).ok().and_then(size) })
}

fn sha256(path: &Path) -> Result<String, SourceError> {
    let mut file = File::open(path).map_err(SourceError::io(path))?;
    let mut hash = Sha256::new();
    let mut buffer = vec![0; 1 << 16];
    loop {
        match file.read(&mut buffer).map_err(SourceError::io(path))? {
            0 => break,
            n => hash.update(&buffer[..n]),
        }
    }
    Ok(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}

fn size(found: imagesize::ImageSize) -> Option<Size> {
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
            assert_eq!(find(&folder, name), None, "{name}");
        }
        let photo = read(&find(&folder, "./sub folder/a b.jpg").unwrap(), Look::Bytes).unwrap();
        // The test vector of FIPS 180-2 for "abc".
        let wanted = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(photo.sha256.as_deref(), Some(wanted));
        assert_eq!(photo.size, None);
    }
}
