//! Events of GPU frames compared with events of CPU frames, with the same noise.
//!
//! Luminance differs by some units of 6e-8 of 255, and a threshold is some 10 grey levels. With the
//! same noise a pixel therefore crosses at the same time, within 1e-6 of the time between two
//! events. An additional or missing crossing needs a tie.

use super::OFFICIAL;
use super::gpu;
use gs2e_demo as procedural;
use gs2e_demo::StillLife;
use gs2e_event::Event;
use gs2e_gpu::GpuRenderer;
use gs2e_image::Size;
use gs2e_num::se3::Se3;
use gs2e_num::seed::Seed;
use gs2e_num::units::Timestamp;
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::{ChannelSet, RenderedImages, Renderer};
use gs2e_sampling::rendered::RenderedFrames;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::CameraView;
use gs2e_sensor::frames::{DenseFrame, FrameError, FrameSequence};
use gs2e_sensor::simulate_one;
use gs2e_sensor::voltmeter::{VoltmeterModel, VoltmeterPreset};
use gs2e_trajectory::Trajectory;
use std::collections::{BTreeMap, VecDeque};
use std::ops::ControlFlow;
use std::sync::Arc;

const SIZE: Size = Size { width: 160, height: 120 };
const FRAMES: usize = 60;
/// Time between frames, us.
const STEP_US: i64 = 417;

fn path(life: &StillLife) -> (Camera, Trajectory) {
    let capture = procedural::still_capture(life);
    let [from, to] = [&capture.views[0], &capture.views[5]].map(|view| view.world_from_camera);
    let pose = |k: usize| Se3 {
        rotation: from.rotation,
        translation: from.translation.lerp(to.translation, k as f64 / FRAMES as f64),
    };
    let trajectory = Trajectory {
        world_from_camera: (0..FRAMES).map(pose).collect(),
        stamps_us: (0..).map(|k| k * STEP_US).take(FRAMES).collect(),
    };
    (capture.views[0].camera.resized(SIZE), trajectory)
}

/// The views of the path, each with its stamp in us.
fn views(life: &StillLife) -> Vec<(CameraView, i64)> {
    let (camera, trajectory) = path(life);
    let poses = trajectory.world_from_camera.into_iter().zip(trajectory.stamps_us);
    poses.map(|(pose, stamp)| (CameraView::at_rest(camera, pose), stamp)).collect()
}

fn frames(renderer: Box<dyn Renderer>, life: &StillLife) -> RenderedFrames {
    let (camera, trajectory) = path(life);
    RenderedFrames::new(renderer, camera, trajectory)
}

/// The sensor's events, in its order.
fn sensed(frames: &mut dyn FrameSequence) -> Vec<Event> {
    let mut all: Vec<Event> = Vec::new();
    let mut go_on = |_: &_| ControlFlow::Continue(());
    simulate_one(frames, &VoltmeterModel::new(VoltmeterPreset::Dvs346.k()), Seed(7), &mut all, &mut go_on)
        .unwrap();
    all
}

/// Events by pixel in order of time, ns.
fn events(renderer: Box<dyn Renderer>, life: &StillLife) -> BTreeMap<(u16, u16), Vec<i64>> {
    let all = sensed(&mut frames(renderer, life));
    let mut pixels: BTreeMap<_, Vec<i64>> = BTreeMap::new();
    all.iter().for_each(|event| pixels.entry((event.x, event.y)).or_default().push(event.t.0));
    pixels.values_mut().for_each(|times| times.sort_unstable());
    pixels
}

/// Frames that were made before.
#[derive(Debug)]
struct StoredFrames {
    frames: VecDeque<DenseFrame>,
    len: usize,
}

impl FrameSequence for StoredFrames {
    fn size(&self) -> Size {
        SIZE
    }

    fn len(&self) -> usize {
        self.len
    }

    fn next(&mut self) -> Result<Option<DenseFrame>, FrameError> {
        Ok(self.frames.pop_front())
    }
}

/// The events of a build, whose frames are in flight while the sensor works, are those of the sensor
/// fed with the same frames one by one, bit for bit: with all features of the GPU, and without each.
#[test]
fn events_are_those_of_the_sensor_fed_with_the_same_frames() {
    let Some(device) = gpu::device() else { return };
    let life = StillLife { gaussians: 500, views: 6, arc: 40.0, seed: 1, fountain: None };
    let scene = procedural::still_life(&life);
    let renderer = |device| Box::new(GpuRenderer::new(device, &scene, OFFICIAL).unwrap());
    let views = views(&life);
    let want = ChannelSet { luminance: true, ..ChannelSet::NONE };
    let mut made = VecDeque::new();
    for (index, (view, stamp_us)) in views.into_iter().enumerate() {
        // A renderer of its own, so that no frame has a trace of another.
        let mut out = RenderedImages::default();
        renderer(device.clone()).render(&view, want, &mut out).unwrap();
        let mut luminance = out.luminance.unwrap();
        luminance.pixels_mut().iter_mut().for_each(|value| *value *= 255.0);
        made.push_back(DenseFrame { index, t: Timestamp(1000 * stamp_us), luminance, rate: None });
    }
    let wanted = sensed(&mut StoredFrames { len: made.len(), frames: made });
    assert!(wanted.len() > 10_000, "too few to compare");
    let mut devices = gpu::devices_without_features();
    devices.push(("nothing".to_owned(), device));
    for (without, device) in devices {
        assert!(sensed(&mut frames(renderer(device), &life)) == wanted, "without {without}");
    }
}

#[test]
fn events_are_those_of_the_cpu() {
    let Some(device) = gpu::device() else { return };
    let life = StillLife { gaussians: 500, views: 6, arc: 40.0, seed: 1, fountain: None };
    let scene = Arc::new(procedural::still_life(&life));
    let by_gpu = events(Box::new(GpuRenderer::new(device, &scene, OFFICIAL).unwrap()), &life);
    let by_cpu = events(Box::new(CpuRenderer::new(scene, OFFICIAL).unwrap()), &life);
    let count = |pixels: &BTreeMap<_, Vec<i64>>| pixels.values().map(Vec::len).sum::<usize>();
    let (found, wanted) = (count(&by_gpu), count(&by_cpu));
    let mut apart: Vec<i64> = by_cpu
        .iter()
        .flat_map(|(pixel, times)| times.iter().zip(by_gpu.get(pixel).into_iter().flatten()))
        .map(|(a, b)| (a - b).abs())
        .collect();
    apart.sort_unstable();
    let (median, most) = (apart[apart.len() / 2], apart[apart.len() * 99 / 100]);
    println!("{found} events, {wanted} by the CPU; apart by {median} ns at the median, {most} ns at 99 %");
    assert!(wanted > 10_000, "too few to compare");
    assert!(found.abs_diff(wanted) as f64 <= 1e-3 * wanted as f64);
    assert!(median < 1000, "{median} ns");
}
