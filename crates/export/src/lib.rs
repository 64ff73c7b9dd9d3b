//! Exports: one trajectory of a released tree, in the layout that a published method reads.
//!
//! ```text
//! released tree ── subject ── plan ── format ── folder
//! ```
//! An [`ExportSubject`] is one trajectory with one sensor. An [`ExportPlan`] adds what is decided
//! before anything is written: the interval, the frames and the held-out views. An
//! [`ExportFormat`] names the needs that are not met and the properties that are lost, and writes
//! its files.
//!
//! Layouts are facts about the loaders of these methods. No code of theirs is in this program.
//!
//! It reads the files of a release with `gs2e-tree`, descriptions of scenes in the types of `gs2e-release`,
//! and their recipes with `gs2e-recipe`. Poses, cameras, sensors, events and images are those of
//! `gs2e-trajectory`, `gs2e-num`, `gs2e-scene`, `gs2e-sensor`, `gs2e-event` and `gs2e-image`. It writes
//! models of COLMAP with `gs2e-source`, and files with `gs2e-files`. Only the program uses it.
//!
//! # Examples
//!
//! ```
//! use gs2e_export::{FORMATS, format_named};
//! use std::collections::BTreeSet;
//!
//! // Recordings of ROS have absolute times, and the layout of E-NeRF has not.
//! let mcap = format_named("mcap").ok_or("no such layout")?;
//! let e_nerf = format_named("e-nerf").ok_or("no such layout")?;
//! assert!(mcap.has_epoch && !e_nerf.has_epoch);
//! // A name leads to one layout.
//! let names: BTreeSet<&str> = FORMATS.iter().map(|format| format.name).collect();
//! assert_eq!(names.len(), FORMATS.len());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod brightness;
mod error;
mod formats;
mod geometry;
mod hdf5;
mod included;
mod ledger;
mod npy;
mod plan;
mod poses;
mod subject;
mod tensor;
mod tree;

pub use error::ExportError;
pub use formats::{FORMATS, format_named};
pub use included::IncludedExporter;
pub use ledger::{ExportLoss, LossKind, UnmetNeed};
pub use plan::{ExportPlan, TestViews};
pub use subject::{ExportSubject, SubjectChoice};

use gs2e_tree::Exposure;
use serde_json::{Value, json};
use std::path::Path;
use tree::ExportFolder;

/// A layout of a published method.
#[derive(Debug)]
pub struct ExportFormat {
    /// Name on the command line.
    pub name: &'static str,
    /// The program whose loader reads it, with the commit at which the layout was read.
    consumer: &'static str,
    /// True if its stamps are absolute, and begin at [`ExportPlan::epoch_us`].
    pub has_epoch: bool,
    /// True if a lens that distorts is no obstacle: the layout describes it, or has no camera at all.
    takes_lens: bool,
    unmet: fn(&ExportPlan<'_>) -> Vec<Option<UnmetNeed>>,
    losses: fn(&ExportPlan<'_>) -> Vec<ExportLoss>,
    write: FormatWriter,
}

/// Writes the files of a layout. Returns facts for `export.json`, such as similarity and thresholds.
///
/// It fails if the release cannot be read, a file cannot be written, or the data do not fit the loader.
type FormatWriter = fn(&ExportPlan<'_>, &mut ExportFolder<'_>) -> Result<Value, ExportError>;

impl ExportFormat {
    /// A layout of a camera without a lens, with times from 0. `unmet` are the requirements of the loader
    /// other than such a camera, each where the plan does not meet it; `losses` are the properties of the
    /// release that the layout does not hold, or holds approximately.
    const fn new(
        name: &'static str,
        consumer: &'static str,
        unmet: fn(&ExportPlan<'_>) -> Vec<Option<UnmetNeed>>,
        losses: fn(&ExportPlan<'_>) -> Vec<ExportLoss>,
        write: FormatWriter,
    ) -> Self {
        Self { name, consumer, has_epoch: false, takes_lens: false, unmet, losses, write }
    }

    /// The same layout of a camera with any lens.
    const fn for_any_lens(self) -> Self {
        Self { takes_lens: true, ..self }
    }

    /// The same layout with absolute times.
    const fn with_epoch(self) -> Self {
        Self { has_epoch: true, ..self }
    }

    /// Requirements of the layout that the plan does not meet.
    fn unmet_needs(&self, plan: &ExportPlan<'_>) -> Vec<UnmetNeed> {
        let lens = plan.subject.camera.lens.filter(|_| !self.takes_lens);
        let lens = lens.map(|lens| {
            let what = format!("the lens {lens}, where the loader assumes a pinhole");
            UnmetNeed::new(what, "a camera without `lens`")
        });
        [lens].into_iter().chain((self.unmet)(plan)).flatten().collect()
    }
}

/// Name of the file that describes an export.
pub const DESCRIPTION: &str = "export.json";

/// Writes an export to the folder `to`, which must not exist. The folder appears complete or not at
/// all. Returns the content of its `export.json`.
///
/// # Errors
/// A need is unmet; a property is approximate and `lossy` is false; `to` exists; or reading or
/// writing fails.
pub fn write_export(
    format: &ExportFormat,
    plan: &ExportPlan<'_>,
    to: &Path,
    lossy: bool,
    progress: &dyn ExportProgress,
) -> Result<Value, ExportError> {
    let unmet = format.unmet_needs(plan);
    if !unmet.is_empty() {
        return Err(ExportError::Unmet { format: format.name, unmet });
    }
    // Lost and derived properties follow from the choice of a format; a false assumption does not.
    let losses = [(format.losses)(plan), plan.losses()].concat();
    if !lossy && losses.iter().any(|loss| loss.kind == LossKind::Approximate) {
        return Err(ExportError::Lossy { format: format.name, losses });
    }
    // Only now: a refused export leaves no folder behind.
    let mut out = ExportFolder::create(to, progress)?;
    let facts = (format.write)(plan, &mut out)?;
    let description = json!({
        "format": format.name,
        "consumer": format.consumer,
        "source": plan.subject.release,
        "selection": plan.selection(),
        "losses": losses,
        "facts": facts,
        // With this one.
        "files": out.files() + 1,
    });
    out.write_file(DESCRIPTION, format!("{description:#}\n").as_bytes())?;
    out.place()?;
    Ok(description)
}

/// Receives the progress of an export, and may stop it.
pub trait ExportProgress {
    /// Called after `events` more events were written.
    fn advance(&self, events: u64);

    /// Returns true if the export is to stop.
    fn is_cancelled(&self) -> bool;
}

/// No progress is shown, and nothing stops the export.
#[derive(Debug, Clone, Copy)]
pub struct SilentProgress;

impl ExportProgress for SilentProgress {
    fn advance(&self, _: u64) {}

    fn is_cancelled(&self) -> bool {
        false
    }
}
