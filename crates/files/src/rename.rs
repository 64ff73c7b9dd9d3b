//! Files that appear whole or not at all: each is written under a temporary name in its folder.

use super::{Removal, remove};
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Number of partial files that this process has created.
static PARTS: AtomicUsize = AtomicUsize::new(0);

/// Writes a file whole or not at all: under a temporary name in its folder, then under its own.
///
/// # Errors
/// The file cannot be written or replaced, or `fill` fails. No file is left then.
pub fn write_by_rename<E: From<io::Error>>(
    path: &Path,
    fill: impl FnOnce(&Path) -> Result<(), E>,
) -> Result<(), E> {
    let part = PartialFile::new(path)?;
    fill(&part.temporary)?;
    // Without the sync, a power cut could leave an empty file under the final name.
    super::open(&part.temporary)?.sync_all()?;
    Ok(part.finish()?)
}

/// Maximum number of links followed to a target. Linux follows no more.
const MAX_LINKS: usize = 40;

/// The target of a path with all links followed, even if nothing is there yet.
pub fn link_target(path: &Path) -> PathBuf {
    let mut place = path.to_owned();
    for _ in 0..MAX_LINKS {
        let Ok(to) = fs::read_link(&place) else { break };
        place = parent_folder(&place).join(to);
    }
    // Without the file, its folder can still be resolved.
    let in_folder = || Some(parent_folder(&place).canonicalize().ok()?.join(place.file_name()?));
    place.canonicalize().ok().or_else(in_folder).unwrap_or_else(|| place.clone())
}

/// The folder of a file, as a path that the system accepts. The parent of a bare name is the empty
/// path, which the system does not accept.
pub fn parent_folder(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A file that is being written under a temporary name. It is removed when it is dropped
/// unfinished.
#[derive(Debug)]
pub struct PartialFile {
    temporary: PathBuf,
    path: PathBuf,
}

impl PartialFile {
    /// Prepares a part without content.
    pub(crate) fn new(path: &Path) -> io::Result<Self> {
        // A rename over a link would replace the link, and leave its target with the old bytes.
        let path = link_target(path);
        super::replaceable(&path)?;
        // In the same folder, because a rename does not cross file systems. The number separates
        // the outputs of one process, and of its threads.
        let number = PARTS.fetch_add(1, Ordering::Relaxed);
        let temporary = parent_folder(&path).join(format!(".gs2e-{}-{number}.part", std::process::id()));
        // An earlier process with this id may have been killed.
        let _ = remove(&temporary, Removal::File);
        Ok(Self { temporary, path })
    }

    /// Writes the content of a part, and syncs it.
    ///
    /// # Errors
    /// The path leads to something that must not be replaced, or the part cannot be written.
    pub fn write_part(path: &Path, fill: &dyn Fn(&mut dyn Write) -> io::Result<()>) -> io::Result<Self> {
        let part = Self::new(path)?;
        let mut out = BufWriter::new(File::create_new(&part.temporary)?);
        fill(&mut out)?;
        out.into_inner().map_err(io::IntoInnerError::into_error)?.sync_all()?;
        Ok(part)
    }

    /// The final path, with links followed.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Puts the part in place of the file.
    ///
    /// # Errors
    /// The file at the path must not be replaced, or the rename fails.
    pub fn finish(self) -> io::Result<()> {
        // Another file may have been created there while this one was written.
        if let Some(mode) = super::replaceable(&self.path)? {
            fs::set_permissions(&self.temporary, fs::Permissions::from_mode(mode))?;
        }
        fs::rename(&self.temporary, &self.path)
    }
}

impl Drop for PartialFile {
    fn drop(&mut self) {
        // The first error is the one to report, and a finished file has another name by now.
        let _ = remove(&self.temporary, Removal::File);
    }
}
