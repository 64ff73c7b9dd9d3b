//! The CPU renderer with little room for its lists. The back ends' behaviour at the limits of their
//! arithmetic is tested in `gs2e stress` (`tests/it/stress.rs`).
#![expect(clippy::cast_possible_truncation, reason = "the counts of these scenes fit every type")]

use gs2e_lab::stress::splat::scenes;
use gs2e_lab::stress::splat::scenes::ALL_RULES;
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::{ChannelSet, RenderStyle, RenderWork, RenderedImages, Renderer};
use gs2e_scene::Gaussians;
use gs2e_scene::camera::view::CameraView;
use std::sync::Arc;

fn cpu(scene: &Gaussians, style: RenderStyle) -> CpuRenderer {
    CpuRenderer::new(Arc::new(scene.clone()), style).unwrap()
}

fn image(renderer: &mut dyn Renderer, view: &CameraView) -> (RenderedImages, RenderWork) {
    let mut out = RenderedImages::default();
    let work = renderer.render(view, ChannelSet::AT_REST, &mut out).unwrap();
    (out, work)
}

/// Every value of every image, as bits, so that NaN equals itself.
fn bits(image: &RenderedImages) -> Vec<u32> {
    let planes = [&image.luminance, &image.alpha, &image.depth, &image.doubtful];
    let grey = planes.into_iter().flatten().flat_map(|plane| plane.pixels().iter());
    let colour = image.rgb.iter().flat_map(|plane| plane.pixels().as_flattened());
    grey.chain(colour).map(|v| v.to_bits()).collect()
}

/// Any limit of the lists, down to one entry, gives the same picture and the same counts.
#[test]
fn lists_in_bands_give_the_same_bits() {
    let (scene, view) = scenes::askew_crowd(3000);
    for rules in ALL_RULES {
        let style = RenderStyle { rules, ..RenderStyle::OFFICIAL };
        let mut renderer = cpu(&scene, style);
        let whole = image(&mut renderer, &view);
        assert!(whole.1.tile_pairs > 10_000, "the scene is a test: {:?}", whole.1);
        for budget in [1, 100, 3000, whole.1.tile_pairs as usize - 1, whole.1.tile_pairs as usize] {
            renderer.set_list_budget(budget);
            // twice: leftovers of the previous frame must not enter this one
            for _ in 0..2 {
                let banded = image(&mut renderer, &view);
                assert!((bits(&banded.0), banded.1) == (bits(&whole.0), whole.1), "{budget}, {rules:?}");
            }
        }
    }
}

/// Giants over a large picture have ten times the entries of the budget. Each pixel shows the first
/// two of them.
#[test]
fn giants_over_a_large_picture() {
    let (edge, n) = (2048, 6000);
    let (scene, view) = scenes::giant_scene(n, edge);
    let mut out = RenderedImages::default();
    let want = ChannelSet { luminance: true, ..ChannelSet::default() };
    let work = cpu(&scene, RenderStyle::OFFICIAL).render(&view, want, &mut out).unwrap();
    assert_eq!(work.tile_pairs, n as u64 * u64::from(edge / 16).pow(2));
    let pixels = u64::from(edge).pow(2);
    // 0.1 cubed is above 1e-4, and its fourth power is just at it: three or four layers
    assert_eq!(work.stopped, pixels);
    let grey = out.luminance.unwrap();
    let middle = grey.pixels()[(edge / 2 * edge + edge / 2) as usize];
    // 0.9 of each layer's 0.587 x 0.5 + 0.114 and, in all but the first, a little red
    assert!((f64::from(middle) / (0.999 * 0.4075) - 1.0).abs() < 2e-3, "{middle}");
    assert!((3 * pixels..=4 * pixels).contains(&work.blended), "{}", work.blended);
}
