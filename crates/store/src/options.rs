//! Access to a store, and the settings with which it is opened.

use super::fs;
use super::fs::Fs;
use super::lock::LockClaim;
use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

/// The purpose for which a store is opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StoreAccess {
    /// Reading: takes no lock, creates nothing.
    Read,
    /// Building: takes the lock, and waits for it.
    Write,
    /// Building: takes the lock, or fails at once.
    WriteNow,
}

/// The settings of the environment for buckets. Its debug form has no values, because some are secret.
#[derive(Clone, Default, PartialEq, Eq)]
pub struct BucketEnvironment {
    /// The variables whose names begin with `AWS_`.
    pub variables: BTreeMap<String, String>,
    /// The user's folder, which may have profiles in `.aws`.
    pub home: Option<PathBuf>,
}

impl fmt::Debug for BucketEnvironment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.variables.keys()).finish()
    }
}

/// Options for opening a store.
#[derive(Debug, Clone)]
pub struct StoreOptions {
    /// Purpose.
    pub access: StoreAccess,
    /// The writer, for others who wait.
    pub claim: LockClaim,
    /// True if every file is read, whatever its stat fields say.
    pub verify: bool,
    /// True if each file is synced before the next is written, instead of a whole batch at once.
    pub sync_each: bool,
    /// Folder of the database, if it must not lie in the store: for a store on a network file
    /// system.
    pub index: Option<PathBuf>,
    /// Folder that the stores of several machines share, if there is one. A store that is opened for reading
    /// only reads it.
    pub shared: Option<PathBuf>,
    /// Bytes that the files of a store in front of a shared one may take, if they are bounded.
    pub cache_size: Option<u64>,
    /// The environment's settings for a shared store in a bucket.
    pub bucket: BucketEnvironment,
    /// Implementation of file operations.
    pub fs: Arc<dyn Fs>,
}

impl From<StoreAccess> for StoreOptions {
    fn from(access: StoreAccess) -> Self {
        Self {
            access,
            claim: LockClaim::default(),
            verify: false,
            sync_each: false,
            index: None,
            shared: None,
            cache_size: None,
            bucket: BucketEnvironment::default(),
            fs: Arc::new(fs::SystemFs),
        }
    }
}
