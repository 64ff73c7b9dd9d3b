//! `gs2e study`: measurements over one scene, or of one sensor.

mod meter;
mod real;
mod sensor;
mod subject;
mod thresholds;
mod work_precision;

use super::{CommonArgs, Console, ExitKind, VerbError};
use gs2e_lab::work_precision::lab::LabError;
use gs2e_sensor::SimulateError;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};

/// Arguments of `study`.
#[derive(Debug, clap::Args)]
#[command(args_conflicts_with_subcommands = true)]
pub(super) struct StudyArgs {
    #[command(subcommand)]
    of: Option<StudySubcommand>,
    #[command(flatten)]
    work_precision: work_precision::WorkPrecision,
}

#[derive(Debug, clap::Subcommand)]
enum StudySubcommand {
    /// Sweep the contrast threshold: count all events at each value, and those that come from
    /// smooth motion
    Thresholds(thresholds::ThresholdsArgs),
    /// Compare all presets with a recording: frames and the events of the same pixels
    Real(real::RealArgs),
    /// Show a sensor steps of known height and constant light: its contrast, spread and noise next to
    /// what it states
    Sensor(sensor::SensorArgs),
}

impl StudyArgs {
    pub(super) fn run(self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        match self.of {
            Some(StudySubcommand::Thresholds(study)) => study.run(common, console),
            Some(StudySubcommand::Real(study)) => study.run(common, console),
            Some(StudySubcommand::Sensor(study)) => study.run(common, console),
            None => self.work_precision.run(common, console),
        }
    }
}

/// Stops a pass if the run was cancelled.
fn go_unless(cancelled: &AtomicBool) -> ControlFlow<()> {
    if cancelled.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
}

/// The error for a study that ended early.
fn lab_problem(error: LabError) -> VerbError {
    match error {
        LabError::Interrupted => interrupted_problem(),
        LabError::Render(error) => not_rendered(&error),
        LabError::Simulate(error) => end_problem(error),
    }
}

/// The error for a pass that ended early.
fn end_problem(error: SimulateError) -> VerbError {
    match error {
        SimulateError::Interrupted => interrupted_problem(),
        e => VerbError::failed("step-failed", format!("failed to simulate: {e}")),
    }
}

fn interrupted_problem() -> VerbError {
    VerbError::interrupted("interrupted: nothing was written")
}

/// The error for a frame that cannot be rendered.
fn not_rendered(error: &dyn std::error::Error) -> VerbError {
    VerbError::failed("step-failed", format!("failed to render: {error}"))
}
