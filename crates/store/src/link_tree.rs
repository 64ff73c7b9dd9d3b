//! A folder of symbolic links to stored files: one folder per step, one link per output.
//!
//! A link has the name of the output, so other programs know the file by its extension. Nothing but
//! links into the same store is ever replaced or removed.

use super::Store;
use super::record::StoredOutput;
use gs2e_files as files;
use gs2e_files::{PathError, Removal};
use std::collections::BTreeSet;
use std::fs;
use std::io::{self, ErrorKind};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

fn link_error(path: &Path) -> impl FnOnce(io::Error) -> PathError {
    move |source| PathError::new(path, source)
}

/// A folder of links into one store.
#[derive(Debug)]
pub struct LinkTree<'a> {
    store: &'a Store,
    folder: PathBuf,
    /// Absolute path of the store: the links have it in common.
    target: PathBuf,
}

impl<'a> LinkTree<'a> {
    /// The tree in `folder`, which need not exist.
    ///
    /// # Errors
    /// The store's path cannot be resolved.
    pub fn new(store: &'a Store, folder: &Path) -> Result<Self, PathError> {
        let root = store.root();
        let target = fs::canonicalize(root).map_err(link_error(root))?;
        Ok(Self { store, folder: folder.to_owned(), target })
    }

    /// Links the outputs of the step `name`, a path such as `scene/trajectory/events`. Links of an
    /// earlier run that the step no longer has are removed.
    ///
    /// # Errors
    /// A name is taken by something else than a link into the store, or a link cannot be made.
    pub fn link_step(&self, name: &str, outputs: &[StoredOutput]) -> Result<(), PathError> {
        let folder = self.create_folder(Path::new(name))?;
        let wanted: BTreeSet<PathBuf> = outputs.iter().map(|output| folder.join(&output.name)).collect();
        for entry in fs::read_dir(&folder).map_err(link_error(&folder))? {
            let path = entry.map_err(link_error(&folder))?.path();
            if !wanted.contains(&path) && self.is_store_link(&path) {
                files::remove(&path, Removal::File).map_err(link_error(&path))?;
            }
        }
        for output in outputs {
            let below = Path::new(name).join(&output.name);
            if let Some(parent) = below.parent() {
                self.create_folder(parent)?;
            }
            self.link(&folder.join(&output.name), &self.blob_of(output))?;
        }
        Ok(())
    }

    /// Creates a folder below that of the tree. A link on the way would lead to a folder of others, and is
    /// refused.
    fn create_folder(&self, below: &Path) -> Result<PathBuf, PathError> {
        let folder = self.folder.join(below);
        let above = folder.ancestors().take_while(|path| *path != self.folder);
        // Ancestors go from the inside out, so the last one is the outermost link: all others lie behind it.
        if let Some(link) = above.filter(|path| path.is_symlink()).last() {
            let what = "it is a link, and outputs are linked into folders only";
            return Err(link_error(link)(io::Error::new(ErrorKind::AlreadyExists, what)));
        }
        fs::create_dir_all(&folder).map_err(link_error(&folder))?;
        Ok(folder)
    }

    fn blob_of(&self, output: &StoredOutput) -> PathBuf {
        let blob = self.store.path_of(&output.digest);
        blob.strip_prefix(self.store.root()).map_or_else(|_| blob.clone(), |inner| self.target.join(inner))
    }

    /// Returns true for a link into the store.
    fn is_store_link(&self, path: &Path) -> bool {
        fs::read_link(path).is_ok_and(|target| target.starts_with(&self.target))
    }

    fn link(&self, path: &Path, blob: &Path) -> Result<(), PathError> {
        if fs::read_link(path).is_ok_and(|target| target == blob) {
            return Ok(());
        }
        if self.is_store_link(path) {
            files::remove(path, Removal::File).map_err(link_error(path))?;
        }
        symlink(blob, path).map_err(|error| match error.kind() {
            ErrorKind::AlreadyExists => {
                let what = "the name is taken by a file that is not a link into the store";
                link_error(path)(io::Error::new(ErrorKind::AlreadyExists, what))
            }
            _ => link_error(path)(error),
        })
    }
}
