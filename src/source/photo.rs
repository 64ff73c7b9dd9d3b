//! The photos beside a source: found by name, never outside the source's folder; only their hash and size are used.

use super::SourceError;
use crate::image::Size;
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

/// What is known of a photo that is there.
pub(super) struct Photo {
    /// SHA-256 of its bytes, hexadecimal.
    pub(super) sha256: String,
    /// Its size; `None` where it is in no format whose size can be read.
    pub(super) size: Option<Size>,
}

/// Where the photo of this name lies, if it does: a name may hold folders, but leads nowhere up.
pub(super) fn find(folder: &Path, name: &str) -> Option<PathBuf> {
    let inside = |c: Component<'_>| matches!(c, Component::Normal(_) | Component::CurDir);
    let path = folder.join(name);
    (!name.is_empty() && Path::new(name).components().all(inside) && path.is_file()).then_some(path)
}

/// A folder by a path that the system takes: the empty one is the current folder.
pub(super) fn or_here(folder: &Path) -> PathBuf {
    if folder.as_os_str().is_empty() { PathBuf::from(".") } else { folder.to_owned() }
}

/// Reads a photo.
pub(super) fn read(path: &Path) -> Result<Photo, SourceError> {
    let mut file = File::open(path).map_err(SourceError::io(path))?;
    let mut hash = Sha256::new();
    let mut buffer = vec![0; 1 << 16];
    loop {
        match file.read(&mut buffer).map_err(SourceError::io(path))? {
            0 => break,
            n => hash.update(&buffer[..n]),
        }
    }
    let sha256 = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    Ok(Photo { sha256, size: imagesize::size(path).ok().and_then(size) })
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
        let photo = read(&find(&folder, "./sub folder/a b.jpg").unwrap()).unwrap();
        // The test vector of FIPS 180-2 for "abc".
        assert_eq!(photo.sha256, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
        assert_eq!(photo.size, None);
    }
}
