//! Versions of the programs that are asked about trajectories. To know a version is to run the program,
//! so a step that may not run anything takes the version that was found before, or does without.

use crate::programs::ProgramFinder;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// COLMAP's program.
pub(super) const COLMAP: &str = "colmap";
/// Python's.
pub(super) const PYTHON: &str = "python3";
/// Python's option for a run that takes no module of the current folder, no variable of its own and no
/// package of the user.
pub(super) const ISOLATED: &str = "-I";

/// A program that is asked about trajectories.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum VersionQuery {
    /// COLMAP.
    Colmap,
    /// Python with its packages.
    Python,
}

/// A version that a program said, and the files that it depends on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProgramVersion {
    /// The version of the program and of its packages, or a sentence that says what is absent. It
    /// enters keys.
    pub text: String,
    /// The program and the folders of its packages: while none of them moves, the program says the same
    /// again.
    pub grounds: Vec<PathBuf>,
}

impl VersionQuery {
    /// The name by which it is looked for.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Colmap => COLMAP,
            Self::Python => PYTHON,
        }
    }

    /// Its absolute path; `None` if there is none.
    #[must_use]
    pub fn path(self, programs: &ProgramFinder) -> Option<PathBuf> {
        programs.find(Path::new(self.name())).ok()
    }

    /// Asks it for its version.
    #[must_use]
    pub fn version(self, programs: &ProgramFinder) -> ProgramVersion {
        let (text, folders) = match self {
            Self::Colmap => (colmap(programs).unwrap_or_else(|absent| absent), Vec::new()),
            Self::Python => {
                let folders = python(programs).map(|packages| packages.folders).unwrap_or_default();
                (packages(programs), folders)
            }
        };
        ProgramVersion { text, grounds: self.path(programs).into_iter().chain(folders).collect() }
    }
}

/// The packages that a Python has, by their versions.
#[derive(Debug, Clone, PartialEq, Eq, Default, Deserialize)]
pub struct PackageVersions {
    /// Arrays.
    pub numpy: Option<String>,
    /// OpenCV.
    pub cv2: Option<String>,
    /// HDF5.
    pub h5py: Option<String>,
    /// Where packages are installed.
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

/// COLMAP's version as it says it, `COLMAP 3.8`.
///
/// # Errors
/// A sentence for people if there is none.
pub fn colmap(programs: &ProgramFinder) -> Result<String, String> {
    let said = programs.ask(COLMAP, &["help"])?;
    let mut lines = said.lines().map(|line| line.split(" -- ").next().unwrap_or(line).trim());
    let name = lines.find(|line| line.starts_with("COLMAP "));
    name.map(str::to_owned).ok_or_else(|| format!("the program `{COLMAP}` does not say which COLMAP it is"))
}

/// The packages that Python has.
///
/// # Errors
/// A sentence for people where there is no Python.
pub fn python(programs: &ProgramFinder) -> Result<PackageVersions, String> {
    let said = programs.ask(PYTHON, &[ISOLATED, "-c", LISTS_PACKAGES])?;
    // Packages may print warnings while they are imported.
    let list = said.lines().rev().find_map(|line| serde_json::from_str(line).ok());
    list.ok_or_else(|| format!("the program `{PYTHON}` does not list its packages"))
}

/// The versions of these packages, each with its name.
///
/// # Errors
/// A sentence for people that names the first package that is absent.
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
