//! Both CPU renderers, compared with images by an independent float64 renderer that blends every
//! pixel with every Gaussian in depth order.
//!
//! Limits (`tests/golden/render`): mean absolute error 2e-5, 99.9 % at most 1e-3, maximum 5e-3. Two
//! effects of float32 explain them: a layer whose opacity is within rounding of 1/255 is blended or
//! not (at most 1/255 of a colour), and pixel positions are rounded to 6e-5 px at 1000 px. The
//! reference computes in float64 too: its mean error is below 1e-6, mostly the rounding of its
//! images to 32 bits; its largest error is a layer at exactly 1/255.

use super::cases::{Case, MAX_LIMIT, Stats, captured, difference, npy, row, synthetic};
use gs2e_image::luminance;
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::reference::ReferenceRenderer;
use gs2e_render::{RenderWork, RenderedImages};
use std::path::Path;

const REFERENCE_MEAN_LIMIT: f64 = 1e-6;

fn by_cpu(case: &Case, root: &Path) -> (RenderedImages, RenderWork) {
    case.render(&mut CpuRenderer::new(case.scene(root), case.style()).unwrap())
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
        let (found, work) = by_cpu(case, root);
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
        let [a, b] = [case, twin].map(|case| by_cpu(case, &root).0.rgb);
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
