//! The takers of a pass, as one reader of the renderings.

use super::{PassEnd, PassGround, PoseStage, PoseTaker};
use crate::stage::shot::ShotParameters;
use crate::stage::{StageContext, StageError, choose_camera};
use gs2e_render::objects::near_warnings;
use gs2e_render::{ChannelSet, RenderWork, RenderedImages, Renderer};
use gs2e_sampling::rendered::{PoseReader, ReadFrames, ReaderSeconds, RenderedFrames, RenderedPose};
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::CameraView;

/// The steps that take the poses of a pass.
pub(in crate::stage) struct PoseReaders<'p, 'c> {
    steps: Vec<ReadingStep<'p, 'c>>,
    camera: Option<Camera>,
    /// Number of poses of the path, and of those that were read.
    poses: usize,
    read: usize,
    clock: fn() -> f64,
}

/// A step that takes poses.
struct ReadingStep<'p, 'c> {
    /// Index of the step in the pass.
    index: usize,
    /// Its taker, or its failure.
    taker: Result<Box<dyn PoseTaker>, StageError>,
    cx: &'p mut StageContext<'c>,
    /// The images that it wants of the current pose.
    want: ChannelSet,
    seconds: ReaderSeconds,
}

impl<'p, 'c> PoseReaders<'p, 'c> {
    pub(in crate::stage) fn new(poses: usize, clock: fn() -> f64) -> Self {
        Self { steps: Vec::new(), camera: None, poses, read: 0, clock }
    }

    /// Adds a step.
    pub(in crate::stage) fn add(
        &mut self,
        index: usize,
        stage: &dyn PoseStage,
        ground: &PassGround,
        cx: &'p mut StageContext<'c>,
    ) {
        // Each step warns of the camera, as it does alone. All of them choose the same one.
        let camera = choose_camera(stage.shot().camera, &ground.capture, cx);
        self.camera = Some(camera);
        let rules = stage.shot().render.rules;
        cx.warnings.extend(near_warnings(&ground.gaussians, &camera, &ground.motion.trajectory, rules));
        let taker = stage.taker(ground, camera);
        let (want, seconds) = (ChannelSet::NONE, ReaderSeconds::default());
        self.steps.push(ReadingStep { index, taker, cx, want, seconds });
    }

    /// Renders the poses for the steps alone.
    pub(in crate::stage) fn lead(
        &mut self,
        shot: &ShotParameters,
        ground: &PassGround,
    ) -> Result<(), StageError> {
        let Some(camera) = self.camera.filter(|_| self.is_open()) else { return Ok(()) };
        let mut renderer = shot.renderer(ground, camera)?;
        let poses = &ground.motion.trajectory.world_from_camera;
        let velocities = ground.motion.velocities();
        let mut images = RenderedImages::default();
        for (index, (pose, velocity)) in poses.iter().zip(velocities).enumerate() {
            if !self.is_open() {
                break;
            }
            let seconds = ground.motion.trajectory.seconds(index);
            let view = CameraView { velocity, ..CameraView::at_rest(camera, *pose).at_time(seconds) };
            let want = self.want(index, &mut *renderer);
            let (began, mut work) = ((self.clock)(), RenderWork::default());
            if !want.is_empty() {
                let rendered = renderer.render(&view, want, &mut images);
                work = rendered.map_err(StageError::work_failed("render"))?;
            }
            let seconds = (self.clock)() - began;
            let (images, renderer) = (&images, &mut *renderer);
            // Also a pose that no step wants: `finish` takes a product as complete only if all poses were
            // read.
            self.read(RenderedPose { index, images, work, seconds, has_frame: false, renderer });
        }
        Ok(())
    }

    /// The frames, whose renderings these steps take.
    pub(in crate::stage) fn reading<'f>(&'f mut self, frames: &'f mut RenderedFrames) -> ReadFrames<'f> {
        let clock = self.clock;
        ReadFrames::new(frames, self, clock)
    }

    /// Returns true while a step has not failed.
    fn is_open(&self) -> bool {
        self.steps.iter().any(|step| step.taker.is_ok())
    }

    /// The ends of the steps, by their index in the pass.
    pub(in crate::stage) fn finish(self) -> impl Iterator<Item = (usize, PassEnd)> + use<'p, 'c> {
        let (is_complete, clock) = (self.read == self.poses, self.clock);
        self.steps.into_iter().map(move |step| step.finish(is_complete, clock))
    }
}

impl ReadingStep<'_, '_> {
    fn wants(&self) -> bool {
        self.taker.is_ok() && !self.want.is_empty()
    }

    fn read(&mut self, pose: RenderedPose<'_>, clock: fn() -> f64) {
        let Ok(taker) = &mut self.taker else { return };
        let began = clock();
        if let Err(error) = self.cx.go_on().and_then(|()| taker.take(pose, self.cx)) {
            self.taker = Err(error);
        }
        self.seconds.worked(clock() - began);
    }

    fn finish(self, is_complete: bool, clock: fn() -> f64) -> (usize, PassEnd) {
        let Self { index, taker, cx, mut seconds, .. } = self;
        let began = clock();
        let made = match taker {
            Err(error) => Some(Err(error)),
            Ok(taker) if is_complete => Some(taker.finish(cx)),
            // The pass ended early. If it was cancelled, so was the step.
            Ok(_) => cx.go_on().err().map(Err),
        };
        seconds.worked(clock() - began);
        (index, PassEnd { made, seconds })
    }
}

impl PoseReader for PoseReaders<'_, '_> {
    fn want(&mut self, index: usize, renderer: &mut dyn Renderer) -> ChannelSet {
        let mut all = ChannelSet::NONE;
        for step in &mut self.steps {
            step.want = step.taker.as_mut().map_or(ChannelSet::NONE, |taker| taker.want(index, renderer));
            all = all.with(step.want);
        }
        all
    }

    fn read(&mut self, pose: RenderedPose<'_>) {
        let RenderedPose { index, images, work, seconds, has_frame, renderer } = pose;
        let shared = self.steps.iter().filter(|step| step.wants()).count() + usize::from(has_frame);
        for step in &mut self.steps {
            if step.wants() {
                step.seconds.rendered(seconds, shared);
            }
            let renderer = &mut *renderer;
            step.read(RenderedPose { index, images, work, seconds, has_frame, renderer }, self.clock);
        }
        self.read += 1;
    }
}
