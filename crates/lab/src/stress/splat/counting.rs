//! Counts of blended, stopped, culled and doubtful Gaussians, as the rules define them.

use super::scenes::{self, ALL_RULES, GaussianCounts};
use super::{CaseRenderer, FloatPrecision, pixel_opacities};
use crate::stress::{Outcome, StressPoint, WorstPoint};
use gs2e_image::Size;
use gs2e_render::backend::Backend;
use gs2e_render::{ChannelSet, RenderRules, RenderStyle, RenderWork};
use std::sync::Arc;

/// Layers of equal opacity, clamped at 0.99, are a geometric series up to the layer that would
/// leave less than 1e-4.
pub(super) fn stack_case(by: CaseRenderer<'_>) -> Outcome {
    const LAYERS: i32 = 1000;
    let mut worst = WorstPoint::default();
    for opacity in [0.004, 0.009, 0.02, 0.5, 0.99, 0.99999_f64] {
        let alpha = opacity.min(0.99);
        // 0.01 squared is below 1e-4 in 32 bits, and by definition in 64.
        let left = |n: i32| libm::pow(1.0 - alpha, f64::from(n));
        let blended = (1..=LAYERS).take_while(|n| left(*n) >= 1e-4 * (1.0 + 1e-6)).count();
        let sum = |first: i32| -> f64 {
            (first..LAYERS)
                .take(blended.saturating_sub(first.unsigned_abs() as usize))
                .step_by(2)
                .map(|i| alpha * left(i))
                .sum()
        };
        // Even layers are red, odd ones green.
        let wanted = [sum(0), sum(1), 0.0];
        let (scene, view) = scenes::layer_stack(LAYERS.unsigned_abs() as usize, opacity);
        let (image, work) =
            by.picture(&Arc::new(scene), RenderStyle::OFFICIAL, &view, ChannelSet::AT_REST)?;
        let rgb = image.rgb.map_or([f32::NAN; 3], |rgb| rgb.pixels()[0]);
        for (found, wanted) in rgb.into_iter().zip(wanted) {
            let point = StressPoint::absolute_error(f64::from(found), wanted, 1e-4);
            worst.see(point, || format!("{opacity}: colour"));
        }
        worst.see(StressPoint::exact_count(work.blended, blended as u64), || format!("{opacity}: layers"));
        // Without a stop, the pixel blends every layer.
        let stops = u64::from(blended < LAYERS.unsigned_abs() as usize);
        worst.see(StressPoint::exact_count(work.stopped, stops), || format!("{opacity}: stops"));
    }
    Ok(worst.found())
}

fn gaussian_counts(work: RenderWork) -> GaussianCounts {
    let RenderWork { gaussians, behind, degenerate, outside, affine_doubtful, affine_invalid, .. } = work;
    GaussianCounts {
        gaussians,
        behind,
        degenerate,
        outside,
        doubtful: affine_doubtful,
        invalid: affine_invalid,
    }
}

/// Number of Gaussians with a different outcome.
fn miscounted(found: GaussianCounts, wanted: GaussianCounts) -> u64 {
    let of = |c: GaussianCounts| [c.gaussians, c.behind, c.degenerate, c.outside, c.doubtful, c.invalid];
    of(found).into_iter().zip(of(wanted)).map(|(a, b)| a.abs_diff(b)).sum()
}

/// Compares the counts with the known outcome of twelve Gaussians, and in 32 bits also with those
/// of the reference on a crowd.
pub(super) fn counted_case(by: CaseRenderer<'_>) -> Outcome {
    let mut worst = WorstPoint::default();
    let (scene, view, wanted) = scenes::counted_scene();
    let scene = Arc::new(scene);
    for rules in ALL_RULES {
        let (_, work) =
            by.picture(&scene, RenderStyle { rules, ..RenderStyle::OFFICIAL }, &view, ChannelSet::AT_REST)?;
        let point = StressPoint::exact_count(miscounted(gaussian_counts(work), wanted), 0);
        worst.see(point, || format!("{rules:?}: {:?}", gaussian_counts(work)));
    }
    if by.precision() == FloatPrecision::Double {
        return Ok(worst.found());
    }
    let (scene, mut view) = scenes::askew_crowd(6000);
    view.world_from_camera.translation.z = 0.5;
    view.camera = view.camera.resized(Size { width: 64, height: 37 });
    let scene = Arc::new(scene);
    for rules in ALL_RULES {
        for antialiased in [false, true] {
            let style = RenderStyle { rules, antialiased, ..RenderStyle::OFFICIAL };
            let (_, work) = by.picture(&scene, style, &view, ChannelSet::AT_REST)?;
            let (_, wanted) =
                CaseRenderer(&Backend::Reference).picture(&scene, style, &view, ChannelSet::AT_REST)?;
            let at = |what| move || format!("{what}, a crowd, {rules:?}, antialiased {antialiased}");
            // 32 bits widen an extent by 0.02 px against rounding, and few Gaussians are that close
            // to it.
            let outside = StressPoint::absolute_error(work.outside as f64, wanted.outside as f64, 6.0);
            worst.see(outside, at("outside"));
            let [work, wanted] =
                [work, wanted].map(|work| gaussian_counts(RenderWork { outside: 0, ..work }));
            worst.see(StressPoint::exact_count(miscounted(work, wanted), 0), at("others"));
        }
    }
    Ok(worst.found())
}

pub(super) fn near_plane(by: CaseRenderer<'_>) -> Outcome {
    let mut worst = WorstPoint::default();
    for rules in ALL_RULES {
        // For gsplat, also at the plane itself.
        let (near, at) = if rules == RenderRules::Gsplat { (0.01_f32, 0) } else { (0.2, 1) };
        for (z, behind) in [(near.next_down(), 1), (near, at), (near.next_up(), 0), (-1.0, 1), (0.0, 1)] {
            let (scene, view) = scenes::at_depth(z);
            let (image, work) = by.picture(
                &Arc::new(scene),
                RenderStyle { rules, ..RenderStyle::OFFICIAL },
                &view,
                ChannelSet::AT_REST,
            )?;
            worst.see(StressPoint::exact_count(work.behind, behind), || {
                format!("{rules:?}, depth {z}: behind")
            });
            let visible = u64::from(pixel_opacities(&image).iter().any(|alpha| *alpha > 0.0));
            worst
                .see(StressPoint::exact_count(visible, 1 - behind), || format!("{rules:?}, depth {z}: seen"));
        }
    }
    Ok(worst.found())
}
