//! The one way to open a file that a person or a stranger names.
//!
//! A path from outside may lead to a device, a FIFO, a socket or a file without end. Each function here opens regular
//! files only, checks the type on the open file, so that a swap between check and use changes nothing, and reads at
//! most the given number of bytes. Only `NotFound` counts as absent: a dangling link, a loop or a folder without
//! permission is an error.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

use rustix::fs::{Mode, OFlags};

/// Limit for texts that people write: recipes, sensors, lists of scenes. 16 MiB.
pub const MAX_TEXT: u64 = 16 << 20;

/// Limit for documents that programs write, such as `transforms.json`, `manifest.json` and sums. 1 GiB.
pub const MAX_DOCUMENT: u64 = 1 << 30;

/// Whether links on the last part of a path are followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Links {
    /// Links are followed; what they lead to must be a regular file.
    Follow,
    /// A link is refused, as in a release tree.
    Refuse,
}

/// Opens a regular file for reading, following links.
///
/// # Errors
/// `NotFound` where nothing of that name exists; `InvalidInput` for a folder, device, FIFO or socket; any error of the
/// file system.
pub fn open(path: &Path) -> io::Result<File> {
    open_with(path, Links::Follow)
}

/// Opens a regular file for reading.
///
/// # Errors
/// As [`open`], and `InvalidInput` for a link where `links` refuses them.
pub fn open_with(path: &Path, links: Links) -> io::Result<File> {
    // Opening a device can act on it, so the type is checked before as well as after.
    let about = match links {
        Links::Follow => stat(path)?,
        Links::Refuse => fs::symlink_metadata(path)?,
    };
    require_regular(&about)?;
    // Without O_NONBLOCK, a FIFO put there in between would wait for a writer for ever.
    let mut flags = OFlags::RDONLY | OFlags::CLOEXEC | OFlags::NONBLOCK | OFlags::NOCTTY;
    if links == Links::Refuse {
        flags |= OFlags::NOFOLLOW;
    }
    let file = File::from(rustix::fs::open(path, flags, Mode::empty())?);
    require_regular(&file.metadata()?)?;
    Ok(file)
}

/// Reads a whole regular file of at most `limit` bytes, following links.
///
/// # Errors
/// As [`open`]; `FileTooLarge` for a file beyond `limit`, also if it grows while it is read.
pub fn read(path: &Path, limit: u64) -> io::Result<Vec<u8>> {
    read_open(open(path)?, limit)
}

/// Reads a whole regular file of at most `limit` bytes.
///
/// # Errors
/// As [`read`], and `InvalidInput` for a link where `links` refuses them.
pub fn read_with(path: &Path, links: Links, limit: u64) -> io::Result<Vec<u8>> {
    read_open(open_with(path, links)?, limit)
}

/// Reads a regular UTF-8 file of at most `limit` bytes, following links.
///
/// # Errors
/// As [`read`]; `InvalidData` with the byte offset where the text is not UTF-8.
pub fn read_text(path: &Path, limit: u64) -> io::Result<String> {
    String::from_utf8(read(path, limit)?).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        io::Error::new(io::ErrorKind::InvalidData, format!("not UTF-8 at byte {at}"))
    })
}

/// Whether a regular file lies at `path`. A folder or a device of that name is an error, as is a link to nothing.
///
/// # Errors
/// `InvalidInput` for anything but a regular file; any error of the file system but `NotFound` of the name itself.
pub fn exists(path: &Path) -> io::Result<bool> {
    match fs::symlink_metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
        Err(error) => Err(error),
        Ok(_) => require_regular(&stat(path)?).map(|()| true),
    }
}

/// The file that `path` leads to. A link to nothing says so: plain `NotFound` would read as absent.
fn stat(path: &Path) -> io::Result<fs::Metadata> {
    fs::metadata(path).map_err(|error| {
        let dangles = error.kind() == io::ErrorKind::NotFound && fs::symlink_metadata(path).is_ok();
        if dangles { io::Error::other("a link to a file that does not exist") } else { error }
    })
}

fn require_regular(about: &fs::Metadata) -> io::Result<()> {
    if about.is_file() {
        return Ok(());
    }
    Err(io::Error::new(io::ErrorKind::InvalidInput, format!("{}, not a regular file", kind(about.file_type()))))
}

/// The kind of a directory entry, with its article.
fn kind(of: fs::FileType) -> &'static str {
    use std::os::unix::fs::FileTypeExt as _;
    match of {
        of if of.is_dir() => "a folder",
        of if of.is_symlink() => "a link",
        of if of.is_fifo() => "a FIFO",
        of if of.is_socket() => "a socket",
        of if of.is_block_device() || of.is_char_device() => "a device",
        _ => "a special file",
    }
}

fn read_open(file: File, limit: u64) -> io::Result<Vec<u8>> {
    let length = file.metadata()?.len();
    if length > limit {
        return Err(too_large(limit));
    }
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(usize::try_from(length).unwrap_or(usize::MAX))?;
    // Files of /proc have length 0 and content all the same, so the limit holds for what is read.
    file.take(limit + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit { Err(too_large(limit)) } else { Ok(bytes) }
}

fn too_large(limit: u64) -> io::Error {
    io::Error::new(io::ErrorKind::FileTooLarge, format!("larger than the limit of {limit} bytes"))
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;
    use std::path::PathBuf;

    use super::*;

    /// A folder with one entry of each kind, and the entry's path by name.
    fn entries() -> (tempfile::TempDir, impl Fn(&str) -> PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().to_owned();
        let at = move |name: &str| root.join(name);
        fs::write(at("file"), "seven b").unwrap();
        fs::create_dir(at("folder")).unwrap();
        rustix::fs::mknodat(rustix::fs::CWD, at("fifo"), rustix::fs::FileType::Fifo, Mode::RUSR, 0).unwrap();
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
    }

    #[test]
    fn a_link_is_refused_where_the_rule_says_so() {
        let (_folder, at) = entries();
        let refused = read_with(&at("link"), Links::Refuse, 7).unwrap_err().to_string();
        assert_eq!(refused, "a link, not a regular file");
        assert_eq!(read_with(&at("file"), Links::Refuse, 7).unwrap(), b"seven b");
    }

    #[test]
    fn the_limit_holds_for_the_length_and_for_what_is_read() {
        let (_folder, at) = entries();
        assert_eq!(read(&at("file"), 6).unwrap_err().kind(), io::ErrorKind::FileTooLarge);
        // Length 0 by its metadata, longer when read.
        let endless = Path::new("/proc/self/status");
        if endless.exists() {
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
