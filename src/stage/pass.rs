//! One pass of a renderer over the poses of a trajectory, for all steps that take them.
//!
//! A step that is made of rendered poses takes them one after the other as a [`PoseTaker`]. Alone, it
//! has a pass of its own. Together with others, the renderer projects and sorts each pose once and
//! blends the images that all of them want. The values of an image do not depend on the others, and
//! the counts of a taker's work do not either, so the products are the same bytes.

mod readers;

use super::events::EventsStage;
use super::shot::ShotParameters;
use super::wired::AnyStep;
use super::{StageContext, StageError, StepId, StepNeed};
use crate::artifact::{Artifact as _, ArtifactError, ArtifactFiles, TrajectoryProduct};
use crate::camera::{Camera, CameraChoice};
use crate::frames::rendered::RenderedPose;
use crate::render::backend::Backend;
use crate::render::{ChannelSet, OmissionPolicy, RenderChoice, Renderer};
use crate::scene::Gaussians;
use crate::source::Capture;
pub(super) use readers::PoseReaders;
use std::fmt::Debug;
use std::sync::Arc;

/// What the steps of a pass have in common.
#[derive(Debug, Clone, PartialEq)]
pub struct SharedPass {
    inputs: Vec<StepId>,
    camera: Option<CameraChoice>,
    render: RenderChoice,
    omit: OmissionPolicy,
    class: String,
}

/// The part of a stage in a pass.
#[derive(Debug, Clone, Copy)]
pub enum PassRole<'a> {
    /// Simulation of sensors. It asks for each frame when it needs it, so it leads the pass.
    Events(&'a EventsStage),
    /// A product of rendered poses.
    Poses(&'a dyn PoseStage),
}

/// A stage whose product is made of rendered poses.
pub trait PoseStage: Debug + Sync {
    /// Camera and rendering.
    fn shot(&self) -> &ShotParameters;

    /// Memory per pixel in addition to that of the renderer, bytes.
    fn bytes_a_pixel(&self) -> u64;

    /// The taker of the poses.
    ///
    /// # Errors
    /// The product cannot be made of this trajectory.
    fn taker(&self, ground: &PassGround, camera: Camera) -> Result<Box<dyn PoseTaker>, StageError>;
}

/// The state of a product that is made while the poses of a trajectory are rendered in order.
pub trait PoseTaker {
    /// The images that it wants of the next pose. Called for each pose.
    fn want(&mut self, pose: usize, renderer: &mut dyn Renderer) -> ChannelSet;

    /// Takes the pose, with the images that it wanted and perhaps others.
    ///
    /// # Errors
    /// The work fails, or was cancelled.
    fn take(&mut self, pose: RenderedPose<'_>, cx: &StageContext<'_>) -> Result<(), StageError>;

    /// Writes what remains after the last pose.
    ///
    /// # Errors
    /// The work fails.
    fn finish(self: Box<Self>, cx: &mut StageContext<'_>) -> Result<(), StageError>;
}

/// The inputs of a pass.
#[derive(Debug)]
pub struct PassGround {
    pub(super) capture: Capture,
    pub(super) gaussians: Arc<Gaussians>,
    pub(super) motion: TrajectoryProduct,
}

impl PassGround {
    pub(super) fn new((capture, gaussians, motion): (Capture, Gaussians, TrajectoryProduct)) -> Self {
        Self { capture, gaussians: Arc::new(gaussians), motion }
    }

    fn open(files: &[ArtifactFiles]) -> Result<Self, ArtifactError> {
        let [capture, gaussians, motion] = files else {
            unreachable!("a pass has a capture, a scene and a trajectory");
        };
        Ok(Self::new((
            Capture::open(capture)?,
            Gaussians::open(gaussians)?,
            TrajectoryProduct::open(motion)?,
        )))
    }

    /// Number of poses.
    pub(super) fn poses(&self) -> usize {
        self.motion.trajectory.world_from_camera.len()
    }
}

impl PassRole<'_> {
    fn shot(&self) -> ShotParameters {
        match self {
            Self::Events(stage) => stage.shot(),
            Self::Poses(stage) => stage.shot().clone(),
        }
    }

    fn bytes_a_pixel(&self) -> u64 {
        match self {
            Self::Events(stage) => stage.bytes_a_pixel(),
            Self::Poses(stage) => stage.bytes_a_pixel(),
        }
    }
}

impl SharedPass {
    /// The pass that a step can share. `None` for a step that takes no poses, and for renderings of a
    /// GPU: the images of one kernel need not be those of another.
    #[must_use]
    pub fn of(step: &dyn AnyStep) -> Option<Self> {
        let ShotParameters { camera, render, omit, backend } = step.role()?.shot();
        let inputs = step.inputs().into_iter().map(|(_, input)| input).collect();
        let shares = matches!(backend, Backend::Cpu | Backend::Reference);
        shares.then(|| Self { inputs, camera, render, omit, class: backend.class() })
    }
}

/// Resources of a pass of these steps, by the sizes of their inputs.
///
/// # Panics
/// There is no step, or one takes no poses.
#[must_use]
pub fn shared_need(steps: &[&dyn AnyStep], files: &[ArtifactFiles]) -> StepNeed {
    let roles: Vec<PassRole<'_>> = steps.iter().map(|step| step.role().expect("it takes poses")).collect();
    let shot = roles.first().expect("a pass has a step").shot();
    let others = roles.iter().map(PassRole::bytes_a_pixel).sum();
    super::rendering_need(&shot.backend, shot.camera, files, others)
}

/// A step of a pass.
#[derive(Debug)]
pub struct PassStep<'a> {
    /// The step.
    pub step: &'a dyn AnyStep,
    /// Its facilities.
    pub cx: StageContext<'a>,
}

/// The end of a step of a pass.
#[derive(Debug, Default)]
pub struct PassEnd {
    /// The outcome; `None` if the pass ended early for a reason that is not the step's own. The step
    /// must then be made alone.
    pub made: Option<Result<(), StageError>>,
    /// Durations.
    pub seconds: PassSeconds,
}

/// Durations of a step of a pass.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PassSeconds {
    /// Its share of the pass, s: its own work, and an equal part of each rendering that it took. The
    /// shares of all steps add up to the pass.
    pub share: f64,
    /// An estimate of what it takes alone, s: its own work, and each rendering that it took.
    pub alone: f64,
    /// Its own work, s, if it does not lead the pass.
    own: f64,
}

/// Makes the products of several steps of one [`SharedPass`]. `files` are those of their inputs;
/// `clock` gives seconds since some moment.
pub fn run_pass(steps: &mut [PassStep<'_>], files: &[ArtifactFiles], clock: fn() -> f64) -> Vec<PassEnd> {
    let began = clock();
    let mut ends: Vec<PassEnd> = steps.iter().map(|_| PassEnd::default()).collect();
    // Each step finds the same error alone.
    let Ok(ground) = PassGround::open(files) else { return ends };
    let mut readers = PoseReaders::new(ground.poses(), clock);
    let (mut leader, mut first) = (None, None);
    for (index, PassStep { step, cx }) in steps.iter_mut().enumerate() {
        match step.role() {
            Some(PassRole::Events(stage)) => leader = Some((index, stage, cx)),
            Some(PassRole::Poses(stage)) => {
                first.get_or_insert(stage);
                readers.add(index, stage, &ground, cx);
            }
            None => {}
        }
    }
    let led = leader.as_ref().map(|(index, ..)| *index);
    if let Some((index, stage, cx)) = leader {
        ends[index].made = Some(stage.lead(ground, &mut readers, cx));
    } else if let Some(stage) = first {
        // Each step that has not seen all poses finds a failure of the renderer again alone.
        let _ = readers.lead(stage.shot(), &ground);
    }
    for (index, end) in readers.finish() {
        ends[index] = end;
    }
    share_rest(&mut ends, led, clock() - began);
    ends
}

/// Adds what is left of the duration of a pass to the shares: to that of the leader, or to all alike.
fn share_rest(ends: &mut [PassEnd], leader: Option<usize>, seconds: f64) {
    let (count, shared) = (ends.len() as f64, ends.iter().map(|end| end.seconds.share).sum::<f64>());
    let rest = (seconds - shared).max(0.0);
    match leader {
        Some(leader) => {
            let others: f64 = ends.iter().map(|end| end.seconds.own).sum();
            ends[leader].seconds = PassSeconds { share: rest, alone: seconds - others, own: 0.0 };
        }
        None => ends.iter_mut().for_each(|end| {
            end.seconds.share += rest / count;
            end.seconds.alone += rest;
        }),
    }
}

/// Makes the product of a step in a pass of its own.
pub(super) fn run_alone(
    stage: &dyn PoseStage,
    inputs: (Capture, Gaussians, TrajectoryProduct),
    cx: &mut StageContext<'_>,
) -> Result<(), StageError> {
    let ground = PassGround::new(inputs);
    let mut readers = PoseReaders::new(ground.poses(), || 0.0);
    readers.add(0, stage, &ground, cx);
    readers.lead(stage.shot(), &ground)?;
    let ends: Vec<(usize, PassEnd)> = readers.finish().collect();
    ends.into_iter().find_map(|(_, end)| end.made).expect("a pass that has not failed is complete")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn end(own: f64, share: f64, alone: f64) -> PassEnd {
        PassEnd { made: None, seconds: PassSeconds { share, alone, own } }
    }

    fn check(mut ends: Vec<PassEnd>, leader: Option<usize>, wanted: &[[f64; 2]]) {
        share_rest(&mut ends, leader, 10.0);
        for (end, [share, alone]) in ends.iter().zip(wanted) {
            let PassSeconds { share: found, alone: found_alone, .. } = end.seconds;
            assert!((found - share).abs() < 1e-12 && (found_alone - alone).abs() < 1e-12, "{end:?}");
        }
        let sum: f64 = ends.iter().map(|end| end.seconds.share).sum();
        assert!((sum - 10.0).abs() < 1e-12, "the shares add up to the pass: {sum}");
    }

    #[test]
    fn the_time_of_a_pass_is_shared_out() {
        // Two takers, with 1 s and 0.5 s of their own, of renderings of 4 s that three or two shared.
        let takers = || vec![end(1.0, 2.5, 5.0), end(0.5, 2.0, 4.5)];
        check(
            [vec![end(0.0, 0.0, 0.0)], takers()].into_iter().flatten().collect(),
            Some(0),
            // The leader did all that the others did not.
            &[[5.5, 8.5], [2.5, 5.0], [2.0, 4.5]],
        );
        // Without a leader, 5.5 s are left for both.
        check(takers(), None, &[[5.25, 10.5], [4.75, 10.0]]);
    }
}
