//! Detection of a full file system, and its description for messages.

use super::{StepWorkspace, StoreError};
use std::error::Error;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// A file system and its free space.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DiskSpace {
    /// Bytes that this user can still write.
    pub free: u64,
    /// Mount point, if known.
    pub mount: PathBuf,
    /// Type, for example `ext4`; empty if unknown.
    pub kind: String,
}

/// Free space below which a failed write is attributed to a full disk: not every library passes on
/// the cause.
const MIN_FREE: u64 = 1 << 20;

impl DiskSpace {
    /// The file system that holds `path`.
    ///
    /// # Errors
    /// The path does not exist, or the system does not report it.
    pub fn holding_path(path: &Path) -> io::Result<Self> {
        let found = rustix::fs::statvfs(path)?;
        let path = path.canonicalize()?;
        // Some systems do not list their mounts; then the path itself is used.
        let mounts = fs::read_to_string("/proc/self/mountinfo").unwrap_or_default();
        let (mount, kind) = mount_of(&path, &mounts).unwrap_or((path, String::new()));
        Ok(Self { free: found.f_bavail.saturating_mul(found.f_frsize), mount, kind })
    }

    /// Returns true if the file system is remote, or implemented by a program. A database in WAL
    /// mode needs shared memory on one host.
    #[must_use]
    pub fn is_remote(&self) -> bool {
        const REMOTE: [&str; 10] =
            ["nfs", "cifs", "smb", "lustre", "fuse", "9p", "ceph", "beegfs", "gpfs", "afs"];
        // Types have suffixes: `nfs4`, `fuse.sshfs`, `smb3`.
        REMOTE.iter().any(|kind| self.kind.starts_with(kind))
    }

    /// Returns true if there is almost no free space.
    #[must_use]
    pub fn is_used_up(&self) -> bool {
        self.free < MIN_FREE
    }
}

/// Mount point and type of the file system of a path, from `proc_pid_mountinfo(5)`.
fn mount_of(path: &Path, mounts: &str) -> Option<(PathBuf, String)> {
    let read = |line: &str| {
        let (mount, rest) = line.split_once(" - ")?;
        // The fifth field. A variable number of optional fields follows up to the separator ` - `.
        let point = PathBuf::from(mount.split(' ').nth(4)?.replace("\\040", " "));
        path.starts_with(&point).then(|| (point, rest.split(' ').next().unwrap_or_default().to_owned()))
    };
    // Of two mounts on one folder, the later one hides the other.
    mounts.lines().filter_map(read).max_by_key(|(point, _)| point.components().count())
}

/// Returns true if an error was caused by a full file system or an exhausted quota.
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
    /// Returns true if the file system of the store is full.
    #[must_use]
    pub fn is_full(&self) -> bool {
        is_full(self) || self.may_be_full()
    }

    /// SQLite has one code for all failures of its shared memory, so the free space decides.
    fn may_be_full(&self) -> bool {
        let Self::State { path, source } = self else { return false };
        let is_vague = source.sqlite_error_code() == Some(rusqlite::ErrorCode::SystemIoFailure);
        is_vague
            && path
                .parent()
                .and_then(|f| DiskSpace::holding_path(f).ok())
                .is_some_and(|space| space.is_used_up())
    }
}

impl StepWorkspace<'_> {
    /// Bytes in its files so far. Files that cannot be accessed do not count.
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
        let is_remote =
            |kind: &str| DiskSpace { free: 0, mount: PathBuf::new(), kind: kind.into() }.is_remote();
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
        let space = DiskSpace::holding_path(folder.path()).unwrap();
        assert!(folder.path().canonicalize().unwrap().starts_with(&space.mount), "{space:?}");
        assert!(DiskSpace::holding_path(&folder.path().join("absent")).is_err());
    }
}
