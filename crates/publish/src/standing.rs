//! The folder that stands where a release is to go: whether it is a release of this program, and
//! which of its files have the bytes that the release there states.
//!
//! A folder is a release only if `manifest.json` parses in full, and `SHA256SUMS` and `B3SUMS` are
//! in their one form and list what it lists. Only files with the stated bytes count as sound, and
//! only sound files are ever removed.

use super::ReleaseError;
use super::removal::remove_ours;
use gs2e_files as files;
use gs2e_files::{LinkRule, MAX_DOCUMENT};
use gs2e_release::manifest::ReleaseManifest;
use gs2e_release::signature::ReleaseSignature;
use gs2e_release::{checksum, manifest, signature};
use gs2e_store::Digest;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::Metadata;
use std::io;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use walkdir::WalkDir;

/// The manifest's format that this program writes.
pub(super) const FORMAT: u32 = 1;

/// The fields by which a file that was read is recognised without reading it again. The ctime is
/// not among them, since a second name in the new release changes it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct FileMark {
    device: u64,
    inode: u64,
    size: u64,
    /// Time of the last change of its bytes: seconds and nanoseconds.
    modified: [i64; 2],
}

impl FileMark {
    fn of(about: &Metadata) -> Self {
        Self {
            device: about.dev(),
            inode: about.ino(),
            size: about.size(),
            modified: [about.mtime(), about.mtime_nsec()],
        }
    }
}

/// A file with the bytes that its release states.
#[derive(Debug)]
struct SoundFile {
    mark: FileMark,
    blake3: Digest,
    /// Number of names that it had when it was read.
    links: u64,
}

/// The folder that stands at a target, as it was read.
#[derive(Debug)]
pub(super) struct StandingTree {
    folder: PathBuf,
    /// The bytes of `B3SUMS`; `None` where the folder is not a release.
    b3: Option<String>,
    sound: BTreeMap<String, SoundFile>,
    /// Deviations from a whole release, in words, sorted by path.
    oddities: Vec<String>,
}

impl StandingTree {
    /// Reads every file of `folder`.
    ///
    /// # Errors
    /// The folder cannot be listed, or `cancel` is set.
    pub(super) fn read(folder: &Path, cancel: &AtomicBool) -> Result<Self, ReleaseError> {
        let mut tree =
            Self { folder: folder.to_owned(), b3: None, sound: BTreeMap::new(), oddities: Vec::new() };
        let lists = match ReleaseLists::read(folder) {
            Ok(lists) => lists,
            Err(because) => {
                tree.oddities.push(because);
                // Without lists no file is sound, and none needs to be read.
                return Ok(tree);
            }
        };
        let (found, mut oddities) = list(folder, &lists).map_err(super::failed(folder))?;
        let missing = lists.sums.keys().filter(|path| !found.contains(path.as_str()));
        oddities.extend(missing.map(|path| format!("{path} is missing")));
        let judge = |path: String| {
            if cancel.load(Ordering::Relaxed) {
                return Err(ReleaseError::Interrupted);
            }
            Ok(match lists.judge(folder, &path) {
                Ok(sound) => (path, Ok(sound)),
                Err(because) => (path.clone(), Err(format!("{path} {because}"))),
            })
        };
        let judged: Result<Vec<_>, ReleaseError> = found.into_par_iter().map(judge).collect();
        for (path, judged) in judged? {
            match judged {
                Ok(sound) => {
                    tree.sound.insert(path, sound);
                }
                Err(oddity) => oddities.push(oddity),
            }
        }
        // The files were judged in parallel, so without the sort the message would change from run to run.
        oddities.sort();
        tree.oddities = oddities;
        tree.b3 = Some(lists.b3_text);
        Ok(tree)
    }

    /// Returns true if it is a release of this program, with or without edited and additional
    /// files.
    pub(super) fn is_release(&self) -> bool {
        self.b3.is_some()
    }

    /// Deviations from a whole release; empty for a whole release.
    pub(super) fn oddities(&self) -> &[String] {
        &self.oddities
    }

    /// Returns true if the folder is whole and its `B3SUMS` is this text. Every other file is then
    /// that of the release with this `B3SUMS`.
    pub(super) fn is_the_release_of(&self, b3: &str) -> bool {
        self.oddities.is_empty() && self.b3.as_deref() == Some(b3)
    }

    /// Returns true if one of its files has another name, for example in the store.
    pub(super) fn shares_files(&self) -> bool {
        self.sound.values().any(|file| file.links > 1)
    }

    /// The file at `path`, if it has these bytes and no other name.
    pub(super) fn unshared(&self, path: &str, blake3: &Digest) -> Option<PathBuf> {
        let file = self.sound.get(path)?;
        (file.blake3 == *blake3 && file.links == 1).then(|| self.folder.join(path))
    }

    /// The paths of its sound files, with their BLAKE3.
    pub(super) fn sums(&self) -> impl Iterator<Item = (&str, Digest)> {
        self.sound.iter().map(|(path, file)| (path.as_str(), file.blake3))
    }

    /// The number of its sound files and their bytes.
    pub(super) fn size(&self) -> (usize, u64) {
        (self.sound.len(), self.sound.values().map(|file| file.mark.size).sum())
    }

    /// The first entry that changed since the folder was read, by its path, if any did.
    ///
    /// # Errors
    /// The folder cannot be listed.
    pub(super) fn changed(&self) -> io::Result<Option<String>> {
        let mut seen = 0;
        for entry in WalkDir::new(&self.folder).min_depth(1).sort_by_file_name() {
            let entry = entry?;
            // A new folder counts by the files in it; an empty one is kept aside when the rest
            // goes.
            if entry.file_type().is_dir() {
                continue;
            }
            let below = entry.path().strip_prefix(&self.folder).expect("a walk stays below its root");
            let path = below.to_string_lossy();
            if !self.sound.get(path.as_ref()).is_some_and(|file| is_same(file, &entry)) {
                return Ok(Some(path.into_owned()));
            }
            seen += 1;
        }
        Ok((seen < self.sound.len()).then(|| "a file was removed".to_owned()))
    }

    /// Removes its sound files at `folder`, where the tree may have been moved to, if they are
    /// unchanged since they were read. Returns true if the folder is gone.
    ///
    /// # Errors
    /// A folder cannot be listed, or a file or folder cannot be removed.
    pub(super) fn remove_at(&self, folder: &Path) -> io::Result<bool> {
        let is_ours = |path: &str, about: &Metadata| {
            self.sound.get(path).is_some_and(|file| file.mark == FileMark::of(about))
        };
        remove_ours(folder, self.sound.keys().map(String::as_str), &is_ours)
    }
}

fn is_same(file: &SoundFile, entry: &walkdir::DirEntry) -> bool {
    entry.file_type().is_file() && entry.metadata().is_ok_and(|about| file.mark == FileMark::of(&about))
}

/// The listed files that exist, and entries that have no place in a release.
fn list(folder: &Path, lists: &ReleaseLists) -> io::Result<(BTreeSet<String>, Vec<String>)> {
    let (mut found, mut oddities) = (BTreeSet::new(), Vec::new());
    for entry in WalkDir::new(folder).min_depth(1).sort_by_file_name() {
        let entry = entry?;
        let below = entry.path().strip_prefix(folder).expect("a walk stays below its root");
        let kind = entry.file_type();
        let listed =
            |path: &&str| [checksum::NAME, signature::NAME].contains(path) || lists.sums.contains_key(*path);
        match below.to_str().filter(listed) {
            _ if kind.is_dir() => {
                if entry.path().read_dir()?.next().is_none() {
                    oddities.push(format!("{} is an empty folder", below.display()));
                }
            }
            Some(path) if kind.is_file() => {
                found.insert(path.to_owned());
            }
            Some(path) => oddities.push(format!("{path} is not a regular file")),
            None => oddities.push(format!("{} is not listed", below.display())),
        }
    }
    Ok((found, oddities))
}

/// The lists of a release, which agree with each other.
struct ReleaseLists {
    b3_text: String,
    b3: BTreeMap<String, String>,
    sums: BTreeMap<String, String>,
}

impl ReleaseLists {
    /// Reads the lists; the error says why the folder is not a release.
    fn read(folder: &Path) -> Result<Self, String> {
        let read = |name: &str| {
            let bytes = files::read_with(&folder.join(name), LinkRule::Refuse, MAX_DOCUMENT);
            bytes.map_err(|e| match e.kind() {
                io::ErrorKind::NotFound => format!("it has no {name}"),
                _ => format!("its {name} cannot be read: {e}"),
            })
        };
        let manifest_bytes = read(manifest::NAME)?;
        let manifest: ReleaseManifest = serde_json::from_slice(&manifest_bytes)
            .map_err(|e| format!("its {} is not that of a release: {e}", manifest::NAME))?;
        if manifest.format != FORMAT {
            return Err(format!("its {} has format {}, not {FORMAT}", manifest::NAME, manifest.format));
        }
        let sums = |name: &str| -> Result<(String, BTreeMap<String, String>), String> {
            let parsed = String::from_utf8(read(name)?).ok().and_then(|text| Some((parse(&text)?, text)));
            parsed
                .map(|(sums, text)| (text, sums))
                .ok_or_else(|| format!("its {name} is not that of a release"))
        };
        let ((_, sums), (b3_text, b3)) = (sums(checksum::NAME)?, sums(checksum::B3_NAME)?);
        let lists = Self { b3_text, b3, sums };
        if lists.agree(&manifest, &manifest_bytes) {
            Ok(lists)
        } else {
            let [a, b, c] = [manifest::NAME, checksum::NAME, checksum::B3_NAME];
            Err(format!("its {a}, {b} and {c} do not agree"))
        }
    }

    fn agree(&self, manifest: &ReleaseManifest, manifest_bytes: &[u8]) -> bool {
        let stated = manifest.scenes.iter().flat_map(|scene| &scene.files).chain(&manifest.files);
        let mut stated: BTreeMap<&str, String> =
            stated.map(|file| (file.path.as_str(), file.blake3.to_string())).collect();
        // The manifest lists all files but itself and the two files of sums.
        stated.insert(manifest::NAME, Digest::of_bytes(manifest_bytes).to_string());
        let is_same = |(path, sum): (&String, &String)| stated.get(path.as_str()) == Some(sum);
        // `SHA256SUMS` lists `B3SUMS` as well, and `B3SUMS` lists neither.
        let both = self.b3.keys().map(String::as_str).chain([checksum::B3_NAME]).collect::<BTreeSet<_>>();
        let of_b3 = self.sums.get(checksum::B3_NAME);
        self.b3.len() == stated.len()
            && self.b3.iter().all(is_same)
            && both.into_iter().eq(self.sums.keys().map(String::as_str))
            && of_b3 == Some(&checksum::sha256_hex(self.b3_text.as_bytes()))
    }

    /// Reads a file that is listed; the error says what is wrong with it.
    fn judge(&self, folder: &Path, path: &str) -> Result<SoundFile, String> {
        let file = files::open_with(&folder.join(path), LinkRule::Refuse);
        // The mark is older than the bytes, so a write during the read shows as a change later.
        let about = file.and_then(|file| file.metadata());
        let about = about.map_err(|e| format!("cannot be read: {e}"))?;
        let hashes = checksum::hash_file(&folder.join(path)).map_err(|e| format!("cannot be read: {e}"))?;
        let is_stated = match path {
            // No list has its sum, but it was parsed in its one form.
            checksum::NAME => true,
            // A signature that a person made stays theirs.
            signature::NAME => ReleaseSignature::read(folder).is_ok_and(|read| {
                read.is_some_and(|parsed| parsed.is_ok_and(|signature| signature.is_by_this_program()))
            }),
            checksum::B3_NAME => self.sums.get(path) == Some(&hashes.sha256),
            _ => {
                self.b3.get(path) == Some(&hashes.blake3.to_string())
                    && self.sums.get(path) == Some(&hashes.sha256)
            }
        };
        if !is_stated {
            return Err("was edited".to_owned());
        }
        Ok(SoundFile { mark: FileMark::of(&about), blake3: hashes.blake3, links: about.nlink() })
    }
}

/// Reads sums in their one form, in which [`checksum::sums_text`] writes them.
fn parse(text: &str) -> Option<BTreeMap<String, String>> {
    let line = |line: &str| line.split_once("  ").map(|(sum, path)| (path.to_owned(), sum.to_owned()));
    let sums: BTreeMap<String, String> = text.lines().map(line).collect::<Option<_>>()?;
    let rewritten = checksum::sums_text(sums.iter().map(|(path, sum)| (path.as_str(), sum.clone())));
    (rewritten == text).then_some(sums)
}
