//! Both CPU renderers, compared with images by an independent float64 renderer that blends every
//! pixel with every Gaussian in depth order.
//!
//! Limits (`tests/golden/render`): mean absolute error 2e-5, 99.9 % at most 1e-3, maximum 5e-3. Two
//! effects of float32 explain them: a layer whose opacity is within rounding of 1/255 is blended or
//! not (at most 1/255 of a colour), and pixel positions are rounded to 6e-5 px at 1000 px. The
//! reference computes in float64 too: its mean error is below 1e-6, mostly the rounding of its
//! images to 32 bits; its largest error is a layer at exactly 1/255.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]
#![expect(clippy::print_stdout, reason = "the table of differences")]

use crate::support::gaussians::ALL;
use crate::support::{golden, ply, shared};
use glam::{DMat3, DQuat, DVec3};
use gs2e_image::{Size, luminance};
use gs2e_num::se3::Se3;
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::reference::ReferenceRenderer;
use gs2e_render::{LayerOrder, RenderRules, RenderStyle, RenderWork, RenderedImages, Renderer};
use gs2e_scene::Gaussians;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::CameraView;
use serde::Deserialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const MEAN_LIMIT: f64 = 2e-5;
const MAX_LIMIT: f64 = 5e-3;
const REFERENCE_MEAN_LIMIT: f64 = 1e-6;

#[derive(Deserialize)]
pub(super) struct Case {
    pub(super) name: String,
    ply: String,
    mode: String,
    antialiased: bool,
    background: [f32; 3],
    camera: GoldenCamera,
    pub(super) stats: Stats,
    pub(super) same_as: Option<String>,
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
pub(super) struct Stats {
    pub(super) blended_pixels: u64,
    pub(super) stopped_pixels: u64,
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

    pub(super) fn style(&self) -> RenderStyle {
        RenderStyle {
            rules: self.rules(),
            order: LayerOrder::Depth,
            antialiased: self.antialiased,
            background: self.background,
        }
    }

    pub(super) fn scene(&self, root: &Path) -> Arc<Gaussians> {
        Arc::new(ply::read(&root.join(&self.ply)))
    }

    pub(super) fn render(&self, renderer: &mut dyn Renderer) -> (RenderedImages, RenderWork) {
        let mut out = RenderedImages::default();
        let work = renderer.render(&self.camera.view(), ALL, &mut out).unwrap();
        (out, work)
    }

    fn by_cpu(&self, root: &Path) -> (RenderedImages, RenderWork) {
        self.render(&mut CpuRenderer::new(self.scene(root), self.style()).unwrap())
    }
}

fn cases(root: &Path) -> Vec<Case> {
    serde_json::from_slice(&std::fs::read(root.join("manifest.json")).unwrap()).unwrap()
}

/// The folder of the synthetic cases, and all cases.
pub(super) fn synthetic() -> (PathBuf, Vec<Case>) {
    let root = golden::folder("render");
    let cases = cases(&root);
    (root, cases)
}

/// The folder of the cases of a captured scene, and all of them; `None` without the optional test
/// data.
pub(super) fn captured() -> Option<(PathBuf, Vec<Case>)> {
    let root = shared::path("data/golden/render")?;
    let mut cases = cases(&root);
    cases.retain(|case| case.name.starts_with("playbot"));
    assert!(!cases.is_empty(), "the captured scene has cases");
    Some((root, cases))
}

pub(super) fn npy(path: &Path) -> Vec<f32> {
    let bytes = std::fs::read(path).unwrap();
    npyz::NpyFile::new(&bytes[..]).unwrap().into_vec().unwrap()
}

/// Mean, maximum, and share above 1e-3 of the absolute differences.
pub(super) fn difference(found: &[f32], wanted: &[f32]) -> [f64; 3] {
    assert_eq!(found.len(), wanted.len());
    let n = wanted.len() as f64;
    let each = || found.iter().zip(wanted).map(|(a, b)| f64::from((a - b).abs()));
    assert!(each().all(f64::is_finite));
    [each().sum::<f64>() / n, each().fold(0.0, f64::max), each().filter(|&d| d > 1e-3).count() as f64 / n]
}

pub(super) fn row(name: &str, what: &str, [mean, largest, share]: [f64; 3]) -> bool {
    let within = mean <= MEAN_LIMIT && largest <= MAX_LIMIT && share <= 1e-3;
    let verdict = if within { "" } else { "  OVER" };
    println!("{name:28} {what:9} {mean:9.2e} {largest:9.2e} {share:9.2e}{verdict}");
    within
}

#[test]
fn every_golden_is_met() {
    let (root, cases) = synthetic();
    assert_eq!(cases.len(), 20, "synthetic cases");
    meets(&root, &cases);
}

#[test]
fn every_golden_of_a_captured_scene_is_met() {
    let Some((root, cases)) = captured() else { return };
    meets(&root, &cases);
}

fn meets(root: &Path, cases: &[Case]) {
    println!("{:28} {:9} {:>9} {:>9} {:>9}", "case", "channel", "mean", "max", "> 1e-3");
    let mut fine = true;
    for case in cases {
        let golden = case.same_as.as_ref().unwrap_or(&case.name);
        let (found, work) = case.by_cpu(root);
        let rgb = found.rgb.as_ref().unwrap().pixels();
        let wanted = npy(&root.join(format!("{golden}.rgb.npy")));
        fine &= row(&case.name, "rgb", difference(rgb.as_flattened(), &wanted));
        let grey: Vec<f32> = wanted.as_chunks().0.iter().map(|&c| luminance(c)).collect();
        fine &= row(&case.name, "luminance", difference(found.luminance.as_ref().unwrap().pixels(), &grey));
        let alpha = npy(&root.join(format!("{golden}.alpha.npy")));
        fine &= row(&case.name, "alpha", difference(found.alpha.as_ref().unwrap().pixels(), &alpha));
        // The counts are whole numbers that the rounding of a few opacities near 1/255 may change.
        let near = |a: u64, b: u64| a.abs_diff(b) <= 2 + b / 100_000;
        let Stats { blended_pixels, stopped_pixels } = case.stats;
        let counts_agree = near(work.blended, blended_pixels) && near(work.stopped, stopped_pixels);
        println!(
            "  blended {} of {blended_pixels}, stopped {} of {stopped_pixels}",
            work.blended, work.stopped
        );
        fine &= counts_agree;
    }
    assert!(fine, "a golden is missed, see the table");
}

#[test]
fn cases_said_to_be_the_same_have_the_same_bits() {
    let (root, cases) = synthetic();
    for case in &cases {
        let Some(twin) = cases.iter().find(|c| Some(&c.name) == case.same_as.as_ref()) else { continue };
        let [a, b] = [case, twin].map(|case| case.by_cpu(&root).0.rgb);
        assert!(a == b, "{} and {}", case.name, twin.name);
    }
}

#[test]
fn the_reference_meets_the_goldens_within_rounding() {
    let (root, cases) = synthetic();
    reference_meets(&root, &cases);
}

#[test]
fn the_reference_meets_the_goldens_of_a_captured_scene() {
    let Some((root, cases)) = captured() else { return };
    reference_meets(&root, &cases);
}

fn reference_meets(root: &Path, cases: &[Case]) {
    for case in cases {
        let golden = case.same_as.as_ref().unwrap_or(&case.name);
        let (found, work) = case.render(&mut ReferenceRenderer::new(case.scene(root), case.style()).unwrap());
        let wanted = npy(&root.join(format!("{golden}.rgb.npy")));
        let rgb = difference(found.rgb.as_ref().unwrap().pixels().as_flattened(), &wanted);
        let alpha = npy(&root.join(format!("{golden}.alpha.npy")));
        let alpha = difference(found.alpha.as_ref().unwrap().pixels(), &alpha);
        println!(
            "{:28} rgb {:9.2e} {:9.2e}, alpha {:9.2e} {:9.2e}",
            case.name, rgb[0], rgb[1], alpha[0], alpha[1]
        );
        assert!(rgb[0] <= REFERENCE_MEAN_LIMIT && alpha[0] <= REFERENCE_MEAN_LIMIT, "{}", case.name);
        assert!(rgb[1] <= MAX_LIMIT && alpha[1] <= MAX_LIMIT, "{}", case.name);
        let near = |a: u64, b: u64| a.abs_diff(b) <= 1 + b / 1_000_000;
        assert!(near(work.blended, case.stats.blended_pixels), "{}: {}", case.name, work.blended);
    }
}
