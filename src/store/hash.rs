//! BLAKE3 of files.

use super::Digest;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// BLAKE3 of a file's bytes, in pieces.
pub(super) fn file(path: &Path) -> io::Result<Digest> {
    let mut file = File::open(path)?;
    let mut hasher = blake3::Hasher::new();
    let mut piece = vec![0; 1 << 16];
    loop {
        let n = file.read(&mut piece)?;
        if n == 0 {
            return Ok(Digest::from(hasher.finalize()));
        }
        hasher.update(&piece[..n]);
    }
}
