//! The cases of `tests/golden/render`, and their limits. The tests of `gs2e-gpu` have them too.

use glam::{DMat3, DQuat, DVec3};
use gs2e_image::Size;
use gs2e_num::se3::Se3;
use gs2e_render::{ChannelSet, LayerOrder, RenderRules, RenderStyle, RenderWork, RenderedImages, Renderer};
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::{CameraVelocity, CameraView};
use gs2e_scene::{Gaussians, SceneScreening};
use gs2e_testing::{golden, ply, shared};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const MEAN_LIMIT: f64 = 2e-5;
pub(crate) const MAX_LIMIT: f64 = 5e-3;

#[derive(Deserialize)]
pub(crate) struct Case {
    pub(crate) name: String,
    ply: String,
    mode: String,
    antialiased: bool,
    background: [f32; 3],
    camera: GoldenCamera,
    pub(crate) stats: Stats,
    pub(crate) same_as: Option<String>,
}

#[derive(Deserialize)]
#[serde(rename_all = "UPPERCASE")]
struct GoldenCamera {
    w: u32,
    h: u32,
    #[serde(rename = "fx")]
    fx: f64,
    #[serde(rename = "fy")]
    fy: f64,
    #[serde(rename = "cx")]
    cx: f64,
    #[serde(rename = "cy")]
    cy: f64,
    /// World to camera, row by row.
    r: [DVec3; 3],
    #[serde(rename = "t")]
    t: DVec3,
}

#[derive(Deserialize)]
pub(crate) struct Stats {
    pub(crate) blended_pixels: u64,
    pub(crate) stopped_pixels: u64,
}

impl GoldenCamera {
    fn view(&self) -> CameraView {
        let world_from_camera = DMat3::from_cols(self.r[0], self.r[1], self.r[2]);
        let size = Size { width: self.w, height: self.h };
        let camera = Camera { size, fx: self.fx, fy: self.fy, cx: self.cx, cy: self.cy, lens: None };
        let rotation = DQuat::from_mat3(&world_from_camera);
        CameraView::at_rest(camera, Se3 { rotation, translation: -(world_from_camera * self.t) })
    }
}

impl Case {
    fn rules(&self) -> RenderRules {
        match self.mode.as_str() {
            "official" => RenderRules::Official,
            "exact" => RenderRules::Exact,
            "gsplat" => RenderRules::Gsplat,
            mode => panic!("no golden has the rules {mode}"),
        }
    }

    pub(crate) fn style(&self) -> RenderStyle {
        RenderStyle {
            rules: self.rules(),
            order: LayerOrder::Depth,
            antialiased: self.antialiased,
            background: self.background,
        }
    }

    pub(crate) fn scene(&self, root: &Path) -> Arc<Gaussians> {
        Arc::new(read_ply(&root.join(&self.ply)))
    }

    pub(crate) fn render(&self, renderer: &mut dyn Renderer) -> (RenderedImages, RenderWork) {
        let mut out = RenderedImages::default();
        let work = renderer.render(&self.camera.view(), ChannelSet::AT_REST, &mut out).unwrap();
        (out, work)
    }
}

fn cases(root: &Path) -> Vec<Case> {
    serde_json::from_slice(&std::fs::read(root.join("manifest.json")).unwrap()).unwrap()
}

/// The folder of the synthetic cases, and all cases.
pub(crate) fn synthetic() -> (PathBuf, Vec<Case>) {
    let root = golden::folder("render");
    let cases = cases(&root);
    (root, cases)
}

/// The folder of the cases of a captured scene, and all of them; `None` without the optional test
/// data.
pub(crate) fn captured() -> Option<(PathBuf, Vec<Case>)> {
    let root = shared::path("data/golden/render")?;
    let mut cases = cases(&root);
    cases.retain(|case| case.name.starts_with("playbot"));
    assert!(!cases.is_empty(), "the captured scene has cases");
    Some((root, cases))
}

pub(crate) fn npy(path: &Path) -> Vec<f32> {
    let bytes = std::fs::read(path).unwrap();
    npyz::NpyFile::new(&bytes[..]).unwrap().into_vec().unwrap()
}

/// Mean, maximum, and share above 1e-3 of the absolute differences.
pub(crate) fn difference(found: &[f32], wanted: &[f32]) -> [f64; 3] {
    assert_eq!(found.len(), wanted.len());
    let n = wanted.len() as f64;
    let each = || found.iter().zip(wanted).map(|(a, b)| f64::from((a - b).abs()));
    assert!(each().all(f64::is_finite));
    [each().sum::<f64>() / n, each().fold(0.0, f64::max), each().filter(|&d| d > 1e-3).count() as f64 / n]
}

pub(crate) fn row(name: &str, what: &str, [mean, largest, share]: [f64; 3]) -> bool {
    let within = mean <= MEAN_LIMIT && largest <= MAX_LIMIT && share <= 1e-3;
    let verdict = if within { "" } else { "  OVER" };
    println!("{name:28} {what:9} {mean:9.2e} {largest:9.2e} {share:9.2e}{verdict}");
    within
}

/// A scene, by a reader that shares no code with ours.
fn read_ply(path: &Path) -> Gaussians {
    let read = ply::read(path);
    Gaussians {
        origin: DVec3::ZERO,
        positions: read.positions,
        log_scales: read.log_scales,
        rotations: read.rotations,
        opacity_logits: read.opacity_logits,
        sh: read.sh,
        sh_degree: read.sh_degree,
        antialiased: None,
        screening: SceneScreening::default(),
        motion: None,
    }
}

/// A view that moves in every direction at once.
pub(crate) fn moving(view: CameraView) -> CameraView {
    let velocity = CameraVelocity { linear: DVec3::new(0.6, -0.3, 0.8), angular: DVec3::new(0.2, 0.7, -0.5) };
    CameraView { velocity, ..view }
}

#[derive(Deserialize)]
struct Transforms {
    w: u32,
    h: u32,
    fl_x: f64,
    fl_y: f64,
    cx: f64,
    cy: f64,
    frames: Vec<Frame>,
}

#[derive(Deserialize)]
struct Frame {
    /// Camera to world, row by row, with y up and z back.
    transform_matrix: [[f64; 4]; 4],
}

/// A captured scene and its twelfth view, at this size; `None` without the optional test data.
pub(crate) fn playbot(size: Size) -> Option<(Arc<Gaussians>, CameraView)> {
    let scene = Arc::new(read_ply(&shared::path("data/scenes/playbot_lod3.ply")?));
    let file = std::fs::read(shared::path("data/scenes/playbot.transforms.json")?).unwrap();
    let Transforms { w, h, fl_x, fl_y, cx, cy, frames } = serde_json::from_slice(&file).unwrap();
    let camera = Camera::pinhole(Size { width: w, height: h }, [fl_x, fl_y, cx, cy]).resized(size);
    let column = |k: usize| DVec3::from_array([0, 1, 2].map(|i| frames[11].transform_matrix[i][k]));
    let rotation = DQuat::from_mat3(&DMat3::from_cols(column(0), -column(1), -column(2)));
    Some((scene, CameraView::at_rest(camera, Se3 { rotation, translation: column(3) })))
}
