//! Rendering one view, all passes: activation is done once, before.

use super::{amount, shared};
use crate::measure::{Workload, timed};
use glam::{DMat3, DQuat, DVec3};
use gs2e::camera::Camera;
use gs2e::image::Size;
use gs2e::render::cpu::{Cpu, Instructions, Pass};
use gs2e::render::gpu::{Choice, Device, Gpu, Stage};
use gs2e::render::{Channels, Layering, Rendered, Renderer as _, Rules, Style, Velocity, View};
use gs2e::scene::procedural::{self, StillLife};
use gs2e::scene::{self, Gaussians};
use gs2e::se3::Se3;
use std::sync::Arc;
use std::time::Instant;

const STYLE: Style =
    Style { rules: Rules::Official, order: Layering::Depth, antialiased: false, background: [0.0; 3] };

pub(super) fn workloads() -> Vec<Workload> {
    let luminance = Channels { luminance: true, ..Channels::default() };
    let rgb = Channels { rgb: true, ..Channels::default() };
    let rate = Channels { luminance_rate: true, ..luminance };
    let mut all = Vec::new();
    for (name, scene, view) in [Some(still_life()), playbot()].into_iter().flatten() {
        all.push(workload(&format!("{name}, luminance"), &scene, view, luminance));
        all.push(workload(&format!("{name}, rgb"), &scene, view, rgb));
        all.push(workload(&format!("{name}, luminance and its rate"), &scene, view, rate));
        eprintln!("{name}: {}", split(&scene, view, luminance));
        all.extend(on_gpu(name, &scene, view, [rgb, luminance, rate]));
    }
    all
}

/// Where the time of a frame goes: the fastest of several, pass by pass, and the raster over every instruction set.
fn split(scene: &Arc<Gaussians>, view: View, want: Channels) -> String {
    const FRAMES: usize = 5;
    let mut renderer = Cpu::new(Arc::clone(scene), STYLE).expect("the scene can be rendered");
    let mut out = Rendered::default();
    let mut words = Vec::new();
    for set in Instructions::all() {
        renderer.set_instructions(set);
        let mut fastest = [f64::INFINITY; 5];
        let mut blended = 0;
        for _ in 0..FRAMES {
            let mut start = Instant::now();
            let mut done = |pass: Pass| {
                let now = Instant::now();
                let least = &mut fastest[pass as usize];
                *least = least.min(now.duration_since(start).as_secs_f64());
                start = now;
            };
            let work =
                renderer.render_in_passes(&view, want, &mut out, &mut done).expect("it can be rendered");
            blended = work.blended;
        }
        let cores = rayon::current_num_threads() as f64;
        let [project, sort, bin, raster, resolve] = fastest.map(|seconds| seconds * 1e3);
        let each = raster * 1e6 * cores / blended as f64;
        if words.is_empty() {
            words
                .push(format!("project {project:.1} ms, sort {sort:.1}, bin {bin:.1}, resolve {resolve:.1}"));
        }
        words.push(format!("raster by {} {raster:.1} ms, {each:.2} core-ns a blended pair", set.name()));
    }
    words.join("; ")
}

/// The same on the GPU, one that is none in software, at two sizes; where its time goes is told on stderr.
fn on_gpu(name: &str, scene: &Gaussians, view: View, wants: [Channels; 3]) -> Vec<Workload> {
    let device = match Device::open(&Choice::Hardware) {
        Ok(device) => device,
        Err(because) => {
            eprintln!("{name}: left out on the GPU: {because}");
            return Vec::new();
        }
    };
    let sizes = [Size { width: 1280, height: 720 }, Size { width: 1920, height: 1080 }];
    let views = sizes.map(|size| View { camera: view.camera.resized(size), ..moving(view) });
    let names = ["rgb", "luminance", "luminance and its rate"];
    let pairs = views
        .iter()
        .flat_map(|view| names.into_iter().zip(wants).map(move |(what, want)| (view, what, want)));
    pairs
        .map(|(view, what, want)| gpu_workload(&format!("{name}, {what}"), scene, &device, (*view, want)))
        .collect()
}

/// Frames one after another, each begun while the one before it is read.
fn gpu_workload(name: &str, scene: &Gaussians, device: &Device, (view, want): (View, Channels)) -> Workload {
    const FRAMES: usize = 20;
    let mut renderer = Gpu::new(device.clone(), scene, STYLE).expect("the scene can be rendered");
    let mut out = Rendered::default();
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
    let words: Vec<String> = Stage::ALL
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

fn moving(view: View) -> View {
    let velocity = Velocity { linear: DVec3::new(0.5, 0.0, 0.2), angular: DVec3::new(0.0, 0.5, 0.0) };
    View { velocity, ..view }
}

/// The demo's scene from the middle of its capture.
fn still_life() -> (&'static str, Arc<Gaussians>, View) {
    let life = StillLife::default();
    let photo = &procedural::capture(&life).views[life.views as usize / 2];
    let view = View::still(photo.camera, photo.world_from_camera);
    ("still-life", Arc::new(procedural::gaussians(&life)), view)
}

/// A real capture from outside: its up is -y, its centre (0, -0.5, 0), its radius about 1.
fn playbot() -> Option<(&'static str, Arc<Gaussians>, View)> {
    let scene = scene::read(&shared("playbot.spz")?).expect("the scene is sound");
    let size = Size { width: 1280, height: 720 };
    let view = look_at(DVec3::new(1.5, -1.1, 2.0), DVec3::new(0.0, -0.5, 0.0), size);
    Some(("playbot.spz", Arc::new(scene), view))
}

fn workload(name: &str, scene: &Arc<Gaussians>, view: View, want: Channels) -> Workload {
    let mut renderer = Cpu::new(Arc::clone(scene), STYLE).expect("the scene can be rendered");
    let mut out = Rendered::default();
    let view = moving(view);
    let work = renderer.render(&view, want, &mut out).expect("the view can be rendered");
    let (gaussians, size) = (scene.len(), view.camera.size);
    let each = work.blended as f64 / size.pixels() as f64;
    let what = format!("{name}, {gaussians} Gaussians, {size}, rules official, {each:.1} blended a pixel");
    let run = move || {
        timed(|| {
            renderer.render(&view, want, &mut out).expect("it was rendered before");
            vec![amount(gaussians, "MGaussian"), amount(size.pixels(), "Mpixel"), amount(1, "frame")]
        })
    };
    Workload { part: "render", what, rival: false, run: Box::new(run) }
}

/// A camera with a horizontal field of view of 60 degrees, its image's down along world y.
fn look_at(centre: DVec3, target: DVec3, size: Size) -> View {
    let forward = (target - centre).normalize();
    let right = DVec3::Y.cross(forward).normalize();
    let rotation = DQuat::from_mat3(&DMat3::from_cols(right, forward.cross(right), forward));
    let (width, height) = (f64::from(size.width), f64::from(size.height));
    let focal = width / (2.0 * libm::tan(30f64.to_radians()));
    let camera = Camera { size, fx: focal, fy: focal, cx: width / 2.0, cy: height / 2.0 };
    View::still(camera, Se3 { rotation, translation: centre })
}
