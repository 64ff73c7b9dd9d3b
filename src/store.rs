//! The store: immutable blobs under the BLAKE3 of their bytes, and records that say what a key made.
//!
//! ```text
//! .gs2e/  VERSION  lock  state.db  cas/ab/<64 hex>  ac/ab/<64 hex>.json  tmp/  trash/  roots/
//! ```
//! `cas/` and `ac/` are the truth and never changed in place; `state.db` is an index of `ac/` and a cache of file
//! digests: losing it costs time, never correctness. Publishing goes blobs, record, sync, database row, in this order,
//! so a record never names bytes that are not there, and the database never one that a power cut may take. A process
//! that is killed loses nothing that it published: the records count without the database. The store knows nothing
//! of scenes, poses or events.

pub mod blob;
pub mod description;
mod digest;
mod disk;
pub mod fs;
pub mod gc;
mod hash;
mod lock;
mod memo;
mod publish;
pub mod record;
mod root;
pub mod space;
pub mod stat_cache;
mod state;
mod unlike;

pub use digest::{Digest, Key};
pub use root::Root;

use blob::Blobs;
pub use lock::Claim;
pub use publish::Workspace;
pub use unlike::Unlike;

use disk::Disk;
use fs::Fs;
use record::{Brief, Output, Record};
use space::Space;
use stat_cache::{Entry, Sighting};
use state::{State, Table};
use std::collections::BTreeSet;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};

/// Why the store cannot do what it was asked.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// An operation on a file failed.
    #[error("{doing} {}: {source}", path.display())]
    Io {
        /// What was being done.
        doing: &'static str,
        /// To which file.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// The database refused.
    #[error("the state database {}: {source}", path.display())]
    State {
        /// The file.
        path: PathBuf,
        /// Cause.
        source: rusqlite::Error,
    },
    /// A newer program made the store.
    #[error("{} has format {found}, this gs2e knows {known}", path.display())]
    Newer {
        /// The store.
        path: PathBuf,
        /// Its format.
        found: String,
        /// The format of this program.
        known: u32,
    },
    /// Another process works in the store.
    #[error("{} is in use by {holder}", path.display())]
    Locked {
        /// The store.
        path: PathBuf,
        /// Who holds it: pid, host and command.
        holder: String,
    },
    /// A key made other bytes than before.
    #[error("nondeterministic step: {0}")]
    Nondeterministic(Box<Unlike>),
}

/// Format of the folder; raised when an older program could no longer use it.
const FORMAT: u32 = 1;

/// An open store.
#[derive(Debug)]
pub struct Store {
    root: PathBuf,
    disk: Disk,
    blobs: Blobs,
    state: Mutex<State>,
    /// Files whose bytes this process has read, where it trusts no stat fields.
    verified: Option<Mutex<BTreeSet<PathBuf>>>,
    counts: Counts,
    /// The first failure of an operation whose result nobody waits for.
    failed: Mutex<Option<StoreError>>,
    /// The kernel frees it with the store.
    lock: Option<lock::Lock>,
}

/// Where digests came from.
#[derive(Debug, Default)]
struct Counts {
    trusted: AtomicUsize,
    hashed: AtomicUsize,
}

/// What a store is opened for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// To look only: takes no lock, creates nothing.
    Read,
    /// To build: takes the lock, and waits for it.
    Write,
    /// To build: takes the lock, or fails at once.
    WriteNow,
}

/// How a store is opened.
#[derive(Debug, Clone)]
pub struct Opening {
    /// What for.
    pub access: Access,
    /// Who opens it to write.
    pub claim: Claim,
    /// Read every file, whatever its stat fields say.
    pub verify: bool,
    /// Have each file on disk before the next is written, instead of a batch at once.
    pub sync_each: bool,
    /// Folder of the database, where it is not to lie in the store: a store on a network file system.
    pub index: Option<PathBuf>,
    /// What operates on the files.
    pub fs: Arc<dyn Fs>,
}

impl From<Access> for Opening {
    fn from(access: Access) -> Self {
        Self {
            access,
            claim: Claim::default(),
            verify: false,
            sync_each: false,
            index: None,
            fs: Arc::new(fs::Real),
        }
    }
}

/// The folder of what programs said, a file a key.
const LOGS: &str = "logs";
/// How the names of those files end.
const LOG: &str = ".txt";

impl Store {
    /// Opens the store at `root`, for writing creates it. `waiting` is told for whom it waits, and again as often as
    /// the claim says.
    ///
    /// # Errors
    /// When it cannot be read or made, was made by a newer program, or is locked and `access` does not wait.
    pub fn open(
        root: &Path,
        opening: impl Into<Opening>,
        waiting: &mut dyn FnMut(&str),
    ) -> Result<Self, StoreError> {
        let Opening { access, claim, verify, sync_each, index, fs } = opening.into();
        let disk = Disk::new(fs, sync_each);
        let lock = match access {
            Access::Read => None,
            Access::Write | Access::WriteNow => {
                disk.create_dir(root)?;
                Some(lock::Lock::take(root, &claim, access == Access::Write, waiting)?)
            }
        };
        disk.check_format(root, FORMAT, lock.is_some())?;
        if lock.is_some() {
            for folder in ["cas", "ac", "tmp", "trash"] {
                disk.create_dir(&root.join(folder))?;
            }
            // Nobody else may write while the lock is held: what lies here was left by a process that died.
            disk.empty_dir(&root.join("tmp"))?;
        }
        let state = State::open(root, index.as_deref(), disk.clone(), lock.is_some())?;
        Ok(Self {
            root: root.to_owned(),
            blobs: Blobs::new(root, disk.clone()),
            state: Mutex::new(state),
            verified: verify.then(Mutex::default),
            counts: Counts::default(),
            failed: Mutex::new(None),
            disk,
            lock,
        })
    }

    /// What had to be mended since the last call, one line each.
    #[must_use]
    pub fn take_notices(&self) -> Vec<String> {
        self.state().take_notices()
    }

    /// The file of the store's lock, for a process that works in the store's folders: the lock is held until that
    /// process has closed it, too. `None` if the store was opened to look only.
    ///
    /// # Errors
    /// When the system has no more file descriptors.
    pub fn share_lock(&self) -> Result<Option<File>, StoreError> {
        let shared = self.lock.as_ref().map(lock::Lock::share).transpose();
        shared.map_err(disk::failed("sharing", &self.root.join("lock")))
    }

    /// How many digests were taken from stat fields, and how many from bytes.
    #[must_use]
    pub fn digests(&self) -> (usize, usize) {
        (self.counts.trusted.load(Ordering::Relaxed), self.counts.hashed.load(Ordering::Relaxed))
    }

    /// The outputs on record for a key, if there is a record, and what it took. The index is asked first; what a
    /// process recorded that was killed before it wrote the index, or that works just now, stands in `ac/` alone and
    /// counts as much.
    ///
    /// # Errors
    /// When the record is there and cannot be read.
    pub fn record(&self, key: &Key) -> Result<Option<Brief>, StoreError> {
        let name = key.to_string();
        let indexed = self.state().get(Table::Record, &name);
        if let Some(brief) = indexed.and_then(|row| serde_json::from_slice(&row).ok()) {
            return Ok(Some(brief));
        }
        let brief = self.full_record(key)?.map(|record| record.brief());
        brief.iter().for_each(|brief| self.state().put(Table::Record, &name, brief.row()));
        Ok(brief)
    }

    /// What the index has of every record.
    #[must_use]
    pub fn records(&self) -> Vec<Brief> {
        let rows = self.state().all(Table::Record).into_values();
        rows.filter_map(|row| serde_json::from_slice(&row).ok()).collect()
    }

    /// The whole record of a key as it lies in `ac/`; `None` where it is absent or damaged.
    ///
    /// # Errors
    /// When it is there and cannot be read.
    pub fn full_record(&self, key: &Key) -> Result<Option<Record>, StoreError> {
        Record::read(&self.root, &self.disk, key)
    }

    /// The key that a step of a scene was last made with.
    #[must_use]
    pub fn last_key(&self, scene: &str, step: &str) -> Option<Key> {
        let row = self.state().get(Table::Last, &last_name(scene, step))?;
        std::str::from_utf8(&row).ok()?.parse().ok().map(Key)
    }

    /// Remembers that a step of a scene now stands at `key`, for explanations.
    pub fn note_last(&self, scene: &str, step: &str, key: Key) {
        self.state().put_new(Table::Last, &last_name(scene, step), key.to_string().into_bytes());
    }

    /// The recipe that a scene was last made from.
    #[must_use]
    pub fn last_recipe(&self, scene: &str) -> Option<String> {
        String::from_utf8(self.state().get(Table::Recipe, scene)?).ok()
    }

    /// Remembers the recipe that a scene is made from, for explanations.
    pub fn note_recipe(&self, scene: &str, recipe: &str) {
        self.state().put_new(Table::Recipe, scene, recipe.as_bytes().to_vec());
    }

    /// The state of a blob, by its stat fields where they are known and by its bytes where not.
    ///
    /// # Errors
    /// When the file is there and cannot be read.
    pub fn examine(&self, output: &Output) -> Result<BlobState, StoreError> {
        let path = self.blobs.path(&output.digest);
        match self.look(&path) {
            Ok(entry) if entry.digest == output.digest => Ok(BlobState::Sound),
            Ok(_) => Ok(BlobState::Altered),
            Err(source) if disk::is_absent(&source) => Ok(BlobState::Missing),
            Err(source) => Err(StoreError::Io { doing: "reading", path, source }),
        }
    }

    /// Where a blob lies.
    #[must_use]
    pub fn path_of(&self, digest: &Digest) -> PathBuf {
        self.blobs.path(digest)
    }

    /// Where the programs that a step runs leave what they say: told beside what is kept under the key, and no part of it.
    ///
    /// # Errors
    /// When the folder cannot be made.
    pub fn log_of(&self, key: &Key) -> Result<PathBuf, StoreError> {
        let folder = self.root.join(LOGS);
        self.disk.create_dir(&folder)?;
        Ok(folder.join(format!("{key}{LOG}")))
    }

    /// What is known of a file, in the store or outside it; it is read only where its stat fields moved.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn look(&self, path: &Path) -> std::io::Result<Entry> {
        let stat = self.disk.stat(path)?;
        // A path that is not UTF-8 is hashed each time: correct, only slower.
        let name = path.to_str().filter(|_| self.trusts(path));
        let known = name.and_then(|name| self.state().get(Table::Stat, name));
        let known = known.and_then(|row| postcard::from_bytes::<Entry>(&row).ok());
        if let Some(entry) = known.filter(|entry| entry.seen.holds_for(&stat)) {
            self.counts.trusted.fetch_add(1, Ordering::Relaxed);
            return Ok(entry);
        }
        let seen = Sighting::now(stat);
        let entry = Entry { seen, digest: self.disk.digest(path)? };
        self.counts.hashed.fetch_add(1, Ordering::Relaxed);
        self.enter(path, entry);
        Ok(entry)
    }

    /// The stat fields of a file or folder, seen now.
    ///
    /// # Errors
    /// When it is not there.
    pub fn sight(&self, path: &Path) -> std::io::Result<Sighting> {
        self.disk.stat(path).map(Sighting::now)
    }

    /// Whether what is on record of a file may be believed.
    fn trusts(&self, path: &Path) -> bool {
        self.verified.as_ref().is_none_or(|read| read.lock().expect("no holder panics").contains(path))
    }

    fn enter(&self, path: &Path, entry: Entry) {
        if let Some(read) = &self.verified {
            read.lock().expect("no holder panics").insert(path.to_owned());
        }
        if let Some(name) = path.to_str() {
            let row = postcard::to_stdvec(&entry).expect("an entry is plain data");
            self.state().put_new(Table::Stat, name, row);
        }
    }

    /// Takes a blob that is altered out of the way, into `trash/`. One that another step has made anew meanwhile
    /// stays.
    ///
    /// # Errors
    /// When it cannot be read or moved.
    pub fn discard(&self, digest: &Digest) -> Result<(), StoreError> {
        self.blobs.discard(digest)
    }

    /// The file system that the store is on.
    ///
    /// # Errors
    /// When the system does not tell.
    pub fn space(&self) -> std::io::Result<Space> {
        Space::around(&self.root)
    }

    /// Renews what is known of a blob after this program itself linked or unlinked it, which moves its ctime.
    ///
    /// # Errors
    /// When it cannot be looked at.
    pub fn settle(&self, digest: &Digest) -> Result<(), StoreError> {
        let path = self.blobs.path(digest);
        let stat = self.disk.stat(&path).map_err(disk::failed("reading", &path))?;
        self.enter(&path, Entry { seen: Sighting::settled(stat), digest: *digest });
        Ok(())
    }

    /// Whether so much is pending that it should be written, for the case that this process is killed.
    #[must_use]
    pub fn is_due(&self) -> bool {
        /// Some hundred steps with their files.
        const ROWS: usize = 2048;
        self.state().pending() >= ROWS
    }

    /// Has what was published on disk, and writes what is pending to the database.
    ///
    /// # Errors
    /// When the disk or the database refuses, or an operation failed before whose result nobody waited for.
    pub fn flush(&self) -> Result<(), StoreError> {
        if let Some(error) = self.failed.lock().expect("no holder panics").take() {
            return Err(error);
        }
        let mut state = self.state();
        if !state.is_behind() {
            return Ok(());
        }
        // With the state held: a row that is entered from here on speaks of bytes that this sync may have missed.
        self.disk.sync_all(&self.root)?;
        state.flush()
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("no holder of the state panics")
    }
}

fn last_name(scene: &str, step: &str) -> String {
    format!("{scene}\0{step}")
}

/// What became of a blob.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BlobState {
    /// There, with the bytes of its name.
    Sound,
    /// Not there.
    Missing,
    /// There, with other bytes.
    Altered,
}
