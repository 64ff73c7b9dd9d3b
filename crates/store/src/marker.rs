//! The marker of a store: a file `VERSION` that begins with a magic word.
//!
//! It is made while the folder is empty. Everything below a marked folder was therefore put there by this
//! program, or by a person who knew that it is a store. In a folder with other content and without a marker
//! nothing is created, changed or deleted.

use super::disk::{StoreDisk, disk_error, is_absent};
use super::lock::{LOCK, is_lock};
use super::{FORMAT, StoreError};
use gs2e_files as files;
use gs2e_files::{LinkRule, MAX_TEXT};
use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use tempfile::NamedTempFile;

/// Name of the marker.
const VERSION: &str = "VERSION";
/// Folder of the root of an ext4 file system.
const LOST_AND_FOUND: &str = "lost+found";
/// Beginning of the text of a marker.
const MAGIC: &str = "gs2e ";
/// Separates the kind of a store from its format.
const FORMAT_IS: &str = ", format ";

/// The kinds of folders that have a marker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum StoreKind {
    /// The store of one machine.
    Local,
    /// A store that several machines share.
    Shared,
}

impl StoreKind {
    /// The kind, as the marker and messages name it.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Local => "store",
            Self::Shared => "shared store",
        }
    }

    /// Text of the marker.
    pub(super) fn text(self) -> String {
        format!("{MAGIC}{}{FORMAT_IS}{FORMAT}\n", self.name())
    }
}

/// The state of a folder that may be a store.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum StoreFolder {
    /// Nothing is there, or an empty folder.
    Empty,
    /// A store of this kind.
    Marked,
    /// A store of an earlier version of this program, which wrote no magic word.
    Unmarked,
}

/// Returns true if `root` has the marker of a store of this kind, whatever its format.
fn is_marked(root: &Path, kind: StoreKind) -> bool {
    let text = read_marker(root).ok().flatten().unwrap_or_default();
    parse(&text).is_some_and(|(of, _)| of == kind.name())
}

/// Finds out whether a folder is a store.
///
/// # Errors
/// [`StoreError::Foreign`] if it is something else; [`StoreError::Newer`]; the folder cannot be read.
pub(super) fn examine(root: &Path, kind: StoreKind) -> Result<StoreFolder, StoreError> {
    let text = read_marker(root).map_err(disk_error("reading", &root.join(VERSION)))?;
    let foreign = |found: String| StoreError::Foreign { path: root.to_owned(), kind: kind.name(), found };
    let Some(text) = text else {
        // Another process may have claimed the folder since the marker was looked for.
        return match first_entry(root).map_err(disk_error("listing", root))? {
            None => Ok(StoreFolder::Empty),
            Some(_) if is_marked(root, kind) => Ok(StoreFolder::Marked),
            Some(name) => Err(foreign(format!("it holds {name} and no marker"))),
        };
    };
    match parse(&text) {
        Some((of, format)) if of == kind.name() => match format.parse::<u32>() {
            Ok(format) if format <= FORMAT => Ok(StoreFolder::Marked),
            _ => Err(newer(root, format)),
        },
        Some((of, _)) if of == StoreKind::Local.name() => {
            Err(StoreError::NotShared { path: root.to_owned() })
        }
        Some((of, _)) => Err(foreign(format!("it is a {of} of gs2e"))),
        None => examine_unmarked(root, kind, &text),
    }
}

fn newer(root: &Path, found: &str) -> StoreError {
    StoreError::Newer { path: root.to_owned(), found: found.to_owned(), known: FORMAT }
}

/// Recognises a store of an earlier version: its `VERSION` has a number only, so its other files decide.
fn examine_unmarked(root: &Path, kind: StoreKind, text: &str) -> Result<StoreFolder, StoreError> {
    let number = text.trim_matches(|c: char| c.is_whitespace() || c == '\0');
    if kind == StoreKind::Shared && is_lock(&root.join(LOCK)) {
        return Err(StoreError::NotShared { path: root.to_owned() });
    }
    if !has_form(root, kind) {
        let found = format!("its {VERSION} is not that of a {}", kind.name());
        return Err(StoreError::Foreign { path: root.to_owned(), kind: kind.name(), found });
    }
    // A power cut may have kept the name and lost the bytes.
    match number.parse::<u32>() {
        Ok(format) if format <= FORMAT => Ok(StoreFolder::Unmarked),
        Err(_) if number.is_empty() => Ok(StoreFolder::Unmarked),
        _ => Err(newer(root, number)),
    }
}

/// Returns true if a folder has the form of a store: its folders, and files that only this program writes.
fn has_form(root: &Path, kind: StoreKind) -> bool {
    let is_folder = |name: &str| fs::symlink_metadata(root.join(name)).is_ok_and(|about| about.is_dir());
    if !["cas", "ac"].iter().all(|name| is_folder(name)) {
        return false;
    }
    match kind {
        StoreKind::Local => is_lock(&root.join(LOCK)),
        StoreKind::Shared => has_record(&root.join("ac")),
    }
}

/// Returns true if the folder has a file with the name of a record, as every store that was used has.
fn has_record(records: &Path) -> bool {
    let is_record = |path: &Path| {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        name.strip_suffix(".json").is_some_and(|key| key.parse::<super::Digest>().is_ok())
    };
    let entries =
        |folder: &Path| fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    entries(records).any(|folder| entries(&folder).any(|path| is_record(&path)))
}

/// The text of the marker; `None` if there is no such file.
fn read_marker(root: &Path) -> std::io::Result<Option<String>> {
    let bytes = match files::read_with(&root.join(VERSION), LinkRule::Refuse, MAX_TEXT) {
        Ok(bytes) => bytes,
        Err(e) if is_absent(&e) => return Ok(None),
        // Something else of this name is not a marker.
        Err(e) if files::is_no_file(&e) => Vec::new(),
        Err(e) => return Err(e),
    };
    Ok(Some(String::from_utf8_lossy(&bytes).into_owned()))
}

/// The kind and the format in the text of a marker.
fn parse(text: &str) -> Option<(&str, &str)> {
    let (kind, format) = text.strip_prefix(MAGIC)?.split_once(FORMAT_IS)?;
    Some((kind, format.trim_end()))
}

/// The first name in a folder, apart from the remains of a claim; `None` if it is empty or absent.
fn first_entry(root: &Path) -> std::io::Result<Option<String>> {
    let entries = match fs::read_dir(root) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        entries => entries?,
    };
    let mut first: Option<String> = None;
    for entry in entries {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        let is_other = name != LOST_AND_FOUND && !is_part(&entry.path());
        // The smallest name, because a folder lists its entries in any order and messages must not change.
        if is_other && first.as_ref().is_none_or(|first| name < *first) {
            first = Some(name);
        }
    }
    Ok(first)
}

/// Ending of the name of a marker that is not complete.
const PART: &str = ".gs2e-version";

/// A file for a marker that is being written, with a name that no other process has. Members of a group may
/// share the folder.
fn fresh_part(root: &Path) -> Result<NamedTempFile, StoreError> {
    let part = tempfile::Builder::new()
        .prefix(".")
        .suffix(PART)
        .permissions(Permissions::from_mode(0o664))
        .tempfile_in(root);
    part.map_err(|e| StoreError::Io { doing: "creating a file in", path: root.to_owned(), source: e })
}

/// Returns true for a marker that another process is writing, or that a killed process left.
fn is_part(path: &Path) -> bool {
    let is_named = path.file_name().is_some_and(|name| name.as_encoded_bytes().ends_with(PART.as_bytes()));
    let is_begun = |bytes: &[u8]| {
        [StoreKind::Local, StoreKind::Shared].iter().any(|kind| kind.text().as_bytes().starts_with(bytes))
    };
    is_named && files::read_with(path, LinkRule::Refuse, MAX_TEXT).is_ok_and(|bytes| is_begun(&bytes))
}

impl StoreDisk {
    /// Makes a folder a store of this kind, or finds that it is one. Returns its state before.
    ///
    /// # Errors
    /// [`StoreError::Foreign`] if the folder is something else, [`StoreError::Newer`], or it cannot be
    /// written.
    pub(super) fn claim(&self, kind: StoreKind) -> Result<StoreFolder, StoreError> {
        let root = self.root();
        let state = examine(root, kind)?;
        if state == StoreFolder::Empty {
            self.create_dir(root)?;
            let (part, marker) = (fresh_part(root)?, root.join(VERSION));
            // Synced before anything else: a newer program reads from it which format the store has.
            let careful = self.syncing_each();
            careful.write(part.path(), kind.text().as_bytes())?;
            // A link never replaces a file: of two processes that claim the folder, one makes the marker.
            if !careful.link_new(part.path(), &marker)? {
                // The other process may have claimed the folder as the other kind of store.
                examine(root, kind)?;
            }
        }
        Ok(state)
    }

    /// Gives a store of an earlier version its marker. The caller holds the lock, if there is one.
    pub(super) fn mark_earlier(&self, kind: StoreKind) -> Result<(), StoreError> {
        let (part, marker) = (fresh_part(self.root())?, self.root().join(VERSION));
        self.syncing_each().write_atomically(&marker, part.path(), kind.text().as_bytes())
    }
}
