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
use super::{
    ExpectedSize, OpenedInputs, PathLength, Stage, StageContext, StageError, StageFacts, StepId, StepNeed,
    StepTarget,
};
use crate::artifact::{Artifact, ArtifactError, ArtifactFiles, TrajectoryProduct};
use gs2e_render::backend::Backend;
use gs2e_render::{ChannelSet, OmissionPolicy, RenderChoice, Renderer};
use gs2e_sampling::rendered::{ReaderSeconds, RenderedPose, share_rest};
use gs2e_scene::Gaussians;
use gs2e_scene::camera::{Camera, CameraChoice};
use gs2e_source::Capture;
pub(super) use readers::PoseReaders;
use serde::Serialize;
use std::fmt::Debug;
use std::sync::Arc;

/// Inputs and settings that the steps of a pass have in common.
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

/// The inputs of a pass.
pub type PassInputs = (StepTarget<Capture>, StepTarget<Gaussians>, StepTarget<TrajectoryProduct>);

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

/// A product of rendered poses: a [`Stage`] that only takes poses.
pub trait PoseProduct: PoseStage + Serialize {
    /// See [`Stage::NAME`].
    const NAME: &'static str;
    /// See [`Stage::REVISION`].
    const REVISION: u32;
    /// The product.
    type Output: Artifact;

    /// Its expected size along a path.
    fn size_along(&self, path: PathLength) -> ExpectedSize;

    /// Returns true if other steps can share its pass.
    fn is_shareable(&self) -> bool {
        true
    }
}

impl<P: PoseProduct> StageFacts for P {
    fn class(&self) -> Option<String> {
        Some(self.shot().backend.class())
    }

    fn need(&self, files: &[ArtifactFiles]) -> StepNeed {
        self.shot().need(files, self.bytes_a_pixel())
    }

    fn expected_size(&self, path: PathLength) -> Option<ExpectedSize> {
        Some(self.size_along(path))
    }

    fn role(&self) -> Option<PassRole<'_>> {
        self.is_shareable().then_some(PassRole::Poses(self))
    }
}

impl<P: PoseProduct> Stage for P {
    const NAME: &'static str = P::NAME;
    const REVISION: u32 = P::REVISION;
    type Inputs = PassInputs;
    type Output = P::Output;

    fn run(&self, inputs: OpenedInputs<Self>, cx: &mut StageContext<'_>) -> Result<(), StageError> {
        let ground = PassGround::from(inputs);
        let mut readers = PoseReaders::new(ground.poses(), || 0.0);
        readers.add(0, self, &ground, cx);
        readers.lead(self.shot(), &ground)?;
        let ends: Vec<(usize, PassEnd)> = readers.finish().collect();
        ends.into_iter().find_map(|(_, end)| end.made).expect("a pass that has not failed is complete")
    }
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

impl From<(Capture, Gaussians, TrajectoryProduct)> for PassGround {
    fn from(inputs: (Capture, Gaussians, TrajectoryProduct)) -> Self {
        let (capture, gaussians, motion) = inputs;
        Self { capture, gaussians: Arc::new(gaussians), motion }
    }
}

impl PassGround {
    fn open(files: &[ArtifactFiles]) -> Result<Self, ArtifactError> {
        let [capture, gaussians, motion] = files else {
            unreachable!("a pass has a capture, a scene and a trajectory");
        };
        let (gaussians, motion) = (Arc::new(Gaussians::open(gaussians)?), TrajectoryProduct::open(motion)?);
        Ok(Self { capture: Capture::open(capture)?, gaussians, motion })
    }

    /// Number of poses.
    pub(super) fn poses(&self) -> usize {
        self.motion.trajectory.world_from_camera.len()
    }
}

impl PassRole<'_> {
    fn shot(&self) -> &ShotParameters {
        match self {
            Self::Events(stage) => &stage.shot,
            Self::Poses(stage) => stage.shot(),
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
        let role = step.facts().role()?;
        let ShotParameters { camera, render, omit, backend } = role.shot();
        let inputs = step.inputs().into_iter().map(|(_, input)| input).collect();
        let shares = matches!(backend, Backend::Cpu | Backend::Reference);
        let (camera, render, omit) = (*camera, *render, *omit);
        shares.then(|| Self { inputs, camera, render, omit, class: backend.class() })
    }
}

/// Resources of a pass of these steps, by the sizes of their inputs.
///
/// # Panics
/// There is no step, or one takes no poses.
#[must_use]
pub(crate) fn shared_need(steps: &[&dyn AnyStep], files: &[ArtifactFiles]) -> StepNeed {
    let roles: Vec<PassRole<'_>> =
        steps.iter().map(|step| step.facts().role().expect("it takes poses")).collect();
    let others = roles.iter().map(PassRole::bytes_a_pixel).sum();
    roles.first().expect("a pass has a step").shot().need(files, others)
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
    pub seconds: ReaderSeconds,
}

/// Makes the products of several steps of one [`SharedPass`]. `files` are those of their inputs;
/// `clock` gives seconds since some moment.
pub(crate) fn run_pass(
    steps: &mut [PassStep<'_>],
    files: &[ArtifactFiles],
    clock: fn() -> f64,
) -> Vec<PassEnd> {
    let began = clock();
    let mut ends: Vec<PassEnd> = steps.iter().map(|_| PassEnd::default()).collect();
    // Each step finds the same error alone.
    let Ok(ground) = PassGround::open(files) else { return ends };
    let mut readers = PoseReaders::new(ground.poses(), clock);
    let (mut leader, mut first) = (None, None);
    for (index, PassStep { step, cx }) in steps.iter_mut().enumerate() {
        match step.facts().role() {
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
        // All readers have been added by now. The leader renders each pose once, and a later reader would
        // miss poses.
        ends[index].made = Some(stage.lead(ground, &mut readers, cx));
    } else if let Some(stage) = first {
        // Each step that has not seen all poses finds a failure of the renderer again alone.
        let _ = readers.lead(stage.shot(), &ground);
    }
    for (index, end) in readers.finish() {
        ends[index] = end;
    }
    let durations = ends.iter_mut().map(|end| &mut end.seconds);
    share_rest(durations.collect(), led, clock() - began);
    ends
}
