//! Poses, seconds of motion, files and bytes of a plan, before anything is built.
//!
//! The length of a path follows from the recipe, from the trajectory where that is built, or else from
//! the poses and points of its source (`lengths`). Pictures without compression have exact sizes. The
//! others take the bytes per pixel of their kind, and events the number per pixel and px of motion, as
//! measured over scenes of many kinds (`EVENTS_PER_FLOW`).

mod lengths;

use super::assess::StepAssessment;
use super::{Plan, PlannedStep};
use gs2e_recipe::OutputKind;
use gs2e_sensor::SensorChoice;
use gs2e_store::Store;
use gs2e_store::record::StoredOutput;
use lengths::{SceneLengths, TrajectoryLength};
use serde::Serialize;

/// Events per pixel and px of motion at a contrast of 0.2. Over eight streams of five scenes, 0.09 to 0.40.
const EVENTS_PER_FLOW: f64 = 0.2;
/// Bytes of an event in `events.h5`. In the same streams, 2.45 to 2.79.
const BYTES_AN_EVENT: f64 = 2.55;
/// Grey at which the noise of a sensor is taken.
const GREY: f64 = 64.0;
/// Bytes of a pose in the text files and the picture of a path, and of a sharp frame in `transforms.json`.
const BYTES_A_POSE: f64 = 350.0;
const BYTES_A_FRAME: f64 = 640.0;
/// Bytes that the lists of files take for each file.
const BYTES_A_FILE: f64 = 600.0;
/// Files of a release besides the trajectories, and their bytes.
const TOP: [f64; 2] = [13.0, 200e3];
/// Files of a trajectory besides pictures and events, and their bytes without the poses.
const OF_TRAJECTORY: [f64; 2] = [10.0, 75e3];
/// Bytes of `scene.json`.
const OF_SCENE: f64 = 8e3;
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
    /// `scene/trajectory` of those without a known length or picture size before a build.
    pub unknown: Vec<String>,
}

/// A plan, compared with a store.
#[derive(Clone, Copy)]
struct PlanState<'a> {
    plan: &'a Plan,
    assessed: &'a [StepAssessment],
    store: &'a Store,
}

impl PlanForecast {
    /// Looks ahead. Scenes of which nothing is known are named.
    #[must_use]
    pub fn of_plan(plan: &Plan, assessed: &[StepAssessment], store: &Store) -> Self {
        let count = plan.scenes().len();
        let looked_at = count.min(SAMPLED);
        let mut sum = Self::default();
        for i in 0..looked_at {
            // Spread over the whole plan: neighbours in the order of ids are often scenes of one kind.
            sum.add_scene(PlanState { plan, assessed, store }, i * count / looked_at);
        }
        if sum.trajectories > 0.0 {
            sum.scale(count as f64 / looked_at as f64);
            // After the scaling, because a release has these files once for all scenes.
            sum.files += TOP[0];
            sum.bytes += TOP[1] + sum.files * BYTES_A_FILE;
        }
        sum
    }

    fn add_scene(&mut self, state: PlanState<'_>, scene: usize) {
        let recipe = &state.plan.scenes()[scene];
        let mut lengths = SceneLengths::new(state, scene);
        self.files += 1.0;
        self.bytes += OF_SCENE;
        for trajectory in &recipe.trajectories {
            // The body of a rig sees nothing. Its cameras are trajectories of their own, and are counted.
            if recipe.is_of_body(&trajectory.name) {
                continue;
            }
            match lengths.of(&trajectory.name) {
                Some(found) => self.add_trajectory(state, scene, &trajectory.name, found),
                None => self.unknown.push(format!("{}/{}", recipe.scene, trajectory.name)),
            }
        }
    }

    fn add_trajectory(&mut self, state: PlanState<'_>, scene: usize, name: &str, length: TrajectoryLength) {
        self.trajectories += 1.0;
        self.poses += length.path.poses;
        self.seconds += length.path.seconds;
        self.files += OF_TRAJECTORY[0];
        self.bytes += OF_TRAJECTORY[1] + length.path.poses * BYTES_A_POSE;
        for (id, step) in state.plan.steps_of(scene) {
            let output = step.name.strip_prefix(name).and_then(|rest| rest.strip_prefix('/'));
            let kind = OutputKind::ALL.into_iter().find(|kind| Some(kind.name()) == output);
            match (kind, state.assessed[id.0].outputs.as_deref()) {
                (None, _) => {}
                (Some(kind), Some(made)) => self.add_made(kind, made),
                (Some(kind), None) if kind.is_simulated() => {
                    let sensors = state.plan.scenes()[scene].sensors_of(name);
                    sensors.iter().for_each(|(_, sensor)| self.add_events(sensor, length));
                }
                (Some(kind), None) => self.add_expected(kind, step, length),
            }
        }
    }

    /// Adds the files of an output that is up to date.
    fn add_made(&mut self, kind: OutputKind, made: &[StoredOutput]) {
        // Of a simulation a release has the streams alone: its frames and its record stay in the store.
        let released = |output: &&StoredOutput| !kind.is_simulated() || output.name.ends_with(".h5");
        for output in made.iter().filter(released) {
            self.files += 1.0;
            self.bytes += output.size as f64;
            self.event_bytes += if kind.is_simulated() { output.size as f64 } else { 0.0 };
        }
    }

    /// Adds the stream of a sensor: the events of the motion of the picture, and of noise.
    fn add_events(&mut self, sensor: &SensorChoice, length: TrajectoryLength) {
        let model = sensor.as_model();
        let (on, off) = model.contrast();
        let moved_px = length.moved_px.unwrap_or(0.0);
        // The constant holds for a contrast of 0.2, and the number of events falls as the mean contrast
        // rises.
        let a_pixel = EVENTS_PER_FLOW * moved_px * 0.2 / (0.5 * (on + off))
            + model.array_noise(GREY).total_hz * length.path.seconds;
        let bytes = BYTES_AN_EVENT * a_pixel * length.size.pixels() as f64;
        self.files += 1.0;
        self.bytes += bytes;
        self.event_bytes += bytes;
    }

    /// Adds the files of another output.
    fn add_expected(&mut self, kind: OutputKind, step: &PlannedStep, length: TrajectoryLength) {
        let Some(expected) = step.step.facts().expected_size(length.path) else { return };
        // A product without pictures is inertial data, which has three files.
        self.files += expected.pictures.unwrap_or(3.0);
        self.bytes += expected.bytes_at(length.size);
        if kind.is_listed() {
            self.bytes += expected.pictures.unwrap_or(0.0) * BYTES_A_FRAME;
        }
    }

    fn scale(&mut self, factor: f64) {
        let Self { trajectories, poses, seconds, files, bytes, event_bytes, .. } = self;
        for sum in [trajectories, poses, seconds, files, bytes, event_bytes] {
            *sum *= factor;
        }
    }
}
