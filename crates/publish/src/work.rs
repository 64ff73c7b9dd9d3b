//! The folder in which a release is written. It lies next to the target, has a name that cannot be
//! guessed, and belongs to one process.
//!
//! ```text
//! .NAME.gs2e-<16 letters>/   about     the format, and every file that is written to tree/
//!                            tree/     the release; after the swap with the target, what stood
//!                                      there
//!                            old/      what stood there
//!                            placing   written before the swap: which folder tree/ is, and the
//!                                      sound files of what stands at the target
//! ```
//! The lock of the target covers all of its work folders, so that its holder may clear what a
//! killed process left. Before the swap only files that `about` lists are removed. After it only
//! files that `placing` lists are removed, by their bytes. Both lists outlive every file that they
//! name, so a process may be killed while it removes them. Any other content of the folder stays,
//! and is reported.

mod swap;

pub(super) use swap::write_new;
use swap::{SwapNote, exchange, listing, move_to_free, parse_listing, sync_folder};

use super::removal::{is_there, remove_if_empty, remove_ours};
use super::standing::StandingTree;
use super::{ReleaseError, failed};
use gs2e_files as files;
use gs2e_files::{LinkRule, MAX_DOCUMENT, Removal};
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::{OsStr, OsString};
use std::fs::{self, Metadata, Permissions};
use std::io;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// The first line of `about`.
const FORMAT: &str = "work folder of gs2e release, format 1\n";
/// Separates the target's name from the letters in the name of a work folder.
const INFIX: &str = ".gs2e-";
/// Number of those letters: about 95 bits.
const LETTERS: usize = 16;

const ABOUT: &str = "about";
const TREE: &str = "tree";
const OLD: &str = "old";
const PLACING: &str = "placing";

/// A work folder of this process. Dropped before the release is in place, it is cleared.
#[derive(Debug)]
pub(super) struct WorkFolder {
    folder: PathBuf,
    target: PathBuf,
    placed: bool,
}

impl WorkFolder {
    /// Makes the folder for a release at `target` with these files of at most these sizes, and the
    /// folders of `tree/`.
    pub(super) fn create(target: &Path, files: &BTreeMap<String, u64>) -> Result<Self, ReleaseError> {
        let parent = target.parent().expect("a target has a parent");
        let made = tempfile::Builder::new()
            .prefix(&prefix(target))
            .rand_bytes(LETTERS)
            // No other user can enter the folder before the release is audited.
            .permissions(Permissions::from_mode(0o700))
            .tempdir_in(parent);
        let folder = made.map_err(failed(parent))?.keep();
        let work = Self { folder, target: target.to_owned(), placed: false };
        let path = work.folder.join(ABOUT);
        // Before the first file of the tree, so that every file a killed process leaves is listed.
        write_new(&path, listing(files).as_bytes()).map_err(failed(&path))?;
        let folders = files.keys().filter_map(|path| Path::new(path).parent());
        for folder in folders.collect::<BTreeSet<_>>() {
            let folder = work.tree().join(folder);
            // With the usual mode: only the work folder is closed to others, and that does not become the
            // release.
            fs::create_dir_all(&folder).map_err(failed(&folder))?;
        }
        Ok(work)
    }

    /// The folder that becomes the release.
    pub(super) fn tree(&self) -> PathBuf {
        self.folder.join(TREE)
    }

    /// Puts the tree in place of the target in one step. The folder that stood there moves into the
    /// work folder.
    pub(super) fn place(&mut self, stood: Option<&StandingTree>) -> Result<(), ReleaseError> {
        let parent = self.target.parent().expect("a target has a parent");
        let placing = SwapNote::before_swap(&self.tree(), stood).map_err(failed(&self.tree()))?;
        let path = self.folder.join(PLACING);
        write_new(&path, placing.text().as_bytes()).map_err(failed(&path))?;
        // On disk before the swap: after it this list alone says which files may be removed.
        for folder in [&self.tree(), &self.folder] {
            sync_folder(folder).map_err(failed(folder))?;
        }
        if is_there(&self.target) {
            exchange(&self.tree(), &self.target, &self.folder.join(OLD))
        } else {
            move_to_free(&self.tree(), &self.target)
        }
        .map_err(failed(&self.target))?;
        // The release is in place even if the sync fails; the next run then clears the folder.
        self.placed = true;
        sync_folder(parent).map_err(failed(parent))
    }

    /// Removes the work folder after [`WorkFolder::place`], with the sound files of what stood
    /// there. Any other content is kept next to the target; the notes say so.
    pub(super) fn finish(self, stood: Option<&StandingTree>) -> Vec<String> {
        // Without a standing tree nothing may be removed, and an empty folder is gone by now.
        let known = |folder: &Path| stood.map_or(Ok(!is_there(folder)), |stood| stood.remove_at(folder));
        note_failure(&self.folder, self.clear_placed(&known))
    }

    /// Clears a folder whose tree may be in place. `remove` removes the files that it may remove of
    /// `tree/` or `old/`, and returns true if the folder is gone.
    fn clear_placed(&self, remove: &dyn Fn(&Path) -> io::Result<bool>) -> io::Result<Vec<String>> {
        let mut notes = Vec::new();
        for (part, letter) in [(TREE, "-tree"), (OLD, "")] {
            let path = self.folder.join(part);
            if is_there(&path) {
                // An empty folder at a target counts as nothing, so no list names it.
                remove_if_empty(&path)?;
            }
            if is_there(&path) && !remove(&path)? {
                let aside = self.kept_name(letter);
                move_to_free(&path, &aside)?;
                notes.push(format!(
                    "kept files that this release did not write: {}; remove them if you do not need them",
                    aside.display()
                ));
            }
        }
        self.remove_frame()?;
        Ok(notes)
    }

    /// `NAME.replaced-<letters>`, next to the target.
    fn kept_name(&self, suffix: &str) -> PathBuf {
        // The letters of the work folder make the name a new one.
        let own = self.folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let letters = own.rsplit('-').next().unwrap_or_default().to_owned();
        let mut name = self.target.file_name().unwrap_or_default().to_owned();
        name.push(format!(".replaced-{letters}{suffix}"));
        self.target.with_file_name(name)
    }

    /// Clears a folder whose tree is not in place. Of `tree/` it removes the files that `about`
    /// lists.
    fn clear_unplaced(&self, files: &BTreeMap<String, u64>) -> io::Result<()> {
        // A longer file than listed is not one that this program wrote.
        let is_ours = |path: &str, about: &Metadata| files.get(path).is_some_and(|size| about.len() <= *size);
        if is_there(&self.tree()) {
            remove_ours(&self.tree(), files.keys().map(String::as_str), &is_ours)?;
        }
        self.remove_frame()
    }

    /// Removes `placing`, `about` and the folder, if nothing else is left in it.
    fn remove_frame(&self) -> io::Result<()> {
        let frame = [PLACING, ABOUT];
        // In doubt an entry counts as foreign, and everything stays.
        let others = fs::read_dir(&self.folder)?.filter(|entry| {
            entry.as_ref().map_or(true, |entry| frame.iter().all(|name| entry.file_name() != *name))
        });
        if others.count() > 0 {
            return Err(io::Error::new(
                io::ErrorKind::DirectoryNotEmpty,
                "it holds files that gs2e did not write",
            ));
        }
        // `about` last: without it the next run would not know the folder.
        for name in frame.map(|name| self.folder.join(name)).iter().filter(|path| is_there(path)) {
            files::remove(name, Removal::File)?;
        }
        files::remove(&self.folder, Removal::EmptyFolder)
    }
}

impl Drop for WorkFolder {
    fn drop(&mut self) {
        if !self.placed {
            // The next release to this target clears the rest, or reports it.
            let _ = clear(&self.folder, &self.target, &AtomicBool::new(false));
        }
    }
}

/// Clears the work folders that killed processes left for `target`, whose lock is held. A folder
/// that is not strictly of that form stays. Returns notes for the user.
pub(super) fn clear_leftovers(target: &Path, cancel: &AtomicBool) -> Result<Vec<String>, ReleaseError> {
    let parent = target.parent().expect("a target has a parent");
    let mut notes = Vec::new();
    let mut folders: Vec<PathBuf> = Vec::new();
    for entry in fs::read_dir(parent).map_err(failed(parent))? {
        let entry = entry.map_err(failed(parent))?;
        if is_work_name(&entry.file_name(), target) {
            folders.push(entry.path());
        }
    }
    folders.sort();
    for folder in folders {
        notes.extend(note_failure(&folder, clear(&folder, target, cancel)));
    }
    Ok(notes)
}

/// Clears one work folder that no process uses.
fn clear(folder: &Path, target: &Path, cancel: &AtomicBool) -> io::Result<Vec<String>> {
    let foreign = |what: &str| io::Error::new(io::ErrorKind::InvalidData, what.to_owned());
    // A link of this name is not followed.
    if !fs::symlink_metadata(folder)?.is_dir() {
        return Err(foreign("it is not a work folder of gs2e"));
    }
    let about = match files::read_with(&folder.join(ABOUT), LinkRule::Refuse, MAX_DOCUMENT) {
        Ok(bytes) => String::from_utf8(bytes).map_err(|_| foreign("gs2e did not write its `about`"))?,
        // A process that was killed before it wrote the file left an empty folder.
        Err(e) if e.kind() == io::ErrorKind::NotFound => {
            remove_if_empty(folder)?;
            return if is_there(folder) {
                Err(foreign("it is not a work folder of gs2e"))
            } else {
                Ok(Vec::new())
            };
        }
        Err(e) => return Err(e),
    };
    let files = parse_listing(&about).ok_or_else(|| foreign("gs2e did not write its `about`"))?;
    // As placed, since dropping it would clear the folder again, without end.
    let work = WorkFolder { folder: folder.to_owned(), target: target.to_owned(), placed: true };
    let Some(placing) = SwapNote::read(&folder.join(PLACING))? else {
        return work.clear_unplaced(&files).map(|()| Vec::new());
    };
    let old = folder.join(OLD);
    let is_cut_off = is_there(&work.tree()) && placing.is_the_new(&work.tree())?;
    if is_cut_off && is_there(&old) && !is_there(target) {
        // The swap took two steps and was cut off between them.
        move_to_free(&old, target)?;
    }
    // After an exchange `tree` is the folder that stood at the target; only the inode shows that.
    if is_cut_off {
        return work.clear_unplaced(&files).map(|()| Vec::new());
    }
    work.clear_placed(&|part| placing.remove_at(part, cancel))
}

fn note_failure(folder: &Path, result: io::Result<Vec<String>>) -> Vec<String> {
    result.unwrap_or_else(|e| vec![format!("left as it is: {}: {e}", folder.display())])
}

fn prefix(target: &Path) -> OsString {
    let mut name = OsString::from(".");
    name.push(target.file_name().unwrap_or_default());
    name.push(INFIX);
    name
}

fn is_work_name(name: &OsStr, target: &Path) -> bool {
    let (name, prefix) = (name.as_encoded_bytes(), prefix(target));
    let letters = name.strip_prefix(prefix.as_encoded_bytes());
    letters.is_some_and(|letters| letters.len() == LETTERS && letters.iter().all(u8::is_ascii_alphanumeric))
}

#[cfg(test)]
mod tests {
    use super::swap::identity;
    use super::*;
    use gs2e_store::Digest;

    fn never() -> AtomicBool {
        AtomicBool::new(false)
    }

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    /// A place with a work folder whose process was killed while it wrote.
    fn killed() -> (tempfile::TempDir, PathBuf, PathBuf) {
        let place = tempfile::tempdir().unwrap();
        let target = place.path().join("out");
        let files = [("a/one", 3), ("two", 3)].map(|(path, size)| (path.to_owned(), size)).into();
        let mut work = WorkFolder::create(&target, &files).unwrap();
        fs::write(work.tree().join("a/one"), "one").unwrap();
        work.placed = true;
        let folder = work.folder.clone();
        (place, target, folder)
    }

    #[test]
    fn a_dropped_work_folder_leaves_nothing() {
        let (place, target, folder) = killed();
        drop(WorkFolder { folder, target, placed: false });
        assert_eq!(names(place.path()), [""; 0]);
    }

    #[test]
    fn names_cannot_be_foreseen() {
        let [(_a, _, first), (_b, _, second)] = [killed(), killed()];
        assert_ne!(first.file_name(), second.file_name());
        assert_eq!(fs::metadata(&first).unwrap().permissions().mode() & 0o777, 0o700);
    }

    #[test]
    fn what_a_killed_process_left_is_cleared_and_nothing_else() {
        let (place, target, folder) = killed();
        // A longer file than this program would have written, one that it never writes, and one
        // like it elsewhere.
        fs::write(folder.join("tree/two"), "a thesis").unwrap();
        fs::write(folder.join("notes"), "mine").unwrap();
        fs::create_dir_all(place.path().join(".out.gs2e-notes/tree")).unwrap();
        fs::create_dir(place.path().join(".out.gs2e-abcdefgh01234567")).unwrap();
        let notes = clear_leftovers(&target, &never()).unwrap();
        assert_eq!(notes.len(), 1, "{notes:?}");
        assert!(notes[0].starts_with("left as it is: "), "{notes:?}");
        let own = folder.file_name().unwrap().to_str().unwrap();
        let mut left = vec![own.to_owned(), ".out.gs2e-notes".to_owned()];
        left.sort();
        assert_eq!(names(place.path()), left, "the empty one is gone");
        assert_eq!(names(&folder), ["about", "notes", "tree"]);
        assert_eq!(names(&folder.join("tree")), ["two"]);
        fs::remove_file(folder.join("tree/two")).unwrap();
        fs::remove_file(folder.join("notes")).unwrap();
        assert_eq!(clear_leftovers(&target, &never()).unwrap(), [""; 0]);
        assert_eq!(names(place.path()), [".out.gs2e-notes"]);
    }

    #[test]
    fn a_folder_without_the_format_stays() {
        let (place, target, folder) = killed();
        fs::write(folder.join("about"), "1 a/one\n").unwrap();
        assert_eq!(clear_leftovers(&target, &never()).unwrap().len(), 1);
        assert!(folder.join("tree/a/one").exists());
        // A link of this form of name is neither followed nor removed.
        fs::rename(&folder, place.path().join("elsewhere")).unwrap();
        std::os::unix::fs::symlink("elsewhere", &folder).unwrap();
        assert_eq!(clear_leftovers(&target, &never()).unwrap().len(), 1);
        assert!(folder.join("tree/a/one").exists());
    }

    /// The swap in two steps, for file systems without one step: cut off in between, the next run
    /// moves the old back.
    #[test]
    fn a_swap_that_was_cut_off_is_undone() {
        let (place, target, folder) = killed();
        let placing = SwapNote::before_swap(&folder.join(TREE), None).unwrap();
        fs::write(folder.join(PLACING), placing.text()).unwrap();
        fs::create_dir(folder.join(OLD)).unwrap();
        fs::write(folder.join("old/thesis"), "mine").unwrap();
        assert_eq!(clear_leftovers(&target, &never()).unwrap(), [""; 0]);
        assert_eq!(names(place.path()), ["out"]);
        assert_eq!(fs::read(target.join("thesis")).unwrap(), b"mine");
    }

    /// The removal of the old release is cut off after each of its files.
    #[test]
    fn a_removal_that_was_cut_off_is_ended_by_the_next_run() {
        let files = ["B3SUMS", "SHA256SUMS", "a/one", "manifest.json"];
        for removed in 0..=files.len() {
            let (place, target, folder) = killed();
            let sound = files.map(|path| (path.to_owned(), Digest::of_bytes(path.as_bytes()))).into();
            fs::rename(folder.join(TREE), &target).unwrap();
            let placing = SwapNote { tree: identity(&target).unwrap(), sound };
            fs::write(folder.join(PLACING), placing.text()).unwrap();
            fs::create_dir_all(folder.join("old/a")).unwrap();
            for path in &files[removed..] {
                fs::write(folder.join(OLD).join(path), path).unwrap();
            }
            assert_eq!(clear_leftovers(&target, &never()).unwrap(), [""; 0], "after {removed}");
            assert_eq!(names(place.path()), ["out"], "after {removed}");
        }
    }

    #[test]
    fn what_stood_there_and_is_not_ours_is_kept() {
        let (place, target, folder) = killed();
        fs::create_dir(&target).unwrap();
        fs::write(target.join("thesis"), "mine").unwrap();
        let stood = StandingTree::read(&target, &never()).unwrap();
        assert!(!stood.is_release());
        let mut work = WorkFolder { folder, target: target.clone(), placed: false };
        work.place(Some(&stood)).unwrap();
        let notes = work.finish(Some(&stood));
        assert!(notes.len() == 1 && notes[0].contains("out.replaced-"), "{notes:?}");
        let [out, kept] = <[String; 2]>::try_from(names(place.path())).unwrap();
        assert_eq!((out.as_str(), names(&target)), ("out", vec!["a".to_owned()]));
        assert_eq!(fs::read(place.path().join(kept).join("thesis")).unwrap(), b"mine");
    }
}
