//! Possible contents of a disk after a power failure: everything up to the last sync, and some
//! names and some bytes of later writes, in any order.

use super::recorder::{Database, DiskOperation};
use crate::random::Random;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// The fate of unsynced data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Loss {
    /// All of it is lost, except commits of the database: files that the database names must be
    /// synced before.
    Dropped,
    /// All names are there, and files have lost bytes.
    Torn,
    /// Some operations reached the disk and earlier ones did not; files have lost bytes.
    Reordered,
}

#[derive(Debug, Clone)]
struct Content {
    bytes: Vec<u8>,
    synced: bool,
}

/// The content of a store's folder.
#[derive(Debug, Default)]
pub(super) struct Disk {
    folders: BTreeSet<PathBuf>,
    files: BTreeMap<PathBuf, Content>,
    /// Every state of the database since the last sync, and the last before it.
    databases: Vec<Database>,
}

impl Disk {
    /// The disk after these operations and the power failure.
    pub(super) fn after(ops: &[DiskOperation], loss: Loss, random: &mut Random) -> Self {
        let synced =
            ops.iter().rposition(|op| matches!(op, DiskOperation::SyncAll)).map_or(0, |last| last + 1);
        let mut disk = Self::default();
        ops[..synced].iter().for_each(|op| disk.apply(op));
        disk.apply(&DiskOperation::SyncAll);
        for op in &ops[synced..] {
            let reaches = match loss {
                Loss::Dropped => matches!(op, DiskOperation::Commit(_) | DiskOperation::Sync(_)),
                Loss::Torn => true,
                Loss::Reordered => random.once_in(2) || matches!(op, DiskOperation::Commit(_)),
            };
            if reaches {
                disk.apply(op);
            }
        }
        if loss != Loss::Dropped {
            disk.tear(random);
        }
        if loss == Loss::Reordered && !disk.databases.is_empty() {
            // The database's log is not synced at a commit: an older state may come back.
            disk.databases.truncate(1 + random.below(disk.databases.len()));
        }
        disk
    }

    fn apply(&mut self, op: &DiskOperation) {
        match op {
            DiskOperation::Folder(path) => self.folders.extend(path.ancestors().map(Path::to_owned)),
            DiskOperation::Write(path, bytes) | DiskOperation::Link(path, bytes) => {
                self.files.insert(path.clone(), Content { bytes: bytes.clone(), synced: false });
            }
            DiskOperation::Rename(from, to, bytes) => {
                // A step wrote this file by itself, so its bytes were not recorded before.
                let written = bytes.clone().map(|bytes| Content { bytes, synced: false });
                if let Some(content) = self.files.remove(from).or(written) {
                    self.files.insert(to.clone(), content);
                }
            }
            DiskOperation::Remove(path) => {
                self.files.retain(|file, _| !file.starts_with(path));
                self.folders.retain(|folder| !folder.starts_with(path));
            }
            DiskOperation::Sync(path) => {
                self.files.get_mut(path).into_iter().for_each(|content| content.synced = true)
            }
            DiskOperation::SyncAll => {
                self.files.values_mut().for_each(|content| content.synced = true);
                self.databases.drain(..self.databases.len().saturating_sub(1));
            }
            DiskOperation::Commit(database) => self.databases.push(database.clone()),
        }
    }

    /// Takes bytes from unsynced files: all, the end, or the values of some or all with the length
    /// kept. Some files stay whole.
    fn tear(&mut self, random: &mut Random) {
        for content in self.files.values_mut().filter(|content| !content.synced) {
            let bytes = &mut content.bytes;
            match random.below(5) {
                0 => bytes.clear(),
                1 => bytes.truncate(random.below(bytes.len() + 1)),
                2 => bytes.fill(0),
                3 => {
                    let from = random.below(bytes.len() + 1);
                    bytes[from..].fill(0);
                }
                _ => {}
            }
        }
    }

    /// Writes the content to the store's folder.
    pub(super) fn write(&self, root: &Path) {
        fs::create_dir_all(root).unwrap();
        for folder in &self.folders {
            fs::create_dir_all(root.join(folder)).unwrap();
        }
        for (path, content) in &self.files {
            let path = root.join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(&path, &content.bytes).unwrap();
        }
        for (suffix, bytes) in self.databases.last().into_iter().flatten() {
            fs::write(root.join(format!("state.db{suffix}")), bytes).unwrap();
        }
    }
}
