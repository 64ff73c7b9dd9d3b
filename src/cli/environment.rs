//! The variables of the environment that the program itself reads. Libraries read others, such as
//! `NO_COLOR`.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

/// Values of the variables; `None` where one is not set.
#[derive(Debug, Clone, Default)]
pub struct Environment {
    /// `PATH`: the folders in which programs are found.
    pub path: Option<OsString>,
    /// `HOME`: the user's folder, which no release replaces.
    pub home: Option<OsString>,
    /// `XDG_CACHE_HOME`: folder of the index of a store on a remote disk.
    pub cache: Option<OsString>,
}

impl Environment {
    /// The environment of this process.
    #[must_use]
    pub fn of_process() -> Self {
        let [path, home, cache] = ["PATH", "HOME", "XDG_CACHE_HOME"].map(std::env::var_os);
        Self { path, home, cache }
    }

    pub(super) fn path(&self) -> Option<&OsStr> {
        self.path.as_deref()
    }

    pub(super) fn home(&self) -> Option<&Path> {
        self.home.as_deref().map(Path::new)
    }

    /// The user's cache folder: `XDG_CACHE_HOME`, else `.cache` in the home folder.
    pub(super) fn cache_folder(&self) -> Option<PathBuf> {
        let given = self.cache.as_ref().map(PathBuf::from);
        given.or_else(|| Some(self.home()?.join(".cache")))
    }
}
