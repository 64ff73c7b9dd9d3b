//! Whole pictures: 32 bits against 64, one channel against three, and the rate of the luminance.

use super::{CaseRenderer, FloatPrecision, SplatBench, exact_luminance};
use crate::stress::{CaseResult, Outcome, StressPoint, WorstPoint};
use glam::DVec3;
use gs2e_demo as procedural;
use gs2e_demo::StillLife;
use gs2e_image::{Size, luminance as grey_of};
use gs2e_num::se3::rotation::exp_vector;
use gs2e_num::se3::{Se3, look_at};
use gs2e_render::backend::Backend;
use gs2e_render::{ChannelSet, RenderRules, RenderStyle, RenderedImages};
use gs2e_scene::Gaussians;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::{CameraVelocity, CameraView};
use std::sync::Arc;

const SIZE: Size = Size { width: 80, height: 45 };

/// A scene, a view from a moving camera, and the rules.
pub(super) struct PictureSetup {
    scene: Arc<Gaussians>,
    view: CameraView,
    rules: &'static [RenderRules],
}

/// A camera that moves in every direction at once.
fn moving_view(camera: Camera, world_from_camera: Se3, unit: f64) -> CameraView {
    let velocity =
        CameraVelocity { linear: DVec3::new(0.6, -0.3, 0.8) * unit, angular: DVec3::new(0.2, 0.7, -0.5) };
    CameraView { velocity, ..CameraView::at_rest(camera, world_from_camera) }
}

/// The embedded still life.
pub(super) fn embedded_setup() -> PictureSetup {
    let life = StillLife { gaussians: 3000, views: 6, ..StillLife::default() };
    let key = procedural::still_capture(&life).views.swap_remove(2);
    let view = moving_view(key.camera.resized(SIZE), key.world_from_camera, 1.0);
    PictureSetup {
        scene: Arc::new(procedural::still_life(&life)),
        view,
        rules: &[RenderRules::Official, RenderRules::Soft],
    }
}

/// The user's scene from the side: its median in the middle of the view, at twice the median
/// distance of the Gaussians from it.
pub(super) fn user_setup(stage: &SplatBench) -> PictureSetup {
    let scene = stage.scene.clone().expect("there are cases of it where it is there");
    let middle = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    };
    let places: Vec<DVec3> =
        (0..scene.len()).map(|i| scene.position(i)).filter(|place| place.is_finite()).collect();
    // Medians, because a few Gaussians far away would move means.
    let median = DVec3::from([0, 1, 2].map(|k| middle(places.iter().map(|p| p[k]).collect())));
    // A scene in one point has no radius, so it gets a small one.
    let radius = middle(places.iter().map(|p| (*p - median).length()).collect()).max(1e-9);
    let way = DVec3::new(0.6, -0.35, -1.0).normalize();
    let rotation = look_at(-way, DVec3::NEG_Y).expect("not along the picture's top");
    let focal = f64::from(SIZE.width);
    let [cx, cy] = [SIZE.width, SIZE.height].map(|edge| f64::from(edge) / 2.0);
    let camera = Camera { size: SIZE, fx: focal, fy: focal, cx, cy, lens: None };
    let pose = Se3 { rotation, translation: median + way * (2.0 * radius) };
    PictureSetup { view: moving_view(camera, pose, radius), scene, rules: &[RenderRules::Official] }
}

impl PictureSetup {
    /// The rendering of the scene under each of its rules.
    fn styles(&self) -> impl Iterator<Item = RenderStyle> {
        self.rules.iter().map(|rules| RenderStyle {
            rules: *rules,
            background: [0.1, 0.3, 0.2],
            ..RenderStyle::OFFICIAL
        })
    }
}

/// The 99 % quantile and the largest value.
fn error_quantiles(mut errors: Vec<f64>) -> [f64; 2] {
    errors.sort_by(f64::total_cmp);
    [errors[(errors.len() - 1) * 99 / 100], errors[errors.len() - 1]]
}

fn image_colours(image: &RenderedImages) -> Vec<[f32; 3]> {
    image.rgb.iter().flat_map(|rgb| rgb.pixels()).copied().collect()
}

/// Compares the colours of a picture with those of the reference. They differ in few pixels, and by
/// little: where one of the two leaves out a layer at 1/255, or where two layers swap.
pub(super) fn value_case(set: &PictureSetup, by: CaseRenderer<'_>) -> Outcome {
    let mut worst = WorstPoint::default();
    for style in set.styles() {
        let (found, _) = by.picture(&set.scene, style, &set.view, ChannelSet::AT_REST)?;
        let (wanted, _) =
            CaseRenderer(&Backend::Reference).picture(&set.scene, style, &set.view, ChannelSet::AT_REST)?;
        let (found, wanted) = (image_colours(&found), image_colours(&wanted));
        let pairs = found.as_flattened().iter().zip(wanted.as_flattened());
        let [most, largest] = error_quantiles(pairs.map(|(a, b)| f64::from((a - b).abs())).collect());
        worst.see(StressPoint::absolute_error(most, 0.0, 1e-4), || format!("{:?}: 99 %", style.rules));
        worst.see(StressPoint::absolute_error(largest, 0.0, 5e-2), || format!("{:?}: largest", style.rules));
    }
    Ok(worst.found())
}

/// The luminance channel equals the luminance of the colours. In 64 bits it equals the sum over
/// three scenes with one colour each.
pub(super) fn luminance_case(set: &PictureSetup, by: CaseRenderer<'_>) -> Outcome {
    let mut worst = WorstPoint::default();
    for style in set.styles() {
        let pairs = if by.precision() == FloatPrecision::Double {
            one_by_one(set, style)
        } else {
            let want = ChannelSet { luminance: true, ..ChannelSet::default() };
            let (grey, _) = by.picture(&set.scene, style, &set.view, want)?;
            let (rgb, _) =
                by.picture(&set.scene, style, &set.view, ChannelSet { rgb: true, ..ChannelSet::default() })?;
            let grey = grey.luminance.iter().flat_map(|plane| plane.pixels()).map(|v| f64::from(*v));
            grey.zip(image_colours(&rgb).into_iter().map(|c| f64::from(grey_of(c)))).collect()
        };
        let limit = if by.precision() == FloatPrecision::Double { 1e-13 } else { 2e-6 };
        for (i, (found, wanted)) in pairs.into_iter().enumerate() {
            worst.see(StressPoint::absolute_error(found, wanted, limit), || {
                format!("{:?}, pixel {i}", style.rules)
            });
        }
    }
    Ok(worst.found())
}

/// Luminance in 64 bits, and that of red, green and blue alone.
fn one_by_one(set: &PictureSetup, style: RenderStyle) -> Vec<(f64, f64)> {
    /// A value so dark that it is clamped at 0 for any harmonics.
    const DARK: f32 = -1e6;
    let whole = exact_luminance(&set.scene, style, &set.view);
    let alone = |channel: usize| {
        let mut scene = (*set.scene).clone();
        let length = scene.sh_len();
        let mut background = [0.0; 3];
        background[channel] = style.background[channel];
        for first in scene.sh.iter_mut().step_by(length) {
            // Colours are clamped from below, so a dark constant term silences all terms.
            (0..3).filter(|c| *c != channel).for_each(|c| first[c] = DARK);
        }
        exact_luminance(&Arc::new(scene), RenderStyle { background, ..style }, &set.view)
    };
    let parts = [0, 1, 2].map(alone);
    let sum = |i: usize| parts.iter().map(|part| part[i][0]).sum();
    whole.iter().enumerate().map(|(i, grey)| (grey[0], sum(i))).collect()
}

/// Compares the rates of a 32-bit renderer with those of the reference.
pub(super) fn rate_case(set: &PictureSetup, by: CaseRenderer<'_>) -> Outcome {
    let mut worst = WorstPoint::default();
    for style in set.styles() {
        let want = ChannelSet { luminance_rate: true, ..ChannelSet::default() };
        let (found, _) = by.picture(&set.scene, style, &set.view, want)?;
        let wanted = exact_luminance(&set.scene, style, &set.view);
        // Errors relative to the rate of a pixel would be unbounded where the rate passes 0.
        let largest = wanted.iter().fold(0.0, |m: f64, [_, rate]| m.max(rate.abs()));
        let found = found.luminance_rate.iter().flat_map(|plane| plane.pixels());
        let errors = found.zip(&wanted).map(|(a, [_, b])| (f64::from(*a) - b).abs() / largest);
        let [most, _] = error_quantiles(errors.collect());
        worst.see(StressPoint::absolute_error(most, 0.0, 1e-5), || format!("{:?}", style.rules));
    }
    Ok(worst.found())
}

/// Compares the reference's rates with differences of its own values, relative to the largest rate.
pub(super) fn rate_by_differences(set: &PictureSetup) -> CaseResult {
    let mut worst = WorstPoint::default();
    for style in set.styles() {
        let rates = exact_luminance(&set.scene, style, &set.view);
        let CentralDifferences { wide, narrow } = CentralDifferences::for_setup(set, style);
        let largest = narrow.iter().fold(0.0, |m: f64, rate| m.max(rate.abs()));
        for i in (0..rates.len()).filter(|i| is_smooth(wide[*i], narrow[*i], largest)) {
            let point = StressPoint::scaled_error(rates[i][1], narrow[i], largest, 1e-5);
            worst.see(point, || format!("{:?}, pixel {i}", style.rules));
        }
    }
    worst.found()
}

/// Share of pixels that may have no rate: at least 99 % must have one.
pub(super) fn jump_case(set: &PictureSetup) -> CaseResult {
    let mut worst = WorstPoint::default();
    for style in set.styles() {
        let CentralDifferences { wide, narrow } = CentralDifferences::for_setup(set, style);
        let largest = narrow.iter().fold(0.0, |m: f64, rate| m.max(rate.abs()));
        let rough = wide.iter().zip(&narrow).filter(|(a, b)| !is_smooth(**a, **b, largest)).count();
        let share = rough as f64 / wide.len() as f64;
        worst.see(StressPoint::absolute_error(share, 0.0, 0.01), || format!("{:?}", style.rules));
    }
    worst.found()
}

/// Returns true if two differences agree. They do not where a layer appears, disappears or swaps.
fn is_smooth(wide: f64, narrow: f64, largest: f64) -> bool {
    (wide - narrow).abs() <= 1e-5 * largest
}

/// Central differences of luminance over 0.2 us and over half of that. In so short a time hardly
/// two depths swap, and 64 bits keep nine digits of the differences.
struct CentralDifferences {
    wide: Vec<f64>,
    narrow: Vec<f64>,
}

impl CentralDifferences {
    fn for_setup(set: &PictureSetup, style: RenderStyle) -> Self {
        const H: f64 = 1e-7;
        let grey = |seconds: f64| -> Vec<f64> {
            exact_luminance(&set.scene, style, &view_after(&set.view, seconds))
                .into_iter()
                .map(|[value, _]| value)
                .collect()
        };
        let over = |h: f64| -> Vec<f64> {
            grey(h).iter().zip(grey(-h)).map(|(later, earlier)| (later - earlier) / (2.0 * h)).collect()
        };
        Self { wide: over(H), narrow: over(H / 2.0) }
    }
}

/// The view after `seconds`, to first order in its velocity.
fn view_after(view: &CameraView, seconds: f64) -> CameraView {
    let Se3 { rotation, translation } = view.world_from_camera;
    let world_from_camera = Se3 {
        rotation: rotation * exp_vector(view.velocity.angular * seconds),
        translation: translation + rotation * view.velocity.linear * seconds,
    };
    CameraView { world_from_camera, ..*view }
}
