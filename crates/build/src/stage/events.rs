//! Stage `events`: renders the luminance of every pose, and its colours if a sensor needs them, and
//! simulates the sensors.

mod resample;
mod sampling;

use super::near::{self, hide_near_along};
use super::pass::{PassGround, PassInputs, PassRole, PoseReaders};
use super::shot::ShotParameters;
use super::{OpenedInputs, Stage, StageContext, StageError, StageFacts, StepNeed};
use crate::artifact::{ArtifactFiles, EventStream, EventStreams, SimulationRecord, TrajectoryProduct};
use gs2e_event::{LawStamp, StreamHeader, h5};
use gs2e_image::{Image, Size, npy};
use gs2e_num::seed::Seed;
use gs2e_num::stats::nearest_ranks;
use gs2e_recipe::OutputKind;
use gs2e_render::doubt::BlendDoubt;
use gs2e_render::lights::SceneLights;
use gs2e_render::objects::near_warnings;
use gs2e_render::{ChannelSet, OmissionPolicy, RenderStyle, RenderedImages, Renderer};
use gs2e_sampling::ErrorTolerance;
use gs2e_sampling::kept::{KeptFrames, KeptRenderer};
use gs2e_sampling::rendered::RenderedFrames;
use gs2e_scene::Gaussians;
use gs2e_scene::camera::view::{CameraVelocity, CameraView};
use gs2e_scene::camera::{Camera, flow};
use gs2e_sensor::frames::anchors::{AnchorChoice, AnchorFrames};
use gs2e_sensor::frames::{DenseFrame, FrameSequence};
use gs2e_sensor::front_end::FrontEnd;
use gs2e_sensor::voltmeter::BetweenFrames;
use gs2e_sensor::{
    SensorChannel, SensorChoice, SensorSet, SimulateError, SimulationAccount, front_end, simulate_all,
};
use gs2e_trajectory::Trajectory;
use gs2e_trajectory::flow::FlowQuantiles;
use gs2e_trajectory::sampled::SampledPath;
use resample::DoubledPath;
use sampling::SampledFrames;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fs::File;
use std::ops::ControlFlow;
use std::sync::Arc;

/// Parameters: camera, rendering, sensors, and the seed of their noise.
#[derive(Debug, Serialize)]
pub struct EventsStage {
    /// Camera and rendering.
    #[serde(flatten)]
    pub shot: ShotParameters,
    /// The sensor, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sensor: Option<SensorChoice>,
    /// The sensors by name, if there are several.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub sensors: BTreeMap<String, SensorChoice>,
    /// Seed of the sensors' noise.
    pub seed: Seed,
    /// Tolerance of the error between frames. If it is set, frames are where it requires them;
    /// otherwise at the poses.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tolerance: Option<ErrorTolerance>,
    /// Light that changes, if it does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lights: Option<SceneLights>,
}

/// Bytes per pixel, as measured: state of a sensor, frames on their way to it, kept frames, and the
/// sample of the flow.
const BYTES_A_PIXEL: u64 = 230;
/// Bytes per pixel of a front end: the frame that it makes, and the colours from which it is made,
/// as blended and as read, 32 bits each.
const BYTES_OF_FRONT_END: u64 = 4 + 2 * 12;

/// Bytes per pixel of light that changes: the colours from which luminance is made.
const BYTES_OF_LIGHT: u64 = 12;

/// Bytes per pixel of a bus: its flags, and a waiting event in a tree of rows.
const BYTES_OF_BUS: u64 = 64;

/// Bytes per pixel of a latency: the past of the pixel, a waiting event, and ten frames of light.
const BYTES_OF_LATENCY: u64 = 16 + 40 + 10 * 4;

/// Bytes per pixel of a bandwidth: three frames of logarithms and slopes, two stages, and the ends of eight
/// pieces with their rates.
const BYTES_OF_BANDWIDTH: u64 = 3 * 16 + 2 * 8 + 8 * 8;

/// Maximum number of pairs of neighbouring poses at which the optical flow is measured.
const FLOW_SAMPLES: usize = 9;

impl StageFacts for EventsStage {
    fn class(&self) -> Option<String> {
        Some(self.shot.backend.class())
    }

    fn need(&self, files: &[ArtifactFiles]) -> StepNeed {
        self.shot.need(files, self.bytes_a_pixel())
    }

    fn role(&self) -> Option<PassRole<'_>> {
        // With a tolerance, frames are elsewhere than at the poses.
        self.tolerance.is_none().then_some(PassRole::Events(self))
    }

    fn kept_shot(&self) -> Option<&ShotParameters> {
        Some(&self.shot)
    }
}

impl Stage for EventsStage {
    const NAME: &'static str = OutputKind::Events.name();
    const REVISION: u32 = 8;
    type Inputs = PassInputs;
    type Output = EventStreams;

    fn run(&self, inputs: OpenedInputs<Self>, cx: &mut StageContext<'_>) -> Result<(), StageError> {
        self.make(inputs.into(), None, cx)
    }
}

impl EventsStage {
    /// Leads a pass: makes the product, and shows the renderings of its frames to the readers.
    pub(super) fn lead(
        &self,
        ground: PassGround,
        readers: &mut PoseReaders<'_, '_>,
        cx: &mut StageContext<'_>,
    ) -> Result<(), StageError> {
        self.make(ground, Some(readers), cx)
    }

    fn make(
        &self,
        ground: PassGround,
        readers: Option<&mut PoseReaders<'_, '_>>,
        cx: &mut StageContext<'_>,
    ) -> Result<(), StageError> {
        let camera = super::choose_camera(self.shot.camera, &ground.capture, cx);
        let (gaussians, hidden) =
            hide_near_along(&ground.gaussians, &ground.motion, &camera, &self.shot.render);
        let motion = ground.motion;
        cx.warnings.extend(near_warnings(&gaussians, &camera, &motion.trajectory, self.shot.render.rules));
        let style = self.shot.render.resolve(gaussians.antialiased);
        let kept = cx.kept.clone();
        let new_renderer = || self.new_renderer(gaussians.clone(), style, kept.clone());
        let path = continuous_path(&motion)?;
        let SampledFrames { trajectory, velocities, chosen, renderer } =
            self.sample(motion, camera, new_renderer()?, cx)?;
        let chosen_own = chosen.as_ref().map(|chosen| self.between(chosen.between));
        let own = chosen_own.as_ref().unwrap_or(self);
        let sampled = sample_path(&mut *new_renderer()?, camera, &trajectory, cx)?;
        let choice = AnchorChoice::from_stamps(&trajectory.stamps_us, span_frames(sampled.flow_px));
        let frames = RenderedFrames::new(renderer, camera, trajectory.clone()).lit_by(self.lights.clone());
        let mut frames = own.with_inputs(frames, velocities, readers.is_some());
        self.measure_saving(&mut frames, cx)?;
        let stamps_us = &trajectory.stamps_us;
        let mut simulated = match readers {
            Some(readers) => own.simulate(&mut readers.reading(&mut frames), stamps_us, &choice, cx)?,
            None => own.simulate(&mut frames, stamps_us, &choice, cx)?,
        };
        // The count ends here: frames that only the comparison below renders are no work of the stream.
        let work = frames.work();
        if let Some(doubled) = path.and_then(|path| DoubledPath::new(&path, stamps_us)) {
            let tried = own.resample(doubled, camera, frames.into_renderer(), cx)?;
            simulated.streams.iter_mut().zip(tried).for_each(|(stream, tried)| stream.resampled = tried);
        }
        own.report(&trajectory, chosen.as_ref(), &simulated, cx);
        near::add_remark(cx, hidden);
        let SimulatedStreams { streams, anchors } = simulated;
        let simulation = SimulationRecord {
            camera,
            gaussians: gaussians.len(),
            sh_degree: gaussians.sh_degree,
            screening: gaussians.screening,
            antialiased: style.antialiased,
            streams,
            seed: self.seed,
            omit: self.shot.omit,
            work,
            flow_px: sampled.flow_px,
            doubtful_share: sampled.doubtful_share,
            depth_unit: sampled.depth_unit,
            brightness_stamps_us: anchors[0].stamps_us.clone(),
            brightness_spans: choice.spans,
            depth_stamps_us: sampled.stamps_us,
            chosen,
        };
        for (i, anchors) in anchors.iter().enumerate() {
            write_product(&cx.out.join(EventStreams::brightness_name(i)), |file| anchors.write_images(file))?;
        }
        cx.write_record("simulation.json", &simulation)
    }

    /// Measures the time that leaving work out saves, if it does.
    fn measure_saving(
        &self,
        frames: &mut RenderedFrames,
        cx: &mut StageContext<'_>,
    ) -> Result<(), StageError> {
        // Frames that are only shown again leave out no work.
        let renders = cx.kept.as_ref().is_none_or(|kept| !kept.has_any());
        let is_measured = renders && self.shot.omit.is_needless() && self.shot.backend.has_choice();
        if let Some(clock) = cx.clock.filter(|_| is_measured) {
            cx.saving = frames.saving(clock).map_err(StageError::work_failed("render"))?;
        }
        Ok(())
    }

    fn new_renderer(
        &self,
        gaussians: Arc<Gaussians>,
        style: RenderStyle,
        kept: Option<Arc<KeptFrames>>,
    ) -> Result<Box<dyn Renderer>, StageError> {
        let mut renderer =
            self.shot.backend.renderer(gaussians, style).map_err(StageError::work_failed("render"))?;
        renderer.omit(self.shot.omit);
        let keeps = ChannelSet {
            luminance_rate: true,
            rgb: self.sees_colour() || self.lights.is_some(),
            ..ChannelSet::NONE
        };
        Ok(match kept {
            Some(kept) => Box::new(KeptRenderer::new(renderer, kept, keeps, self.shot.omit)),
            None => renderer,
        })
    }

    /// Memory per pixel in addition to that of the renderer, bytes.
    pub(super) fn bytes_a_pixel(&self) -> u64 {
        let sensors = self.sensors().count() as u64;
        // Only a front end that changes the frame, or a build that omits nothing, holds frames of
        // its own.
        let is_coloured =
            |front_end: &&FrontEnd| self.shot.omit == OmissionPolicy::Nothing || !front_end.is_plain();
        let front_ends = self.front_ends().iter().filter(is_coloured).count() as u64;
        let buses = self.sensors().filter(|(_, sensor)| sensor.readout().is_some()).count() as u64;
        let late = self.sensors().filter(|(_, sensor)| sensor.latency().is_some()).count() as u64;
        let slow =
            |sensor: &SensorChoice| sensor.as_voltmeter().is_some_and(|own| !own.bandwidth.is_absent());
        let slow = self.sensors().filter(|(_, sensor)| slow(sensor)).count() as u64;
        let around = BYTES_OF_BUS * buses + BYTES_OF_LATENCY * late + BYTES_OF_BANDWIDTH * slow;
        let lit = if self.lights.is_some() { BYTES_OF_LIGHT } else { 0 };
        BYTES_A_PIXEL * sensors + BYTES_OF_FRONT_END * front_ends + around + lit
    }

    /// The frames with all that the sensors read: rates for [`BetweenFrames::Hermite`], and colour.
    /// Other readers may want the flow.
    fn with_inputs(
        &self,
        frames: RenderedFrames,
        velocities: Vec<CameraVelocity>,
        has_readers: bool,
    ) -> RenderedFrames {
        let needs_rates = self.sensors().any(|(_, sensor)| sensor.between() == BetweenFrames::Hermite);
        let mut frames = match (needs_rates, has_readers) {
            (true, _) => frames.with_rates(velocities),
            (false, true) => frames.with_velocities(velocities),
            (false, false) => frames,
        };
        if self.sees_colour() {
            frames.want_colour();
        }
        frames
    }

    /// The parameters for these sensors at the poses, in light that does not change.
    #[must_use]
    pub fn new(sensors: &SensorSet, seed: Seed, shot: ShotParameters) -> Self {
        let (sensor, sensors) = match sensors.clone() {
            SensorSet::One(sensor) => (Some(sensor), BTreeMap::new()),
            SensorSet::Named(sensors) => (None, sensors),
        };
        Self { shot, sensor, sensors, seed, tolerance: None, lights: None }
    }

    /// Each sensor, with its name if there are several.
    fn sensors(&self) -> impl Iterator<Item = (Option<&str>, &SensorChoice)> {
        let one = self.sensor.iter().map(|sensor| (None, sensor));
        one.chain(self.sensors.iter().map(|(name, sensor)| (Some(name.as_str()), sensor)))
    }

    fn front_ends(&self) -> Vec<FrontEnd> {
        front_end::distinct_front_ends(self.sensors().map(|(_, sensor)| sensor.as_model()))
    }

    /// Returns true if colours are rendered: a sensor needs them, or nothing is left out.
    fn sees_colour(&self) -> bool {
        self.shot.omit == OmissionPolicy::Nothing || self.front_ends().iter().any(FrontEnd::needs_colour)
    }

    /// Streams the frames through the sensors into their files, and keeps some frames as each front
    /// end shows them.
    fn simulate(
        &self,
        frames: &mut dyn FrameSequence,
        stamps_us: &[i64],
        choice: &AnchorChoice,
        cx: &StageContext<'_>,
    ) -> Result<SimulatedStreams, StageError> {
        let size = frames.size();
        let mut anchors = vec![AnchorFrames::without_frames(choice); self.front_ends().len()];
        let keep = |anchors: &mut AnchorFrames, frame: &DenseFrame| {
            if choice.frames.binary_search(&frame.index).is_ok() {
                anchors.keep(frame, stamps_us[frame.index]);
            }
        };
        let mut keepers: Vec<_> = anchors.iter_mut().map(|a| |frame: &DenseFrame| keep(a, frame)).collect();
        let mut tap = |_: &DenseFrame| match cx.go_on() {
            Ok(()) => ControlFlow::Continue(()),
            Err(_) => ControlFlow::Break(()),
        };
        let failed = |e| match e {
            SimulateError::Interrupted => StageError::Cancelled,
            e => StageError::work_failed("simulate events")(e),
        };
        let mut sinks = self.sinks(size, cx)?;
        let mut channels = Vec::new();
        let mut unwatched: Vec<_> = self.front_ends().into_iter().zip(&mut keepers).collect();
        for ((_, sensor), sink) in self.sensors().zip(&mut sinks) {
            let model = sensor.as_model();
            let pixels = model.start(size, [0, 0], self.seed).map_err(|e| failed(e.into()))?;
            let mut channel = SensorChannel::new(pixels, sink).behind(model.front_end());
            // The first sensor behind each front end keeps the frames for the others.
            if let Some(at) = unwatched.iter().position(|(front_end, _)| *front_end == model.front_end()) {
                channel = channel.watched(unwatched.swap_remove(at).1);
            }
            channels.push(channel);
        }
        let accounts = simulate_all(frames, &mut channels, &mut tap).map_err(failed)?;
        // The channels borrow the sinks, which are finished next.
        drop(channels);
        let last = stamps_us.last().copied().unwrap_or(0);
        for sink in sinks {
            sink.finish(last).map_err(StageError::work_failed("write events"))?;
        }
        let stream = |((name, sensor), account): ((Option<&str>, &SensorChoice), SimulationAccount)| {
            EventStream { name: name.map(str::to_owned), sensor: sensor.clone(), account, resampled: None }
        };
        Ok(SimulatedStreams { streams: self.sensors().zip(accounts).map(stream).collect(), anchors })
    }

    /// The file of each sensor's events.
    fn sinks(&self, size: Size, cx: &StageContext<'_>) -> Result<Vec<h5::Writer>, StageError> {
        let sink = |(name, sensor): (Option<&str>, &SensorChoice)| {
            let model = sensor.as_model();
            let (c_on, c_off) = model.contrast();
            let law = Some(LawStamp { version: model.law_version(), c_on, c_off });
            h5::Writer::create(
                &cx.out.join(EventStream::stored_name(name)),
                &StreamHeader { size, law, labelled: model.labels() },
            )
        };
        self.sensors().map(sink).collect::<Result<_, _>>().map_err(StageError::work_failed("write events"))
    }
}

/// The streams of the sensors, and some frames as each front end shows them.
struct SimulatedStreams {
    streams: Vec<EventStream>,
    anchors: Vec<AnchorFrames>,
}

/// The result of a sample of the path.
struct PathSample {
    /// Image motion between neighbouring poses.
    flow_px: Option<FlowQuantiles>,
    doubtful_share: Option<f64>,
    depth_unit: Option<[f32; 3]>,
    /// Stamps of the first poses of the pairs.
    stamps_us: Vec<i64>,
}

/// The trajectory as continuous motion; `None` for a single pose.
fn continuous_path(motion: &TrajectoryProduct) -> Result<Option<SampledPath>, StageError> {
    let poses = &motion.trajectory.world_from_camera;
    let path = || {
        SampledPath::through_poses(poses, motion.seconds())
            .map_err(StageError::work_failed("follow the path"))
    };
    (poses.len() > 1).then(path).transpose()
}

/// Number of frames in which the median image motion is about a pixel.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a number of frames, saturating")]
fn span_frames(flow_px: Option<FlowQuantiles>) -> usize {
    // Without motion, the quotient is infinite, and the choice of anchors clamps it.
    flow_px.map_or(1, |flow| (1.0 / flow.median).round() as usize)
}

/// Measures depth and flow, and writes the depths.
fn sample_path(
    renderer: &mut dyn Renderer,
    camera: Camera,
    trajectory: &Trajectory,
    cx: &StageContext<'_>,
) -> Result<PathSample, StageError> {
    let poses = &trajectory.world_from_camera;
    let want = ChannelSet { depth: true, alpha: true, doubtful: true, ..renderer.motion_channels() };
    let (mut moved_px, mut stamps_us, mut depths) = (Vec::new(), Vec::new(), Vec::new());
    let mut doubt = BlendDoubt::default();
    for (a, b) in flow::sample_pairs(poses.len(), FLOW_SAMPLES) {
        cx.go_on()?;
        let view = |j: usize| CameraView::at_rest(camera, poses[j]).at_time(trajectory.seconds(j));
        let [from, to] = [a, b].map(view);
        let mut rendered = RenderedImages::default();
        renderer
            .render(&from, want, &mut rendered)
            .map_err(StageError::work_failed("measure the optical flow"))?;
        doubt.add(&rendered);
        let mut depth = rendered.depth.expect("depth was asked for");
        let segmentation = rendered.segmentation.as_ref();
        let drift = rendered.drift.as_ref();
        let [from, to] = [from, to].map(|view| renderer.object_views(&view));
        moved_px.extend(match drift {
            Some(drift) => flow::displacement_with_drift(&depth, drift, &from[0], &to[0]).into_pixels(),
            None => flow::displacement_of_objects(&depth, segmentation, &from, &to).into_pixels(),
        });
        // The checks compare depths with the poses of the camera, which tell nothing of what moves by itself.
        segmentation.into_iter().for_each(|segmentation| flow::leave_out_objects(&mut depth, segmentation));
        drift.into_iter().for_each(|drift| flow::leave_out_drifting(&mut depth, drift));
        stamps_us.push(trajectory.stamps_us[a]);
        depths.push(depth);
    }
    write_product(&cx.out.join(EventStreams::DEPTH), |file| npy::write_stack(&depths, file))?;
    let flow_px = FlowQuantiles::from_values(moved_px);
    let depths = depths.into_iter().flat_map(Image::into_pixels).collect();
    let depth_unit = nearest_ranks(depths, [5, 50, 95]);
    Ok(PathSample { flow_px, doubtful_share: doubt.share(), depth_unit, stamps_us })
}

fn write_product(
    path: &std::path::Path,
    fill: impl FnOnce(&mut File) -> std::io::Result<()>,
) -> Result<(), StageError> {
    File::create(path).and_then(|mut file| fill(&mut file)).map_err(StageError::io_error(path))
}
