//! `gs2e export`: writes a trajectory of a release in the layout of a published method.

use super::{Console, ExitKind, VerbError, on_interrupt, output, path};
use gs2e_export::{
    ExportError, ExportFormat, ExportLoss, ExportPlan, ExportProgress, ExportSubject, FORMATS, SubjectChoice,
    TestViews, format_named, write_export,
};
use gs2e_store::space::is_full;
use indicatif::ProgressBar;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// First time that messages of ROS 2 cannot hold: their seconds have 31 bits.
const MAX_EPOCH_S: f64 = 2_147_483_648.0;

/// Arguments of `export`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Formats: e-nerf, event-3dgs, colmap, eventnerf, e-3dgs, robust-e-nerf, deblur-e-nerf, evdeblurnerf, \
    llff, e2nerf, e2gs, inceventgs, monash-h5, e2vid, e2vid-zip, evreal, dsec, webdataset, parquet, mcap. \
    DIR is written whole or not at all, and export.json in it lists every loss."
)]
pub(super) struct ExportArgs {
    /// Folder of the release
    #[arg(value_name = "RELEASE")]
    release: PathBuf,
    /// Layout to write
    #[arg(long, value_name = "FORMAT")]
    to: String,
    /// Folder to write; it must not exist
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Scene, if the release has several
    #[arg(long, value_name = "ID")]
    scene: Option<String>,
    /// Trajectory, if the scene has several
    #[arg(long, value_name = "NAME")]
    trajectory: Option<String>,
    /// Sensor, if the trajectory has several
    #[arg(long, value_name = "NAME")]
    sensor: Option<String>,
    /// Interval to export, in microseconds of the release [default: all poses]
    #[arg(long, value_name = "START..END", value_parser = parse_window)]
    window: Option<[i64; 2]>,
    /// Hold out every n-th sharp frame
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(2..))]
    test_every: u32,
    /// Hold out the sharp frames of another trajectory of the scene instead
    #[arg(long, value_name = "NAME", conflicts_with = "test_every")]
    test_from: Option<String>,
    /// Time at which the stamps of an mcap begin, in seconds since 1970 [default: 1]
    #[arg(long, value_name = "SECONDS", value_parser = parse_epoch)]
    epoch: Option<i64>,
    /// Write the export although the method assumes something else than the release holds
    #[arg(long)]
    lossy: bool,
}

/// Reads a range of whole microseconds as `FROM..TO`.
pub(in crate::cli) fn parse_window(text: &str) -> Result<[i64; 2], String> {
    let parts = text.split_once("..").and_then(|(a, b)| Some([a.parse().ok()?, b.parse().ok()?]));
    let window = parts.filter(|[start, end]: &[i64; 2]| start < end);
    window.ok_or_else(|| "wanted two whole numbers of microseconds, such as 0..500000".to_owned())
}

/// An epoch in microseconds.
fn parse_epoch(text: &str) -> Result<i64, String> {
    let seconds = text.strip_suffix('s').unwrap_or(text).parse::<f64>().ok();
    let seconds = seconds.filter(|seconds| (0.0..MAX_EPOCH_S).contains(seconds));
    // Below 2^51 microseconds, so the cast is exact.
    #[expect(clippy::cast_possible_truncation, reason = "bounded above")]
    seconds
        .map(|seconds| (seconds * 1e6).round() as i64)
        .ok_or_else(|| format!("wanted seconds from 0 to {MAX_EPOCH_S}, such as 1 or 1700000000"))
}

impl ExportArgs {
    pub(super) fn run(self, console: &Console) -> Result<ExitKind, VerbError> {
        let Some(format) = format_named(&self.to) else {
            let names: Vec<&str> = FORMATS.iter().map(|format| format.name).collect();
            let what = format!("{} is no format of exports", self.to);
            return Err(VerbError::usage("format", what).help(names.join(", ")));
        };
        if self.epoch.is_some() && !format.has_epoch {
            let what = format!("--epoch: {} has no absolute times", format.name);
            return Err(VerbError::usage("epoch", what).help("--to mcap has"));
        }
        output::refuse_inside(&self.out, &self.release, "the release")?;
        let description = self.export(format, console).map_err(Self::to_error)?;
        let selection = &description["selection"];
        let [trajectory, scene] =
            ["trajectory", "scene"].map(|name| selection[name].as_str().unwrap_or_default());
        let (poses, frames, files) = (&selection["poses"], &selection["frames"], &description["files"]);
        let out = self.out.display();
        console
            .note(&format!("{out}: {trajectory} of {scene}, {poses} poses, {frames} frames, {files} files"));
        console.result(&json!({ "output": path(&self.out), "export": description }));
        Ok(ExitKind::Done)
    }

    fn export(&self, format: &ExportFormat, console: &Console) -> Result<Value, ExportError> {
        let open = |scene: Option<&String>, trajectory: Option<&String>| {
            let (scene, trajectory) = (scene.cloned(), trajectory.cloned());
            let choice = SubjectChoice { scene, trajectory, sensor: self.sensor.clone() };
            ExportSubject::open(&self.release, &choice)
        };
        let subject = open(self.scene.as_ref(), self.trajectory.as_ref())?;
        let test = match &self.test_from {
            None => TestViews::Every(self.test_every as usize),
            other => TestViews::From(Box::new(open(Some(&subject.scene), other.as_ref())?)),
        };
        let mut plan = ExportPlan::new(&subject, &test, self.window)?;
        plan.epoch_us = self.epoch.unwrap_or(plan.epoch_us);
        let cancel = on_interrupt().map_err(|_| ExportError::Interrupted)?;
        let progress = BarProgress::new(console, cancel);
        let written = write_export(format, &plan, &self.out, self.lossy, &progress);
        progress.finish();
        written
    }

    fn to_error(error: ExportError) -> VerbError {
        let said = error.to_string();
        match error {
            ExportError::Source(_) => VerbError::failed("input-unreadable", said),
            ExportError::Selection(_) => VerbError::usage("selection", said),
            ExportError::Exists { .. } => VerbError::usage("output-unwritable", said),
            ExportError::Data(_) => VerbError::failed("not-written", said),
            ExportError::Interrupted => VerbError::interrupted(said),
            ExportError::Write(error) => {
                let code = if is_full(&error) { "disk-full" } else { "output-unwritable" };
                VerbError::failed(code, said)
            }
            ExportError::Unmet { unmet, .. } => {
                let lines = unmet.iter().map(|need| format!("{}: {}", need.what, need.remedy));
                VerbError::usage("unmet", said).details(lines).help("build a release that meets them")
            }
            ExportError::Lossy { losses, .. } => {
                let line = |loss: &ExportLoss| format!("{}: {}", loss.field, loss.what);
                let lines = losses.iter().filter(|loss| loss.figure.is_some()).map(line);
                VerbError::usage("lossy", said).details(lines).help("pass --lossy to write it anyway")
            }
        }
    }
}

/// Shows the number of events, and stops at an interrupt.
pub(super) struct BarProgress {
    bar: ProgressBar,
    pub(super) cancel: Arc<AtomicBool>,
}

impl BarProgress {
    pub(super) fn new(console: &Console, cancel: Arc<AtomicBool>) -> Self {
        // The number of events in an interval is not known before they are read.
        let bar = if console.is_live() { ProgressBar::new_spinner() } else { ProgressBar::hidden() };
        Self { bar, cancel }
    }

    /// Removes the bar from the screen.
    pub(super) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl ExportProgress for BarProgress {
    fn advance(&self, events: u64) {
        self.bar.inc(events);
    }

    fn is_cancelled(&self) -> bool {
        self.cancel.load(Ordering::Relaxed)
    }
}
