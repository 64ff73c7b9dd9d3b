//! Detection of the programs and their versions. Each program is searched once, and only on demand.

use serde::Deserialize;
use std::process::{Command, Stdio};
use std::sync::OnceLock;

/// COLMAP's executable.
pub(super) const COLMAP: &str = "colmap";
/// Python's executable.
pub(super) const PYTHON: &str = "python3";

/// Versions of the Python packages in use.
#[derive(Debug, Clone, PartialEq, Eq, Default, Deserialize)]
pub struct Packages {
    /// numpy, for arrays.
    pub numpy: Option<String>,
    /// OpenCV.
    pub cv2: Option<String>,
    /// h5py, for HDF5.
    pub h5py: Option<String>,
}

const LISTS_PACKAGES: &str = "
import importlib, json
def version(name):
    try:
        return str(importlib.import_module(name).__version__)
    except ImportError:
        return None
print(json.dumps({name: version(name) for name in ('numpy', 'cv2', 'h5py')}))
";

/// Returns COLMAP's own version text, `COLMAP 3.8`.
///
/// # Errors
/// COLMAP is absent. The error is a sentence for the user.
pub fn colmap() -> Result<&'static str, &'static str> {
    static FOUND: OnceLock<Result<String, String>> = OnceLock::new();
    let find = || {
        let said = said_by(COLMAP, &["help"])?;
        let mut lines = said.lines().map(|line| line.split(" -- ").next().unwrap_or(line).trim());
        let name = lines.find(|line| line.starts_with("COLMAP "));
        name.map(str::to_owned)
            .ok_or_else(|| format!("the program `{COLMAP}` does not say which COLMAP it is"))
    };
    FOUND.get_or_init(find).as_ref().map(String::as_str).map_err(String::as_str)
}

/// Returns the installed packages of Python.
///
/// # Errors
/// Python is absent. The error is a sentence for the user.
pub fn python() -> Result<&'static Packages, &'static str> {
    static FOUND: OnceLock<Result<Packages, String>> = OnceLock::new();
    let find = || {
        let said = said_by(PYTHON, &["-c", LISTS_PACKAGES])?;
        serde_json::from_str(&said).map_err(|_| format!("the program `{PYTHON}` does not list its packages"))
    };
    FOUND.get_or_init(find).as_ref().map_err(String::as_str)
}

/// Returns the names and versions of these packages.
///
/// # Errors
/// A package is absent. The error is a sentence for the user.
pub(super) fn having(wanted: &[&str]) -> Result<String, String> {
    let packages = python()?;
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

/// Returns the standard output of a program; its exit code is ignored.
fn said_by(program: &str, arguments: &[&str]) -> Result<String, String> {
    let mut command = Command::new(program);
    command.args(arguments).env("QT_QPA_PLATFORM", "offscreen").stdin(Stdio::null());
    match command.output() {
        Ok(output) => Ok(String::from_utf8_lossy(&output.stdout).into_owned()),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            Err(format!("there is no program `{program}`"))
        }
        Err(error) => Err(format!("the program `{program}` cannot be started: {error}")),
    }
}

/// Returns Python's packages as one text: versions and absent packages.
#[must_use]
pub fn packages() -> String {
    let one = |name| having(&[name]).unwrap_or_else(|absent| absent);
    ["numpy", "cv2", "h5py"].map(one).join(", ")
}
