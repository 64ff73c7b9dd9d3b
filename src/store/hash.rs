//! BLAKE3 of a file. Never through a map of it: a source may be cut short while it is read, and a map would then end
//! the program with a signal, where a read ends with an error.
//!
//! BLAKE3 is a binary tree over chunks of 1 KiB, so that a large file can be hashed as subtrees side by side
//! (section 2.1 of its paper). Each task reads its own subtree piece by piece into a buffer that stays in the core's
//! own cache, and hashes each piece while it is there.

use super::Digest;
use crate::files;
use blake3::Hasher;
use blake3::hazmat::{self, ChainingValue, HasherExt, Mode};
use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::os::unix::fs::FileExt;
use std::path::Path;

/// Files shorter than this are read by one thread: starting others costs more than it saves.
const PARALLEL_FROM: u64 = 16 << 20;

/// What one task hashes. A power of two of chunks, so that it is a whole subtree.
const TASK: u64 = 4 << 20;

/// What is read at once: less than the second-level cache of any core of today holds.
const PIECE: usize = 256 << 10;

impl Digest {
    /// The digest of a file's bytes; from 16 MiB on by the threads of the current rayon pool.
    ///
    /// Of a file that is written to meanwhile it is that of bytes that were read from it, each at some moment: whoever
    /// must know whether it was at rest compares its stat fields before and after.
    ///
    /// A task of a rayon pool must hold no lock that other tasks of that pool take while it calls this: a thread that
    /// waits for the other half of a file takes up any task meanwhile.
    ///
    /// # Errors
    /// When it cannot be opened or read.
    pub fn of_file(path: &Path) -> io::Result<Self> {
        let file = files::open(path)?;
        let length = file.metadata()?.len();
        if length >= PARALLEL_FROM {
            match in_parallel(&file, length) {
                // It was cut short meanwhile. What is there now is read to its end, wherever that is.
                Err(e) if e.kind() == ErrorKind::UnexpectedEof => {}
                done => return done,
            }
        }
        to_the_end(file)
    }
}

/// By one thread, to the end that the reads find: a special file says 0 for its length.
fn to_the_end(mut file: File) -> io::Result<Digest> {
    let mut hasher = Hasher::new();
    let mut piece = vec![0; 1 << 16];
    loop {
        match file.read(&mut piece) {
            Ok(0) => return Ok(hasher.finalize().into()),
            Ok(n) => drop(hasher.update(&piece[..n])),
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
}

/// The first `length` bytes, more than one task.
fn in_parallel(file: &File, length: u64) -> io::Result<Digest> {
    let left = hazmat::left_subtree_len(length);
    let (left, right) = rayon::join(|| subtree(file, 0, left), || subtree(file, left, length - left));
    Ok(hazmat::merge_subtrees_root(&left?, &right?, Mode::Hash).into())
}

/// `length` bytes from `offset` on, which are no whole file.
fn subtree(file: &File, offset: u64, length: u64) -> io::Result<ChainingValue> {
    if length <= TASK {
        return task(file, offset, length);
    }
    let left = hazmat::left_subtree_len(length);
    let (left, right) =
        rayon::join(|| subtree(file, offset, left), || subtree(file, offset + left, length - left));
    Ok(hazmat::merge_subtrees_non_root(&left?, &right?, Mode::Hash))
}

fn task(file: &File, offset: u64, length: u64) -> io::Result<ChainingValue> {
    let mut hasher = Hasher::new();
    hasher.set_input_offset(offset);
    let mut piece = vec![0; PIECE];
    let end = offset + length;
    for at in (offset..end).step_by(PIECE) {
        let n = usize::try_from(end - at).unwrap_or(PIECE).min(PIECE);
        file.read_exact_at(&mut piece[..n], at)?;
        hasher.update(&piece[..n]);
    }
    Ok(hasher.finalize_non_root())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes that repeat nowhere in a chunk's distance.
    fn bytes(length: u64) -> Vec<u8> {
        let mut reader = Hasher::new().finalize_xof();
        let mut bytes = vec![0; usize::try_from(length).unwrap()];
        reader.fill(&mut bytes);
        bytes
    }

    #[test]
    fn a_file_of_any_length_has_the_digest_of_its_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let piece = PIECE as u64;
        let all = bytes(3 * PARALLEL_FROM);
        let around =
            [0, 1024, 1 << 16, piece, TASK, PARALLEL_FROM, PARALLEL_FROM + piece, PARALLEL_FROM + TASK];
        let lengths = around.iter().flat_map(|&n: &u64| [n.saturating_sub(1), n, n + 1]);
        let more = [PARALLEL_FROM + 1024, PARALLEL_FROM + TASK + 1025, 2 * PARALLEL_FROM, 3 * PARALLEL_FROM];
        for length in lengths.chain(more) {
            let part = &all[..usize::try_from(length).unwrap()];
            std::fs::write(&path, part).unwrap();
            assert_eq!(Digest::of_file(&path).unwrap(), Digest::of(part), "{length} bytes");
        }
    }

    #[test]
    fn a_file_that_is_cut_short_meanwhile_has_the_digest_of_what_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let all = bytes(PARALLEL_FROM);
        std::fs::write(&path, &all).unwrap();
        let file = File::open(&path).unwrap();
        // As if the length had been asked before the cut.
        for said in [PARALLEL_FROM + 1, PARALLEL_FROM + TASK, 4 * PARALLEL_FROM] {
            assert_eq!(in_parallel(&file, said).unwrap_err().kind(), ErrorKind::UnexpectedEof, "{said}");
        }
        assert_eq!(to_the_end(file).unwrap(), Digest::of(&all));
    }

    /// A writer that cuts and grows the file all the while: an answer or an error each time, never a panic.
    #[test]
    fn a_file_in_motion_harms_nobody() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let all = bytes(2 * PARALLEL_FROM);
        std::fs::write(&path, &all).unwrap();
        let done = std::sync::atomic::AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let file = File::options().write(true).open(&path).unwrap();
                let mut lengths = [0, PARALLEL_FROM - 1, PARALLEL_FROM + 7, 2 * PARALLEL_FROM].iter().cycle();
                while !done.load(std::sync::atomic::Ordering::Relaxed) {
                    file.set_len(*lengths.next().unwrap()).unwrap();
                }
            });
            for _ in 0..20 {
                Digest::of_file(&path).unwrap();
            }
            done.store(true, std::sync::atomic::Ordering::Relaxed);
        });
    }

    #[test]
    fn what_is_no_file_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        assert!(Digest::of_file(folder.path()).is_err());
        assert_eq!(Digest::of_file(&folder.path().join("a")).unwrap_err().kind(), ErrorKind::NotFound);
    }
}
