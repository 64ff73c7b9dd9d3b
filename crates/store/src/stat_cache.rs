//! Digests of files by their stat fields.

use super::Digest;
use gs2e_files::stat::StatSighting;
use serde::{Deserialize, Serialize};

/// The cached digest of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct StatEntry {
    /// The observation of the file.
    pub seen: StatSighting,
    /// Digest of its bytes.
    pub digest: Digest,
}
