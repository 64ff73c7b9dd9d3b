//! The CPU renderer against images by an independent float64 renderer, which blends every pixel against every
//! Gaussian in depth order.
//!
//! Limits (`data/golden/render`): mean absolute error 2e-5, maximum 5e-3. Two float32 effects lie between: a layer
//! whose opacity is within rounding of 1/255 is blended or not (at most 1/255 of a colour), and pixel positions are
//! rounded to 6e-5 px at 1000 px.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]
#![expect(clippy::print_stdout, reason = "the table of differences")]

use crate::support::{ply, shared};
use glam::{DMat3, DQuat, DVec3};
use gs2e::camera::Camera;
use gs2e::image::{Size, luminance};
use gs2e::render::cpu::Cpu;
use gs2e::render::{Channels, Rendered, Renderer, Rules, Style, View, Work};
use gs2e::se3::Se3;
use serde::Deserialize;
use std::path::Path;
use std::sync::Arc;

const MEAN_LIMIT: f64 = 2e-5;
const LARGEST_LIMIT: f64 = 5e-3;

#[derive(Deserialize)]
struct Case {
    name: String,
    ply: String,
    mode: String,
    antialiased: bool,
    background: [f32; 3],
    camera: GoldenCamera,
    stats: Stats,
    same_as: Option<String>,
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
struct Stats {
    blended_pixels: u64,
    stopped_pixels: u64,
}

impl GoldenCamera {
    fn view(&self) -> View {
        let world_from_camera = DMat3::from_cols(self.r[0], self.r[1], self.r[2]);
        View {
            camera: Camera {
                size: Size { width: self.w, height: self.h },
                fx: self.fx,
                fy: self.fy,
                cx: self.cx,
                cy: self.cy,
            },
            world_from_camera: Se3 {
                rotation: DQuat::from_mat3(&world_from_camera),
                translation: -(world_from_camera * self.t),
            },
        }
    }
}

impl Case {
    /// The rules, where the back end has them.
    fn rules(&self) -> Option<Rules> {
        match self.mode.as_str() {
            "official" => Some(Rules::Official),
            "exact" => Some(Rules::Exact),
            _ => None,
        }
    }

    fn render(&self, root: &Path, rules: Rules) -> (Rendered, Work) {
        let scene = Arc::new(ply::read(&root.join(&self.ply)));
        let style = Style { rules, antialiased: self.antialiased, background: self.background };
        let mut out = Rendered::default();
        let want = Channels { rgb: true, luminance: true, alpha: true, depth: true };
        let work = Cpu::new(scene, style).unwrap().render(&self.camera.view(), want, &mut out).unwrap();
        (out, work)
    }
}

fn cases(root: &Path) -> Vec<Case> {
    serde_json::from_slice(&std::fs::read(root.join("manifest.json")).unwrap()).unwrap()
}

fn npy(path: &Path) -> Vec<f32> {
    let bytes = std::fs::read(path).unwrap();
    npyz::NpyFile::new(&bytes[..]).unwrap().into_vec().unwrap()
}

/// Mean, maximum, and share above 1e-3 of the absolute differences.
fn difference(found: &[f32], wanted: &[f32]) -> [f64; 3] {
    assert_eq!(found.len(), wanted.len());
    let n = wanted.len() as f64;
    let each = || found.iter().zip(wanted).map(|(a, b)| f64::from((a - b).abs()));
    assert!(each().all(f64::is_finite));
    [each().sum::<f64>() / n, each().fold(0.0, f64::max), each().filter(|&d| d > 1e-3).count() as f64 / n]
}

fn row(name: &str, what: &str, [mean, largest, share]: [f64; 3]) -> bool {
    let within = mean <= MEAN_LIMIT && largest <= LARGEST_LIMIT;
    let verdict = if within { "" } else { "  OVER" };
    println!("{name:28} {what:9} {mean:9.2e} {largest:9.2e} {share:9.2e}{verdict}");
    within
}

#[test]
fn every_golden_of_the_rules_that_exist() {
    let Some(root) = shared::path("data/golden/render") else { return };
    let cases = cases(&root);
    println!("{:28} {:9} {:>9} {:>9} {:>9}", "case", "channel", "mean", "max", "> 1e-3");
    let mut fine = true;
    for case in &cases {
        let Some(rules) = case.rules() else { continue };
        let golden = case.same_as.as_ref().unwrap_or(&case.name);
        let (found, work) = case.render(&root, rules);
        let rgb = found.rgb.as_ref().unwrap().pixels();
        let wanted = npy(&root.join(format!("{golden}.rgb.npy")));
        fine &= row(&case.name, "rgb", difference(rgb.as_flattened(), &wanted));
        let grey: Vec<f32> = wanted.as_chunks().0.iter().map(|&c| luminance(c)).collect();
        fine &= row(&case.name, "luminance", difference(found.luminance.as_ref().unwrap().pixels(), &grey));
        let alpha = npy(&root.join(format!("{golden}.alpha.npy")));
        fine &= row(&case.name, "alpha", difference(found.alpha.as_ref().unwrap().pixels(), &alpha));
        // The counts are whole numbers that the rounding of a few opacities near 1/255 may move.
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
    let Some(root) = shared::path("data/golden/render") else { return };
    let cases = cases(&root);
    for case in &cases {
        let Some(twin) = cases.iter().find(|c| Some(&c.name) == case.same_as.as_ref()) else { continue };
        let (Some(rules), Some(twins)) = (case.rules(), twin.rules()) else { continue };
        let [a, b] = [case.render(&root, rules), twin.render(&root, twins)].map(|(image, _)| image.rgb);
        assert!(a == b, "{} and {}", case.name, twin.name);
    }
}
