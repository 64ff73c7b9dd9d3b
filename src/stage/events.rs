//! Stage `events`: renders the luminance of every pose and shows it to the sensor.

use super::{Context, Need, Stage, StageError, Target};
use crate::artifact::{EventStream, Files, Motion, Simulation, write_json};
use crate::camera::{Camera, CameraChoice};
use crate::event::{Header, LawStamp, h5};
use crate::frames::anchors::Anchors;
use crate::frames::rendered::RenderedFrames;
use crate::image::Size;
use crate::render::backend::Backend;
use crate::render::doubt::Doubt;
use crate::render::flow::{self, Quantiles};
use crate::render::{Channels, RenderChoice, Rendered, Renderer, View};
use crate::scene::Gaussians;
use crate::seed::Seed;
use crate::sensor::{Account, Sensor, SimulateError, simulate};
use crate::source::Capture;
use crate::trajectory::Trajectory;
use crate::units::amount;
use serde::Serialize;
use std::fs::File;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

/// Parameters: camera, rendering, sensor, and the seed of its noise.
#[derive(Debug, Serialize)]
pub struct Simulating {
    /// The camera, where it differs from the source's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraChoice>,
    /// The rendering.
    pub render: RenderChoice,
    /// The sensor.
    pub sensor: Sensor,
    /// Seed of the sensor's stream.
    pub seed: Seed,
    /// What renders.
    #[serde(skip)]
    pub backend: Backend,
}

/// State of the sensor, pictures between the renderer and it, and the sample of the flow, by measurement.
const BYTES_A_PIXEL: u64 = 232;

/// Pairs of neighbouring poses at which the optical flow is measured.
const FLOW_SAMPLES: usize = 9;

impl Stage for Simulating {
    const NAME: &'static str = "events";
    const REVISION: u32 = 3;
    type Inputs = (Target<Capture>, Target<Gaussians>, Target<Motion>);
    type Output = EventStream;

    fn class(&self) -> Option<String> {
        Some(self.backend.class())
    }

    fn need(&self, files: &[Files]) -> Need {
        super::rendering_need(&self.backend, self.camera, files, BYTES_A_PIXEL)
    }

    fn run(
        &self,
        (capture, gaussians, motion): (Capture, Gaussians, Motion),
        cx: &mut Context<'_>,
    ) -> Result<(), StageError> {
        let camera = super::camera(self.camera, &capture, cx);
        let style = self.render.resolve(gaussians.antialiased);
        let gaussians = Arc::new(gaussians);
        let new_renderer =
            || self.backend.renderer(gaussians.clone(), style).map_err(StageError::work("render"));
        let trajectory = motion.trajectory;
        let sampled = sample_depth(&mut *new_renderer()?, camera, &trajectory, cx)?;
        let mut frames = RenderedFrames::new(new_renderer()?, camera, trajectory.clone());
        let (account, anchors) = self.simulate(&mut frames, &trajectory.stamps_us, camera.size, cx)?;
        cx.remark = Some(amount(account.events, "ev"));
        let simulation = Simulation {
            camera,
            gaussians: gaussians.len(),
            sh_degree: gaussians.sh_degree,
            screening: gaussians.screening,
            antialiased: style.antialiased,
            sensor: self.sensor.clone(),
            seed: self.seed,
            account,
            work: frames.work(),
            flow_px: Quantiles::of(sampled.moved_px),
            doubtful_share: sampled.doubt.share(),
            depth_unit: flow::nearest_ranks(sampled.depth, [5, 50, 95]),
            brightness_stamps_us: anchors.stamps_us.clone(),
        };
        write(&cx.out.join("brightness.npy"), |file| anchors.write_images(file))?;
        let out = cx.out.join("simulation.json");
        write_json(&out, &simulation).map_err(StageError::io(&out))
    }
}

impl Simulating {
    /// Streams the frames through the sensor into `events.h5`.
    fn simulate(
        &self,
        frames: &mut RenderedFrames,
        stamps_us: &[i64],
        size: Size,
        cx: &Context<'_>,
    ) -> Result<(Account, Anchors), StageError> {
        let chosen = Anchors::choose(stamps_us);
        let mut anchors = Anchors::empty();
        let mut tap = |frame: &crate::frames::Frame| {
            if chosen.contains(&frame.index) {
                anchors.keep(frame, stamps_us[frame.index]);
            }
            if cx.go_on().is_ok() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        };
        let model = self.sensor.as_model();
        let (c_on, c_off) = model.contrast();
        let law = Some(LawStamp { version: model.law_version(), c_on, c_off });
        let header = Header { size, law };
        let path = cx.out.join("events.h5");
        let mut sink = h5::Writer::create(&path, &header).map_err(StageError::work("write events.h5"))?;
        let account = simulate(frames, model, self.seed, &mut sink, &mut tap);
        let account = account.map_err(|e| match e {
            SimulateError::Interrupted => StageError::Cancelled,
            e => StageError::work("simulate events")(e),
        })?;
        let last = stamps_us.last().copied().unwrap_or(0);
        sink.finish(last).map_err(StageError::work("write events.h5"))?;
        Ok((account, anchors))
    }
}

/// Values of all pixels over a sample of the path.
#[derive(Default)]
struct Sampled {
    /// Way of the picture between neighbouring poses.
    moved_px: Vec<f32>,
    depth: Vec<f32>,
    doubt: Doubt,
}

fn sample_depth(
    renderer: &mut dyn Renderer,
    camera: Camera,
    trajectory: &Trajectory,
    cx: &Context<'_>,
) -> Result<Sampled, StageError> {
    let poses = &trajectory.world_from_camera;
    let want = Channels { depth: true, alpha: true, doubtful: true, ..Channels::default() };
    let mut sampled = Sampled::default();
    for (a, b) in flow::sample_pairs(poses.len(), FLOW_SAMPLES) {
        cx.go_on()?;
        let [from, to] = [a, b].map(|j| View::still(camera, poses[j]));
        let mut rendered = Rendered::default();
        renderer.render(&from, want, &mut rendered).map_err(StageError::work("measure the optical flow"))?;
        sampled.doubt.add(&rendered);
        let depth = rendered.depth.expect("depth was asked for");
        sampled.moved_px.extend(flow::displacement(&depth, &from, &to).into_pixels());
        sampled.depth.extend(depth.into_pixels());
    }
    Ok(sampled)
}

fn write(path: &Path, fill: impl FnOnce(&mut File) -> std::io::Result<()>) -> Result<(), StageError> {
    File::create(path).and_then(|mut file| fill(&mut file)).map_err(StageError::io(path))
}
