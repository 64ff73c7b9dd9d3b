//! Digests of files by their stat fields.

use super::Digest;
use gs2e_files::stat::StatSighting;
use serde::{Deserialize, Serialize};

/// The cached digest of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct StatEntry {
    /// The observation of the file; the name in the store is an older one.
    #[serde(rename = "seen")]
    pub sighting: StatSighting,
    /// Digest of its bytes.
    pub digest: Digest,
}
