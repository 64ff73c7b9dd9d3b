//! Failures of the store.

use super::shared::SharedMismatch;
use super::unlike::OutputMismatch;
use std::path::PathBuf;

/// The reason why the store cannot do what it was asked.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// An operation on a file failed.
    #[error("{doing} {}: {source}", path.display())]
    Io {
        /// The operation.
        doing: &'static str,
        /// The file.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// The database reported an error.
    #[error("using the state database {}: {source}", path.display())]
    State {
        /// The file.
        path: PathBuf,
        /// Cause.
        source: rusqlite::Error,
    },
    /// The folder is not a store, and not empty.
    #[error("{} is not a {kind} of gs2e: {found}", path.display())]
    Foreign {
        /// The folder.
        path: PathBuf,
        /// The kind of store that was wanted.
        kind: &'static str,
        /// The content of the folder that no store has, or that a store has and it lacks.
        found: String,
    },
    /// A folder of the store is a link.
    #[error("{} is a link, and a store follows none", path.display())]
    Link {
        /// The link.
        path: PathBuf,
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
    /// Another process is working in the store.
    #[error("{} is in use by {holder}", path.display())]
    Locked {
        /// The store.
        path: PathBuf,
        /// The holder of the lock: pid, host and command.
        holder: String,
    },
    /// The folder that was named as shared is the store of one machine.
    #[error("{} is the store of one machine, and cannot be shared", path.display())]
    NotShared {
        /// The folder.
        path: PathBuf,
    },
    /// This user may not write to the shared folder.
    #[error("creating a folder in {}: {source}", path.display())]
    NotPermitted {
        /// The folder.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// A request to a bucket failed.
    #[error("{doing} {place}: {because}")]
    Bucket {
        /// The operation.
        doing: &'static str,
        /// The object, or the bucket.
        place: String,
        /// Cause.
        because: String,
    },
    /// A bucket cannot be used as a shared store.
    #[error("{place} cannot be a shared store: {because}")]
    Unshareable {
        /// The bucket.
        place: String,
        /// Cause.
        because: String,
        /// The remedy.
        help: &'static str,
    },
    /// The clocks of machines differ too much to tell the age of files.
    #[error(
        "the times of files in {} differ by {seconds} s from the clock of this machine", path.display()
    )]
    Clocks {
        /// The shared folder.
        path: PathBuf,
        /// Difference.
        seconds: u64,
    },
    /// Another machine produced other bytes for a key.
    #[error("nondeterministic step: {0}")]
    SharedMismatch(Box<SharedMismatch>),
    /// A key produced other bytes than before.
    #[error("nondeterministic step: {0}")]
    Nondeterministic(Box<OutputMismatch>),
}
