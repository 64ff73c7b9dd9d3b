//! Frames that steps keep for later ones, in `frames/<name>/`. They are no outputs: a step can be made
//! without them, and their readers compare each entry with its hash.

use super::blob::is_fresh_name;
use super::disk::{disk_error, is_absent};
use super::gc::GcSweep;
use super::{Digest, Store, StoreError, TMP};
use gs2e_files::stat::FileStat;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Folder of kept frames.
pub(super) const FRAMES: &str = "frames";

/// Number and bytes of files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct KeptFiles {
    /// Number of files.
    pub files: usize,
    /// Their bytes.
    pub bytes: u64,
}

impl Store {
    /// The files of a name, sorted.
    ///
    /// # Errors
    /// The folder cannot be read.
    pub fn frames_of(&self, name: &Digest) -> Result<Vec<PathBuf>, StoreError> {
        let files = self.files_of(&format!("{FRAMES}/{name}"))?;
        Ok(files.into_iter().map(|(_, path)| path).collect())
    }

    /// A path that no file has, for a new file of frames. A file that is not kept is removed when the store
    /// is opened next.
    #[must_use]
    pub fn fresh_frames(&self) -> PathBuf {
        self.blobs.fresh(TMP)
    }

    /// Keeps a finished file under a name. If the files of all names exceed `limit` bytes, those without a
    /// use for longest are removed.
    ///
    /// # Errors
    /// A file cannot be moved or removed.
    pub fn keep_frames(&self, name: &Digest, fresh: &Path, limit: u64) -> Result<(), StoreError> {
        let folder = self.root.join(FRAMES).join(name.to_string());
        self.disk.create_dir(&folder)?;
        let file = fresh.file_name().unwrap_or_default();
        // Without a sync: a reader compares each entry with its hash, so a torn file costs time only.
        self.disk.rename(fresh, &folder.join(file))?;
        self.trim_frames(limit)
    }

    /// Marks the files of a name as used.
    ///
    /// # Errors
    /// A file cannot be touched.
    pub fn use_frames(&self, name: &Digest) -> Result<(), StoreError> {
        for path in self.frames_of(name)? {
            match self.disk.touch(&path) {
                // Another step has just made room.
                Err(e) if is_absent(&e) => {}
                touched => touched.map_err(disk_error("touching", &path))?,
            }
        }
        Ok(())
    }

    fn trim_frames(&self, limit: u64) -> Result<(), StoreError> {
        let mut files = self.all_frames()?;
        // `use_frames` touches the files of a name, so the mtime is the time of their last use.
        files.sort_by_key(|(_, stat)| stat.mtime_ns);
        let mut bytes: u64 = files.iter().map(|(_, stat)| stat.size).sum();
        for (path, stat) in files {
            if bytes <= limit {
                break;
            }
            self.disk.remove(&path)?;
            bytes -= stat.size;
        }
        Ok(())
    }

    /// Deletes frames with other names than these that were not used since `sweep.until_ns`.
    ///
    /// # Errors
    /// A file cannot be removed.
    pub fn sweep_frames(&self, names: &BTreeSet<Digest>, sweep: GcSweep) -> Result<KeptFiles, StoreError> {
        let mut swept = KeptFiles::default();
        for (path, stat) in self.all_frames()? {
            let name = path.parent().and_then(Path::file_name).and_then(|name| name.to_str()?.parse().ok());
            if stat.mtime_ns <= sweep.until_ns && name.is_none_or(|name| !names.contains(&name)) {
                swept.files += 1;
                swept.bytes += stat.size;
                if !sweep.dry_run {
                    self.disk.remove(&path)?;
                }
            }
        }
        Ok(swept)
    }

    /// The files with names that this program gives, below folders with such names.
    fn all_frames(&self) -> Result<Vec<(PathBuf, FileStat)>, StoreError> {
        let is_ours = |name: &str| {
            let parts = name.split_once('/');
            parts.is_some_and(|(of, file)| of.parse::<Digest>().is_ok() && is_fresh_name(file.as_ref()))
        };
        let files = self.files_of(FRAMES)?.into_iter().filter(|(name, _)| is_ours(name));
        Ok(files.filter_map(|(_, path)| self.disk.stat(&path).ok().map(|stat| (path, stat))).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::StoreAccess;

    fn put(store: &Store, name: &[u8], bytes: usize, limit: u64) -> Digest {
        let (name, fresh) = (Digest::of_bytes(name), store.fresh_frames());
        std::fs::write(&fresh, vec![1; bytes]).unwrap();
        store.keep_frames(&name, &fresh, limit).unwrap();
        name
    }

    fn store(folder: &Path) -> Store {
        Store::open(folder, StoreAccess::Write, &mut |_| {}).unwrap()
    }

    #[test]
    fn files_without_a_use_for_longest_make_room() {
        let folder = tempfile::tempdir().unwrap();
        let store = store(folder.path());
        let a = put(&store, b"a", 400, 1000);
        let b = put(&store, b"b", 400, 1000);
        // The clock of the file system has steps.
        std::thread::sleep(std::time::Duration::from_millis(30));
        store.use_frames(&a).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(30));
        let c = put(&store, b"c", 400, 1000);
        let files = [a, b, c].map(|name| store.frames_of(&name).unwrap().len());
        assert_eq!(files, [1, 0, 1]);
    }

    #[test]
    fn a_collection_deletes_frames_that_no_recipe_asks_for() {
        let folder = tempfile::tempdir().unwrap();
        let store = store(folder.path());
        let [a, b] = [b"a", b"b"].map(|name| put(&store, name, 100, 1000));
        let sweep = |until_ns, dry_run| {
            store.sweep_frames(&BTreeSet::from([a]), GcSweep { until_ns, dry_run }).unwrap().files
        };
        // Young files stay.
        assert_eq!(sweep(0, false), 0);
        assert_eq!(sweep(i64::MAX, true), 1);
        assert_eq!(sweep(i64::MAX, false), 1);
        assert_eq!([a, b].map(|name| store.frames_of(&name).unwrap().len()), [1, 0]);
    }
}
