//! A method that is trained on an export: the built-in trainer on the pictures that `event-3dgs` integrates
//! from events, judged by sharp frames that it never saw.
//!
//! It knows one frame, the first, and events; the colours of the points, which come from sharp frames, are
//! replaced by grey.

use super::export;
use crate::release::small::{gs2e, said};
use glam::DVec2;
use gs2e_image::likeness::{mean_square, psnr_db};
use gs2e_image::{Image, luminance, png};
use gs2e_num::se3::Se3;
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::{ChannelSet, LayerOrder, RenderRules, RenderStyle, RenderedImages, Renderer as _};
use gs2e_scene as scene;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::CameraView;
use gs2e_source::colmap::ColmapModel;
use std::fs::{self, File};
use std::io::BufReader;
use std::path::Path;
use std::sync::Arc;

const RECIPE: &str = "\
version: 1
scene: still
seed: 7
source:
  procedural: { kind: still-life, gaussians: 2000, views: 6, arc: 30, seed: 1 }
camera: { width: 96, height: 72 }
trajectories: [{ name: base, refine: { window: 1, factor: 20 } }]
sensor:
  esim: { threshold: { on: 0.1, off: 0.1 }, eps: 0.01 }
outputs: [events, sharp, depth]
depth: { every: 20 }
";

/// Every how many frames one is held out; the trainer's default.
const HOLD_OUT: usize = 8;

/// Replaces the colours of the points. A point without a track has 51 bytes, its colour after 32.
fn forget_colours(export: &Path) {
    let path = export.join("sparse/0/points3D.bin");
    let mut bytes = fs::read(&path).unwrap();
    bytes[8..].chunks_mut(51).for_each(|point| point[32..35].fill(128));
    fs::write(path, bytes).unwrap();
}

/// Number, camera and pose of the held-out frames.
fn held_out(export: &Path) -> Vec<(String, Camera, Se3)> {
    let model = ColmapModel::find_model(&export.join("sparse/0")).unwrap();
    let cameras = model.cameras().unwrap();
    let images = model.images().unwrap();
    let view = |image: &gs2e_source::colmap::ColmapImage| {
        let camera_from_world = Se3 { rotation: image.rotation.rotation, translation: image.translation };
        (image.name.clone(), cameras[&image.camera_id].camera, camera_from_world.inverse())
    };
    images.iter().step_by(HOLD_OUT).map(view).collect()
}

/// A sharp frame in grey, 0 to 1.
fn truth(export: &Path, name: &str) -> Image<[f32; 3]> {
    let file = File::open(export.join("renders").join(name)).unwrap();
    let image = png::read_rgb(BufReader::new(file)).unwrap();
    let grey = |rgb: &[u8; 3]| [luminance(rgb.map(f32::from)) / 255.0; 3];
    Image::from_vec(image.size(), image.pixels().iter().map(grey).collect())
}

/// Mean PSNR of the held-out frames of a scene.
fn judged(ply: &Path, export: &Path) -> f64 {
    let style = RenderStyle {
        rules: RenderRules::Soft,
        order: LayerOrder::Depth,
        antialiased: false,
        background: [0.0; 3],
    };
    let mut renderer = CpuRenderer::new(Arc::new(scene::read_file(ply).unwrap()), style).unwrap();
    let views = held_out(export);
    let psnr = |(name, camera, pose): &(String, Camera, Se3)| {
        let mut out = RenderedImages::default();
        let view = CameraView::at_rest(*camera, *pose);
        renderer.render(&view, ChannelSet { rgb: true, ..ChannelSet::NONE }, &mut out).unwrap();
        psnr_db(mean_square(&out.rgb.unwrap(), &truth(export, name)))
    };
    let figures: Vec<f64> = views.iter().map(psnr).collect();
    figures.iter().sum::<f64>() / figures.len() as f64
}

#[test]
fn gaussians_trained_on_events_show_frames_that_they_never_saw() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("still.yaml"), RECIPE).unwrap();
    let output = gs2e(folder.path(), &["release", "--copy", "--to", "out", "still.yaml"]);
    assert!(output.status.success(), "{}", said(&output));
    let e3 = folder.path().join("e3");
    let output = export(&folder.path().join("out"), &e3, "event-3dgs", &[]);
    assert!(output.status.success(), "{}", said(&output));
    forget_colours(&e3);
    let trained = |iterations: &str| {
        let ply = format!("{iterations}.ply");
        let train = ["train", "--capture", "e3", "--gaussians", "400", "--seed", "3", "--out", &ply];
        let output = gs2e(folder.path(), &[&train[..], &["--iterations", iterations]].concat());
        assert!(output.status.success(), "{}", said(&output));
        judged(&folder.path().join(ply), &e3)
    };
    let [early, late] = ["20", "600"].map(trained);
    // A method without events knows the first frame, and shows it everywhere.
    let views = held_out(&e3);
    let first = truth(&e3, &views[0].0);
    let others: Vec<f64> =
        views[1..].iter().map(|(name, ..)| psnr_db(mean_square(&first, &truth(&e3, name)))).collect();
    let floor = others.iter().sum::<f64>() / others.len() as f64;
    eprintln!(
        "trained on events: {early:.2} dB after 20 iterations, {late:.2} dB after 600; first frame {floor:.2} dB"
    );
    assert!(late > early + 3.0 && late > floor + 3.0, "{early} {late} {floor}");
    let moved = views[0].2.translation.distance(views[views.len() - 1].2.translation);
    assert!(moved > 0.1 && DVec2::new(early, late).is_finite());
}
