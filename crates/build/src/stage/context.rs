//! The surroundings of a running stage: its folder, its programs, its warnings, and the flag that stops it.

use super::StageError;
use crate::artifact::write_json;
use gs2e_files as files;
use gs2e_files::Removal;
use gs2e_files::programs::ProgramFinder;
use gs2e_sampling::kept::KeptFrames;
use gs2e_sampling::rendered::TimeSaved;
use gs2e_source::reconstruct::ProgramWorkspace;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Facilities for a running stage.
#[derive(Debug)]
pub struct StageContext<'a> {
    /// Empty folder for its files.
    pub out: &'a Path,
    cancel: &'a AtomicBool,
    /// Warnings.
    pub warnings: Vec<String>,
    /// A short remark on the size of the product, for the progress line.
    pub remark: Option<String>,
    /// A clock in seconds, for reports on the work that enter no product.
    pub clock: Option<fn() -> f64>,
    /// Time saved by leaving work out, if it was measured.
    pub saving: Option<TimeSaved>,
    /// True if programs named by a recipe may be run.
    pub allows_commands: bool,
    /// Destination of the log of external programs. During the run it lies next to the product's
    /// files.
    pub log: Option<PathBuf>,
    /// The programs that can be run.
    pub programs: ProgramFinder,
    /// The receiver of progress within the step, if anything shows it.
    pub progress: Option<StepProgress<'a>>,
    /// The renderings of earlier steps with the same path and style, if they are kept.
    pub kept: Option<Arc<KeptFrames>>,
    /// A folder that outlives an interrupted step, and that only a step with the same key gets. It is
    /// removed when the step is made.
    pub resume: Option<PathBuf>,
}

/// The receiver of a step's progress.
#[derive(Clone, Copy)]
pub struct StepProgress<'a>(pub &'a (dyn Fn(&str) + Sync));

impl StepProgress<'_> {
    /// Passes on the state of the step, in words for people.
    pub fn report(&self, words: &str) {
        (self.0)(words);
    }
}

impl std::fmt::Debug for StepProgress<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("StepProgress").finish_non_exhaustive()
    }
}

impl<'a> StageContext<'a> {
    /// A context that writes to `out` and stops when `cancel` is set.
    #[must_use]
    pub fn new(out: &'a Path, cancel: &'a AtomicBool) -> Self {
        let (warnings, remark, clock, saving) = (Vec::new(), None, None, None);
        let programs = ProgramFinder::default();
        Self {
            out,
            cancel,
            warnings,
            remark,
            clock,
            saving,
            allows_commands: false,
            log: None,
            programs,
            progress: None,
            kept: None,
            resume: None,
        }
    }

    /// Writes a record of the product, as JSON.
    ///
    /// # Errors
    /// The file cannot be written.
    pub(crate) fn write_record<T: Serialize>(&self, name: &str, record: &T) -> Result<(), StageError> {
        let path = self.out.join(name);
        write_json(&path, record).map_err(StageError::io_error(&path))
    }

    /// The file that keeps the state of a step that is interrupted, in a folder that exists; `None`
    /// if the run keeps none.
    ///
    /// # Errors
    /// The folder cannot be created.
    pub(crate) fn resumable(&self) -> Result<Option<PathBuf>, StageError> {
        let Some(folder) = &self.resume else { return Ok(None) };
        std::fs::create_dir_all(folder).map_err(StageError::io_error(folder))?;
        Ok(Some(folder.join("state")))
    }

    /// Returns true if the work has been cancelled.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        // Only the flag matters: no other data is published with it.
        self.cancel.load(Ordering::Relaxed)
    }

    /// Called at every frame or chunk. Returns an error if the work has been cancelled.
    ///
    /// # Errors
    /// [`StageError::Cancelled`].
    pub fn go_on(&self) -> Result<(), StageError> {
        if self.is_cancelled() { Err(StageError::Cancelled) } else { Ok(()) }
    }
}

/// Runs programs that no recipe names in a separate folder that is not part of the product. `name` is
/// unused in the step's folder.
pub(super) fn known_program<T, E>(
    name: &str,
    cx: &StageContext<'_>,
    run: impl FnOnce(ProgramWorkspace<'_>) -> Result<T, E>,
) -> Result<T, StageError>
where
    StageError: From<E>,
{
    cx.go_on()?;
    // Programs work in the root folder, so their paths are absolute.
    let folder = std::path::absolute(cx.out.join(name)).map_err(StageError::io_error(cx.out))?;
    std::fs::create_dir(&folder).map_err(StageError::io_error(&folder))?;
    let log = cx.log.clone().unwrap_or_else(|| folder.join("log.txt"));
    let workspace = ProgramWorkspace {
        folder: &folder,
        log: &log,
        goes_on: &|| !cx.is_cancelled(),
        programs: &cx.programs,
    };
    let made = run(workspace)?;
    // Everything that stays below `out` becomes part of the product.
    files::remove(&folder, Removal::Tree).map_err(StageError::io_error(&folder))?;
    Ok(made)
}
