//! The renderer's rules, compared with closed forms.

use super::{ALL, OFFICIAL, render};
use gs2e_image::{Image, luminance};
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::{ChannelSet, RenderError, RenderRules, RenderStyle, RenderedImages, Renderer};
use gs2e_scene::blobs::{ColourBlob, blob_scene, view_ahead};
use gs2e_scene::camera::view::CameraView;
use std::sync::Arc;

const EXACT: RenderStyle = RenderStyle { rules: RenderRules::Exact, ..OFFICIAL };

fn at<T: Copy>(image: Option<&Image<T>>, x: u32, y: u32) -> T {
    let image = image.unwrap();
    image.pixels()[(y * image.size().width + x) as usize]
}

/// Opacity of a layer: profile, cap, cut.
fn layer(opacity: f64, variance: f64, square_distance: f64) -> f64 {
    let alpha = (opacity * (-square_distance / (2.0 * variance)).exp()).min(0.99);
    if alpha < 1.0 / 255.0 { 0.0 } else { alpha }
}

#[test]
fn a_round_gaussian_on_the_axis_has_its_profile() {
    // focal 100 px at depth 4: deviation 0.4 is 10 px, plus the dilation
    let blob = ColourBlob { deviations: [0.4; 3], opacity: 0.8, ..ColourBlob::default() };
    let variance = 100.0 + 0.3;
    for style in [OFFICIAL, EXACT] {
        let (found, _) = render(blob_scene(&[blob]), style, &view_ahead(101, 81, 100.0));
        for y in 0..81 {
            for x in 0..101 {
                let square = (f64::from(x) - 50.0).powi(2) + (f64::from(y) - 40.0).powi(2);
                // both rules keep the whole disc down to 1/255: 32.7 px; official's square is 16-px
                // tiles beyond 31
                let wanted = layer(0.8, variance, square);
                let alpha = f64::from(at(found.alpha.as_ref(), x, y));
                // the exponent, up to 5.3, carries a few roundings of 6e-8; 1 - T rounds at 6e-8
                assert!((alpha - wanted).abs() < 1e-6, "({x}, {y}) {style:?}: {alpha}, wanted {wanted}");
            }
        }
    }
}

#[test]
fn official_extents_end_with_the_tiles_of_three_deviations() {
    // deviation 10 px: r = ceil(3 sqrt(100.3 + sqrt .1)) = 31 from pixel 50 reaches tiles 1 (16..)
    // to 5 (..95) in x; opacity 0.99 would reach 33.3 px, to columns 17..83, inside. At 45 px the
    // tiles begin at 0 instead.
    let blob = ColourBlob { deviations: [0.4; 3], opacity: 0.999, ..ColourBlob::default() };
    let mut view = view_ahead(160, 160, 100.0);
    // the mean on pixel 47: 47 - 31 = 16 starts exactly with tile 1, which excludes pixel 15 at 32
    // px
    (view.camera.cx, view.camera.cy) = (47.5, 47.5);
    let [official, exact] = [OFFICIAL, EXACT].map(|style| render(blob_scene(&[blob]), style, &view).0);
    let alpha = |image: &RenderedImages, x| f64::from(at(image.alpha.as_ref(), x, 47));
    let wanted = layer(0.999, 100.3, 32.0 * 32.0);
    assert!(wanted > 0.006 && (alpha(&exact, 15) - wanted).abs() < 1e-6);
    assert!(alpha(&official, 15).abs() < f64::EPSILON, "cut by the rule");
    assert!((alpha(&official, 16) - layer(0.999, 100.3, 31.0 * 31.0)).abs() < 1e-6);
}

#[test]
fn nearer_gaussians_are_blended_first_over_the_background() {
    let near = ColourBlob {
        position: [0.0, 0.0, 2.0],
        opacity: 0.6,
        colour: [1.0, 0.2, 0.0],
        ..ColourBlob::default()
    };
    let far = ColourBlob {
        position: [0.0, 0.0, 5.0],
        opacity: 0.7,
        colour: [0.1, 0.9, 0.4],
        ..ColourBlob::default()
    };
    let style = RenderStyle { background: [0.2, 0.4, 0.8], ..OFFICIAL };
    // the far one is written first: depth decides, not the file
    let (found, _) = render(blob_scene(&[far, near]), style, &view_ahead(33, 33, 100.0));
    let centre = at(found.rgb.as_ref(), 16, 16);
    for (c, found) in centre.into_iter().enumerate() {
        let background = f64::from(style.background[c]);
        let wanted = 0.6 * near.colour[c] + 0.4 * (0.7 * far.colour[c] + 0.3 * background);
        assert!((f64::from(found) - wanted).abs() < 5e-7, "channel {c}: {found} for {wanted}");
    }
    let depth = at(found.depth.as_ref(), 16, 16);
    let wanted = (0.6 * 2.0 + 0.4 * 0.7 * 5.0) / (0.6 + 0.4 * 0.7);
    assert!((f64::from(depth) - wanted).abs() < 2e-6, "{depth} for {wanted}");
    // a corner that neither Gaussian reaches shows the background and has no depth
    assert_eq!(at(found.rgb.as_ref(), 0, 0).map(f32::to_bits), style.background.map(f32::to_bits));
    assert!(at(found.depth.as_ref(), 0, 0).is_nan());
}

#[test]
fn depth_is_undefined_below_half_opacity() {
    for (opacity, defined) in [(0.499, false), (0.501, true)] {
        let (found, _) = render(
            blob_scene(&[ColourBlob { opacity, ..ColourBlob::default() }]),
            OFFICIAL,
            &view_ahead(17, 17, 100.0),
        );
        assert_eq!(!at(found.depth.as_ref(), 8, 8).is_nan(), defined, "opacity {opacity}");
    }
}

#[test]
fn equal_depths_follow_the_file() {
    let red = ColourBlob { opacity: 0.9, colour: [1.0, 0.0, 0.0], ..ColourBlob::default() };
    let green = ColourBlob { colour: [0.0, 1.0, 0.0], ..red };
    for (blobs, first) in [([red, green], 0), ([green, red], 1)] {
        let (found, _) = render(blob_scene(&blobs), OFFICIAL, &view_ahead(17, 17, 100.0));
        let centre = at(found.rgb.as_ref(), 8, 8);
        assert!((centre[first] - 0.9).abs() < 1e-6 && (centre[1 - first] - 0.09).abs() < 1e-6, "{centre:?}");
    }
}

#[test]
fn a_pixel_stops_before_the_layer_that_would_leave_too_little() {
    // capped at 0.99, two layers leave 1e-4 less a rounding: the second is not blended, nor any
    // later one
    let blob = |z| ColourBlob {
        position: [0.0, 0.0, z],
        deviations: [1.0; 3],
        opacity: 0.999_999,
        ..ColourBlob::default()
    };
    let (found, work) = render(blob_scene(&[1.0, 2.0, 3.0].map(blob)), OFFICIAL, &view_ahead(1, 1, 100.0));
    assert!((at(found.alpha.as_ref(), 0, 0) - 0.99).abs() < 1e-7);
    assert_eq!((work.blended, work.stopped), (1, 1));
}

#[test]
fn the_antialiased_rule_weakens_small_gaussians() {
    let style = RenderStyle { antialiased: true, ..OFFICIAL };
    // 100 px focal at depth 4: deviation 0.02 is half a pixel
    for (deviation, opacity) in [(0.02_f32, 0.8), (0.4, 0.8), (1e-5, 0.95)] {
        let blob = ColourBlob { deviations: [deviation; 3], opacity, ..ColourBlob::default() };
        let (found, _) = render(blob_scene(&[blob]), style, &view_ahead(17, 17, 100.0));
        let variance = (f64::from(deviation) * 25.0).powi(2);
        // both determinants are squares; the floor under their ratio is 2.5e-5
        let wanted = opacity * (variance / (variance + 0.3)).max(2.5e-5_f64.sqrt());
        let alpha = f64::from(at(found.alpha.as_ref(), 8, 8));
        assert!((alpha - wanted).abs() < 1e-6 * wanted.max(0.1), "{deviation}: {alpha} for {wanted}");
    }
}

#[test]
fn channels_are_clamped_below_zero_before_luminance_and_never_above_one() {
    let blob = ColourBlob { opacity: 0.5, colour: [-2.0, 1.6, 0.5], ..ColourBlob::default() };
    let (found, _) = render(blob_scene(&[blob]), OFFICIAL, &view_ahead(17, 17, 100.0));
    let centre = at(found.rgb.as_ref(), 8, 8);
    let wanted = [0.0, 0.8, 0.25];
    assert!(centre.iter().zip(wanted).all(|(found, wanted)| (found - wanted).abs() < 1e-6), "{centre:?}");
    assert!((at(found.luminance.as_ref(), 8, 8) - luminance(wanted)).abs() < 1e-6);
}

#[test]
fn omitted_gaussians_are_counted() {
    let here = ColourBlob::default();
    let blobs = [
        here,
        ColourBlob { position: [0.0, 0.0, -4.0], ..here },
        ColourBlob { position: [100.0, 0.0, 4.0], ..here },
        ColourBlob { opacity: 0.003, ..here },
        ColourBlob { deviations: [f32::MAX, 1.0, 1.0], ..here },
        // a fifth of its depth deep, then a third
        ColourBlob { deviations: [0.8; 3], ..here },
        ColourBlob { deviations: [4.0 / 3.0; 3], ..here },
    ];
    let (_, work) = render(blob_scene(&blobs), OFFICIAL, &view_ahead(32, 32, 100.0));
    assert_eq!((work.gaussians, work.behind, work.outside, work.degenerate), (7, 1, 2, 1));
    assert_eq!((work.affine_doubtful, work.affine_invalid), (2, 1));
    // 10 px on an image of two by two tiles: all three are everywhere
    assert_eq!(work.tile_pairs, 12);
}

#[test]
fn views_and_styles_without_an_image_are_errors() {
    let mut cpu = CpuRenderer::new(Arc::new(blob_scene(&[ColourBlob::default()])), OFFICIAL).unwrap();
    let mut t = |spoil: fn(&mut CameraView), because: &str| {
        let mut view = view_ahead(8, 8, 10.0);
        spoil(&mut view);
        let error = cpu.render(&view, ALL, &mut RenderedImages::default()).unwrap_err();
        let RenderError::View(text) = &error else { panic!("{error}") };
        assert!(text.starts_with(because), "{text}");
    };
    t(|v| v.camera.size.width = 0, "image size 0x8, wanted 1 to 65535 px along each edge");
    t(|v| v.camera.size.height = 70_000, "image size 8x70000, wanted 1 to 65535 px along each edge");
    t(|v| v.camera.fx = -1.0, "focal lengths -1, 10 px, wanted finite positive values");
    t(|v| v.camera.cy = f64::NAN, "principal point (4, NaN) is not finite");
    t(|v| v.world_from_camera.translation.x = f64::INFINITY, "pose ");
    t(|v| v.world_from_camera.rotation.w = f64::NAN, "pose ");
    let style = RenderStyle { background: [0.0, f32::NAN, 0.0], ..OFFICIAL };
    let error = CpuRenderer::new(Arc::new(blob_scene(&[ColourBlob::default()])), style).unwrap_err();
    assert!(matches!(error, RenderError::Style(_)), "{error}");
}

#[test]
fn an_empty_scene_shows_the_background() {
    let style = RenderStyle { background: [0.25, 0.5, 0.75], ..EXACT };
    let (found, work) = render(blob_scene(&[]), style, &view_ahead(20, 3, 10.0));
    assert!(
        found.rgb.unwrap().pixels().iter().all(|c| c.map(f32::to_bits) == style.background.map(f32::to_bits))
    );
    assert_eq!(work, gs2e_render::RenderWork::default());
}

#[test]
fn only_requested_images_are_made() {
    let mut cpu = CpuRenderer::new(Arc::new(blob_scene(&[ColourBlob::default()])), OFFICIAL).unwrap();
    let mut out = RenderedImages::default();
    cpu.render(&view_ahead(8, 8, 10.0), ALL, &mut out).unwrap();
    let want = ChannelSet { alpha: true, ..ChannelSet::default() };
    cpu.render(&view_ahead(9, 7, 10.0), want, &mut out).unwrap();
    assert!(out.rgb.is_none() && out.luminance.is_none() && out.depth.is_none());
    assert_eq!(out.alpha.unwrap().pixels().len(), 63);
}
