//! The place of a release: claimed by one process, and checked before anything is built.

use super::removal::is_there;
use super::standing::StandingTree;
use super::work::{WorkFolder, clear_leftovers};
use super::{ReleaseError, failed};
use gs2e_files as files;
use gs2e_files::Removal;
use gs2e_store::{LockClaim, LockRequest, StoreError, StoreLock};
use rustix::fs::{AtFlags, CWD, StatxAttributes, StatxFlags};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::{fs, io};

/// A file or folder that no release may replace.
#[derive(Debug, Clone)]
pub struct GuardedPath {
    /// Name of the file or folder in messages, with its article.
    pub what: String,
    /// The file or folder.
    pub path: PathBuf,
    /// True if a release may not lie in it either.
    pub whole: bool,
}

/// Options of a claim.
#[derive(Debug)]
pub struct TargetClaim<'a> {
    /// True if the release may replace a folder that is not a release, or one with edited,
    /// additional or missing files.
    pub replace: bool,
    /// Files and folders that the target may neither be nor hold.
    pub guarded: &'a [GuardedPath],
    /// The claimant, as others who wait see it.
    pub claim: LockClaim,
    /// True if the claim waits for another process that writes there.
    pub wait: bool,
    /// Set to stop waiting and reading.
    pub cancel: &'a AtomicBool,
}

/// The place of a release. No other process of this program writes there until it is dropped.
#[derive(Debug)]
pub struct ReleaseTarget {
    /// The path as the user named it.
    named: PathBuf,
    /// The path without links in its parents.
    path: PathBuf,
    replace: bool,
    /// The folder that stands there; `None` for nothing or an empty folder.
    standing: Option<StandingTree>,
    notes: Vec<String>,
    // Dropped in this order: a parent is empty only after the lock has removed its file.
    _lock: StoreLock,
    _parents: NewFolders,
}

impl ReleaseTarget {
    /// Claims a place, clears what killed processes left for it, and reads what stands there.
    /// `waiting` receives the holder of the place, and again as often as the claim says.
    ///
    /// # Errors
    /// [`ReleaseError::Foreign`] if the place is guarded, or holds what a release may not replace.
    /// Another process holds the place and `wait` is false. The place cannot be read or made.
    /// `cancel` is set.
    pub fn claim(
        to: &Path,
        options: TargetClaim<'_>,
        waiting: &mut dyn FnMut(&str),
    ) -> Result<Self, ReleaseError> {
        let TargetClaim { replace, guarded, claim, wait, cancel } = options;
        let foreign = |because: String| ReleaseError::Foreign { path: to.to_owned(), because };
        let path = resolve(to).map_err(failed(to))?;
        let path = path.ok_or_else(|| foreign("is not a name for a release folder".into()))?;
        // Before any folder or lock is made, so that a guarded place stays as it is.
        if let Some(because) = guarded.iter().find_map(|guarded| guarded.forbids(&path)) {
            return Err(foreign(because));
        }
        let parents = NewFolders::make(path.parent().expect("a resolved path has a parent"))?;
        let lock_path = path.with_file_name(lock_name(&path));
        let request = LockRequest { path: &lock_path, of: to, claim: &claim, wait, cancel };
        let lock = StoreLock::take_temporary(&request, waiting).map_err(|error| match error {
            StoreError::Io { source, .. } if source.kind() == io::ErrorKind::Interrupted => {
                ReleaseError::Interrupted
            }
            other => other.into(),
        })?;
        // Before the place is read, since a swap that was cut off is undone here.
        let notes = clear_leftovers(&path, cancel)?;
        let standing = stands(&path).map_err(|e| match e {
            TargetFault::Foreign(because) => foreign(because.to_owned()),
            TargetFault::Io(source) => failed(to)(source),
        })?;
        let standing = if standing { Some(StandingTree::read(&path, cancel)?) } else { None };
        let refusal = standing.as_ref().filter(|_| !replace).and_then(refusal);
        if let Some(because) = refusal {
            return Err(foreign(because));
        }
        Ok(Self { named: to.to_owned(), path, replace, standing, notes, _lock: lock, _parents: parents })
    }

    /// Takes the notes on the place since the last call, one line each.
    pub fn take_notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }

    /// The folder, without links in its parents.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The folder that stands there; `None` for nothing or an empty folder.
    pub(super) fn standing(&self) -> Option<&StandingTree> {
        self.standing.as_ref()
    }

    /// Puts a written tree in place.
    pub(super) fn put(&mut self, mut work: WorkFolder) -> Result<(), ReleaseError> {
        // With `replace` a change is no error, and changed files are kept next to the target.
        self.change()?;
        work.place(self.standing.as_ref())?;
        let stood = self.standing.take();
        self.notes.extend(work.finish(stood.as_ref()));
        Ok(())
    }

    /// Returns true if the release with this `B3SUMS` stands there, unchanged since it was read.
    pub(super) fn holds(&self, b3: &str) -> Result<bool, ReleaseError> {
        let stands = self.standing.as_ref().is_some_and(|standing| standing.is_the_release_of(b3));
        Ok(stands && self.change()?.is_none())
    }

    /// Returns the change since the place was read. It is an error unless the user lets everything
    /// there be replaced.
    fn change(&self) -> Result<Option<String>, ReleaseError> {
        let change = match &self.standing {
            Some(standing) => standing.changed().map_err(failed(&self.named))?,
            None if matches!(stands(&self.path), Ok(false)) => None,
            None => Some("something is there now".to_owned()),
        };
        match change {
            Some(change) if !self.replace => Err(ReleaseError::Foreign {
                path: self.named.clone(),
                because: format!("changed while the release was made: {change}"),
            }),
            change => Ok(change),
        }
    }
}

impl GuardedPath {
    /// The reason why a release may not go to `target`; `None` if this path allows it.
    fn forbids(&self, target: &Path) -> Option<String> {
        // A path that does not exist guards nothing.
        let path = self.path.canonicalize().ok()?;
        let what = &self.what;
        if path == target {
            Some(format!("is {what}"))
        } else if path.starts_with(target) {
            Some(format!("holds {what}: {}", self.path.display()))
        } else if self.whole && target.starts_with(&path) {
            Some(format!("lies in {what}: {}", self.path.display()))
        } else {
            None
        }
    }
}

/// The reason why a release may not replace this tree; `None` if it may.
fn refusal(standing: &StandingTree) -> Option<String> {
    /// Oddities that a message names.
    const MAX_LISTED: usize = 5;
    let oddities = standing.oddities();
    let mut because = oddities.iter().take(MAX_LISTED).cloned().collect::<Vec<_>>().join("; ");
    if oddities.len() > MAX_LISTED {
        because.push_str(&format!("; and {} more", oddities.len() - MAX_LISTED));
    }
    match (oddities.is_empty(), standing.is_release()) {
        (true, _) => None,
        (false, true) => Some(format!("holds a release that was changed: {because}")),
        (false, false) => Some(format!("is not empty and not a release: {because}")),
    }
}

/// The reason why a path cannot be a release folder.
enum TargetFault {
    Foreign(&'static str),
    Io(io::Error),
}

/// Returns true if a folder that is not empty stands at `path`.
fn stands(path: &Path) -> Result<bool, TargetFault> {
    match fs::symlink_metadata(path) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(false),
        Err(e) => Err(TargetFault::Io(e)),
        // A swap would move the link and not the folder.
        Ok(about) if about.is_symlink() => {
            Err(TargetFault::Foreign("is a link; name the folder that it leads to"))
        }
        Ok(about) if !about.is_dir() => Err(TargetFault::Foreign("is not a folder")),
        Ok(_) if is_mount_point(path) => Err(TargetFault::Foreign("is a mount point")),
        Ok(_) => Ok(fs::read_dir(path).map_err(TargetFault::Io)?.next().is_some()),
    }
}

/// Returns true if the kernel says that another file system is mounted at `path`. If it says
/// nothing, a rename of the mount point fails, and nothing is changed.
fn is_mount_point(path: &Path) -> bool {
    let about = rustix::fs::statx(CWD, path, AtFlags::SYMLINK_NOFOLLOW, StatxFlags::BASIC_STATS);
    about.is_ok_and(|about| about.stx_attributes.contains(StatxAttributes::MOUNT_ROOT))
}

/// The target with the links of its parents resolved, as far as the parents exist; `None` if it
/// ends in no name.
fn resolve(to: &Path) -> io::Result<Option<PathBuf>> {
    let Some(name) = to.file_name() else { return Ok(None) };
    let parent = to.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    Ok(Some(resolve_folder(&std::path::absolute(parent)?)?.join(name)))
}

fn resolve_folder(path: &Path) -> io::Result<PathBuf> {
    match path.canonicalize() {
        // A link to nothing is there, and an error: the folder behind it is not known.
        Err(e) if e.kind() == io::ErrorKind::NotFound && !is_there(path) => {
            match (path.parent(), path.file_name()) {
                (Some(parent), Some(name)) => Ok(resolve_folder(parent)?.join(name)),
                _ => Err(e),
            }
        }
        other => other,
    }
}

/// The name of the lock of a target: `.NAME.gs2e-lock`, next to it.
fn lock_name(target: &Path) -> OsString {
    // Not inside the target: the folder there moves away at the swap, and a lock would move with it.
    let mut name = OsString::from(".");
    name.push(target.file_name().unwrap_or_default());
    name.push(".gs2e-lock");
    name
}

/// Folders that were made for a target. Those that stay empty are removed with it.
#[derive(Debug)]
struct NewFolders(Vec<PathBuf>);

impl NewFolders {
    fn make(folder: &Path) -> Result<Self, ReleaseError> {
        // The deepest first, in which order they can be removed again.
        let absent = folder.ancestors().take_while(|folder| !is_there(folder)).map(Path::to_owned);
        let made = Self(absent.collect());
        fs::create_dir_all(folder).map_err(failed(folder))?;
        Ok(made)
    }
}

impl Drop for NewFolders {
    fn drop(&mut self) {
        for folder in &self.0 {
            // One with the release in it stays.
            let _ = files::remove(folder, Removal::EmptyFolder);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn links_of_parents_are_resolved_and_missing_ones_kept() {
        let place = tempfile::tempdir().unwrap();
        let root = place.path().canonicalize().unwrap();
        fs::create_dir(root.join("real")).unwrap();
        symlink("real", root.join("link")).unwrap();
        symlink("nothing", root.join("dangling")).unwrap();
        let t = |to: &str, wanted: Option<&str>| {
            let found = resolve(&root.join(to)).unwrap();
            assert_eq!(found, wanted.map(|wanted| root.join(wanted)), "{to}");
        };
        t("link/out", Some("real/out"));
        t("link/a/b/out/", Some("real/a/b/out"));
        t("link/../out", Some("out"));
        t("real/..", None);
        assert_eq!(resolve(Path::new("/")).unwrap(), None);
        assert!(resolve(&root.join("dangling/out")).is_err());
    }

    #[test]
    fn a_guard_forbids_what_is_around_it_and_if_it_is_whole_what_is_in_it() {
        let place = tempfile::tempdir().unwrap();
        let root = place.path().canonicalize().unwrap();
        fs::create_dir_all(root.join("a/store")).unwrap();
        let t = |whole, target: &str, wanted: Option<&str>| {
            let guard = GuardedPath { what: "the store".into(), path: root.join("a/store"), whole };
            let found = guard.forbids(&root.join(target));
            assert_eq!(found.as_ref().map(|because| because.split(' ').next().unwrap()), wanted, "{target}");
        };
        t(false, "a/store", Some("is"));
        t(false, "a", Some("holds"));
        t(false, "a/store/out", None);
        t(true, "a/store/out", Some("lies"));
        t(true, "a/out", None);
        t(true, "a/store2", None);
    }

    #[test]
    fn folders_made_for_nothing_go_again() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("a/b/c");
        drop(NewFolders::make(&folder).unwrap());
        assert!(!place.path().join("a").exists());
        let made = NewFolders::make(&folder).unwrap();
        fs::write(folder.join("release"), "").unwrap();
        drop(made);
        assert!(folder.join("release").exists());
    }
}
