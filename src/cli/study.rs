//! `gs2e study`: measurements over one scene.

mod cost;
mod subject;
mod thresholds;
mod work_precision;

use super::Common;
use super::console::Console;
use super::message::{Level, Message};
use super::problem::{Exit, Problem};
use crate::sensor::SimulateError;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};

/// Arguments of `study`.
#[derive(Debug, clap::Args)]
#[command(args_conflicts_with_subcommands = true)]
pub(super) struct Study {
    #[command(subcommand)]
    of: Option<Of>,
    #[command(flatten)]
    work_precision: work_precision::WorkPrecision,
}

#[derive(Debug, clap::Subcommand)]
enum Of {
    /// Sweep the contrast threshold: count the events of each, and those that come from smooth motion
    Thresholds(thresholds::Thresholds),
}

impl Study {
    pub(super) fn run(self, common: &Common, console: &Console) -> Result<Exit, Problem> {
        match self.of {
            Some(Of::Thresholds(study)) => study.run(common, console),
            None => self.work_precision.run(common, console),
        }
    }
}

/// Whether a pass goes on after a frame.
fn go_unless(cancelled: &AtomicBool) -> ControlFlow<()> {
    if cancelled.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
}

/// Why a pass ended early.
fn end_problem(error: SimulateError) -> Problem {
    match error {
        SimulateError::Interrupted => interrupted_problem(),
        e => Problem::failed("step-failed", format!("failed to simulate: {e}")),
    }
}

fn interrupted_problem() -> Problem {
    let what = "interrupted: nothing is written";
    Problem::from_message(Exit::Interrupted, Message::new(Level::Error, "interrupted", what))
}

/// What is told where a frame cannot be rendered.
fn not_rendered(error: &dyn std::error::Error) -> Problem {
    Problem::failed("step-failed", format!("failed to render: {error}"))
}
