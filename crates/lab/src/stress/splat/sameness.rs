//! Invariance of pictures: under the world's origin, the number of threads, values that are not
//! finite, and the length of quaternions.

use super::scenes::{self, ALL_RULES};
use super::{CaseRenderer, image_bits, pixel_opacities};
use crate::stress::{NotRun, Outcome, StressPoint, WorstPoint};
use glam::DVec3;
use gs2e_image::Size;
use gs2e_render::backend::Backend;
use gs2e_render::{ChannelSet, RenderRules, RenderStyle, RenderWork, RenderedImages};
use gs2e_scene::Gaussians;
use gs2e_scene::blobs::{ColourBlob, blob_scene, view_ahead};
use gs2e_scene::camera::view::CameraView;
use std::sync::Arc;

/// Values that differ, in either picture.
fn differing_values(a: &RenderedImages, b: &RenderedImages) -> [usize; 2] {
    let (a, b) = (image_bits(a), image_bits(b));
    [a.iter().zip(&b).filter(|(a, b)| a != b).count() + a.len().abs_diff(b.len()), b.len()]
}

fn add_same(
    worst: &mut WorstPoint,
    found: &RenderedImages,
    wanted: &RenderedImages,
    at: impl FnOnce() -> String,
) {
    let [differing, all] = differing_values(found, wanted);
    worst.see_same(differing, all, at);
}

fn render_picture(
    by: CaseRenderer<'_>,
    scene: Gaussians,
    rules: RenderRules,
    view: &CameraView,
) -> Result<(RenderedImages, RenderWork), NotRun> {
    by.picture(&Arc::new(scene), RenderStyle { rules, ..RenderStyle::OFFICIAL }, view, ChannelSet::AT_REST)
}

/// Compares pictures of one scene under shifts that 64 bits represent exactly, together with the
/// camera's centre.
pub(super) fn offset_case(by: CaseRenderer<'_>) -> Outcome {
    let (scene, mut view) = scenes::askew_crowd(2000);
    view.camera = view.camera.resized(Size { width: 101, height: 59 });
    // Rounded to 2^-30, so that adding the shift loses nothing.
    let coarse = |v: f64| (v * f64::from(1 << 30)).round() / f64::from(1 << 30);
    view.world_from_camera.translation = view.world_from_camera.translation.map(coarse);
    let (here, _) = render_picture(by, scene.clone(), RenderRules::Official, &view)?;
    let mut worst = WorstPoint::default();
    for shift in [0.0, 1e2, 1e4, 1e6] {
        let origin = DVec3::new(shift, -shift, 0.5 * shift);
        let mut moved = view;
        moved.world_from_camera.translation += origin;
        let (there, _) =
            render_picture(by, Gaussians { origin, ..scene.clone() }, RenderRules::Official, &moved)?;
        add_same(&mut worst, &there, &here, || format!("offset {shift:e}"));
    }
    Ok(worst.found())
}

/// The centre of a blob's opacity, px.
fn blob_middle(by: CaseRenderer<'_>, shift: DVec3) -> Result<[f64; 2], NotRun> {
    const EDGE: u32 = 33;
    let blob = ColourBlob { position: [0.013, -0.021, 4.0], deviations: [0.12; 3], ..ColourBlob::default() };
    let mut view = view_ahead(EDGE, EDGE, 100.0);
    view.world_from_camera.translation = DVec3::new(0.007, 0.003, -0.011) + shift;
    // Rules under which no pixel appears or disappears at once.
    let (image, _) =
        render_picture(by, Gaussians { origin: shift, ..blob_scene(&[blob]) }, RenderRules::Soft, &view)?;
    let (mut sum, mut moments) = (0.0, [0.0; 2]);
    for (i, alpha) in (0_u32..).zip(pixel_opacities(&image)) {
        sum += alpha;
        moments[0] += alpha * f64::from(i % EDGE);
        moments[1] += alpha * f64::from(i / EDGE);
    }
    Ok(moments.map(|moment| moment / sum))
}

/// Compares the place of a blob under offsets that round the coordinates by at most 1e-10.
pub(super) fn offset_px(by: CaseRenderer<'_>) -> Outcome {
    let here = blob_middle(by, DVec3::ZERO)?;
    let mut worst = WorstPoint::default();
    for shift in [1e2, 1e4, 1e6] {
        let there = blob_middle(by, DVec3::new(shift + 0.1, -2.0 * shift + 0.7, 0.5 * shift + 0.3))?;
        for (found, wanted) in there.into_iter().zip(here) {
            worst.see(StressPoint::absolute_error(found, wanted, 1e-4), || format!("offset {shift:e}"));
        }
    }
    Ok(worst.found())
}

/// Compares the order of ties on several numbers of threads, and with the reference. The colours
/// reveal the order: neighbours in the file differ by up to 1.9 in a channel.
pub(super) fn ties_case(by: CaseRenderer<'_>) -> Outcome {
    let (scene, view) = scenes::tied_crowd(1000);
    let mut worst = WorstPoint::default();
    for rules in ALL_RULES {
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let pool = pool.expect("threads can be started");
            pool.install(|| render_picture(by, scene.clone(), rules, &view)).map(|(image, _)| image)
        };
        let one = on(1)?;
        for threads in [2, 3, 7] {
            add_same(&mut worst, &on(threads)?, &one, || format!("{rules:?}, {threads} threads"));
        }
        let (wanted, _) = render_picture(CaseRenderer(&Backend::Reference), scene.clone(), rules, &view)?;
        let values = |image: &RenderedImages| -> Vec<f32> {
            image.rgb.iter().flat_map(|plane| plane.pixels().as_flattened()).copied().collect()
        };
        let (found, wanted) = (values(&one), values(&wanted));
        let off = found.iter().zip(&wanted).filter(|(a, b)| (**a - **b).abs() > 1e-3).count();
        // Layers at a threshold, which 32 bits leave out and 64 bits do not.
        let few = StressPoint::absolute_error(off as f64, 0.0, found.len() as f64 / 3000.0);
        worst.see(few, || format!("{rules:?}, against the reference"));
    }
    Ok(worst.found())
}

pub(super) fn unsound_case(by: CaseRenderer<'_>) -> Outcome {
    /// A visible Gaussian.
    const I: usize = 40;
    let (scene, mut view) = scenes::askew_crowd(200);
    view.camera = view.camera.resized(Size { width: 101, height: 59 });
    let mut worst = WorstPoint::default();
    for rules in ALL_RULES {
        let (clean, alone) = render_picture(by, scenes::without_gaussian(&scene, I), rules, &view)?;
        // A Gaussian that is not seen would make every comparison pass.
        let [differing, _] = differing_values(&render_picture(by, scene.clone(), rules, &view)?.0, &clean);
        worst.see(StressPoint::exact_count(u64::from(differing > 0), 1), || {
            format!("{rules:?}: Gaussian {I} is seen")
        });
        for (what, spoil) in scenes::UNSOUND {
            let mut twin = scene.clone();
            spoil(&mut twin, I);
            let (found, work) = render_picture(by, twin, rules, &view)?;
            add_same(&mut worst, &found, &clean, || format!("{what}, {rules:?}"));
            let left_out = |work: RenderWork| work.behind + work.degenerate;
            let counted = StressPoint::exact_count(left_out(work), left_out(alone) + 1);
            worst.see(counted, || format!("{what}, {rules:?}: counted"));
        }
    }
    Ok(worst.found())
}

pub(super) fn quaternion_case(by: CaseRenderer<'_>) -> Outcome {
    let (mut scene, view) = scenes::askew_crowd(300);
    let unturned = [1.0, 0.0, 0.0, 0.0];
    let mut twin = scene.clone();
    for (power, rotation) in (-20..=20).cycle().zip(&mut twin.rotations) {
        // A power of two scales without rounding.
        *rotation = rotation.map(|v| libm::scalbnf(v, power));
    }
    // A zero quaternion is the identity.
    for i in [7, 40] {
        scene.rotations[i] = unturned;
        twin.rotations[i] = [0.0; 4];
    }
    let [found, wanted] = [twin, scene].map(|scene| render_picture(by, scene, RenderRules::Official, &view));
    let mut worst = WorstPoint::default();
    add_same(&mut worst, &found?.0, &wanted?.0, || "300 of them".to_owned());
    Ok(worst.found())
}
