//! Folders below one that other people can write to.
//!
//! Each folder is opened in the folder above it, without following links, so its files lie where their path
//! says, whatever happens to the names meanwhile.

use std::ffi::OsString;
use std::fs::File;
use std::io::{self, Write as _};
use std::os::fd::{AsFd as _, OwnedFd};
use std::os::unix::ffi::OsStringExt as _;
use std::path::Path;

use super::removal::remove_file_at;
use rustix::fs::{Dir, Mode, OFlags};
use rustix::io::Errno;

/// An open folder.
#[derive(Debug)]
pub struct FolderBelow(OwnedFd);

/// Maximum number of names that are tried for a temporary file. Others can take names, too.
const ATTEMPTS: u32 = 1000;

impl FolderBelow {
    /// Opens a folder that the user named. Links in this path are followed.
    ///
    /// # Errors
    /// It cannot be opened.
    pub fn open(root: &Path) -> io::Result<Self> {
        Ok(Self(rustix::fs::open(root, flags(), Mode::empty())?))
    }

    /// Opens a folder in this one.
    ///
    /// # Errors
    /// `InvalidInput` for a link or a file; any error of the file system.
    pub fn enter(&self, name: &str) -> io::Result<Self> {
        match rustix::fs::openat(&self.0, name, flags() | OFlags::NOFOLLOW, Mode::empty()) {
            Ok(folder) => Ok(Self(folder)),
            // Links have either error, by system.
            Err(Errno::NOTDIR | Errno::LOOP) => {
                let kind = super::kind_name(super::type_at(self.0.as_fd(), Path::new(name))?);
                Err(super::invalid(&format!("{kind}, not a folder")))
            }
            Err(e) => Err(e.into()),
        }
    }

    /// Opens a folder in this one, and creates it if it is absent.
    ///
    /// # Errors
    /// As [`Self::enter`].
    pub fn enter_or_create(&self, name: &str) -> io::Result<Self> {
        match rustix::fs::mkdirat(&self.0, name, Mode::from_raw_mode(0o777)) {
            // `EXIST` may be a link or a file that others put there; `enter` refuses both.
            Ok(()) | Err(Errno::EXIST) => self.enter(name),
            Err(e) => Err(e.into()),
        }
    }

    /// The names in this folder, in unspecified order.
    ///
    /// # Errors
    /// It cannot be listed.
    pub fn names(&self) -> io::Result<Vec<OsString>> {
        let entries = Dir::read_from(&self.0)?;
        let name = |entry: rustix::io::Result<rustix::fs::DirEntry>| {
            Ok(OsString::from_vec(entry?.file_name().to_bytes().to_vec()))
        };
        let names = entries.map(name).collect::<io::Result<Vec<_>>>()?;
        Ok(names.into_iter().filter(|name| name != "." && name != "..").collect())
    }

    /// Opens a regular file in this folder, which is no link.
    ///
    /// # Errors
    /// As [`super::open_below`].
    pub(crate) fn file(&self, name: &str) -> io::Result<File> {
        super::open_no_link(self.0.as_fd(), Path::new(name))
    }

    /// Reads a regular file of at most `limit` bytes in this folder, which is no link.
    ///
    /// # Errors
    /// As [`super::read_below`].
    pub fn read(&self, name: &str, limit: u64) -> io::Result<Vec<u8>> {
        super::read_open(self.file(name)?, limit)
    }

    /// Writes a file whole or not at all. A file or a link of this name is replaced, and a link is not
    /// followed.
    ///
    /// # Errors
    /// The file cannot be written, or the name belongs to a folder. No file is left then.
    pub fn write(&self, name: &str, bytes: &[u8]) -> io::Result<()> {
        let (part, mut file) = self.create_part()?;
        let mut write = || {
            file.write_all(bytes)?;
            // Without the sync, a power cut could leave an empty file under the final name.
            file.sync_all()?;
            io::Result::Ok(rustix::fs::renameat(&self.0, &part, &self.0, name)?)
        };
        let written = write();
        if written.is_err() {
            // The first error is the one to report.
            let _ = remove_file_at(&self.0, &part);
        }
        written
    }

    fn create_part(&self) -> io::Result<(String, File)> {
        // `EXCL` fails for any name that is taken, so no file and no link of others is written through.
        let create = OFlags::WRONLY | OFlags::CREATE | OFlags::EXCL | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        for number in 0..ATTEMPTS {
            let name = format!(".gs2e-{}-{number}.part", std::process::id());
            match rustix::fs::openat(&self.0, &name, create, Mode::from_raw_mode(0o666)) {
                Ok(file) => return Ok((name, file.into())),
                Err(Errno::EXIST) => {}
                Err(e) => return Err(e.into()),
            }
        }
        Err(Errno::EXIST.into())
    }
}

fn flags() -> OFlags {
    OFlags::RDONLY | OFlags::CLOEXEC | OFlags::DIRECTORY
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::os::unix::fs::symlink;

    #[test]
    fn a_folder_that_is_a_link_is_refused_and_a_file_that_is_a_link_is_replaced() {
        let place = tempfile::tempdir().unwrap();
        let at = |name: &str| place.path().join(name);
        fs::create_dir(at("outside")).unwrap();
        fs::write(at("outside/file"), "theirs").unwrap();
        fs::create_dir(at("root")).unwrap();
        symlink("../outside", at("root/link")).unwrap();
        let root = FolderBelow::open(&at("root")).unwrap();
        for refused in [root.enter("link"), root.enter_or_create("link")] {
            assert_eq!(refused.unwrap_err().to_string(), "a link, not a folder");
        }
        let below = root.enter_or_create("below").unwrap();
        symlink("../../outside/file", at("root/below/name")).unwrap();
        assert_eq!(below.read("name", 9).unwrap_err().to_string(), "a link, not a regular file");
        below.write("name", b"ours").unwrap();
        assert_eq!(below.read("name", 9).unwrap(), b"ours");
        assert_eq!(fs::read(at("outside/file")).unwrap(), b"theirs");
        assert_eq!(below.names().unwrap(), ["name"]);
        // A folder of the name is kept, and no part is left.
        fs::create_dir(at("root/below/taken")).unwrap();
        assert!(below.write("taken", b"x").is_err());
        assert_eq!(below.names().unwrap().len(), 2);
        // The open folder is another one than what has its name now.
        fs::rename(at("root/below"), at("root/moved")).unwrap();
        symlink("../outside", at("root/below")).unwrap();
        below.write("late", b"ours").unwrap();
        assert!(at("root/moved/late").is_file() && !at("outside/late").is_file());
    }
}
