//! A training and those who wait for it: progress, interruption, and the file that keeps the state.

use super::record::CoursePoint;
use super::schedule::TrainingSchedule;
use std::fmt;
use std::path::Path;

/// Callbacks of a training, and its checkpoint.
pub struct TrainingWatch<'a> {
    /// Asked before every iteration. The training stops when it returns false.
    pub goes_on: &'a (dyn Fn() -> bool + Sync),
    /// Called when the photos are read, and at every report: about twenty times.
    pub news: &'a mut (dyn FnMut(&TrainingNews) + Send),
    /// A clock in seconds, from any origin. Without one, no remaining time is known and none is used
    /// up.
    pub clock: Option<fn() -> f64>,
    /// The checkpoint: read if it exists, and written at every report and when the training is
    /// stopped.
    pub checkpoint: Option<CheckpointFile<'a>>,
}

impl fmt::Debug for TrainingWatch<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("TrainingWatch").field("checkpoint", &self.checkpoint).finish_non_exhaustive()
    }
}

/// The file that keeps the state of a training.
#[derive(Debug, Clone, Copy)]
pub struct CheckpointFile<'a> {
    /// Its path.
    pub path: &'a Path,
    /// True if a file that this training cannot go on from is replaced. Otherwise it is an error,
    /// because a person named the file and may need it.
    pub replaces: bool,
}

/// An event of a training. As text it is a line for people.
#[derive(Debug, Clone, PartialEq)]
pub enum TrainingNews {
    /// The photos were read.
    Read {
        /// Number of photos to train on.
        training: usize,
        /// Number of photos held out.
        held_out: usize,
        /// Number of points.
        points: usize,
    },
    /// The training starts again, because its checkpoint cannot be used.
    Restarted {
        /// The problem with the checkpoint.
        because: String,
    },
    /// A report.
    Report(TrainingReport),
}

/// The state of a training.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrainingReport {
    /// Loss, figures and counts.
    pub point: CoursePoint,
    /// Iterations in all.
    pub iterations: u32,
    /// Seconds that the remaining iterations are expected to take, if a clock is there.
    pub seconds_left: Option<f64>,
}

impl fmt::Display for TrainingNews {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Read { training, held_out, points } => {
                write!(f, "{training} photos to train on, {held_out} held out, {points} points")
            }
            Self::Restarted { because } => write!(f, "starts again: {because}"),
            Self::Report(report) => report.fmt(f),
        }
    }
}

impl fmt::Display for TrainingReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { point, iterations, seconds_left } = self;
        let CoursePoint { iteration, loss, psnr, gaussians } = point;
        write!(f, "{iteration}/{iterations}: loss {loss:.4}")?;
        if let Some(psnr) = psnr {
            write!(f, ", held out {psnr:.2} dB")?;
        }
        write!(f, ", {gaussians} Gaussians")?;
        seconds_left.map_or(Ok(()), |left| write!(f, ", about {left:.0} s left"))
    }
}

/// The pace of a run: time and work since its start.
#[derive(Debug, Clone, Copy)]
pub(super) struct TrainingPace {
    clock: Option<fn() -> f64>,
    began: f64,
    /// The first iteration of this run. A resumed training has others before it.
    first: u32,
}

impl TrainingPace {
    pub(super) fn new(clock: Option<fn() -> f64>, first: u32) -> Self {
        Self { clock, began: clock.map_or(0.0, |clock| clock()), first }
    }

    /// Seconds since the start of this run.
    pub(super) fn seconds(&self) -> Option<f64> {
        self.clock.map(|clock| clock() - self.began)
    }

    /// Seconds that the iterations after `iteration` are expected to take.
    pub(super) fn seconds_left(&self, schedule: &TrainingSchedule, iteration: u32) -> Option<f64> {
        let done = schedule.work(self.first, iteration);
        let left = schedule.work(iteration, schedule.iterations);
        self.seconds().filter(|_| done > 0.0).map(|seconds| seconds * left / done)
    }
}
