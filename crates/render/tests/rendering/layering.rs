//! Layers of nearly the same depth that cover each other in part: rules `soft`, `order: blended`.

use super::cases::playbot;
use super::{ALL, OFFICIAL, render};
use gs2e_image::Size;
use gs2e_render::cpu::{CpuRenderer, InstructionSet};
use gs2e_render::reference::ReferenceRenderer;
use gs2e_render::{ChannelSet, LayerOrder, RenderError, RenderRules, RenderStyle, RenderedImages, Renderer};
use gs2e_scene::Gaussians;
use gs2e_scene::blobs::{ColourBlob, blob_crowd, blob_scene, view_ahead};
use gs2e_scene::camera::view::CameraView;
use std::sync::Arc;

const SOFT: RenderStyle = RenderStyle { rules: RenderRules::Soft, background: [0.2, 0.1, 0.4], ..OFFICIAL };
const BLENDED: RenderStyle = RenderStyle { order: LayerOrder::Blended, ..SOFT };

/// A red and a blue layer that fill the picture, the blue one deeper by `behind`.
fn pair(behind: f32) -> Gaussians {
    let layer = |z: f32, opacity: f64, colour: [f64; 3]| ColourBlob {
        position: [0.0, 0.0, z],
        deviations: [50.0, 50.0, 1e-4],
        opacity,
        colour,
        ..ColourBlob::default()
    };
    blob_scene(&[layer(4.0, 0.8, [1.0, 0.0, 0.0]), layer(4.0 + behind, 0.6, [0.0, 0.0, 1.0])])
}

/// Red and blue of the middle pixel, by `CpuRenderer`.
fn middle(scene: Gaussians, style: RenderStyle) -> [f64; 2] {
    let (out, _) = render(scene, style, &view_ahead(17, 17, 20.0));
    let [r, _, b] = out.rgb.unwrap().pixels()[8 * 17 + 8];
    [r, b].map(f64::from)
}

#[test]
fn layers_of_one_depth_share_the_light_evenly() {
    let [r, b] = middle(pair(0.0), BLENDED);
    let rest = (1.0 - 0.8) * (1.0 - 0.6);
    let wanted = [0.8 * (1.0 - 0.3) + rest * 0.2, 0.6 * (1.0 - 0.4) + rest * 0.4];
    // opacities are rounded at 2^-24 and the exponential is good to 2e-7
    assert!((r - wanted[0]).abs() < 1e-6 && (b - wanted[1]).abs() < 1e-6, "{r} {b}, wanted {wanted:?}");
    // the order in the file does not matter
    let swapped = blob_scene(&[0, 1].map(|k| ColourBlob {
        position: [0.0, 0.0, 4.0],
        deviations: [50.0, 50.0, 1e-4],
        opacity: [0.6, 0.8][k],
        colour: [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]][k],
        ..ColourBlob::default()
    }));
    let [r2, b2] = middle(swapped, BLENDED);
    assert!((r - r2).abs() < 1e-6 && (b - b2).abs() < 1e-6);
}

#[test]
fn layers_that_pass_each_other_make_no_jump() {
    const STEP: f32 = 1e-4;
    let path: Vec<[[f64; 2]; 2]> = (-100..=100_i16)
        .map(|k| [SOFT, BLENDED].map(|style| middle(pair(f32::from(k) * STEP), style)))
        .collect();
    let jump =
        |which: usize| path.windows(2).map(|w| (w[1][which][0] - w[0][which][0]).abs()).fold(0.0, f64::max);
    // Red gives way to blue by 0.8 * 0.6 in all. A step is 1e-4 / (2 * 5e-4 * 4) of the way, along
    // a curve with a slope of at most 1.5.
    let most = 0.8 * 0.6 * 1.5 * 1e-4 / (2.0 * 5e-4 * 4.0);
    assert!((jump(0) - 0.48).abs() < 1e-6, "in the plain order all at once: {}", jump(0));
    // positions near 4 are rounded at 2^-22, 1/400 of a step
    assert!(jump(1) <= most * 1.01, "{} of at most {most}", jump(1));
    // 0.01 of 4 is beyond the depths that are blended: both ends are as in the plain order
    for end in [path[0], path[200]] {
        assert!((end[0][0] - end[1][0]).abs() < 1e-6 && (end[0][1] - end[1][1]).abs() < 1e-6);
    }
}

/// Mean and largest difference of luminance between the back ends, and between the CPU's two
/// orders.
fn compare(scene: &Arc<Gaussians>, view: &CameraView) -> [[f64; 2]; 2] {
    let grey = |renderer: &mut dyn Renderer| {
        let mut out = RenderedImages::default();
        renderer.render(view, ChannelSet { luminance: true, ..ChannelSet::default() }, &mut out).unwrap();
        out.luminance.unwrap()
    };
    let reference = grey(&mut ReferenceRenderer::new(scene.clone(), BLENDED).unwrap());
    let cpu = grey(&mut CpuRenderer::new(scene.clone(), BLENDED).unwrap());
    let plain = grey(&mut CpuRenderer::new(scene.clone(), SOFT).unwrap());
    [&reference, &plain].map(|other| {
        let pairs = cpu.pixels().iter().zip(other.pixels());
        let apart: Vec<f64> = pairs.map(|(a, b)| f64::from((a - b).abs())).collect();
        [apart.iter().sum::<f64>() / apart.len() as f64, apart.iter().copied().fold(0.0, f64::max)]
    })
}

#[test]
fn both_back_ends_agree() {
    let mut cases = vec![("crowd", Arc::new(blob_scene(&blob_crowd(3000, 4))), view_ahead(203, 117, 150.0))];
    if let Some((scene, view)) = playbot(Size { width: 160, height: 90 }) {
        cases.push(("playbot", scene, view));
    }
    for (name, scene, view) in cases {
        let [[mean, most], [moved, furthest]] = compare(&scene, &view);
        println!(
            "{name}: mean {mean:.1e}, largest {most:.1e}; from the plain order {moved:.1e}, {furthest:.1e}"
        );
        // A depth rounded at 2^-24 changes the share of two layers by 1.5 / (2 * 5e-4) of that,
        // 9e-5. The limits are those of the goldens.
        assert!(mean <= 2e-5 && most <= 5e-3, "{name}: {mean:e} {most:e}");
        assert!(moved > 10.0 * mean, "{name}: the order makes a difference");
    }
}

#[test]
fn no_bit_depends_on_threads_instructions_or_other_channels() {
    let scene = Arc::new(blob_scene(&blob_crowd(2000, 9)));
    let view = view_ahead(150, 90, 100.0);
    let by = |threads: usize, set: InstructionSet, want: ChannelSet| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut cpu = CpuRenderer::new(scene.clone(), BLENDED).unwrap();
            cpu.set_instructions(set);
            let mut out = RenderedImages::default();
            let work = cpu.render(&view, want, &mut out).unwrap();
            let bits: Vec<u32> = out.luminance.unwrap().pixels().iter().map(|v| v.to_bits()).collect();
            (bits, work)
        })
    };
    let first = by(1, InstructionSet::available_sets()[0], ALL);
    assert!(first.1.blended > 10_000 && first.1.stopped > 100, "the scene is a test: {:?}", first.1);
    assert!(first == by(4, InstructionSet::widest_set(), ALL));
    let moving = ChannelSet { luminance_rate: true, ..ALL };
    assert!(first == by(3, InstructionSet::widest_set(), moving), "the rate changes no value");
}

#[test]
fn the_blended_order_blends_and_stops_as_the_plain_order() {
    let view = view_ahead(150, 90, 100.0);
    let [soft, blended] =
        [SOFT, BLENDED].map(|style| render(blob_scene(&blob_crowd(2000, 9)), style, &view).1);
    assert_eq!(soft.blended, blended.blended);
    assert_eq!(soft.stopped, blended.stopped);
}

#[test]
fn other_rules_have_no_blended_order() {
    for rules in [RenderRules::Official, RenderRules::Exact, RenderRules::Gsplat] {
        let style = RenderStyle { rules, ..BLENDED };
        let refused = [
            CpuRenderer::new(Arc::new(pair(1.0)), style).err(),
            ReferenceRenderer::new(Arc::new(pair(1.0)), style).err(),
        ];
        for error in refused {
            let Some(RenderError::Style(because)) = error else { panic!("{rules:?}: {error:?}") };
            assert!(because.contains("soft"), "{because}");
        }
    }
}
