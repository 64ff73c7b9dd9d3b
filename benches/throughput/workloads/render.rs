//! Rendering of one view, all passes. Activation is done once, before.

use super::{amount, shared};
use crate::measure::{Workload, timed};
use glam::{DMat3, DQuat, DVec3};
use gs2e_demo as procedural;
use gs2e_demo::StillLife;
use gs2e_gpu::{DeviceChoice, GpuDevice, GpuRenderer, TimedStage};
use gs2e_image::Size;
use gs2e_num::se3::Se3;
use gs2e_render::cpu::{CpuRenderer, InstructionSet, PassKind};
use gs2e_render::sample::TileSample;
use gs2e_render::{
    ChannelSet, LayerOrder, RenderRules, RenderStyle, RenderWork, RenderedImages, Renderer as _,
};
use gs2e_scene as scene;
use gs2e_scene::Gaussians;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::{CameraVelocity, CameraView};
use std::sync::Arc;
use std::time::Instant;

const STYLE: RenderStyle = RenderStyle {
    rules: RenderRules::Official,
    order: LayerOrder::Depth,
    antialiased: false,
    background: [0.0; 3],
};

pub(super) fn workloads() -> Vec<Workload> {
    let luminance = ChannelSet { luminance: true, ..ChannelSet::default() };
    let rgb = ChannelSet { rgb: true, ..ChannelSet::default() };
    let rate = ChannelSet { luminance_rate: true, ..luminance };
    // What one pass of a build renders for all outputs.
    let all_outputs = ChannelSet { rgb: true, depth: true, flow: true, ..luminance };
    let mut all = Vec::new();
    let [outside, inside] = playbot().map_or([None, None], |views| views.map(Some));
    for (name, scene, view) in [Some(still_life()), outside, inside].into_iter().flatten() {
        all.push(workload(&format!("{name}, luminance"), &scene, view, luminance));
        all.push(workload(&format!("{name}, rgb"), &scene, view, rgb));
        all.push(workload(&format!("{name}, luminance and its rate"), &scene, view, rate));
        all.push(sampled(&format!("{name}, luminance and its rate"), &scene, view, rate));
        all.push(workload(&format!("{name}, luminance, rgb, depth and flow"), &scene, view, all_outputs));
        all.push(path(name, &scene, view, luminance));
        for (channels, want) in [("luminance", luminance), ("rgb", rgb), ("luminance and its rate", rate)] {
            eprintln!("{name}, {channels}: {}", split(&scene, moving(view), want));
        }
        all.extend(on_gpu(name, &scene, view, [rgb, luminance, rate]));
    }
    eprintln!("{PEER}");
    all
}

/// Core-seconds of the CPU path of pierotofy/OpenSplat, by the same measure on the same kind of
/// machine.
const PEER: &str = "beside it: OpenSplat on one core takes 1.05 core-s a frame from outside and 3.79 from inside, \
                    of 542,000 Gaussians at 1280x720 in rgb";

/// Time of a frame by instruction set and pass, the fastest of several. Core time is wall time
/// multiplied by the number of threads, idle ones included: `RAYON_NUM_THREADS=1` gives that of one
/// busy core.
fn split(scene: &Arc<Gaussians>, view: CameraView, want: ChannelSet) -> String {
    const FRAMES: usize = 5;
    let mut renderer = CpuRenderer::new(Arc::clone(scene), STYLE).expect("the scene can be rendered");
    let mut out = RenderedImages::default();
    let mut lines = Vec::new();
    for set in InstructionSet::available_sets() {
        renderer.set_instructions(set);
        let mut fastest = [f64::INFINITY; 5];
        let mut work = RenderWork::default();
        for _ in 0..FRAMES {
            let mut start = Instant::now();
            let mut done = |pass: PassKind| {
                let now = Instant::now();
                let least = &mut fastest[pass as usize];
                *least = least.min(now.duration_since(start).as_secs_f64());
                start = now;
            };
            work = renderer.render_in_passes(&view, want, &mut out, &mut done).expect("it can be rendered");
        }
        if lines.is_empty() {
            let each = work.blended as f64 / view.camera.size.pixels() as f64;
            let RenderWork { tile_pairs, hidden, .. } = work;
            lines.push(format!(
                "{each:.1} blended per pixel, {tile_pairs} tile pairs, {hidden} of them hidden"
            ));
        }
        let cores = rayon::current_num_threads() as f64;
        let [project, sort, bin, raster, resolve] = fastest.map(|seconds| seconds * cores * 1e3);
        let frame = fastest.iter().sum::<f64>() * cores;
        let each = raster * 1e6 / work.blended as f64;
        lines.push(format!(
            "{:8} project {project:.1} core-ms, sort {sort:.1}, bin {bin:.1}, raster {raster:.1}, resolve \
             {resolve:.1}; {each:.2} core-ns of raster a blended pair; {frame:.3} core-s a frame",
            set.name()
        ));
    }
    lines.join("\n    ")
}

/// The views on a hardware GPU, at two sizes. The time of each stage goes to stderr.
fn on_gpu(name: &str, scene: &Gaussians, view: CameraView, wants: [ChannelSet; 3]) -> Vec<Workload> {
    let device = match GpuDevice::open(&DeviceChoice::Hardware) {
        Ok(device) => device,
        Err(because) => {
            eprintln!("{name}: left out on the GPU: {because}");
            return Vec::new();
        }
    };
    let sizes = [Size { width: 1280, height: 720 }, Size { width: 1920, height: 1080 }];
    let views = sizes.map(|size| CameraView { camera: view.camera.resized(size), ..moving(view) });
    let names = ["rgb", "luminance", "luminance and its rate"];
    let pairs = views
        .iter()
        .flat_map(|view| names.into_iter().zip(wants).map(move |(what, want)| (view, what, want)));
    pairs
        .map(|(view, what, want)| gpu_workload(&format!("{name}, {what}"), scene, &device, (*view, want)))
        .collect()
}

/// Renders frames one after another, each begun while the previous one is read.
fn gpu_workload(
    name: &str,
    scene: &Gaussians,
    device: &GpuDevice,
    (view, want): (CameraView, ChannelSet),
) -> Workload {
    const FRAMES: usize = 20;
    let mut renderer = GpuRenderer::new(device.clone(), scene, STYLE).expect("the scene can be rendered");
    let mut out = RenderedImages::default();
    let mut render = move || {
        renderer.expect(&view, want);
        for frame in 0..FRAMES {
            if frame + 1 < FRAMES {
                renderer.expect(&view, want);
            }
            renderer.render(&view, want, &mut out).expect("the view can be rendered");
        }
        renderer.times()
    };
    let words: Vec<String> = TimedStage::ALL
        .iter()
        .zip(render().into_iter().flatten())
        .map(|(stage, time)| format!("{} {:.3} ms", stage.name(), time.as_secs_f64() * 1e3))
        .collect();
    let size = view.camera.size;
    eprintln!("{name}, {size}, on {}: {}", device.name(), words.join(", "));
    let what = format!("{name}, {} Gaussians, {size}, rules official, on {}", scene.len(), device.name());
    let run = move || {
        timed(|| {
            render();
            vec![amount(FRAMES * size.pixels(), "Mpixel"), amount(FRAMES, "frame")]
        })
    };
    Workload { part: "render", what, rival: false, run: Box::new(run) }
}

/// The demo's scene from the middle of its capture.
fn still_life() -> (&'static str, Arc<Gaussians>, CameraView) {
    let life = StillLife::default();
    let photo = &procedural::still_capture(&life).views[life.views as usize / 2];
    let view = CameraView::at_rest(photo.camera, photo.world_from_camera);
    ("still-life", Arc::new(procedural::still_life(&life)), view)
}

/// A real capture from outside and from inside: its up is -y, its centre (0, -0.5, 0), its radius
/// about 1.
fn playbot() -> Option<[(&'static str, Arc<Gaussians>, CameraView); 2]> {
    let scene = Arc::new(scene::read_file(&shared("playbot.spz")?).expect("the scene is sound"));
    let size = Size { width: 1280, height: 720 };
    let from = |x, y, z| look_at(DVec3::new(x, y, z), DVec3::new(0.0, -0.5, 0.0), size);
    Some([
        ("playbot.spz from outside", Arc::clone(&scene), from(1.5, -1.1, 2.0)),
        ("playbot.spz from inside", scene, from(0.35, -0.65, 0.5)),
    ])
}

/// The view of a moving camera, for the rates.
fn moving(view: CameraView) -> CameraView {
    let velocity = CameraVelocity { linear: DVec3::new(0.5, 0.0, 0.2), angular: DVec3::new(0.0, 0.5, 0.0) };
    CameraView { velocity, ..view }
}

fn workload(name: &str, scene: &Arc<Gaussians>, view: CameraView, want: ChannelSet) -> Workload {
    let mut renderer = CpuRenderer::new(Arc::clone(scene), STYLE).expect("the scene can be rendered");
    let mut out = RenderedImages::default();
    let view = moving(view);
    let work = renderer.render(&view, want, &mut out).expect("the view can be rendered");
    let (gaussians, size) = (scene.len(), view.camera.size);
    let each = work.blended as f64 / size.pixels() as f64;
    let what = format!("{name}, {gaussians} Gaussians, {size}, rules official, {each:.1} blended per pixel");
    let run = move || {
        timed(|| {
            renderer.render(&view, want, &mut out).expect("it was rendered before");
            vec![amount(gaussians, "MGaussian"), amount(size.pixels(), "Mpixel"), amount(1, "frame")]
        })
    };
    Workload { part: "render", what, rival: false, run: Box::new(run) }
}

/// The same view with a sample of the tiles, as in the pilot of a tolerance. Its rival is the whole frame, so the ratio
/// is the share of a frame that it costs.
fn sampled(name: &str, scene: &Arc<Gaussians>, view: CameraView, want: ChannelSet) -> Workload {
    let sample = Arc::new(TileSample::spread(view.camera.size, || 0.5));
    let pixels = sample.pixels().len();
    let mut renderer = CpuRenderer::new(Arc::clone(scene), STYLE).expect("the scene can be rendered");
    renderer.sample(Some(sample));
    let (mut out, view) = (RenderedImages::default(), moving(view));
    let run = move || {
        timed(|| {
            renderer.render(&view, want, &mut out).expect("the view can be rendered");
            vec![amount(1, "frame")]
        })
    };
    let share = 100.0 * pixels as f64 / view.camera.size.pixels() as f64;
    let what = format!("{name}, a sample of {share:.1} % of the pixels");
    Workload { part: "render", what, rival: true, run: Box::new(run) }
}

/// Consecutive frames of a camera that turns about the scene's centre and comes nearer.
fn path(name: &str, scene: &Arc<Gaussians>, view: CameraView, want: ChannelSet) -> Workload {
    const FRAMES: u32 = 8;
    let at = |frame: u32| {
        let seconds = f64::from(frame) / 2400.0;
        let (turn, nearer) = (DQuat::from_rotation_y(0.3 * seconds), 1.0 - 0.2 * seconds);
        let Se3 { rotation, translation } = view.world_from_camera;
        let world_from_camera = Se3 { rotation: turn * rotation, translation: turn * translation * nearer };
        CameraView { world_from_camera, ..view }
    };
    let views: Vec<CameraView> = (0..FRAMES).map(at).collect();
    let mut renderer = CpuRenderer::new(Arc::clone(scene), STYLE).expect("the scene can be rendered");
    let mut out = RenderedImages::default();
    let run = move || {
        timed(|| {
            for view in &views {
                renderer.render(view, want, &mut out).expect("the view can be rendered");
            }
            vec![amount(views.len(), "frame")]
        })
    };
    let what = format!("{name}, {FRAMES} frames along a path at 0.3 rad/s and 2,400 frames/s");
    Workload { part: "render", what, rival: false, run: Box::new(run) }
}

/// A camera with a horizontal field of view of 60 degrees, with its image's down direction along
/// world y.
fn look_at(centre: DVec3, target: DVec3, size: Size) -> CameraView {
    let forward = (target - centre).normalize();
    let right = DVec3::Y.cross(forward).normalize();
    let rotation = DQuat::from_mat3(&DMat3::from_cols(right, forward.cross(right), forward));
    let (width, height) = (f64::from(size.width), f64::from(size.height));
    let focal = width / (2.0 * libm::tan(30f64.to_radians()));
    let camera = Camera { size, fx: focal, fy: focal, cx: width / 2.0, cy: height / 2.0, lens: None };
    CameraView::at_rest(camera, Se3 { rotation, translation: centre })
}
