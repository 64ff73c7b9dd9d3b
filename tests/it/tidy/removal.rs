//! The places that delete files, and those that may replace or truncate one.
//!
//! One function deletes. Each caller is listed with the reason why it deletes nothing of a person. A file
//! that a person names is written by `files::write_by_rename`; the other places write where only this program
//! does.

use super::Fault;
use super::source::Source;

/// A file with the reason why it is allowed to delete or replace.
type Place = (&'static str, &'static str);

/// The calls that delete. Only one file has them.
const DELETING: [&str; 4] = ["remove_file(", "remove_dir(", "remove_dir_all(", "unlinkat("];
const REMOVAL: &str = "crates/files/src/removal.rs";

/// The callers of the function that deletes.
const CALLERS: &[Place] = &[
    ("src/cli/init/write.rs", "the list of rejected scenes, known by its first line"),
    ("crates/event/src/h5/writer.rs", "the file that this writer created"),
    ("crates/event/src/npz/writer.rs", "the files that this writer created"),
    ("crates/export/src/npy.rs", "a spool of an archive, in the hidden folder of the export"),
    (
        "crates/export/src/tree.rs",
        "a hidden folder whose name cannot be guessed, with the text of an export in it",
    ),
    ("crates/files/src/below.rs", "a part that this call created"),
    ("crates/files/src/rename.rs", "a part with a name of this process"),
    ("crates/sampling/src/kept.rs", "a fresh file in a store"),
    (
        "crates/publish/src/removal.rs",
        "files of a release, by a list with their bytes or sizes; empty folders",
    ),
    ("crates/publish/src/target.rs", "empty folders that this claim made"),
    ("crates/publish/src/tree.rs", "a file of the tree that this process writes, in a folder of its own"),
    ("crates/publish/src/work.rs", "the two lists of a work folder, and the empty folder"),
    ("crates/build/src/run/kept.rs", "a fresh file in a store"),
    ("crates/build/src/stage/context.rs", "the folder that this step made in its workspace"),
    ("crates/build/src/stage/reconstruct/command.rs", "the folder that this step made in its workspace"),
    ("crates/store/src/fs.rs", "files of a store, below a folder with its marker"),
    ("crates/store/src/link_tree.rs", "links into this store"),
    ("crates/store/src/lock.rs", "the lock that this process holds"),
];

/// The calls that can replace or truncate a file.
const REPLACING: [&str; 6] =
    ["File::create(", "fs::write(", "fs::rename(", ".truncate(true)", ".set_len(", ".persist("];

/// The places that have them. A name that ends with `/` stands for the files of a folder.
const WRITERS: &[Place] = &[
    ("crates/build/src/artifact.rs", "the workspace of a step"),
    ("src/cli/study/meter.rs", "a file of the kernel"),
    ("crates/event/src/aedat4/writer.rs", "a part of `write_by_rename`, or the workspace of a step"),
    ("crates/event/src/evt/writer.rs", "a part of `write_by_rename`, or the workspace of a step"),
    ("crates/event/src/npz/writer.rs", "a part of `write_by_rename`, or the workspace of a step"),
    ("crates/event/src/text/writer.rs", "a part of `write_by_rename`, or the workspace of a step"),
    ("crates/export/src/tree.rs", "the move of a hidden folder to a free place"),
    ("crates/files/src/rename.rs", "the one rename"),
    ("crates/source/src/foreign/", "a folder that this process made for another program"),
    ("crates/source/src/reconstruct/command.rs", "the log of a step, in the store"),
    ("crates/source/src/reconstruct/layout.rs", "a folder that this step made for another program"),
    ("crates/release/src/signature.rs", "the signature, in the work folder of the release"),
    ("crates/publish/src/tree.rs", "the work folder of the release"),
    ("crates/publish/src/work/swap.rs", "the swap of a release with a folder that this program wrote"),
    ("crates/source/src/colmap/", "a folder that this step made"),
    ("crates/build/src/stage/", "the workspace of a step"),
    ("crates/store/src/fs.rs", "files of a store, below a folder with its marker"),
    ("crates/store/src/lock.rs", "the lock that this process holds"),
    ("crates/store/src/shared/bucket.rs", "a fresh file in a store"),
];

/// Deletions outside of the one function, its unlisted callers, unlisted replacements, and list entries
/// without a call.
pub(super) fn deletions_and_replacements(sources: &[Source]) -> Vec<Fault> {
    let mut faults = faults_of_one(sources);
    let calls_in = |path: &str, calls: fn(&str) -> bool| {
        let mut of_path = sources.iter().filter(|source| is_at(source, path));
        of_path.any(|source| source.lines().any(|(_, line)| calls(line)))
    };
    let mut unused = |list: &[Place], calls, what: &str| {
        for (path, _) in list.iter().filter(|(path, _)| !calls_in(path, calls)) {
            faults.push(Fault { place: (*path).to_owned(), what: what.to_owned() });
        }
    };
    unused(CALLERS, deletes, "deletes nothing, but is listed");
    unused(WRITERS, replaces, "replaces nothing, but is listed");
    faults
}

/// The faults of sources alone.
pub(super) fn faults_of_one(sources: &[Source]) -> Vec<Fault> {
    let mut faults = Vec::new();
    for source in sources.iter().filter(|source| source.path != REMOVAL) {
        let is_in = |list: &[Place]| list.iter().any(|(path, _)| is_at(source, path));
        for (number, line) in source.lines() {
            let what = if DELETING.iter().any(|call| line.contains(call)) {
                "deletes; only `files::remove` and `files::remove_below` do"
            } else if deletes(line) && !is_in(CALLERS) {
                "deletes, and is not listed"
            } else if replaces(line) && !is_in(WRITERS) {
                "may replace a file, and is not listed; `files::write_by_rename` is the way"
            } else {
                continue;
            };
            faults.push(Fault::new(source, number, what));
        }
    }
    faults
}

/// Returns true if a source is a file, or lies in a folder whose name ends with `/`.
fn is_at(source: &Source, path: &str) -> bool {
    source.path == path || path.ends_with('/') && source.path.starts_with(path)
}

/// Returns true for a line with a call of the function that deletes.
fn deletes(line: &str) -> bool {
    line.contains("Removal::") || line.contains("remove_file_at(")
}

fn replaces(line: &str) -> bool {
    // `Hdf5File::create(` is another function.
    let is_whole = |at: usize| !line[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_');
    REPLACING.iter().any(|call| line.match_indices(call).any(|(at, _)| is_whole(at) || call.starts_with('.')))
}
