//! Rates of the picture for a moving camera, compared with central differences of the reference,
//! and between the back ends.
//!
//! Where a layer passes the least opacity, a pixel stops or the order changes, luminance jumps and
//! has no rate. There a difference over h and one over h/2 disagree; such pixels are omitted and
//! counted.

#![expect(clippy::cast_possible_truncation, reason = "scenes and images hold 32 bits")]

use super::cases::{moving, playbot};
use gs2e_image::Size;
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::exp_vector;
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::reference::ReferenceRenderer;
use gs2e_render::{ChannelSet, LayerOrder, RenderRules, RenderStyle, RenderedImages, Renderer};
use gs2e_scene::Gaussians;
use gs2e_scene::blobs::{ColourBlob, ScatterDraws, blob_scene, view_ahead};
use gs2e_scene::camera::flow::flow_displacement;
use gs2e_scene::camera::view::CameraView;
use std::sync::Arc;

const ALL_RULES: [RenderRules; 4] =
    [RenderRules::Official, RenderRules::Exact, RenderRules::Gsplat, RenderRules::Soft];

fn style(rules: RenderRules, antialiased: bool) -> RenderStyle {
    RenderStyle { rules, order: LayerOrder::Depth, antialiased, background: [0.1, 0.3, 0.2] }
}

fn blended_order() -> RenderStyle {
    RenderStyle { order: LayerOrder::Blended, ..style(RenderRules::Soft, false) }
}

/// The view after `seconds`, to the first order of its velocity.
fn after(view: &CameraView, seconds: f64) -> CameraView {
    let Se3 { rotation, translation } = view.world_from_camera;
    let world_from_camera = Se3 {
        rotation: rotation * exp_vector(view.velocity.angular * seconds),
        translation: translation + rotation * view.velocity.linear * seconds,
    };
    CameraView { world_from_camera, ..*view }
}

/// Some hundred overlapping Gaussians of all shapes, a few of them nearly opaque, with harmonics of
/// degree 2.
fn crowd() -> Gaussians {
    let mut draws = ScatterDraws(11);
    let mut draw = |low: f64, high: f64| low + (high - low) * f64::from(draws.next());
    let blobs: Vec<ColourBlob> = (0..300)
        .map(|_| ColourBlob {
            position: [draw(-2.0, 2.0), draw(-1.5, 1.5), draw(1.5, 8.0)].map(|v| v as f32),
            deviations: [0; 3].map(|_| libm::exp(draw(-4.5, -0.8)) as f32),
            rotation: [0; 4].map(|_| draw(-1.0, 1.0) as f32),
            opacity: draw(0.02, 0.999),
            colour: [0; 3].map(|_| draw(0.0, 1.2)),
        })
        .collect();
    let mut scene = blob_scene(&blobs);
    scene.sh = scene
        .sh
        .iter()
        .flat_map(|c| {
            let rest: Vec<[f32; 3]> = (1..9).map(|_| [0; 3].map(|_| draw(-0.2, 0.2) as f32)).collect();
            std::iter::once(*c).chain(rest)
        })
        .collect();
    scene.sh_degree = 2;
    scene
}

/// Errors relative to the wanted value, or to 1e-3 of the largest if that is larger, where the
/// picture changes: median and 99 %, and the share of pixels without a jump.
fn errors(found: &[f64], wanted: &[f64], smooth: &[bool]) -> [f64; 3] {
    let largest = wanted.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    let mut errors: Vec<f64> = (0..wanted.len())
        .filter(|i| smooth[*i] && wanted[*i] != 0.0)
        .map(|i| (found[i] - wanted[i]).abs() / wanted[i].abs().max(1e-3 * largest))
        .collect();
    errors.sort_by(f64::total_cmp);
    let at = |percent: usize| errors[(errors.len() - 1) * percent / 100];
    [at(50), at(99), smooth.iter().filter(|s| **s).count() as f64 / wanted.len() as f64]
}

/// Central differences of the reference over `2 h`, and true where those over `h` agree.
fn differences(reference: &ReferenceRenderer, view: &CameraView, h: f64) -> (Vec<f64>, Vec<bool>) {
    let grey = |seconds: f64| -> Vec<f64> {
        reference.luminance(&after(view, seconds)).unwrap().iter().map(|[value, _]| *value).collect()
    };
    let over =
        |h: f64| -> Vec<f64> { grey(h).iter().zip(grey(-h)).map(|(b, a)| (b - a) / (2.0 * h)).collect() };
    let (wide, narrow) = (over(h), over(h / 2.0));
    let largest = wide.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    let smooth = wide.iter().zip(&narrow).map(|(a, b)| (a - b).abs() <= 1e-5 * largest).collect();
    (narrow, smooth)
}

fn check(scene: &Arc<Gaussians>, view: &CameraView, style: RenderStyle) {
    let name = format!("{:?}{}", style.rules, if style.antialiased { " aa" } else { "" });
    let reference = ReferenceRenderer::new(scene.clone(), style).unwrap();
    let rates: Vec<f64> = reference.luminance(view).unwrap().iter().map(|[_, rate]| *rate).collect();
    // In 2e-7 s nothing moves by 1e-4 px, and few pairs of depths change places. Differences over
    // this time keep 9 digits of f64.
    let (wanted, smooth) = differences(&reference, view, 1e-7);
    let [median, most, share] = errors(&rates, &wanted, &smooth);
    println!("{name:12} reference: median {median:.1e}, 99 % {most:.1e}, smooth {share:.4}");
    assert!(median <= 1e-6 && most <= 1e-4 && share >= 0.99, "{name}");

    let mut out = RenderedImages::default();
    let want = ChannelSet {
        luminance: true,
        luminance_rate: true,
        flow: true,
        depth: true,
        ..ChannelSet::default()
    };
    let mut cpu = CpuRenderer::new(scene.clone(), style).unwrap();
    cpu.render(view, want, &mut out).unwrap();
    let found: Vec<f64> =
        out.luminance_rate.as_ref().unwrap().pixels().iter().map(|v| f64::from(*v)).collect();
    let [median, most, _] = errors(&found, &wanted, &smooth);
    println!("{name:12} cpu:       median {median:.1e}, 99 % {most:.1e}");
    assert!(median <= 1e-4 && most <= 1e-2, "{name}");
    // Luminance is the same with and without the rate, bit for bit.
    let mut alone = RenderedImages::default();
    cpu.render(view, ChannelSet { luminance: true, ..ChannelSet::default() }, &mut alone).unwrap();
    assert!(out.luminance == alone.luminance, "{name}");
    flow_is_the_way_over_time(view, &out);
}

/// Checks that the flow is the displacement of the pixel's point over a short time.
fn flow_is_the_way_over_time(view: &CameraView, out: &RenderedImages) {
    let depth = out.depth.as_ref().unwrap();
    let seconds = 1e-4;
    let moved = flow_displacement(depth, view, &after(view, seconds));
    let flow = out.flow.as_ref().unwrap().pixels();
    let mut errors: Vec<f32> = flow
        .iter()
        .zip(moved.pixels())
        .filter(|(_, moved)| !moved.is_nan())
        .map(|([x, y], moved)| (x.hypot(*y) - moved / seconds as f32).abs() / (moved / seconds as f32))
        .collect();
    errors.sort_by(f32::total_cmp);
    let (median, most) = (errors[errors.len() / 2], errors[errors.len() * 99 / 100]);
    // The displacement is the flow to first order of the time: 1e-4 s of a second order as large as
    // the first.
    assert!(median <= 1e-4 && most <= 1e-2, "{median:e} {most:e}");
    assert!(flow.iter().zip(depth.pixels()).all(|([x, _], z)| x.is_nan() == z.is_nan()));
}

#[test]
fn rates_are_differences_in_a_crowd() {
    let scene = Arc::new(crowd());
    let view = moving(view_ahead(96, 64, 80.0));
    for rules in ALL_RULES {
        for antialiased in [false, true] {
            check(&scene, &view, style(rules, antialiased));
        }
    }
    check(&scene, &view, blended_order());
}

#[test]
fn rates_are_differences_in_a_real_scene() {
    let Some((scene, view)) = playbot(Size { width: 160, height: 90 }) else { return };
    let view = moving(view);
    for rules in ALL_RULES {
        check(&scene, &view, style(rules, false));
    }
    check(&scene, &view, blended_order());
}

#[test]
fn a_camera_at_rest_sees_nothing_change() {
    let mut out = RenderedImages::default();
    let want = ChannelSet { luminance_rate: true, flow: true, ..ChannelSet::default() };
    let view = view_ahead(96, 64, 80.0);
    let mut cpu = CpuRenderer::new(Arc::new(crowd()), style(RenderRules::Soft, true)).unwrap();
    cpu.render(&view, want, &mut out).unwrap();
    assert!(out.luminance_rate.unwrap().pixels().iter().all(|v| v.abs() < 1e-30));
    assert!(out.luminance.is_none() && out.depth.is_none());
    assert!(out.flow.unwrap().pixels().iter().flatten().all(|v| v.is_nan() || *v == 0.0));
}
