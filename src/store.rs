//! The store: immutable blobs under the BLAKE3 of their bytes, and records that say what a key made.
//!
//! ```text
//! .gs2e/  VERSION  lock  state.db  cas/ab/<64 hex>  ac/ab/<64 hex>.json  tmp/  trash/
//! ```
//! `cas/` and `ac/` are the truth and never changed in place; `state.db` is an index of `ac/` and a cache of file
//! digests: losing it costs time, never correctness. Publishing goes blobs, record, database row, in this order, so
//! a record never names bytes that are not there. The store knows nothing of scenes, poses or events.

pub mod blob;
pub mod description;
mod disk;
mod lock;
pub mod record;
pub mod space;
mod stat_cache;
mod state;

use blob::Blobs;
pub use lock::Claim;
use record::{Output, Record};
use space::Space;
use stat_cache::StatCache;
use state::State;
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Mutex;

/// BLAKE3 of some bytes.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Digest([u8; 32]);

impl Digest {
    /// The digest of `bytes`.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Self {
        Self(*blake3::hash(bytes).as_bytes())
    }

    /// The 32 bytes.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8; 32] {
        &self.0
    }

    /// The first 12 hexadecimal digits, for people.
    #[must_use]
    pub fn short(&self) -> String {
        self.to_string()[..12].to_owned()
    }
}

impl fmt::Display for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(blake3::Hash::from_bytes(self.0).to_hex().as_str())
    }
}

impl From<blake3::Hash> for Digest {
    fn from(hash: blake3::Hash) -> Self {
        Self(*hash.as_bytes())
    }
}

impl fmt::Debug for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl FromStr for Digest {
    type Err = blake3::HexError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(Self(*blake3::Hash::from_hex(text)?.as_bytes()))
    }
}

impl serde::Serialize for Digest {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> serde::Deserialize<'de> for Digest {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = <std::borrow::Cow<'de, str>>::deserialize(deserializer)?;
        text.parse().map_err(serde::de::Error::custom)
    }
}

/// What a step is: a hash of everything that may change its bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize)]
#[serde(transparent)]
pub struct Key(pub Digest);

impl Key {
    /// The key of a description.
    #[must_use]
    pub fn of(description: &description::Value) -> Self {
        let mut bytes = Vec::new();
        description.encode(&mut bytes);
        Self(Digest(blake3::derive_key("gs2e 2026 step key v1", &bytes)))
    }
}

impl fmt::Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

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
    #[error(
        "nondeterministic step: key {} made {} before and {} now",
        before.key, record::content(&before.outputs), record::content(&now.outputs)
    )]
    Nondeterministic {
        /// What is on record, and stays.
        before: Box<Record>,
        /// What was made now; its blobs lie beside the others.
        now: Box<Record>,
    },
}

/// Format of the folder; raised when an older program could no longer use it.
const FORMAT: u32 = 1;

/// An open store.
#[derive(Debug)]
pub struct Store {
    root: PathBuf,
    blobs: Blobs,
    state: Mutex<State>,
    stats: Mutex<StatCache>,
    notices: Vec<String>,
    /// Held, not read: the kernel frees it with the store.
    _lock: Option<lock::Lock>,
}

/// How a store is opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// To look only: takes no lock, creates nothing.
    Read,
    /// To build: takes the lock, and waits for it.
    Write,
    /// To build: takes the lock, or fails at once.
    WriteNow,
}

impl Store {
    /// Opens the store at `root`, for nobody in particular; else as [`Store::open_as`].
    ///
    /// # Errors
    /// As [`Store::open_as`].
    pub fn open(root: &Path, access: Access, waiting: &mut dyn FnMut(&str)) -> Result<Self, StoreError> {
        Self::open_as(root, access, &Claim::default(), waiting)
    }

    /// Opens the store at `root`, for writing creates it. `waiting` is told for whom it waits, and again as often as
    /// the claim says.
    ///
    /// # Errors
    /// When it cannot be read or made, was made by a newer program, or is locked and `access` does not wait.
    pub fn open_as(
        root: &Path,
        access: Access,
        claim: &Claim,
        waiting: &mut dyn FnMut(&str),
    ) -> Result<Self, StoreError> {
        let lock = match access {
            Access::Read => None,
            Access::Write | Access::WriteNow => {
                disk::create_dir(root)?;
                Some(lock::Lock::take(root, claim, access == Access::Write, waiting)?)
            }
        };
        disk::check_format(root, FORMAT, lock.is_some())?;
        let blobs = Blobs::new(root);
        if lock.is_some() {
            for folder in ["cas", "ac", "tmp", "trash"] {
                disk::create_dir(&root.join(folder))?;
            }
            // Nobody else may write while the lock is held: what lies here was left by a process that died.
            disk::empty_dir(&root.join("tmp"))?;
        }
        let (state, notices) = State::open(root, lock.is_some())?;
        let stats = StatCache::new(state.stat_entries());
        Ok(Self {
            root: root.to_owned(),
            blobs,
            state: Mutex::new(state),
            stats: Mutex::new(stats),
            notices,
            _lock: lock,
        })
    }

    /// What opening had to mend, one line each.
    #[must_use]
    pub fn notices(&self) -> &[String] {
        &self.notices
    }

    /// The outputs on record for a key, if there is a record. The index is asked first; what a process recorded
    /// that was killed before it wrote the index, or that works just now, stands in `ac/` alone and counts as much.
    #[must_use]
    pub fn record(&self, key: &Key) -> Option<Vec<Output>> {
        let indexed = self.state().outputs(key);
        indexed.or_else(|| {
            let outputs = self.full_record(key)?.outputs;
            self.state().insert(key, outputs.clone());
            Some(outputs)
        })
    }

    /// The whole record of a key as it lies in `ac/`; `None` where it is absent or damaged.
    #[must_use]
    pub fn full_record(&self, key: &Key) -> Option<Record> {
        Record::read(&self.root, key).ok().flatten()
    }

    /// The key that a step of a scene was last made with.
    #[must_use]
    pub fn last_key(&self, scene: &str, step: &str) -> Option<Key> {
        self.state().last(scene, step)
    }

    /// Remembers that a step of a scene now stands at `key`, for explanations.
    pub fn note_last(&self, scene: &str, step: &str, key: Key) {
        self.state().set_last(scene, step, key);
    }

    /// The state of a blob, by its stat fields where they are known and by its bytes where not.
    ///
    /// # Errors
    /// When the file is there and cannot be read.
    pub fn examine(&self, output: &Output) -> Result<BlobState, StoreError> {
        let path = self.blobs.path(&output.digest);
        let found = self.stats().digest_of(&path);
        match found {
            Ok(digest) if digest == output.digest => Ok(BlobState::Sound),
            Ok(_) => Ok(BlobState::Altered),
            Err(source) if source.kind() == std::io::ErrorKind::NotFound => Ok(BlobState::Missing),
            Err(source) => Err(StoreError::Io { doing: "reading", path, source }),
        }
    }

    /// The file system that the store is on.
    ///
    /// # Errors
    /// When the system does not tell.
    pub fn space(&self) -> std::io::Result<Space> {
        Space::around(&self.root)
    }

    /// Where a blob lies.
    #[must_use]
    pub fn path_of(&self, digest: &Digest) -> PathBuf {
        self.blobs.path(digest)
    }

    /// The digest of a file outside the store, read only where its stat fields moved.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn digest_of(&self, path: &Path) -> std::io::Result<Digest> {
        self.stats().digest_of(path)
    }

    /// Takes a blob that is altered out of the way, into `trash/`. One that another step has made anew meanwhile
    /// stays.
    ///
    /// # Errors
    /// When it cannot be read or moved.
    pub fn discard(&self, digest: &Digest) -> Result<(), StoreError> {
        let path = self.blobs.path(digest);
        // Held to the end: between the look and the move, another step could put the sound blob there.
        let mut stats = self.stats();
        match stats.digest_of(&path) {
            Ok(found) if found == *digest => Ok(()),
            Ok(_) => self.blobs.discard(digest),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(()),
            Err(source) => Err(StoreError::Io { doing: "reading", path, source }),
        }
    }

    /// An empty folder for a step to write its files in.
    ///
    /// # Errors
    /// When it cannot be made.
    pub fn workspace(&self) -> Result<Workspace, StoreError> {
        self.blobs.workspace()
    }

    /// Publishes the files of a workspace as what `record` made: blobs, then the record, then the index.
    ///
    /// # Errors
    /// When a file cannot be read or written, or the key is on record with other bytes that are still there.
    pub fn publish(&self, workspace: &Workspace, mut record: Record) -> Result<Vec<Output>, StoreError> {
        record.outputs = self.blobs.take_all(workspace)?;
        if let Some(before) = self.full_record(&record.key) {
            let kept = before.outputs.iter().all(|o| matches!(self.examine(o), Ok(BlobState::Sound)));
            if kept && before.outputs != record.outputs {
                return Err(StoreError::Nondeterministic { before: Box::new(before), now: Box::new(record) });
            }
        }
        record.write(&self.root)?;
        for output in &record.outputs {
            self.settle(&output.digest);
        }
        self.state().insert(&record.key, record.outputs.clone());
        Ok(record.outputs)
    }

    /// Remembers the recipe, as JSON text, with which a scene was built, for explanations.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn note_recipe(&self, scene: &str, recipe: &str) -> Result<(), StoreError> {
        if self.last_recipe(scene).as_deref() == Some(recipe) {
            return Ok(());
        }
        let path = self.recipe_path(scene);
        disk::create_dir(&self.root.join("results"))?;
        disk::write_atomically(&path, &path.with_extension("new"), recipe.as_bytes())
    }

    /// The recipe with which a scene was last built; `None` where that is not known.
    #[must_use]
    pub fn last_recipe(&self, scene: &str) -> Option<String> {
        let bytes = disk::read_optional(&self.recipe_path(scene)).ok().flatten()?;
        String::from_utf8(bytes).ok()
    }

    fn recipe_path(&self, scene: &str) -> PathBuf {
        self.root.join("results").join(format!("{}.json", Digest::of(scene.as_bytes())))
    }

    /// Renews what is known of a blob after this program itself linked or unlinked it, which moves its ctime.
    pub fn settle(&self, digest: &Digest) {
        self.stats().settle(&self.blobs.path(digest), *digest);
    }

    /// Writes what is pending to the database. The records themselves are already on disk.
    ///
    /// # Errors
    /// When the database refuses.
    pub fn flush(&self) -> Result<(), StoreError> {
        let entries = self.stats().take_changes();
        self.state().flush(&entries)
    }

    fn state(&self) -> std::sync::MutexGuard<'_, State> {
        self.state.lock().expect("no holder of the state panics")
    }

    fn stats(&self) -> std::sync::MutexGuard<'_, StatCache> {
        self.stats.lock().expect("no holder of the stat cache panics")
    }
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

/// A folder under `tmp/` that is removed with its content when dropped.
#[derive(Debug)]
pub struct Workspace {
    path: PathBuf,
}

impl Workspace {
    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for Workspace {
    fn drop(&mut self) {
        // Whatever stays is removed when the store is next opened for writing.
        let _ = std::fs::remove_dir_all(&self.path);
    }
}
