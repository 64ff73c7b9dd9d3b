//! `SHA256SUMS` and `B3SUMS`: checksums of every file of the tree, in the form that
//! `sha256sum --strict -c` and `b3sum --check` read. `B3SUMS` lists neither itself nor
//! `SHA256SUMS`. `SHA256SUMS` lists every file except itself, including `B3SUMS`.

use gs2e_files as files;
use gs2e_store::Digest;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use std::fmt::Write as _;
use std::io::{self, Read};
use std::path::Path;

/// Name of the file of SHA-256 sums.
pub const NAME: &str = "SHA256SUMS";

/// Name of the file of BLAKE3 sums.
pub const B3_NAME: &str = "B3SUMS";

/// Bytes as lower-case hexadecimal digits.
fn hex_digits(bytes: &[u8]) -> String {
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
        write!(text, "{byte:02x}").expect("a String takes any text");
        text
    })
}

/// SHA-256 of bytes, hexadecimal.
pub fn sha256_hex(bytes: &[u8]) -> String {
    hex_digits(&Sha256::digest(bytes))
}

/// SHA-256 of a file, hexadecimal.
pub fn sha256_of_file(path: &Path) -> io::Result<String> {
    hash_file(path).map(|hashes| hashes.sha256)
}

/// Both hashes of a file, and its size.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileHashes {
    /// In hexadecimal digits.
    pub sha256: String,
    /// The hash that the store uses.
    pub blake3: Digest,
    /// Bytes.
    pub size: u64,
}

impl FileHashes {
    /// Hashes bytes in memory.
    pub fn of_bytes(bytes: &[u8]) -> Self {
        Self { sha256: sha256_hex(bytes), blake3: Digest::of_bytes(bytes), size: bytes.len() as u64 }
    }
}

/// Hashes a file, in one pass over its bytes.
pub fn hash_file(path: &Path) -> io::Result<FileHashes> {
    // A release contains no links, so one in its place is not followed.
    let mut file = files::open_with(path, files::LinkRule::Refuse)?;
    let (mut sha256, mut blake3) = (Sha256::new(), blake3::Hasher::new());
    // A fixed buffer: event files can be larger than the memory.
    let mut piece = vec![0; 1 << 16];
    let mut size = 0;
    loop {
        let n = file.read(&mut piece)?;
        if n == 0 {
            break;
        }
        sha256.update(&piece[..n]);
        blake3.update(&piece[..n]);
        size += n as u64;
    }
    let blake3 = Digest::from(blake3.finalize());
    Ok(FileHashes { sha256: hex_digits(&sha256.finalize()), blake3, size })
}

/// The text of either file. The sums must be sorted by path.
pub fn sums_text<'a>(sums: impl Iterator<Item = (&'a str, String)>) -> String {
    sums.fold(String::new(), |mut text, (path, sum)| {
        // Two spaces, as `sha256sum` and `b3sum` write them.
        writeln!(text, "{sum}  {path}").expect("a String takes any text");
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_hashes_are_those_of_the_published_algorithms() {
        // FIPS 180-2, "abc"; BLAKE3's test vector of the empty input.
        assert_eq!(sha256_hex(b"abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("empty");
        std::fs::write(&path, b"").unwrap();
        let hashes = hash_file(&path).unwrap();
        assert_eq!(hashes.sha256, "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
        assert!(hashes.blake3.to_string().starts_with("af1349b9f5f9a1a6a0404dea36dcc949"));
    }
}
