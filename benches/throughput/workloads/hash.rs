//! The digest of a file, compared with `b3sum` on the same file: both read it from the page cache
//! with all threads.

use super::amount;
use crate::measure::{Run, Workload, timed};
use gs2e_store::Digest;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::rc::Rc;

const BYTES: usize = 512_000_000;

/// The file, removed when the last workload is dropped.
struct HashedFile {
    /// Keeps the folder alive: dropping it removes the folder.
    _folder: tempfile::TempDir,
    path: PathBuf,
}

pub(super) fn workloads() -> Vec<Workload> {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let path = folder.path().join("given");
    let mut bytes = vec![0; BYTES];
    blake3::Hasher::new().finalize_xof().fill(&mut bytes);
    std::fs::write(&path, bytes).expect("the temporary folder has room");
    let given = Rc::new(HashedFile { _folder: folder, path });
    let file = format!("a file of {} MB in the page cache", BYTES / 1_000_000);
    let (ours, what) = (given.clone(), format!("digest of {file}"));
    let ours = move || timed(|| read(Digest::of_file(&ours.path).map(drop)));
    let ours = Workload { part: "hash", what, rival: false, run: Box::new(ours) };
    if b3sum().arg("--version").status().is_err() {
        eprintln!("not run: b3sum is absent");
        return vec![ours];
    }
    let what = format!("b3sum of {file}, its start included");
    let theirs = Workload { part: "hash", what, rival: true, run: Box::new(move || theirs(&given)) };
    vec![ours, theirs]
}

fn theirs(given: &HashedFile) -> Run {
    timed(|| {
        let ended = b3sum().arg(&given.path).status().expect("b3sum was there");
        assert!(ended.success(), "b3sum ended with {ended}");
        read(Ok(()))
    })
}

fn read(done: std::io::Result<()>) -> Vec<crate::measure::Amount> {
    done.expect("the file can be read");
    vec![amount(BYTES, "MB")]
}

fn b3sum() -> Command {
    let mut command = Command::new("b3sum");
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command
}
