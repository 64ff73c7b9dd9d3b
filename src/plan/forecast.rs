//! Poses, seconds of motion, files and bytes of a plan, before anything is built.
//!
//! The length of a path follows from the recipe, from the trajectory where that is built, or else from
//! the poses and points of its source ([`lengths`]). Pictures without compression have exact sizes. The
//! others take the bytes per pixel of their kind, and events the number per pixel and px of motion, as
//! measured over scenes of many kinds ([`EVENTS_PER_FLOW`]).

mod lengths;

use super::assess::StepAssessment;
use super::{Plan, PlannedStep};
use crate::image::Size;
use crate::recipe::OutputKind;
use crate::sensor::SensorChoice;
use crate::stage::PathLength;
use crate::store::Store;
use lengths::{SceneLengths, TrajectoryLength};
use serde::Serialize;

/// Events per pixel and px of motion at a contrast of 0.2. Measured: 0.15 for a still life, 0.2 for photos of
/// a room, 0.4 for single objects.
const EVENTS_PER_FLOW: f64 = 0.2;
/// Bytes of an event in `events.h5`. Measured: 2.4 to 2.8.
const BYTES_AN_EVENT: f64 = 2.6;
/// Grey at which the noise of a sensor is taken.
const GREY: f64 = 64.0;
/// Bytes of a pose in the text files of a release, `transforms.json` included.
const BYTES_A_POSE: f64 = 900.0;
/// Files of a trajectory besides pictures and events, and of a scene, and of a release.
const FILES: [f64; 3] = [9.0, 1.0, 12.0];
/// Largest number of scenes that are looked at; others are taken to be like these.
const SAMPLED: usize = 16;

/// The sums over the trajectories of a plan.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct PlanForecast {
    /// Number of trajectories with a known length.
    pub trajectories: f64,
    /// Number of their poses.
    pub poses: f64,
    /// Time from their first to their last poses, s.
    pub seconds: f64,
    /// Number of files of a release.
    pub files: f64,
    /// Bytes of these files.
    pub bytes: f64,
    /// Bytes of the events among them, which differ most between scenes.
    pub event_bytes: f64,
    /// `scene/trajectory` of those whose length, or the size of whose pictures, is not known before a build.
    pub unknown: Vec<String>,
}

impl PlanForecast {
    /// Looks ahead. Scenes of which nothing is known are named.
    #[must_use]
    pub fn of_plan(plan: &Plan, assessed: &[StepAssessment], store: &Store) -> Self {
        let count = plan.scenes().len();
        let looked_at = count.min(SAMPLED);
        let mut sum = Self::default();
        for i in 0..looked_at {
            sum.add_scene(plan, i * count / looked_at, assessed, store);
        }
        if sum.trajectories > 0.0 {
            sum.scale(count as f64 / looked_at as f64);
            sum.files += FILES[2];
        }
        sum
    }

    fn add_scene(&mut self, plan: &Plan, scene: usize, assessed: &[StepAssessment], store: &Store) {
        let recipe = &plan.scenes()[scene];
        let mut lengths = SceneLengths::new(plan, scene, assessed, store);
        self.files += FILES[1];
        for trajectory in &recipe.trajectories {
            if recipe.is_of_body(&trajectory.name) {
                continue;
            }
            let found = lengths.of(&trajectory.name);
            let size = lengths.size_along(&trajectory.name);
            match found.zip(size) {
                Some((found, size)) => self.add_trajectory(plan, (scene, &trajectory.name), found, size),
                None => self.unknown.push(format!("{}/{}", recipe.scene, trajectory.name)),
            }
        }
    }

    fn add_trajectory(
        &mut self,
        plan: &Plan,
        (scene, name): (usize, &str),
        length: TrajectoryLength,
        size: Size,
    ) {
        let TrajectoryLength { path, moved_px } = length;
        self.trajectories += 1.0;
        self.poses += path.poses;
        self.seconds += path.seconds;
        self.files += FILES[0];
        self.bytes += path.poses * BYTES_A_POSE;
        let outputs = plan.steps_of(scene).filter_map(|(_, step)| {
            let output = step.name.strip_prefix(name)?.strip_prefix('/')?;
            OutputKind::ALL.iter().any(|kind| kind.name() == output).then_some(step)
        });
        outputs.for_each(|step| self.add_product(step, path, size));
        let recipe = &plan.scenes()[scene];
        if recipe.has_events_along(name) {
            for (_, sensor) in recipe.sensors_of(name).iter() {
                let events = expected_events(sensor, size, path.seconds, moved_px.unwrap_or(0.0));
                self.event_bytes += events * BYTES_AN_EVENT;
                self.bytes += events * BYTES_AN_EVENT;
                self.files += 1.0;
            }
        }
    }

    /// Adds the files of an output; none are known of events.
    fn add_product(&mut self, step: &PlannedStep, path: PathLength, size: Size) {
        let Some(expected) = step.step.expected_size(path) else { return };
        self.files += expected.pictures.unwrap_or(3.0);
        self.bytes += expected.bytes_at(size);
    }

    fn scale(&mut self, factor: f64) {
        let Self { trajectories, poses, seconds, files, bytes, event_bytes, .. } = self;
        for sum in [trajectories, poses, seconds, files, bytes, event_bytes] {
            *sum *= factor;
        }
    }
}

/// Number of events of a sensor: of the motion of the picture, and of noise.
fn expected_events(sensor: &SensorChoice, size: Size, seconds: f64, moved_px: f64) -> f64 {
    let model = sensor.as_model();
    let (on, off) = model.contrast();
    let by_motion = EVENTS_PER_FLOW * moved_px * 0.2 / (0.5 * (on + off));
    size.pixels() as f64 * (by_motion + model.noise_at(GREY).total_hz * seconds)
}
