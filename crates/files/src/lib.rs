//! Safe ways to open files that a user or a stranger names.
//!
//! A path from outside may lead to a device, a FIFO, a socket or an endless file. Each function
//! here opens regular files only. It checks the type on the open file, so a swap between check and
//! use changes nothing, and reads at most the given number of bytes. Only `NotFound` counts as
//! absent: a dangling link, a loop or a folder without permission is an error.
//!
//! It needs no other crate of the workspace. The crates that read or write files use it, from
//! `gs2e-image` and `gs2e-event` to `gs2e-build` and `gs2e-publish`, and so does the program itself.
//!
//! # Examples
//!
//! ```
//! use gs2e_files::{MAX_TEXT, read_below, read_text, write_by_rename};
//! use std::path::Path;
//!
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("note.txt");
//! write_by_rename(&path, |part| std::fs::write(part, "whole or not at all"))?;
//! assert_eq!(read_text(&path, MAX_TEXT)?, "whole or not at all");
//! // A file beyond the limit is refused, and so is a path that leads out of its folder.
//! assert!(read_text(&path, 4).is_err());
//! assert!(read_below(folder.path(), Path::new("../note.txt"), MAX_TEXT).is_err());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod below;
pub mod budget;
pub mod escape;
pub mod html;
pub mod natural;
mod path_error;
pub mod programs;
mod removal;
pub mod rename;
pub mod stat;
mod walk;

pub use path_error::PathError;
pub use removal::{Removal, remove, remove_below};
pub use rename::write_by_rename;
pub use walk::{FolderWalk, MAX_DEPTH, MAX_ENTRIES};

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, Read};
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Component, Path};

use rustix::fs::{AtFlags, CWD, FileType, Mode, OFlags};
use rustix::io::Errno;

/// Limit for texts that people write: recipes, sensors, lists of scenes. 16 MiB.
pub const MAX_TEXT: u64 = 16 << 20;

/// Limit for documents that programs write, for example `transforms.json`, `manifest.json` and
/// checksum lists. 1 GiB.
pub const MAX_DOCUMENT: u64 = 1 << 30;

/// Limit for one picture in its compressed form. 1 GiB.
pub const MAX_PICTURE: u64 = 1 << 30;

/// Limit for one file of a COLMAP model. 16 GiB.
pub const MAX_MODEL: u64 = 16 << 30;

/// Limit for a scene file, which is read whole: 69 million Gaussians of degree 3 as `.ply`. 16 GiB.
pub const MAX_SCENE: u64 = 16 << 30;

/// Treatment of a link in the last part of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkRule {
    /// Links are followed; the target must be a regular file.
    Follow,
    /// A link is refused, as in a release tree.
    Refuse,
}

/// Opens a regular file for reading, following links.
///
/// # Errors
/// `NotFound` if nothing of that name exists; `InvalidInput` for a folder, device, FIFO or socket;
/// any error of the file system.
pub fn open(path: &Path) -> io::Result<File> {
    open_with(path, LinkRule::Follow)
}

/// Opens a regular file for reading.
///
/// # Errors
/// The same as [`open`], and `InvalidInput` for a link if `links` refuses it.
pub fn open_with(path: &Path, links: LinkRule) -> io::Result<File> {
    match links {
        LinkRule::Follow => {
            // Opening a device can act on it, so the type is checked before as well as after.
            require_regular(file_type(&follow_stat(path)?))?;
            open_regular(CWD, path, OFlags::empty())
        }
        LinkRule::Refuse => open_no_link(CWD, path),
    }
}

/// Opens a regular file of at most `limit` bytes, following links.
///
/// # Errors
/// The same as [`open`]; `FileTooLarge` for a file beyond `limit`.
pub fn open_at_most(path: &Path, limit: u64) -> io::Result<File> {
    let file = open(path)?;
    if file.metadata()?.len() > limit { Err(too_large(limit)) } else { Ok(file) }
}

/// Opens a regular file below a folder that a stranger may have filled.
///
/// `below` is relative to `root`. A part that is `..` or a link is refused, so nothing outside
/// `root` is opened.
///
/// # Errors
/// The same as [`open`]; `InvalidInput` for a path that leads out of `root`, and for a link in any
/// part of it.
pub fn open_below(root: &Path, below: &Path) -> io::Result<File> {
    let (folder, name) = folder_below(root, below)?;
    open_no_link(folder, Path::new(name))
}

/// Opens the folder of a path below `root`, and returns it with the last name. A part that is `..`
/// or a link is refused.
fn folder_below<'a>(root: &Path, below: &'a Path) -> io::Result<(OwnedFd, &'a OsStr)> {
    let flags = OFlags::PATH | OFlags::CLOEXEC | OFlags::DIRECTORY;
    let mut folder: OwnedFd = rustix::fs::open(root, flags, Mode::empty())?;
    let mut parts = below.components().filter(|part| *part != Component::CurDir).peekable();
    while let Some(part) = parts.next() {
        // `..` and absolute paths end the loop, as does an empty path, and are refused below it.
        let Component::Normal(name) = part else { break };
        if parts.peek().is_none() {
            return Ok((folder, name));
        }
        // `NOFOLLOW` below would refuse a link as well, but with a message that does not name it.
        if type_at(folder.as_fd(), Path::new(name))? == FileType::Symlink {
            return Err(invalid("a folder in its path is a link"));
        }
        // Relative to the open folder: a parent that is swapped in between cannot lead out of
        // `root`.
        folder = rustix::fs::openat(&folder, name, flags | OFlags::NOFOLLOW, Mode::empty())?;
    }
    Err(invalid("the path leads out of its folder"))
}

/// Reads a whole regular file of at most `limit` bytes, following links.
///
/// # Errors
/// The same as [`open`]; `FileTooLarge` for a file beyond `limit`, also if it grows while it is
/// read.
pub fn read(path: &Path, limit: u64) -> io::Result<Vec<u8>> {
    read_open(open(path)?, limit)
}

/// Reads a whole regular file of at most `limit` bytes.
///
/// # Errors
/// The same as [`read`], and `InvalidInput` for a link if `links` refuses it.
pub fn read_with(path: &Path, links: LinkRule, limit: u64) -> io::Result<Vec<u8>> {
    read_open(open_with(path, links)?, limit)
}

/// Reads a whole regular file of at most `limit` bytes below a folder, see [`open_below`].
///
/// # Errors
/// The same as [`open_below`]; `FileTooLarge` for a file beyond `limit`.
pub fn read_below(root: &Path, below: &Path, limit: u64) -> io::Result<Vec<u8>> {
    read_open(open_below(root, below)?, limit)
}

/// Reads a regular UTF-8 file of at most `limit` bytes, following links.
///
/// # Errors
/// The same as [`read`]; `InvalidData` with the byte offset if the text is not UTF-8.
pub fn read_text(path: &Path, limit: u64) -> io::Result<String> {
    text(read(path, limit)?)
}

fn text(bytes: Vec<u8>) -> io::Result<String> {
    String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        io::Error::new(io::ErrorKind::InvalidData, format!("not UTF-8 at byte {at}"))
    })
}

/// Returns true if a regular file lies at `path`. A folder or a device of that name is an error,
/// and so is a dangling link.
///
/// # Errors
/// `InvalidInput` for anything but a regular file; any error of the file system except `NotFound`
/// of the name itself.
pub fn exists(path: &Path) -> io::Result<bool> {
    // The name itself first: a dangling link is present, but `metadata` would not find it.
    match fs::symlink_metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
        Err(error) => Err(error),
        Ok(_) => require_regular(file_type(&follow_stat(path)?)).map(|()| true),
    }
}

/// Returns true unless nothing of this name exists. A dangling link, a locked folder or a FIFO
/// counts as present: a caller that goes on to open the path learns the cause there.
#[must_use]
pub fn is_there(path: &Path) -> bool {
    match fs::symlink_metadata(path) {
        Err(error) => !matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory),
        Ok(_) => true,
    }
}

/// Checks that a regular file can be written at `path`, and returns the permission bits of the
/// present file, if any. Links are followed, also to a target that does not exist yet.
///
/// # Errors
/// `InvalidInput` for anything but a regular file; `PermissionDenied` for a file without write
/// permission.
pub fn replaceable(path: &Path) -> io::Result<Option<u32>> {
    let about = match fs::metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        _ => follow_stat(path)?,
    };
    require_regular(file_type(&about))?;
    let mode = Mode::from_raw_mode(about.mode());
    // Root may write to any file, but a user who made a file read-only means it for root as well.
    if !mode.intersects(Mode::WUSR | Mode::WGRP | Mode::WOTH) {
        return Err(io::Error::new(io::ErrorKind::PermissionDenied, "a read-only file"));
    }
    Ok(Some(mode.bits() & 0o777))
}

/// Metadata of the file that `path` leads to. A dangling link has an error of its own: plain
/// `NotFound` would read as absent.
fn follow_stat(path: &Path) -> io::Result<fs::Metadata> {
    fs::metadata(path).map_err(|error| match error.kind() {
        // A file that another process has made meanwhile is not a link.
        io::ErrorKind::NotFound if fs::symlink_metadata(path).is_ok_and(|about| about.is_symlink()) => {
            invalid("a link to a file that does not exist")
        }
        // By number: the library has no stable kind for this error.
        _ if error.raw_os_error() == Some(Errno::LOOP.raw_os_error()) => invalid("the links form a cycle"),
        _ => error,
    })
}

/// Returns true for the errors of this module that say that no regular file lies at a path.
#[must_use]
pub fn is_no_file(error: &io::Error) -> bool {
    error.kind() == io::ErrorKind::InvalidInput || error.raw_os_error() == Some(Errno::LOOP.raw_os_error())
}

fn file_type(about: &fs::Metadata) -> FileType {
    FileType::from_raw_mode(about.mode())
}

/// The type of a directory entry itself.
fn type_at(folder: impl AsFd, name: &Path) -> io::Result<FileType> {
    Ok(FileType::from_raw_mode(rustix::fs::statat(folder, name, AtFlags::SYMLINK_NOFOLLOW)?.st_mode))
}

fn open_no_link(folder: impl AsFd, name: &Path) -> io::Result<File> {
    // The type is checked before the file is opened, because opening a device can act on it.
    require_regular(type_at(&folder, name)?)?;
    open_regular(folder, name, OFlags::NOFOLLOW)
}

fn open_regular(folder: impl AsFd, name: &Path, more: OFlags) -> io::Result<File> {
    // Without O_NONBLOCK, a FIFO put there in between would wait forever for a writer.
    let flags = OFlags::RDONLY | OFlags::CLOEXEC | OFlags::NONBLOCK | OFlags::NOCTTY | more;
    let file = File::from(rustix::fs::openat(folder, name, flags, Mode::empty())?);
    // Another file may have taken the name since its type was checked.
    require_regular(file_type(&file.metadata()?))?;
    Ok(file)
}

fn require_regular(found: FileType) -> io::Result<()> {
    if found.is_file() { Ok(()) } else { Err(invalid(&format!("{}, not a regular file", kind_name(found)))) }
}

fn invalid(what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, what)
}

/// The kind of a directory entry, with its article.
fn kind_name(of: FileType) -> &'static str {
    match of {
        FileType::Directory => "a folder",
        FileType::Symlink => "a link",
        FileType::Fifo => "a FIFO",
        FileType::Socket => "a socket",
        FileType::BlockDevice | FileType::CharacterDevice => "a device",
        _ => "a special file",
    }
}

/// Reads the rest of an open file that has at most `limit` bytes.
///
/// # Errors
/// `FileTooLarge` for a file beyond `limit`, also if it grows while it is read; any error of the
/// file system.
pub fn read_open(file: File, limit: u64) -> io::Result<Vec<u8>> {
    let length = file.metadata()?.len();
    if length > limit {
        return Err(too_large(limit));
    }
    let mut bytes = Vec::new();
    // Fallible: a large file ends in an error, not in an abort.
    bytes.try_reserve_exact(usize::try_from(length).unwrap_or(usize::MAX))?;
    // Files in /proc have content although their length is 0, so the limit applies to the bytes
    // read.
    file.take(limit + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit { Err(too_large(limit)) } else { Ok(bytes) }
}

fn too_large(limit: u64) -> io::Error {
    io::Error::new(io::ErrorKind::FileTooLarge, format!("larger than the limit of {limit} bytes"))
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::{PermissionsExt, symlink};
    use std::path::PathBuf;

    use super::*;

    /// A folder with one entry of each kind, and the entry's path by name.
    fn entries() -> (tempfile::TempDir, impl Fn(&str) -> PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().to_owned();
        let at = move |name: &str| root.join(name);
        fs::write(at("file"), "seven b").unwrap();
        fs::create_dir(at("folder")).unwrap();
        rustix::fs::mknodat(CWD, at("fifo"), FileType::Fifo, Mode::RUSR, 0).unwrap();
        symlink("file", at("link")).unwrap();
        symlink("nothing", at("dangling")).unwrap();
        symlink("loop", at("loop")).unwrap();
        symlink("/dev/zero", at("zero")).unwrap();
        symlink("fifo", at("link-to-fifo")).unwrap();
        (folder, at)
    }

    #[test]
    fn only_regular_files_are_read() {
        let (_folder, at) = entries();
        assert_eq!(read(&at("file"), 7).unwrap(), b"seven b");
        assert_eq!(read(&at("link"), 7).unwrap(), b"seven b");
        let refused = |name: &str| read(&at(name), 7).unwrap_err().to_string();
        assert_eq!(refused("folder"), "a folder, not a regular file");
        assert_eq!(refused("fifo"), "a FIFO, not a regular file");
        assert_eq!(refused("link-to-fifo"), "a FIFO, not a regular file");
        assert_eq!(refused("zero"), "a device, not a regular file");
        assert_eq!(refused("dangling"), "a link to a file that does not exist");
        assert_eq!(refused("loop"), "the links form a cycle");
    }

    #[test]
    fn a_link_is_refused_where_the_rule_says_so() {
        let (_folder, at) = entries();
        let refused = read_with(&at("link"), LinkRule::Refuse, 7).unwrap_err().to_string();
        assert_eq!(refused, "a link, not a regular file");
        assert_eq!(read_with(&at("file"), LinkRule::Refuse, 7).unwrap(), b"seven b");
    }

    #[test]
    fn nothing_outside_the_folder_is_opened() {
        let (folder, at) = entries();
        fs::create_dir(at("folder/sub")).unwrap();
        fs::write(at("folder/sub/inside"), "in").unwrap();
        symlink("..", at("folder/up")).unwrap();
        symlink("../file", at("folder/link")).unwrap();
        let root = folder.path().join("folder");
        let read = |below: &str| read_below(&root, Path::new(below), 7).map_err(|error| error.to_string());
        assert_eq!(read("sub/inside").unwrap(), b"in");
        assert_eq!(read("./sub/inside").unwrap(), b"in");
        for out in ["../file", "sub/../../file", "sub/..", "", at("file").to_str().unwrap()] {
            assert_eq!(read(out).unwrap_err(), "the path leads out of its folder", "{out}");
        }
        assert_eq!(read("up/file").unwrap_err(), "a folder in its path is a link");
        assert_eq!(read("link").unwrap_err(), "a link, not a regular file");
        assert_eq!(read("sub").unwrap_err(), "a folder, not a regular file");
        let absent = read_below(&root, Path::new("sub/none"), 7).unwrap_err();
        assert_eq!(absent.kind(), io::ErrorKind::NotFound);
    }

    #[test]
    fn a_name_is_there_unless_the_file_system_denies_it() {
        let (_folder, at) = entries();
        for name in ["file", "link", "dangling", "loop", "folder", "fifo", "zero", "loop/below"] {
            assert!(is_there(&at(name)), "{name}");
        }
        assert!(!is_there(&at("nothing")) && !is_there(&at("nothing/below")) && !is_there(&at("file/below")));
    }

    #[test]
    fn a_file_that_may_be_replaced_keeps_its_mode() {
        let (_folder, at) = entries();
        let mode = |name: &str, mode: u32| {
            fs::set_permissions(at(name), PermissionsExt::from_mode(mode)).unwrap();
            replaceable(&at(name))
        };
        assert_eq!(mode("file", 0o600).unwrap(), Some(0o600));
        assert_eq!(mode("link", 0o640).unwrap(), Some(0o640));
        assert_eq!(mode("file", 0o444).unwrap_err().to_string(), "a read-only file");
        assert_eq!(replaceable(&at("nothing")).unwrap(), None);
        assert_eq!(replaceable(&at("dangling")).unwrap(), None);
        for name in ["loop", "folder", "fifo", "zero"] {
            assert!(replaceable(&at(name)).is_err(), "{name}");
        }
    }

    #[test]
    fn the_limit_holds_for_the_length_and_for_what_is_read() {
        let (_folder, at) = entries();
        assert_eq!(read(&at("file"), 6).unwrap_err().kind(), io::ErrorKind::FileTooLarge);
        // Length 0 by its metadata, longer when read.
        let endless = Path::new("/proc/self/status");
        if is_there(endless) {
            assert_eq!(read(endless, 8).unwrap_err().kind(), io::ErrorKind::FileTooLarge);
        }
    }

    #[test]
    fn absence_is_not_found_alone() {
        let (_folder, at) = entries();
        assert!(exists(&at("file")).unwrap());
        assert!(exists(&at("link")).unwrap());
        assert!(!exists(&at("nothing")).unwrap());
        for name in ["dangling", "loop", "folder", "fifo", "zero"] {
            assert!(exists(&at(name)).is_err(), "{name}");
        }
        assert!(exists(&at("file").join("below")).is_err(), "a file has nothing below it");
    }
}
