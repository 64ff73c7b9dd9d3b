//! The audit of a release, compared with plain readers of the same bytes: the disk, and `b3sum`.
//!
//! The sums alone are the first of the audit's two passes: it reads and hashes every byte, by
//! SHA-256 and BLAKE3 at once. The second opens events, poses and pictures, and composes again
//! every file that follows from others. Its rival is the same tree with another program's version in
//! `manifest.json`, where the audit composes no file: the ratio is the cost of the comparisons. "From
//! the disk" means that every page of the tree is given back to the system before each run.

use super::amount;
use crate::measure::{Amount, Run, Workload, timed};
use gs2e_audit::{audit_release, read_tree};
use sha2::Digest as _;
use std::fs;
use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::rc::Rc;

/// A release of the demo, removed when the last workload is dropped.
struct DemoRelease {
    /// Keeps the folder alive: dropping it removes the folder.
    _folder: tempfile::TempDir,
    tree: PathBuf,
    /// The same tree, as another version would have written it.
    foreign: PathBuf,
    files: Vec<PathBuf>,
    bytes: usize,
}

pub(super) fn workloads() -> Vec<Workload> {
    let given = Rc::new(release());
    let size = format!("{} files, {:.0} MB", given.files.len(), given.bytes as f64 * 1e-6);
    let work = |what: &str, rival, evicted, run: fn(&DemoRelease)| {
        let (given, what) = (given.clone(), format!("{what} ({size})"));
        let run = move || {
            if evicted {
                evict(&given.files);
            }
            done(&given, run)
        };
        Workload { part: "audit", what, rival, run: Box::new(run) }
    };
    let whole =
        |given: &DemoRelease| assert_eq!(audit_release(&given.tree).expect("it can be read").faults, []);
    let mut all = vec![
        work("sums alone, from the disk", false, true, first_pass),
        work("plain reading by one thread, from the disk", true, true, plain),
        work("sums alone, from the page cache", false, false, first_pass),
    ];
    if Command::new("b3sum").arg("--version").stdout(Stdio::null()).status().is_ok() {
        all.push(work("b3sum of all files, its start included", true, false, b3sum));
    } else {
        eprintln!("not run: b3sum is absent");
    }
    let contents = |given: &DemoRelease| {
        let report = audit_release(&given.foreign).expect("it can be read");
        assert!(report.written_by.is_some(), "nothing is composed for another version");
    };
    all.push(work("sums, contents and comparisons, from the page cache", false, false, whole));
    all.push(work("sums and contents without comparisons, from the page cache", true, false, contents));
    all
}

fn release() -> DemoRelease {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let tree = folder.path().join("out");
    let recipe = Path::new(env!("CARGO_MANIFEST_DIR")).join("recipes/demo.yaml");
    let store = folder.path().join("store");
    let words = ["gs2e", "-q", "release", "--copy", "--backend", "cpu", "--to"].map(Into::into);
    let paths =
        [tree.clone().into_os_string(), "--store".into(), store.into_os_string(), recipe.into_os_string()];
    let ended = gs2e::cli::run_program(words.into_iter().chain(paths));
    assert!(ended == ExitCode::SUCCESS, "the demo can be released");
    let entries = walkdir::WalkDir::new(&tree).into_iter().map(|entry| entry.expect("it can be listed"));
    let files: Vec<PathBuf> = entries.filter(|e| e.file_type().is_file()).map(|e| e.into_path()).collect();
    let size = |path: &PathBuf| path.metadata().map_or(0, |about| about.len());
    let bytes = usize::try_from(files.iter().map(size).sum::<u64>()).expect("a demo fits into memory");
    let foreign = folder.path().join("foreign");
    copy_as_foreign(&tree, &files, &foreign);
    DemoRelease { _folder: folder, tree, foreign, files, bytes }
}

/// Copies a release, states another version as its author, and corrects the sums.
fn copy_as_foreign(tree: &Path, files: &[PathBuf], to: &Path) {
    for file in files {
        let copy = to.join(file.strip_prefix(tree).expect("it is below the tree"));
        fs::create_dir_all(copy.parent().expect("it has a folder")).expect("it can be made");
        fs::copy(file, copy).expect("it can be copied");
    }
    let version = concat!("gs2e ", env!("CARGO_PKG_VERSION"));
    let mut edits = vec![(version.to_owned(), "gs2e 0.0.0".to_owned())];
    let sha256 = |bytes: &[u8]| sha2::Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect();
    // Each file lists the sums of those before it.
    for name in ["manifest.json", "B3SUMS", "SHA256SUMS"] {
        let old = fs::read_to_string(to.join(name)).expect("it is text");
        let new = edits.iter().fold(old.clone(), |text, (from, to)| text.replace(from, to));
        fs::write(to.join(name), &new).expect("it can be written");
        edits.push((sha256(old.as_bytes()), sha256(new.as_bytes())));
        let blake3 = |text: &str| blake3::hash(text.as_bytes()).to_hex().to_string();
        edits.push((blake3(&old), blake3(&new)));
    }
}

fn done(given: &DemoRelease, run: fn(&DemoRelease)) -> Run {
    timed(|| -> Vec<Amount> {
        run(given);
        vec![amount(given.bytes, "MB")]
    })
}

fn first_pass(given: &DemoRelease) {
    let bytes = read_tree(&given.tree).expect("it can be read");
    assert_eq!(bytes, given.bytes as u64);
}

fn plain(given: &DemoRelease) {
    let mut piece = vec![0; 1 << 20];
    for path in &given.files {
        let mut file = File::open(path).expect("it is there");
        while file.read(&mut piece).expect("it can be read") > 0 {}
    }
}

fn b3sum(given: &DemoRelease) {
    let mut command = Command::new("b3sum");
    let ended = command.args(&given.files).stdin(Stdio::null()).stdout(Stdio::null()).status();
    assert!(ended.is_ok_and(|ended| ended.success()), "b3sum reads them");
}

/// Writes these files to the disk and makes the system forget their pages.
fn evict(files: &[PathBuf]) {
    for path in files {
        let file = File::open(path).expect("it is there");
        file.sync_all().expect("it can be synced");
        rustix::fs::fadvise(&file, 0, None, rustix::fs::Advice::DontNeed).expect("the system takes advice");
    }
}
