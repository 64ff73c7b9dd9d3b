//! A file system that is full: how to know, and what to tell.

use super::{StoreError, Workspace};
use std::error::Error;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// A file system and its room.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Space {
    /// Bytes that this user may still write.
    pub free: u64,
    /// Where it is mounted, as far as the system tells.
    pub mount: PathBuf,
    /// Its kind, as `ext4`; empty where the system does not tell.
    pub kind: String,
}

/// Less than this, and a write that failed is taken to have failed for want of room: not every library passes on why.
const LEAST: u64 = 1 << 20;

impl Space {
    /// The file system that holds `path`.
    ///
    /// # Errors
    /// When the path is not there, or the system does not tell.
    pub fn around(path: &Path) -> io::Result<Self> {
        let found = rustix::fs::statvfs(path)?;
        let path = path.canonicalize()?;
        // Not every system lists its mounts; then the path itself must do.
        let mounts = fs::read_to_string("/proc/self/mountinfo").unwrap_or_default();
        let (mount, kind) = mount_of(&path, &mounts).unwrap_or((path, String::new()));
        Ok(Self { free: found.f_bavail.saturating_mul(found.f_frsize), mount, kind })
    }

    /// Whether it is another machine's, or a program's: a database in WAL mode needs the shared memory of one host.
    #[must_use]
    pub fn is_remote(&self) -> bool {
        const REMOTE: [&str; 10] =
            ["nfs", "cifs", "smb", "lustre", "fuse", "9p", "ceph", "beegfs", "gpfs", "afs"];
        REMOTE.iter().any(|kind| self.kind.starts_with(kind))
    }

    /// Whether there is hardly any room.
    #[must_use]
    pub fn is_used_up(&self) -> bool {
        self.free < LEAST
    }
}

/// Mount point and kind of the file system that a path is on, by the list of `proc_pid_mountinfo(5)`.
fn mount_of(path: &Path, mounts: &str) -> Option<(PathBuf, String)> {
    let read = |line: &str| {
        let (mount, rest) = line.split_once(" - ")?;
        let point = PathBuf::from(mount.split(' ').nth(4)?.replace("\\040", " "));
        path.starts_with(&point).then(|| (point, rest.split(' ').next().unwrap_or_default().to_owned()))
    };
    // Of two on one folder the later one hides the other.
    mounts.lines().filter_map(read).max_by_key(|(point, _)| point.components().count())
}

/// Whether an error was caused by a full file system or a used-up quota.
#[must_use]
pub fn is_full(error: &(dyn Error + 'static)) -> bool {
    let mut next = Some(error);
    while let Some(error) = next {
        let of_file = error.downcast_ref::<io::Error>().map(io::Error::kind);
        let of_database =
            error.downcast_ref::<rusqlite::Error>().and_then(rusqlite::Error::sqlite_error_code);
        if matches!(of_file, Some(io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded))
            || of_database == Some(rusqlite::ErrorCode::DiskFull)
        {
            return true;
        }
        next = error.source();
    }
    false
}

impl StoreError {
    /// Whether the file system of the store is full.
    #[must_use]
    pub fn is_full(&self) -> bool {
        is_full(self) || self.may_be_full()
    }

    /// SQLite has one word for all that goes wrong with the memory that its log shares: what is left must tell.
    fn may_be_full(&self) -> bool {
        let Self::State { path, source } = self else { return false };
        let is_vague = source.sqlite_error_code() == Some(rusqlite::ErrorCode::SystemIoFailure);
        is_vague && path.parent().and_then(|f| Space::around(f).ok()).is_some_and(|space| space.is_used_up())
    }
}

impl Workspace<'_> {
    /// Bytes in its files so far; what cannot be looked at counts nothing.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let entries = walkdir::WalkDir::new(self.path()).into_iter().flatten();
        let files = entries.filter(|entry| entry.file_type().is_file());
        files.filter_map(|file| Some(file.metadata().ok()?.len())).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MOUNTS: &str = "\
22 1 8:1 / / rw,relatime shared:1 - ext4 /dev/sda1 rw
35 22 0:30 / /data rw shared:2 master:1 - xfs /dev/sdb1 rw
36 35 0:31 / /data/with\\040space rw - tmpfs tmpfs rw
37 22 0:32 / /data rw - btrfs /dev/sdc1 rw
";

    #[test]
    fn the_innermost_and_latest_mount_counts() {
        let t = |path: &str, point: &str, kind: &str| {
            let found = mount_of(Path::new(path), MOUNTS);
            assert_eq!(found, Some((PathBuf::from(point), kind.to_owned())), "{path}");
        };
        t("/var/x", "/", "ext4");
        t("/data/x", "/data", "btrfs");
        t("/database", "/", "ext4");
        t("/data/with space/x", "/data/with space", "tmpfs");
        assert_eq!(mount_of(Path::new("/x"), ""), None);
    }

    #[test]
    fn file_systems_of_other_machines_are_known_by_their_kind() {
        let is_remote = |kind: &str| Space { free: 0, mount: PathBuf::new(), kind: kind.into() }.is_remote();
        for kind in ["nfs", "nfs4", "cifs", "smb3", "lustre", "fuse.sshfs", "fuse", "9p", "ceph"] {
            assert!(is_remote(kind), "{kind}");
        }
        for kind in ["ext4", "xfs", "btrfs", "tmpfs", "overlay", "zfs", ""] {
            assert!(!is_remote(kind), "{kind}");
        }
    }

    #[test]
    fn a_full_disk_is_known_through_the_chain_of_causes() {
        let t = |kind: io::ErrorKind, wanted: bool| {
            let error = StoreError::Io { doing: "writing", path: "a".into(), source: kind.into() };
            assert_eq!(error.is_full(), wanted, "{kind}");
        };
        t(io::ErrorKind::StorageFull, true);
        t(io::ErrorKind::QuotaExceeded, true);
        t(io::ErrorKind::PermissionDenied, false);
    }

    #[test]
    fn the_space_of_a_folder_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let space = Space::around(folder.path()).unwrap();
        assert!(folder.path().canonicalize().unwrap().starts_with(&space.mount), "{space:?}");
        assert!(Space::around(&folder.path().join("absent")).is_err());
    }
}
