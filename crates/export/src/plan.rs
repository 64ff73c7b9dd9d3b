//! What is decided before anything is written: the interval, the frames, and the held-out views.

use super::{ExportError, ExportLoss, ExportSubject, Exposure};
use gs2e_event::Event;
use gs2e_num::se3::Se3;
use gs2e_sensor::SensorChoice;
use serde_json::{Value, json};

/// One second: tools of ROS refuse or hide times of 0.
const DEFAULT_EPOCH_US: i64 = 1_000_000;

/// The held-out views.
#[derive(Debug)]
pub enum TestViews {
    /// Every n-th frame of the trajectory, from the first on.
    Every(usize),
    /// All frames of another trajectory of the scene.
    From(Box<ExportSubject>),
}

/// A plan of an export. Its times count from the first pose of the interval.
#[derive(Debug)]
pub struct ExportPlan<'a> {
    /// The trajectory.
    pub subject: &'a ExportSubject,
    /// The held-out views.
    pub test: &'a TestViews,
    /// Poses of the interval: first, and last plus one.
    poses: std::ops::Range<usize>,
    /// Poses of the interval with a sharp picture, ascending.
    pub frames: Vec<usize>,
    /// Time that stamps of formats with absolute times begin at, us since 1970.
    pub epoch_us: i64,
}

impl<'a> ExportPlan<'a> {
    /// Plans an export of the poses from `window_us[0]` to `window_us[1]` in the times of the
    /// release, or of all poses.
    ///
    /// # Errors
    /// The interval has fewer than two poses.
    pub fn new(
        subject: &'a ExportSubject,
        test: &'a TestViews,
        window_us: Option<[i64; 2]>,
    ) -> Result<Self, ExportError> {
        let stamps = &subject.poses.stamps_us;
        let (first, end) = match window_us {
            None => (0, stamps.len()),
            Some([start, end]) => {
                (stamps.partition_point(|t| *t < start), stamps.partition_point(|t| *t <= end))
            }
        };
        // An interval between two poses has an end before its start.
        let poses = first..end;
        if poses.len() < 2 {
            let [first, last] =
                [stamps.first(), stamps.last()].map(|stamp| stamp.copied().unwrap_or_default());
            let because = format!("the window has fewer than 2 of the poses from {first} to {last} us");
            return Err(ExportError::Selection(because));
        }
        let frames = subject.sharp.iter().copied().filter(|pose| poses.contains(pose)).collect();
        Ok(Self { subject, test, poses, frames, epoch_us: DEFAULT_EPOCH_US })
    }

    /// Losses of every layout: none has a place for a rolling shutter, or for light that changes.
    #[must_use]
    pub(super) fn losses(&self) -> Vec<ExportLoss> {
        let readout_us = f64::from(self.subject.readout_us);
        let rolls = (readout_us > 0.0 && !self.frames.is_empty()).then(|| {
            let what = "the rows of sharp frames have times of their own, up to this many us from that of their pose";
            ExportLoss::approximate("shutter", readout_us / 2.0, what)
        });
        let what = "the light of the scene changes with time; the layout has no place for it";
        let lit = self.subject.is_lit.then(|| ExportLoss::lost("lights", what));
        rolls.into_iter().chain(lit).collect()
    }

    /// The exposures within the interval. Their times count from its start, us.
    #[must_use]
    pub(super) fn exposures(&self) -> Vec<Exposure> {
        let [first, last] = self.window_us();
        let within = |exposure: &&Exposure| first <= exposure.open_us[0] && exposure.open_us[1] <= last;
        let moved = |exposure: &Exposure| Exposure {
            pose: exposure.pose,
            open_us: exposure.open_us.map(|t_us| t_us - first),
        };
        self.subject.exposures.iter().filter(within).map(moved).collect()
    }

    /// First and last stamp, in the times of the release, us.
    #[must_use]
    pub(super) fn window_us(&self) -> [i64; 2] {
        let stamps = &self.subject.poses.stamps_us;
        [stamps[self.poses.start], stamps[self.poses.end - 1]]
    }

    /// Length of the interval, us.
    #[must_use]
    pub(super) fn length_us(&self) -> i64 {
        let [start, end] = self.window_us();
        end - start
    }

    /// Stamp of a pose, us from the start of the interval.
    #[must_use]
    pub(super) fn stamp_us(&self, pose: usize) -> i64 {
        self.subject.poses.stamps_us[pose] - self.window_us()[0]
    }

    /// Stamps from the start of the interval in microseconds, with poses, world from camera.
    pub(super) fn poses(&self) -> impl Iterator<Item = (i64, Se3)> + Clone + '_ {
        let poses = &self.subject.poses.world_from_camera;
        self.poses.clone().map(move |pose| (self.stamp_us(pose), poses[pose]))
    }

    /// Number of poses.
    #[must_use]
    pub(super) fn pose_count(&self) -> usize {
        self.poses.len()
    }

    /// The held-out frames: their subject and their poses in it.
    #[must_use]
    pub(super) fn test_frames(&self) -> (&ExportSubject, Vec<usize>) {
        match self.test {
            TestViews::Every(every) => {
                (self.subject, self.frames.iter().copied().step_by((*every).max(1)).collect())
            }
            TestViews::From(other) => (other, other.sharp.clone()),
        }
    }

    /// The frames for training.
    #[must_use]
    pub(super) fn train_frames(&self) -> Vec<usize> {
        let held_out = match self.test {
            TestViews::Every(_) => self.test_frames().1,
            TestViews::From(_) => Vec::new(),
        };
        self.frames.iter().copied().filter(|frame| !held_out.contains(frame)).collect()
    }

    /// The sensor.
    ///
    /// # Errors
    /// The trajectory has no events.
    pub(super) fn sensor(&self) -> Result<&SensorChoice, ExportError> {
        let none = || ExportError::Selection(format!("{} has no events", self.subject.trajectory));
        self.subject.sensor.as_ref().ok_or_else(none)
    }

    /// Calls `see` with each event of the interval and its time from the start, us.
    ///
    /// # Errors
    /// As [`ExportSubject::for_each_event`].
    pub(super) fn for_each_event(
        &self,
        mut see: impl FnMut(&Event, i64) -> Result<(), ExportError>,
    ) -> Result<(), ExportError> {
        let window = self.window_us();
        self.subject.for_each_event(window, |event, t_us| see(event, t_us - window[0]))
    }

    /// The selection, for `export.json`.
    #[must_use]
    pub(super) fn selection(&self) -> Value {
        let test = match self.test {
            TestViews::Every(every) => json!({ "every": every }),
            TestViews::From(other) => json!({ "from": other.trajectory }),
        };
        json!({
            "scene": self.subject.scene, "trajectory": self.subject.trajectory,
            "sensor": self.subject.sensor_name, "window_us": self.window_us(), "poses": self.poses.len(),
            "frames": self.frames.len(), "test": test,
        })
    }
}

/// A time in seconds, with six decimals: exact.
#[must_use]
pub(super) fn seconds_text(t_us: i64) -> String {
    format!("{}.{:06}", t_us / 1_000_000, t_us % 1_000_000)
}
