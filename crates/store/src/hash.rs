//! BLAKE3 of a file. Files are read and never mapped, because a source may be truncated meanwhile:
//! a read then ends with an error, but an access to a map ends the program with a signal.
//!
//! BLAKE3 is a binary tree over chunks of 1 KiB, so a large file can be hashed as subtrees in
//! parallel (section 2.1 of its paper). Each task reads its subtree piece by piece into a buffer
//! that stays in the core's own cache, and hashes each piece while it is there.

use super::Digest;
use super::disk::is_absent;
use blake3::Hasher;
use blake3::hazmat::{self, ChainingValue, HasherExt, Mode};
use gs2e_files as files;
use gs2e_files::LinkRule;
use std::fs::File;
use std::io::{self, ErrorKind, Read, Write as _};
use std::os::unix::fs::FileExt;
use std::path::Path;

/// Length below which one thread reads a file: starting others would cost more than it saves.
const PARALLEL_FROM: u64 = 16 << 20;

/// Length that one task hashes. It is a power of two of chunks, so it is a whole subtree.
const TASK: u64 = 4 << 20;

/// Length of a read. It is smaller than the second-level cache of any present core.
const PIECE: usize = 256 << 10;

impl Digest {
    /// The digest of a file. Files of 16 MiB or more are hashed by the threads of the current rayon
    /// pool.
    ///
    /// For a file that is being written, it is the digest of bytes read at different moments. A
    /// caller that must know whether the file was stable compares its stat fields before and after.
    ///
    /// A task of a rayon pool must not hold a lock that other tasks of that pool take while it
    /// calls this function: a thread that waits for the other half of a file may run any task
    /// meanwhile.
    ///
    /// # Errors
    /// The file cannot be opened or read.
    pub fn of_file(path: &Path) -> io::Result<Self> {
        let file = files::open(path)?;
        let length = file.metadata()?.len();
        if length >= PARALLEL_FROM {
            match in_parallel(&file, length) {
                // The file was truncated meanwhile. The present content is read to its end.
                Err(e) if e.kind() == ErrorKind::UnexpectedEof => {}
                done => return done,
            }
        }
        // The parallel reads name their offsets and move no cursor, so this one begins at byte 0.
        to_the_end(file)
    }
}

impl Digest {
    /// Copies a regular file of `size` bytes to a new file, and hashes the bytes meanwhile. `None` if no such
    /// file is there: it is absent, has another size, or is a link, a folder or a special file.
    ///
    /// # Errors
    /// The file cannot be read, or the new one cannot be written. It may then have a part of the bytes.
    pub(super) fn of_copy(from: &Path, to: &Path, size: u64) -> io::Result<Option<Self>> {
        let file = match files::open_with(from, LinkRule::Refuse) {
            Err(e) if is_absent(&e) || files::is_no_file(&e) => return Ok(None),
            file => file?,
        };
        if file.metadata()?.len() != size {
            return Ok(None);
        }
        let (mut hasher, mut piece) = (Hasher::new(), vec![0; PIECE]);
        // A file that grows meanwhile is copied up to its known size, so it cannot fill the disk.
        let (mut file, mut copy) = (file.take(size), File::create_new(to)?);
        loop {
            match file.read(&mut piece) {
                Ok(0) => return Ok(Some(hasher.finalize().into())),
                Ok(n) => {
                    hasher.update(&piece[..n]);
                    copy.write_all(&piece[..n])?;
                }
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(e) => return Err(e),
            }
        }
    }
}

/// Hashes with one thread, up to the end of the reads: special files report a length of 0.
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

/// Hashes the first `length` bytes, which is more than one task.
fn in_parallel(file: &File, length: u64) -> io::Result<Digest> {
    let left = hazmat::left_subtree_len(length);
    let (left, right) =
        rayon::join(|| hash_subtree(file, 0, left), || hash_subtree(file, left, length - left));
    Ok(hazmat::merge_subtrees_root(&left?, &right?, Mode::Hash).into())
}

/// Hashes `length` bytes from `offset` on, which are not the whole file.
fn hash_subtree(file: &File, offset: u64, length: u64) -> io::Result<ChainingValue> {
    if length <= TASK {
        return hash_task(file, offset, length);
    }
    let left = hazmat::left_subtree_len(length);
    let (left, right) =
        rayon::join(|| hash_subtree(file, offset, left), || hash_subtree(file, offset + left, length - left));
    Ok(hazmat::merge_subtrees_non_root(&left?, &right?, Mode::Hash))
}

fn hash_task(file: &File, offset: u64, length: u64) -> io::Result<ChainingValue> {
    let mut hasher = Hasher::new();
    // BLAKE3 hashes the number of each chunk with it.
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

    /// Bytes that do not repeat at the distance of a chunk.
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
            assert_eq!(Digest::of_file(&path).unwrap(), Digest::of_bytes(part), "{length} bytes");
        }
    }

    #[test]
    fn a_file_that_is_cut_short_meanwhile_has_the_digest_of_what_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let all = bytes(PARALLEL_FROM);
        std::fs::write(&path, &all).unwrap();
        let file = File::open(&path).unwrap();
        // As if the length had been read before the truncation.
        for said in [PARALLEL_FROM + 1, PARALLEL_FROM + TASK, 4 * PARALLEL_FROM] {
            assert_eq!(in_parallel(&file, said).unwrap_err().kind(), ErrorKind::UnexpectedEof, "{said}");
        }
        assert_eq!(to_the_end(file).unwrap(), Digest::of_bytes(&all));
    }

    /// A writer truncates and extends the file continuously: each call returns a digest or an
    /// error, and never panics.
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
