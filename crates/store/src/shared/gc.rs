//! The garbage collection of a shared folder: files without a use for longer than the longest job.
//!
//! A folder that several people share has no list of all recipes, so age decides, and not reference. A
//! record is touched when it is adopted or offered; a blob stays as long as a record names it. A file goes
//! to the trash first, and is deleted by a later collection, after the same time again: a process that reads
//! it meanwhile reads on.
//!
//! There is no lock, so a process may adopt or publish at the same time. A record is touched before it is
//! read, and looked at again after its move: if it was touched, it returns. A process that publishes a record
//! looks at its files afterwards, and the collection looks for new records after it moved files: one of the
//! two sees the other, and the file is there again.
//!
//! Only files with names of this program are moved or deleted, and no link is followed. Two collections at
//! the same time do no harm: a file that one of them does not find was moved by the other.
//!
//! Times are those of the file system, but some file systems take them from the client. The clocks of two
//! machines may differ by two hours.

use super::PLANS;
use super::folder::{PROCESS_FOLDER, SharedFolder, is_refused};
use super::medium::read_record;
use crate::blob::blob_name;
use crate::disk::{disk_error, is_absent};
use crate::fs::{FolderEntry, SystemFs};
use crate::{Digest, Key, StoreError, TMP, TRASH};
use gs2e_files::stat::FileStat;
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Largest difference between the clocks of two machines. Each age is lengthened by it.
pub(super) const CLOCK_MARGIN: Duration = Duration::from_secs(2 * 3600);

/// Options of a collection.
#[derive(Debug, Clone, Copy)]
pub struct SharedSweep {
    /// Time without use after which a file goes. It must exceed the longest job.
    pub older_than: Duration,
    /// The clock of this machine, ns since the epoch.
    pub now_ns: i64,
    /// True if the collection only reports.
    pub dry_run: bool,
}

/// The result of a collection, or of its dry run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct SharedSweepSummary {
    /// Number of records moved to the trash.
    pub records: usize,
    /// Number of blobs moved to the trash.
    pub blobs: usize,
    /// Bytes of these blobs.
    pub bytes: u64,
    /// Number of records that stay.
    pub kept_records: usize,
    /// Number of files that returned from the trash, because they were used meanwhile.
    pub restored: usize,
    /// Number of files deleted: those moved to the trash long ago, those that killed processes left, and
    /// those of plans without a recent task.
    pub deleted: usize,
    /// Bytes of the deleted files.
    pub deleted_bytes: u64,
    /// Number of old folders that stay, because this user may not delete them.
    pub refused: usize,
    /// Largest difference that was seen between the clock of this machine and the times of files, s. Files
    /// of the past have any age, so only a file system that is behind shows, and files of the future.
    pub clock_difference: u64,
}

/// A file of `cas/` or `ac/`.
#[derive(Debug)]
struct SharedFile {
    name: Digest,
    path: PathBuf,
    stat: FileStat,
}

/// Collects in a shared folder.
///
/// # Errors
/// The folder cannot be read or written, or the clocks differ by more than two hours. Nothing that
/// was used lately is lost.
pub fn sweep_shared(root: &Path, sweep: SharedSweep) -> Result<SharedSweepSummary, StoreError> {
    let shared = SharedFolder::open(root, Arc::new(SystemFs))?;
    // Listed first: a blob that is published later is on no list, and stays.
    let (records, blobs) = (shared.stored("ac", ".json")?, shared.stored("cas", "")?);
    let probed = shared.file_system_time()?;
    let newest = records.iter().chain(&blobs).map(|file| file.stat.mtime_ns).max();
    let ahead = newest.unwrap_or(sweep.now_ns).max(probed).saturating_sub(sweep.now_ns);
    let behind = sweep.now_ns.saturating_sub(probed);
    let difference = Duration::from_nanos(u64::try_from(ahead.max(behind)).unwrap_or(0));
    if difference > CLOCK_MARGIN {
        return Err(StoreError::Clocks { path: root.to_owned(), seconds: difference.as_secs() });
    }
    let age = i64::try_from((sweep.older_than + CLOCK_MARGIN).as_nanos()).unwrap_or(i64::MAX);
    // The earlier of both clocks counts, so that a difference keeps files longer and never shorter.
    let until_ns = probed.min(sweep.now_ns).saturating_sub(age);
    let mut collection = Collection { shared: &shared, until_ns, swept: SharedSweepSummary::default() };
    collection.swept.clock_difference = difference.as_secs();
    collection.run(records, blobs, sweep.dry_run)?;
    Ok(collection.swept)
}

/// A collection that runs.
struct Collection<'a> {
    shared: &'a SharedFolder,
    /// Files of this time and before are old.
    until_ns: i64,
    swept: SharedSweepSummary,
}

impl Collection<'_> {
    fn run(
        &mut self,
        records: Vec<SharedFile>,
        blobs: Vec<SharedFile>,
        dry_run: bool,
    ) -> Result<(), StoreError> {
        // Before anything moves: a file that enters or leaves a folder makes the folder look young.
        let expired = self.expired()?;
        let is_old = |file: &SharedFile| file.stat.mtime_ns <= self.until_ns;
        let (old, young): (Vec<_>, Vec<_>) = records.into_iter().partition(is_old);
        let mut named = NamedFiles::default();
        if dry_run {
            named.read(self.shared, &young)?;
            let gone: Vec<_> = blobs.into_iter().filter(|b| is_old(b) && !named.holds(&b.name)).collect();
            self.swept.records = old.len();
            self.swept.kept_records = young.len();
            self.swept.blobs = gone.len();
            self.swept.bytes = gone.iter().map(|blob| blob.stat.size).sum();
            return self.delete(&expired, true);
        }
        let trash = self.shared.fresh_trash()?;
        self.move_records(old, &trash)?;
        // The records that are there now, also those that returned or came meanwhile.
        named.read(self.shared, &self.shared.stored("ac", ".json")?)?;
        let unused = blobs.into_iter().filter(|blob| blob.stat.mtime_ns <= self.until_ns);
        for blob in unused.filter(|blob| !named.holds(&blob.name)) {
            if self.shared.move_to(&blob.path, &trash.join(blob.name.to_string()))? {
                self.swept.blobs += 1;
                self.swept.bytes += blob.stat.size;
            }
        }
        let records = self.shared.stored("ac", ".json")?;
        named.read(self.shared, &records)?;
        self.swept.kept_records = records.len();
        self.restore(&named)?;
        self.delete(&expired, false)
    }

    /// Moves old records away, and those back that were used meanwhile.
    fn move_records(&mut self, old: Vec<SharedFile>, trash: &Path) -> Result<(), StoreError> {
        for record in old {
            let to = trash.join(format!("{}.json", record.name));
            if !self.shared.move_to(&record.path, &to)? {
                continue;
            }
            match self.shared.disk.stat(&to) {
                Ok(now) if now.mtime_ns > self.until_ns => self.put_back(&to, &record.path)?,
                Ok(_) => self.swept.records += 1,
                Err(e) if is_absent(&e) => {}
                Err(e) => return Err(disk_error("reading", &to)(e)),
            }
        }
        Ok(())
    }

    /// Moves blobs back that a record names: it was published during this collection, or during one that was
    /// killed.
    fn restore(&mut self, named: &NamedFiles) -> Result<(), StoreError> {
        for batch in self.shared.folders(TRASH)? {
            for (name, path) in self.shared.files_of(&batch.path)? {
                let Some(digest) = name.parse().ok().filter(|digest| named.holds(digest)) else { continue };
                self.put_back(&path, &self.shared.root.join(blob_name(&digest)))?;
            }
        }
        Ok(())
    }

    /// Gives a file of the trash its name again.
    fn put_back(&mut self, from: &Path, to: &Path) -> Result<(), StoreError> {
        // A link and no rename: the file that a process has published again meanwhile must stay.
        match self.shared.link(from, to) {
            // Another collection put it back.
            Err(StoreError::Io { source, .. }) if is_absent(&source) => {}
            done => {
                done?;
                self.swept.restored += 1;
            }
        }
        Ok(())
    }

    /// Folders of the trash and of processes in which nothing was put for long, and of plans in which no task
    /// wrote for long. A folder with any other file stays.
    fn expired(&self) -> Result<Vec<PathBuf>, StoreError> {
        let is_old = |path: &Path| self.shared.disk.stat(path).is_ok_and(|s| s.mtime_ns <= self.until_ns);
        let mut expired = Vec::new();
        for kind in [OldFolder::Plan, OldFolder::Trash, OldFolder::Process] {
            for folder in self.shared.folders(kind.place())? {
                let name = folder.path.file_name().unwrap_or_default().to_string_lossy();
                let files = self.shared.files_of(&folder.path)?;
                let is_ours = kind.names(&name) && files.iter().all(|(name, _)| kind.holds(name));
                let is_idle = kind != OldFolder::Plan || files.iter().all(|(_, path)| is_old(path));
                if is_ours && is_idle && is_old(&folder.path) {
                    expired.push(folder.path);
                }
            }
        }
        Ok(expired)
    }

    fn delete(&mut self, expired: &[PathBuf], dry_run: bool) -> Result<(), StoreError> {
        for folder in expired {
            let files = self.shared.files_of(folder)?;
            let bytes: u64 =
                files.iter().filter_map(|(_, path)| Some(self.shared.disk.stat(path).ok()?.size)).sum();
            match if dry_run { Ok(()) } else { self.shared.disk.remove(folder) } {
                // Another collection removes it.
                Err(StoreError::Io { source, .. }) if is_absent(&source) => {}
                Err(StoreError::Io { source, .. }) if is_refused(&source) => self.swept.refused += 1,
                done => {
                    done?;
                    self.swept.deleted += files.len();
                    self.swept.deleted_bytes += bytes;
                }
            }
        }
        Ok(())
    }
}

/// Kinds of folders that are deleted when they are old.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum OldFolder {
    /// That of an array job.
    Plan,
    /// That of a collection, or of a folder in the place of a file.
    Trash,
    /// That of a process.
    Process,
}

impl OldFolder {
    /// The folder of these folders.
    fn place(self) -> &'static str {
        match self {
            Self::Plan => PLANS,
            Self::Trash => TRASH,
            Self::Process => TMP,
        }
    }

    /// Returns true if a folder of this kind can have this name.
    fn names(self, name: &str) -> bool {
        match self {
            Self::Plan => name.len() == 12 && name.chars().all(|c| c.is_ascii_hexdigit()),
            Self::Trash | Self::Process => name.starts_with(PROCESS_FOLDER),
        }
    }

    /// Returns true if a folder of this kind can hold a file of this name.
    fn holds(self, file: &str) -> bool {
        let parts: Vec<&str> = file.split('/').collect();
        let is_number = |text: &str| text.chars().all(|c| c.is_ascii_digit());
        match (self, parts.as_slice()) {
            (Self::Plan, [name]) => {
                let is_shard = name.starts_with("shard-") && name.ends_with(".json");
                let is_part = name.starts_with(".gs2e-") && name.ends_with(".part");
                matches!(*name, "plan.json" | "task.sh") || is_shard || is_part
            }
            (Self::Plan, ["results", run, name]) => {
                run.split(['_', '.']).all(is_number) && matches!(*name, "steps.jsonl" | "log" | "end")
            }
            // A folder in the place of a file may hold anything.
            (Self::Trash, [name, ..]) => name.strip_suffix(".json").unwrap_or(name).parse::<Digest>().is_ok(),
            (Self::Process, [name]) => is_number(name),
            _ => false,
        }
    }
}

/// The files that records name.
#[derive(Debug, Default)]
struct NamedFiles {
    records: BTreeSet<Digest>,
    files: BTreeSet<Digest>,
}

impl NamedFiles {
    /// Adds the files of records that were not read before.
    fn read(&mut self, shared: &SharedFolder, records: &[SharedFile]) -> Result<(), StoreError> {
        for record in records {
            if self.records.insert(record.name) {
                let outputs = read_record(shared, &Key(record.name))?.map(|record| record.outputs);
                self.files.extend(outputs.into_iter().flatten().map(|output| output.digest));
            }
        }
        Ok(())
    }

    fn holds(&self, digest: &Digest) -> bool {
        self.files.contains(digest)
    }
}

impl SharedFolder {
    /// The time of the file system, ns since the epoch.
    fn file_system_time(&self) -> Result<i64, StoreError> {
        let probe = self.fresh();
        self.disk.write(&probe, b"now")?;
        let stat = self.disk.stat(&probe).map_err(disk_error("reading", &probe))?;
        self.disk.remove(&probe)?;
        Ok(stat.mtime_ns)
    }

    /// A new folder in the trash.
    pub(super) fn fresh_trash(&self) -> Result<PathBuf, StoreError> {
        let trash = self.root.join(TRASH);
        self.disk.create_dir(&trash)?;
        let folder = tempfile::Builder::new().prefix(PROCESS_FOLDER).tempdir_in(&trash);
        Ok(folder.map_err(disk_error("creating a folder in", &trash))?.keep())
    }

    /// Renames a file. Returns `false` if it is not there any more.
    fn move_to(&self, from: &Path, to: &Path) -> Result<bool, StoreError> {
        match self.disk.stat(from) {
            Ok(_) => {}
            Err(e) if is_absent(&e) => return Ok(false),
            Err(e) => return Err(disk_error("reading", from)(e)),
        }
        match self.disk.rename(from, to) {
            // Another collection was faster.
            Err(StoreError::Io { source, .. }) if is_absent(&source) => Ok(false),
            moved => moved.map(|()| true),
        }
    }

    /// The folders directly below a folder; empty if it is absent.
    fn folders(&self, name: &str) -> Result<Vec<FolderEntry>, StoreError> {
        let folder = self.root.join(name);
        let private = self.private.as_ref().map(|private| private.path().to_owned());
        let entries = self.disk.entries(&folder)?.into_iter();
        Ok(entries.filter(|entry| entry.is_dir && Some(&entry.path) != private.as_ref()).collect())
    }

    /// The files below a folder, as [`StoreDisk::files_below`]; empty if another process removed it.
    fn files_of(&self, folder: &Path) -> Result<Vec<(String, PathBuf)>, StoreError> {
        match self.disk.files_below(folder) {
            Err(StoreError::Io { source, .. }) if is_absent(&source) || is_refused(&source) => Ok(Vec::new()),
            files => files,
        }
    }

    /// The files of `cas/` or `ac/` with names that this program gives.
    fn stored(&self, folder: &str, suffix: &str) -> Result<Vec<SharedFile>, StoreError> {
        let mut stored = Vec::new();
        for (name, path) in self.disk.files_below(&self.root.join(folder))? {
            let file = name.strip_suffix(suffix).and_then(|name| name.split_once('/'));
            // A file with another name is not from this program, and is not touched.
            let Some(name) = file.and_then(|(_, name)| name.parse().ok()) else { continue };
            match self.disk.stat(&path) {
                Ok(stat) => stored.push(SharedFile { name, path, stat }),
                Err(e) if is_absent(&e) => {}
                Err(e) => return Err(disk_error("reading", &path)(e)),
            }
        }
        Ok(stored)
    }
}

#[cfg(test)]
mod tests;
