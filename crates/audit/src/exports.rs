//! Exports: those that the manifest names are present, each describes itself as what it is, and each is what
//! this program makes of the scene.

use super::{AuditFault, FaultCode, TrustedTree};
use gs2e_files as files;
use gs2e_files::LinkRule;
use gs2e_recipe::{EXPORT_FORMATS, IncludedExport};
use gs2e_release::include::{
    ComposedScene, ExportOrder, IncludeFailure, IncludeRefusal, ReleaseExporter, export_name,
};
use gs2e_release::layout;
use gs2e_release::manifest::ReleaseManifest;
use gs2e_release::published::PublishedScene;
use gs2e_release::scene::SceneRecord;
use gs2e_tree::ReleaseFiles as _;
use serde::Deserialize;
use std::collections::BTreeSet;
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use walkdir::WalkDir;

/// Name of the file that describes an export.
const DESCRIPTION: &str = "export.json";

/// Ends of the names of an export's files. None of them is of a file that an interpreter or a shell runs.
const ENDS: [&str; 15] = [
    ".bin", ".csv", ".h5", ".jpg", ".json", ".mcap", ".npy", ".npz", ".parquet", ".png", ".pt", ".tar",
    ".txt", ".yaml", ".zip",
];

/// What an export states of itself.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct StatedExport {
    format: String,
    selection: StatedSelection,
    files: u64,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct StatedSelection {
    scene: String,
    trajectory: String,
}

/// An export of the manifest.
pub(super) struct ExportPlace<'a> {
    /// Its folder in the tree, with a slash at the end.
    pub(super) folder: String,
    trajectory: &'a str,
    include: &'a IncludedExport,
}

/// The folders of a scene's exports.
pub(super) fn folders<'a>(
    manifest: &'a ReleaseManifest,
    scene: &'a SceneRecord,
) -> impl Iterator<Item = ExportPlace<'a>> {
    let shown = scene.trajectories.iter().filter(|part| !scene.licence.withheld && part.cameras.is_empty());
    shown.flat_map(|part| {
        let covering = manifest.include.iter().filter(|entry| entry.covers(&part.name));
        covering.map(|entry| {
            let folder = export_name(&scene.id, &part.name, &entry.format) + "/";
            ExportPlace { folder, trajectory: part.name.as_str(), include: entry }
        })
    })
}

/// Returns true if an export can have a file of this name, whatever its format.
pub(super) fn may_have(name: &str) -> bool {
    name.split('/').all(|part| !part.starts_with('.')) && ENDS.iter().any(|end| name.ends_with(end))
}

/// The sentence on exports among what the audit covers.
pub(super) fn covered(
    manifest: &ReleaseManifest,
    exporter: Option<&dyn ReleaseExporter>,
) -> Option<&'static str> {
    // Another version may write other bytes for the same scene, so bytes are compared within one version
    // only.
    let is_again = exporter.is_some() && manifest.tool == gs2e_release::TOOL;
    (!manifest.include.is_empty()).then_some(if is_again {
        "exports: made again from the scenes, byte for byte"
    } else {
        "exports: present, complete, and of the scene and format that manifest.json names"
    })
}

/// Returns faults of exports that are absent, incomplete, or of something else.
pub(super) fn audit(
    tree: &TrustedTree<'_>,
    manifest: &ReleaseManifest,
    scenes: &[SceneRecord],
) -> Vec<AuditFault> {
    let places = scenes.iter().flat_map(|scene| folders(manifest, scene).map(move |place| (scene, place)));
    places
        .flat_map(|(scene, place)| {
            let faults = description_faults(tree, &scene.id, &place);
            faults.into_iter().map(|fault| fault.in_scene(&scene.id))
        })
        .collect()
}

fn description_faults(tree: &TrustedTree<'_>, scene: &str, place: &ExportPlace<'_>) -> Vec<AuditFault> {
    let ExportPlace { folder, trajectory, include } = place;
    let path = format!("{folder}{DESCRIPTION}");
    let fault = |code, message: String| AuditFault::of_file(code, &path, message);
    let Ok(bytes) = tree.read(&path, files::MAX_DOCUMENT) else {
        let message = "the manifest includes this export; it is missing or damaged".to_owned();
        return vec![fault(FaultCode::Missing, message)];
    };
    // Everything but these four values is skipped by the parser, so that a large file takes no memory.
    let found = match serde_json::from_slice::<StatedExport>(&bytes) {
        Ok(found) => found,
        Err(e) => {
            return vec![fault(FaultCode::Unreadable, format!("it does not have the expected form: {e}"))];
        }
    };
    let files = tree.below(folder).count() as u64;
    let claims = [
        ("format", found.format, include.format.clone()),
        ("scene", found.selection.scene, scene.to_owned()),
        ("trajectory", found.selection.trajectory, (*trajectory).to_owned()),
        ("number of files", found.files.to_string(), files.to_string()),
    ];
    let wrong = claims.into_iter().filter(|(_, found, wanted)| found != wanted);
    wrong
        .map(|(name, found, wanted)| {
            let message = format!("its {name} is `{}`, wanted `{wanted}`", super::recompose::brief(&found));
            fault(FaultCode::ClaimsDisagree, message)
        })
        .collect()
}

/// Makes the exports of sound scenes once more, in a folder of temporary files, and compares their names and
/// bytes. One export is on the disk at a time.
///
/// # Errors
/// The folder cannot be written. An export that cannot be made is a fault.
pub(super) fn compare_reexports(
    tree: &TrustedTree<'_>,
    manifest: &ReleaseManifest,
    scenes: Option<&[PublishedScene]>,
    exporter: &dyn ReleaseExporter,
) -> io::Result<Vec<AuditFault>> {
    let mut faults = Vec::new();
    if manifest.include.is_empty() {
        return Ok(faults);
    }
    for scene in scenes.unwrap_or_default() {
        let id = &scene.file.id;
        let own = format!("{id}/");
        let files = tree.below(&own).filter(|path| !layout::is_export(id, path));
        let files = files.map(|path| (path.to_owned(), tree.path_of(path))).collect();
        let composed = Arc::new(ComposedScene::released(manifest, &scene.file, files));
        for ExportPlace { folder, trajectory, include } in folders(manifest, &scene.file) {
            let order = ExportOrder { scene: &composed, trajectory, include };
            let found = Reexport { tree, folder: &folder }.compare(order, exporter)?;
            faults.extend(found.into_iter().map(|fault| fault.in_scene(id)));
        }
    }
    Ok(faults)
}

/// An export of the tree that is made again.
struct Reexport<'a> {
    tree: &'a TrustedTree<'a>,
    folder: &'a str,
}

impl Reexport<'_> {
    fn compare(&self, order: ExportOrder<'_>, exporter: &dyn ReleaseExporter) -> io::Result<Vec<AuditFault>> {
        let format = &order.include.format;
        // The exporter panics on a format that it lacks, and a manifest is input that anyone may have
        // written.
        if !EXPORT_FORMATS.contains(&format.as_str()) {
            let message =
                format!("the manifest includes the format `{format}`, which this program does not have");
            return Ok(vec![self.fault(FaultCode::NotComposed, DESCRIPTION, message)]);
        }
        let scratch = tempfile::Builder::new().prefix("gs2e-audit-").tempdir().map_err(unwritten)?;
        // Within the folder, since an export must not exist yet, and its temporary columns lie next to it and
        // are measured.
        let made = scratch.path().join("export");
        let room = FolderRoom::new(scratch.path(), self.size());
        match exporter.rewrite(order, &made, &|| room.is_over()) {
            Ok(()) => self.differences(&made),
            // The disk of the auditor is at fault here, so the release must not be blamed.
            Err(refusal) if refusal.kind == IncludeFailure::Unwritten => Err(unwritten(refusal)),
            Err(refusal) => {
                Ok(vec![self.fault(FaultCode::NotComposed, DESCRIPTION, unmade_because(&refusal))])
            }
        }
    }

    fn fault(&self, code: FaultCode, name: &str, message: impl Into<String>) -> AuditFault {
        AuditFault::of_file(code, &format!("{}{name}", self.folder), message)
    }

    /// Bytes of its files.
    fn size(&self) -> u64 {
        let files = self.tree.below(self.folder).map(|path| self.tree.path_of(path));
        files.filter_map(|path| path.symlink_metadata().ok()).map(|file| file.len()).sum()
    }

    /// The differences between the tree and the folder `made`.
    fn differences(&self, made: &Path) -> io::Result<Vec<AuditFault>> {
        let names = |path: &str| path[self.folder.len()..].to_owned();
        let found: BTreeSet<String> = self.tree.below(self.folder).map(names).collect();
        let mut wanted = BTreeSet::new();
        for entry in WalkDir::new(made) {
            let entry = entry.map_err(io::Error::from)?;
            if !entry.file_type().is_dir() {
                let name = entry.path().strip_prefix(made).expect("a walk stays below its root");
                wanted.insert(name.to_string_lossy().into_owned());
            }
        }
        let mut faults = Vec::new();
        // A name that no export has is reported by the audit of names.
        for name in found.difference(&wanted).filter(|name| may_have(name)) {
            faults.push(self.fault(FaultCode::Stray, name, "the export of this scene has no such file"));
        }
        for name in wanted.difference(&found) {
            let message = "the export needs this file; it is missing or damaged";
            faults.push(self.fault(FaultCode::SceneIncomplete, name, message));
        }
        for name in wanted.intersection(&found) {
            let place = self.tree.path_of(&format!("{}{name}", self.folder));
            if let Some(byte) = first_difference(&place, &made.join(name))? {
                let message = format!(
                    "it differs from what this program exports from the other files: byte {byte} differs"
                );
                faults.push(self.fault(FaultCode::NotComposed, name, message));
            }
        }
        Ok(faults)
    }
}

fn unwritten(because: impl std::fmt::Display) -> io::Error {
    let folder = tempfile::env::temp_dir();
    let folder = folder.display();
    io::Error::other(format!("exports are made again in {folder}; TMPDIR names another folder: {because}"))
}

fn unmade_because(refusal: &IncludeRefusal) -> String {
    if refusal.kind == IncludeFailure::Interrupted {
        return "this program makes a much larger export of the other files".to_owned();
    }
    let details = refusal.details.iter().map(|line| format!("; {line}")).collect::<String>();
    format!("this program cannot make it of the other files: {}{details}", refusal.because)
}

/// The place of the first byte in which two files differ; `None` if they are equal.
fn first_difference(one: &Path, other: &Path) -> io::Result<Option<u64>> {
    let open = |path: &Path| files::open_with(path, LinkRule::Refuse).map(BufReader::new);
    let [mut one, mut other]: [BufReader<File>; 2] = [open(one)?, open(other)?];
    let (mut a, mut b, mut at) = (vec![0; 1 << 16], vec![0; 1 << 16], 0_u64);
    loop {
        // A read may return fewer bytes than asked for, and both files must be cut at the same places.
        let (n, m) = (read_full(&mut one, &mut a)?, read_full(&mut other, &mut b)?);
        let shorter = n.min(m);
        if a[..shorter] != b[..shorter] || n != m {
            let equal = a.iter().zip(&b).take(shorter).take_while(|(a, b)| a == b).count();
            return Ok(Some(at + equal as u64));
        }
        if n == 0 {
            return Ok(None);
        }
        at += n as u64;
    }
}

/// Reads as many bytes as there are, at most the length of `into`.
pub(super) fn read_full(from: &mut impl Read, into: &mut [u8]) -> io::Result<usize> {
    let mut held = 0;
    while held < into.len() {
        match from.read(&mut into[held..])? {
            0 => break,
            n => held += n,
        }
    }
    Ok(held)
}

/// Watches the size of a folder, because the files of a forged scene can lead to an export without end.
struct FolderRoom<'a> {
    folder: &'a Path,
    most: u64,
    asked: AtomicU64,
}

/// A folder is measured once in this many questions: a question comes with each picture, and takes a walk.
const ASKED_AT_ONCE: u64 = 64;
/// Bytes that an export may have beyond what the tree has of it.
const MARGIN: u64 = 64 << 20;

impl<'a> FolderRoom<'a> {
    /// Room for an export of `size` bytes, and for columns that wait in files of their own.
    fn new(folder: &'a Path, size: u64) -> Self {
        Self { folder, most: 2 * size + MARGIN, asked: AtomicU64::new(0) }
    }

    fn is_over(&self) -> bool {
        let asked = self.asked.fetch_add(1, Ordering::Relaxed);
        asked % ASKED_AT_ONCE == ASKED_AT_ONCE - 1 && self.size() > self.most
    }

    /// Bytes of the files in the folder.
    fn size(&self) -> u64 {
        let entries = WalkDir::new(self.folder).into_iter().filter_map(Result::ok);
        let files = entries.filter(|entry| !entry.file_type().is_dir());
        files.filter_map(|entry| entry.metadata().ok()).map(|file| file.len()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exports_have_no_names_that_programs_run() {
        for name in ["events.npy", "train/r_0.png", "sparse/0/points3D.bin", "test/a-b/events_left/events.h5"]
        {
            assert!(may_have(name), "{name}");
        }
        for name in
            ["setup.py", "a.npy/b.pth", ".git/hooks/post-checkout", ".git/config.txt", "program", "a.so"]
        {
            assert!(!may_have(name), "{name}");
        }
    }

    #[test]
    fn an_export_without_end_is_stopped() {
        let folder = tempfile::tempdir().unwrap();
        let file = File::create(folder.path().join("events.txt")).unwrap();
        let is_over = |bytes: u64| {
            file.set_len(bytes).unwrap();
            let room = FolderRoom::new(folder.path(), 1000);
            (0..ASKED_AT_ONCE).any(|_| room.is_over())
        };
        assert!(!is_over(MARGIN + 2000));
        assert!(is_over(MARGIN + 2001));
    }

    #[test]
    fn the_first_difference_of_two_files_is_found() {
        let folder = tempfile::tempdir().unwrap();
        let [one, other] = ["one", "other"].map(|name| folder.path().join(name));
        let t = |a: &[u8], b: &[u8], wanted| {
            std::fs::write(&one, a).unwrap();
            std::fs::write(&other, b).unwrap();
            assert_eq!(first_difference(&one, &other).unwrap(), wanted);
        };
        t(b"", b"", None);
        t(b"abc", b"abd", Some(2));
        t(b"abc", b"ab", Some(2));
        t(&[1; 100_000], &[1; 100_001], Some(100_000));
        t(&[1; 200_000], &[1; 200_000], None);
    }
}
