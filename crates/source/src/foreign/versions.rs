//! Versions of the programs that this program runs by itself. A program must be run to learn its
//! version. A step that may not run anything takes the version that was found before, or has no
//! version.

use gs2e_files::programs::ProgramFinder;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Name of COLMAP's program.
pub(super) const COLMAP: &str = "colmap";
/// Name of ffmpeg's program.
pub(super) const FFMPEG: &str = "ffmpeg";
/// Name of Python's program.
pub(super) const PYTHON: &str = "python3";
/// Python's option for an isolated run: without modules of the current folder, without Python's
/// environment variables, and without the user's packages.
pub(super) const ISOLATED: &str = "-I";

/// A program that is run without being named by a recipe.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum VersionQuery {
    /// COLMAP.
    Colmap,
    /// Python with its packages.
    Python,
    /// ffmpeg.
    Ffmpeg,
}

/// The version that a program stated, and the files that it depends on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProgramVersion {
    /// The version of the program and of its packages, or a sentence that says what is absent. It
    /// enters keys.
    pub text: String,
    /// The program and the folders of its packages. While none of them changes, the program states
    /// the same version.
    pub grounds: Vec<PathBuf>,
}

impl VersionQuery {
    /// Name under which the program is looked up.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Colmap => COLMAP,
            Self::Python => PYTHON,
            Self::Ffmpeg => FFMPEG,
        }
    }

    /// Absolute path of the program; `None` if it is absent.
    #[must_use]
    pub fn path(self, programs: &ProgramFinder) -> Option<PathBuf> {
        programs.find(Path::new(self.name())).ok()
    }

    /// Asks the program for its version.
    #[must_use]
    pub fn version(self, programs: &ProgramFinder) -> ProgramVersion {
        let (text, folders) = match self {
            // An absent program has a sentence as its version, so that installing it changes the
            // key.
            Self::Colmap => (colmap(programs).unwrap_or_else(|absent| absent), Vec::new()),
            Self::Ffmpeg => (ffmpeg(programs).unwrap_or_else(|absent| absent), Vec::new()),
            Self::Python => {
                let folders = python(programs).map(|packages| packages.folders).unwrap_or_default();
                (packages(programs), folders)
            }
        };
        ProgramVersion { text, grounds: self.path(programs).into_iter().chain(folders).collect() }
    }
}

/// Versions of the packages that a Python has.
#[derive(Debug, Clone, PartialEq, Eq, Default, Deserialize)]
pub struct PackageVersions {
    /// Version of numpy, for arrays.
    pub numpy: Option<String>,
    /// Version of OpenCV.
    pub cv2: Option<String>,
    /// Version of h5py, for HDF5.
    pub h5py: Option<String>,
    /// Folders in which packages are installed.
    pub folders: Vec<PathBuf>,
}

const LISTS_PACKAGES: &str = "
import importlib, json, os, sys
def version(name):
    try:
        return str(importlib.import_module(name).__version__)
    except ImportError:
        return None
found = {name: version(name) for name in ('numpy', 'cv2', 'h5py')}
print(json.dumps({**found, 'folders': [path for path in sys.path if os.path.isdir(path)]}))
";

/// Returns COLMAP's version in its own words, `COLMAP 3.8`.
///
/// # Errors
/// The program is absent, or does not state its version. The text is a sentence for people.
pub fn colmap(programs: &ProgramFinder) -> Result<String, String> {
    let said = programs.ask(COLMAP, &["help"])?;
    // The first line is `COLMAP 3.8 -- Structure-from-Motion and Multi-View Stereo`.
    let mut lines = said.lines().map(|line| line.split(" -- ").next().unwrap_or(line).trim());
    let name = lines.find(|line| line.starts_with("COLMAP "));
    name.map(str::to_owned).ok_or_else(|| format!("the program `{COLMAP}` does not report its version"))
}

/// Returns ffmpeg's version in its own words, `ffmpeg version 5.1.8`.
///
/// # Errors
/// The program is absent, or does not state its version. The text is a sentence for people.
pub fn ffmpeg(programs: &ProgramFinder) -> Result<String, String> {
    let said = programs.ask(FFMPEG, &["-version"])?;
    // The first line is `ffmpeg version 5.1.8-0+deb12u1 Copyright (c) 2000-2025 the FFmpeg developers`.
    let mut lines = said.lines().map(|line| line.split(" Copyright").next().unwrap_or(line).trim());
    let name = lines.find(|line| line.starts_with("ffmpeg version "));
    name.map(str::to_owned).ok_or_else(|| format!("the program `{FFMPEG}` does not report its version"))
}

/// Returns the versions of Python's packages.
///
/// # Errors
/// Python is absent, or does not list its packages. The text is a sentence for people.
pub fn python(programs: &ProgramFinder) -> Result<PackageVersions, String> {
    let said = programs.ask(PYTHON, &[ISOLATED, "-c", LISTS_PACKAGES])?;
    // Packages may print warnings while they are imported.
    let list = said.lines().rev().find_map(|line| serde_json::from_str(line).ok());
    list.ok_or_else(|| format!("the program `{PYTHON}` does not list its packages"))
}

/// Returns the versions of these packages, each with its name.
///
/// # Errors
/// Python or a package is absent. The text is a sentence for people that names the first one.
pub(super) fn having(wanted: &[&str], programs: &ProgramFinder) -> Result<String, String> {
    let packages = python(programs)?;
    let version = |name: &&str| {
        let (known, found) = match *name {
            "cv2" => ("OpenCV", &packages.cv2),
            "h5py" => ("h5py", &packages.h5py),
            _ => ("numpy", &packages.numpy),
        };
        let found = found.as_ref().ok_or_else(|| format!("{PYTHON} has no package `{name}`"))?;
        Ok(format!("{known} {found}"))
    };
    wanted.iter().map(version).collect::<Result<Vec<_>, String>>().map(|all| all.join(", "))
}

/// Python's packages as one text: versions, and sentences for those that are absent.
#[must_use]
pub fn packages(programs: &ProgramFinder) -> String {
    let one = |name| having(&[name], programs).unwrap_or_else(|absent| absent);
    ["numpy", "cv2", "h5py"].map(one).join(", ")
}
