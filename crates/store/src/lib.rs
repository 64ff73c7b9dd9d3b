//! The store: immutable blobs named by the BLAKE3 of their bytes, and records of what each key
//! produced.
//!
//! ```text
//! .gs2e/  VERSION  lock  state.db  cas/ab/<64 hex>  ac/ab/<64 hex>.json  gs2e-tmp/  gs2e-trash/
//!         roots/  frames/<64 hex>/  logs/<64 hex>.txt  resume/<64 hex>/
//! ```
//! `cas/` and `ac/` are the truth and never change in place. `state.db` is an index of `ac/` and a
//! cache of file digests; losing it costs time, never correctness. Publishing goes blobs, record,
//! sync, database row, in this order. A record therefore never names bytes that are not there, and
//! the database never has a row that a power cut could undo. A process that is killed loses nothing
//! that it published: records count without the database. The store knows nothing of scenes, poses
//! or events.
//!
//! It needs `gs2e-files` alone. `gs2e-build` publishes the products of steps here, and `gs2e-release`
//! and `gs2e-publish` take the files of a release from it. `gs2e-audit` compares their digests.
//!
//! # Examples
//!
//! ```
//! use gs2e_store::record::{StepProvenance, StepRecord};
//! use gs2e_store::{Digest, Key, Store, StoreAccess, description::describe_value};
//!
//! let folder = tempfile::tempdir()?;
//! let store = Store::open(folder.path(), StoreAccess::Write, &mut |_| {})?;
//! let step = describe_value("a step, its parameters and its inputs");
//! let workspace = store.workspace()?;
//! std::fs::write(workspace.path().join("poses.txt"), "0 0 0")?;
//! let key = Key::of_description(&step);
//! let record = StepRecord::new(key, "poses", step.lines(), StepProvenance::default());
//! store.publish(&workspace, record)?;
//! assert_eq!(store.record(&key)?.ok_or("no record")?.outputs[0].digest, Digest::of_bytes(b"0 0 0"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod blob;
mod cache;
pub mod description;
mod digest;
mod disk;
mod error;
pub mod fs;
pub mod gc;
mod hash;
mod kept;
pub mod link_tree;
mod lock;
mod marker;
mod memo;
mod options;
mod publish;
pub mod record;
mod root;
mod shared;
pub mod space;
pub mod stat_cache;
mod state;
mod unlike;

pub use options::{BucketEnvironment, StoreAccess, StoreOptions};

pub use error::StoreError;

pub use digest::{Digest, Key};
pub use root::ReleaseRoot;

use blob::BlobFolders;
pub use cache::EvictedFiles;
use gs2e_files::is_no_file;
use gs2e_files::stat::StatSighting;
pub use kept::KeptFiles;
pub use lock::{LockClaim, LockRequest, StoreLock};
pub use memo::MemoGround;
pub use publish::StepWorkspace;
pub use shared::{PLANS, SharedMismatch, SharedSweep, SharedSweepSummary, is_bucket, sweep_shared};
pub use unlike::OutputMismatch;

use cache::StoreCache;
use disk::StoreDisk;
use marker::{StoreFolder, StoreKind};
use record::{RecordSummary, StepRecord, StoredOutput};
use shared::SharedStore;
use space::DiskSpace;
use stat_cache::StatEntry;
use state::{StateDb, StateTable};
use std::collections::BTreeSet;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard};

/// Format of the folder. Raise it when an older program can no longer use it.
pub const FORMAT: u32 = 1;

/// An open store.
#[derive(Debug)]
pub struct Store {
    root: PathBuf,
    disk: StoreDisk,
    blobs: BlobFolders,
    state: Mutex<StateDb>,
    /// Files whose bytes this process has read, if it does not trust stat fields.
    verified: Option<Mutex<BTreeSet<PathBuf>>>,
    counts: DigestCounts,
    shared: Option<SharedStore>,
    /// The bound on its size, if there is one.
    cache: Option<StoreCache>,
    /// The first failure of an operation whose result was not awaited.
    failed: Mutex<Option<StoreError>>,
    /// The kernel frees it with the store.
    lock: Option<lock::StoreLock>,
}

/// Sources of digests.
#[derive(Debug, Default)]
struct DigestCounts {
    trusted: AtomicUsize,
    hashed: AtomicUsize,
}

/// Folder of files that are being written.
const TMP: &str = "gs2e-tmp";
/// Folder of files that are about to be deleted, or that a person may want to look at before.
const TRASH: &str = "gs2e-trash";
/// Folders that every store has.
const FOLDERS: [&str; 4] = ["cas", "ac", TMP, TRASH];
/// The change from a store of an earlier version.
const EARLIER: &str = "its folders tmp and trash are not used any more and can be deleted";
/// Folder of the states of interrupted steps, one folder per key.
const RESUME: &str = "resume";
/// Folder of the log files of external programs, one per key.
const LOGS: &str = "logs";
/// Ending of the names of those files.
const LOG: &str = ".txt";

impl Store {
    /// Opens the store at `root`, and creates it for writing. `waiting` is called with the holder
    /// of the lock, and again at the interval given by the claim.
    ///
    /// # Errors
    /// The store cannot be read or created, was made by a newer program, or is locked and `access`
    /// does not wait.
    pub fn open(
        root: &Path,
        opening: impl Into<StoreOptions>,
        waiting: &mut dyn FnMut(&str),
    ) -> Result<Self, StoreError> {
        let opening: StoreOptions = opening.into();
        let disk = StoreDisk::new(root, opening.fs.clone(), opening.sync_each);
        // Before anything is created: a folder of others stays as it is.
        let found = match opening.access {
            StoreAccess::Read => marker::examine(root, StoreKind::Local)?,
            StoreAccess::Write | StoreAccess::WriteNow => disk.claim(StoreKind::Local)?,
        };
        let lock = match opening.access {
            StoreAccess::Read => None,
            StoreAccess::Write | StoreAccess::WriteNow => {
                let waits = opening.access == StoreAccess::Write;
                Some(lock::StoreLock::take_lock(root, &opening.claim, waits, waiting)?)
            }
        };
        if lock.is_some() {
            disk.refuse_links(&[LOGS, RESUME, root::FOLDER, kept::FRAMES])?;
            for folder in FOLDERS {
                disk.create_dir(&root.join(folder))?;
            }
            // No other process writes while the lock is held, so the files here with names of this program
            // are left over from a process that died.
            disk.remove_fresh(TMP)?;
        }
        let shared = opening.shared.as_deref().map(|place| SharedStore::open(place, &opening)).transpose()?;
        let mut state = StateDb::open(root, opening.index.as_deref(), disk.clone(), lock.is_some())?;
        if found == StoreFolder::Unmarked && lock.is_some() {
            disk.mark_earlier(StoreKind::Local)?;
            state.note(format!("{} was made by an earlier version; {EARLIER}", root.display()));
        }
        let mut store = Self {
            root: root.to_owned(),
            blobs: BlobFolders::new(root, disk.clone()),
            state: Mutex::new(state),
            verified: opening.verify.then(Mutex::default),
            counts: DigestCounts::default(),
            shared,
            cache: None,
            failed: Mutex::new(None),
            disk,
            lock,
        };
        // Only where other copies are: what is removed here must be there.
        if let (Some(limit), true) = (opening.cache_size, store.shared.is_some() && store.lock.is_some()) {
            store.bound(limit)?;
        }
        Ok(store)
    }

    /// Returns true if the folder is a store.
    #[must_use]
    pub fn is_store(folder: &Path) -> bool {
        matches!(
            marker::examine(folder, StoreKind::Local),
            Ok(StoreFolder::Marked | StoreFolder::Unmarked) | Err(StoreError::Newer { .. })
        )
    }

    /// Notices of repairs since the last call, one line each.
    #[must_use]
    pub fn take_notices(&self) -> Vec<String> {
        self.state().take_notices()
    }

    /// Returns the file of the store's lock, for a process that works in the store's folders. The
    /// lock is held until that process has closed the file, too. Returns `None` if the store was
    /// opened for reading.
    ///
    /// # Errors
    /// The system has no more file descriptors.
    pub fn share_lock(&self) -> Result<Option<File>, StoreError> {
        let shared = self.lock.as_ref().map(lock::StoreLock::share).transpose();
        shared.map_err(disk::disk_error("sharing", &self.root.join(lock::LOCK)))
    }

    /// Number of digests taken from stat fields, and number of digests taken from bytes.
    #[must_use]
    pub fn digests(&self) -> (usize, usize) {
        (self.counts.trusted.load(Ordering::Relaxed), self.counts.hashed.load(Ordering::Relaxed))
    }

    /// The recorded outputs of a key, if there is a record, and what the step used. The index is
    /// asked first. A record of a process that was killed before it wrote the index, or that is
    /// working now, stands in `ac/` only, and counts as much.
    ///
    /// # Errors
    /// The record exists but cannot be read.
    pub fn record(&self, key: &Key) -> Result<Option<RecordSummary>, StoreError> {
        let name = key.to_string();
        let indexed = self.state().get(StateTable::Record, &name);
        if let Some(brief) = indexed.and_then(|row| serde_json::from_slice(&row).ok()) {
            return Ok(Some(brief));
        }
        let brief = self.full_record(key)?.map(|record| record.brief());
        // The row spares the next look into `ac/`.
        brief.iter().for_each(|brief| self.state().put(StateTable::Record, &name, brief.row()));
        Ok(brief)
    }

    /// Every record of the index.
    #[must_use]
    pub fn records(&self) -> Vec<RecordSummary> {
        let rows = self.state().all(StateTable::Record).into_values();
        rows.filter_map(|row| serde_json::from_slice(&row).ok()).collect()
    }

    /// The whole record of a key from `ac/`; `None` if it is absent or damaged.
    ///
    /// # Errors
    /// It exists but cannot be read.
    pub fn full_record(&self, key: &Key) -> Result<Option<StepRecord>, StoreError> {
        StepRecord::read(&self.root, &self.disk, key)
    }

    /// The key with which a step of a scene was last made.
    #[must_use]
    pub fn last_key(&self, scene: &str, step: &str) -> Option<Key> {
        let row = self.state().get(StateTable::Last, &last_name(scene, step))?;
        std::str::from_utf8(&row).ok()?.parse().ok().map(Key)
    }

    /// Stores the present key of a step of a scene, for explanations.
    pub fn note_last(&self, scene: &str, step: &str, key: Key) {
        self.state().put_new(StateTable::Last, &last_name(scene, step), key.to_string().into_bytes());
    }

    /// The recipe from which a scene was last made.
    #[must_use]
    pub fn last_recipe(&self, scene: &str) -> Option<String> {
        String::from_utf8(self.state().get(StateTable::Recipe, scene)?).ok()
    }

    /// Stores the recipe of a scene, for explanations.
    pub fn note_recipe(&self, scene: &str, recipe: &str) {
        self.state().put_new(StateTable::Recipe, scene, recipe.as_bytes().to_vec());
    }

    /// The state of a blob, from its stat fields if they are known, otherwise from its bytes.
    ///
    /// # Errors
    /// The file exists but cannot be read.
    pub fn examine(&self, output: &StoredOutput) -> Result<BlobState, StoreError> {
        let path = self.blobs.path(&output.digest);
        match self.look(&path) {
            Ok(entry) if entry.digest == output.digest => Ok(BlobState::Sound),
            Ok(_) => Ok(BlobState::Altered),
            // A folder or a link in a blob's place is moved away like altered bytes.
            Err(source) if is_no_file(&source) => Ok(BlobState::Altered),
            Err(source) if disk::is_absent(&source) => Ok(BlobState::Missing),
            Err(source) => Err(StoreError::Io { doing: "reading", path, source }),
        }
    }

    /// Folder of the store.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Path of a blob.
    #[must_use]
    pub fn path_of(&self, digest: &Digest) -> PathBuf {
        self.blobs.path(digest)
    }

    /// Log file for external programs run by the step with this key. It is not part of the step's
    /// outputs.
    ///
    /// # Errors
    /// The folder cannot be created.
    pub fn log_of(&self, key: &Key) -> Result<PathBuf, StoreError> {
        let folder = self.root.join(LOGS);
        self.disk.create_dir(&folder)?;
        Ok(folder.join(format!("{key}{LOG}")))
    }

    /// Folder for the state of the step with this key while it is interrupted. It may not exist. No
    /// other step gets it, so a step never goes on from the state of another.
    #[must_use]
    pub fn resume_of(&self, key: &Key) -> PathBuf {
        self.root.join(RESUME).join(key.to_string())
    }

    /// Removes the state of a step that was made.
    ///
    /// # Errors
    /// It exists but cannot be removed.
    pub fn forget_resume(&self, key: &Key) -> Result<(), StoreError> {
        let folder = self.resume_of(key);
        if gs2e_files::is_there(&folder) { self.disk.remove(&folder) } else { Ok(()) }
    }

    /// The digest of a file, in the store or outside. The file is read only if its stat fields have
    /// changed.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn look(&self, path: &Path) -> std::io::Result<StatEntry> {
        // The fields are read before the bytes. A change in between makes the entry stale, never
        // wrong.
        let stat = self.disk.stat(path)?;
        // A path that is not UTF-8 is hashed each time: correct, but slower.
        let name = path.to_str().filter(|_| self.trusts(path));
        let known = name.and_then(|name| self.state().get(StateTable::Stat, name));
        let known = known.and_then(|row| postcard::from_bytes::<StatEntry>(&row).ok());
        if let Some(entry) = known.filter(|entry| entry.sighting.holds_for(&stat)) {
            self.counts.trusted.fetch_add(1, Ordering::Relaxed);
            return Ok(entry);
        }
        let sighting = StatSighting::observed_now(stat);
        let entry = StatEntry { sighting, digest: self.disk.digest(path)? };
        self.counts.hashed.fetch_add(1, Ordering::Relaxed);
        self.enter(path, entry);
        Ok(entry)
    }

    /// The present stat fields of a file or folder.
    ///
    /// # Errors
    /// It does not exist.
    pub fn sight(&self, path: &Path) -> std::io::Result<StatSighting> {
        self.disk.stat(path).map(StatSighting::observed_now)
    }

    /// Returns true if the recorded digest of a file can be trusted.
    fn trusts(&self, path: &Path) -> bool {
        self.verified.as_ref().is_none_or(|read| read.lock().expect("no holder panics").contains(path))
    }

    fn enter(&self, path: &Path, entry: StatEntry) {
        if let Some(read) = &self.verified {
            read.lock().expect("no holder panics").insert(path.to_owned());
        }
        if let Some(name) = path.to_str() {
            let row = postcard::to_stdvec(&entry).expect("an entry is plain data");
            self.state().put_new(StateTable::Stat, name, row);
        }
    }

    /// Moves an altered blob into `trash/`. A blob that another step has replaced meanwhile stays.
    ///
    /// # Errors
    /// It cannot be read or moved.
    pub fn discard(&self, digest: &Digest) -> Result<(), StoreError> {
        self.blobs.discard(digest)
    }

    /// The file system that the store is on.
    ///
    /// # Errors
    /// The system does not report it.
    pub fn space(&self) -> std::io::Result<DiskSpace> {
        DiskSpace::holding_path(&self.root)
    }

    /// Updates the stat fields of a blob after this program linked or unlinked it, which changes
    /// its ctime.
    ///
    /// # Errors
    /// The blob cannot be accessed.
    pub(crate) fn settle(&self, digest: &Digest) -> Result<(), StoreError> {
        let path = self.blobs.path(digest);
        let stat = self.disk.stat(&path).map_err(disk::disk_error("reading", &path))?;
        self.enter(&path, StatEntry { sighting: StatSighting::settled_file(stat), digest: *digest });
        Ok(())
    }

    /// Returns true if enough is pending that it should be written, in case this process is killed.
    #[must_use]
    pub fn is_due(&self) -> bool {
        /// Some hundred steps with their files.
        const ROWS: usize = 2048;
        self.state().pending() >= ROWS
    }

    /// Syncs the published files, then writes the pending rows to the database.
    ///
    /// # Errors
    /// The disk or the database fails, or an earlier operation failed whose result was not awaited.
    pub fn flush(&self) -> Result<(), StoreError> {
        if let Some(error) = self.failed.lock().expect("no holder panics").take() {
            return Err(error);
        }
        let mut state = self.state();
        if !state.is_behind() {
            return Ok(());
        }
        // With the state locked: a row that is added after this sync may describe bytes that the
        // sync missed.
        self.disk.sync_all(&self.root)?;
        state.flush()
    }

    fn state(&self) -> MutexGuard<'_, StateDb> {
        self.state.lock().expect("no holder of the state panics")
    }
}

fn last_name(scene: &str, step: &str) -> String {
    format!("{scene}\0{step}")
}

/// The state of a blob.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BlobState {
    /// Present, with the bytes of its name.
    Sound,
    /// Absent.
    Missing,
    /// Present, with other bytes.
    Altered,
}
