//! Long thin Gaussians: preservation of their shape in the projection.

use super::scenes::{self, DILATION, NeedleGaussian};
use super::{CaseRenderer, FloatPrecision, exact_luminance, pixel_opacities};
use crate::stress::{CaseResult, NotRun, Outcome, StressPoint, WorstPoint};
use gs2e_render::{ChannelSet, RenderRules, RenderStyle};
use std::sync::Arc;

const EXACT: RenderStyle = RenderStyle { rules: RenderRules::Exact, ..RenderStyle::OFFICIAL };
const ALPHA: ChannelSet = ChannelSet {
    rgb: false,
    luminance: false,
    alpha: true,
    depth: false,
    flow: false,
    luminance_rate: false,
    doubtful: false,
    segmentation: false,
    drift: false,
};

/// A needle's value at every pixel relative to that at its mean. In 64 bits, its luminance, because
/// images have 32 bits.
fn needle_shape(
    by: CaseRenderer<'_>,
    needle: &NeedleGaussian,
    style: RenderStyle,
) -> Result<Vec<f64>, NotRun> {
    let (scene, view) = (Arc::new(needle.scene()), needle.view());
    if by.precision() == FloatPrecision::Double {
        let whole = needle.luminance();
        return Ok(exact_luminance(&scene, style, &view).into_iter().map(|[grey, _]| grey / whole).collect());
    }
    let whole = needle.opacity();
    let (image, _) = by.picture(&scene, style, &view, ALPHA)?;
    Ok(pixel_opacities(&image).into_iter().map(|alpha| alpha / whole).collect())
}

pub(super) fn near_case(by: CaseRenderer<'_>) -> Outcome {
    judge_needles(by.some(scenes::all_needles()), |needle| needle_shape(by, needle, EXACT), by.precision())
}

/// Near a needle's mean, the power is the squared distance across it divided by the smaller
/// eigenvalue, which is the determinant divided by the larger one: a loss in either is fully
/// visible there. `shape` gives `exp(-power)` at each pixel.
///
/// # Errors
/// `shape` fails.
pub fn judge_needles(
    needles: impl IntoIterator<Item = NeedleGaussian>,
    shape: impl Fn(&NeedleGaussian) -> Result<Vec<f64>, NotRun>,
    precision: FloatPrecision,
) -> Result<CaseResult, NotRun> {
    let mut worst = WorstPoint::default();
    for needle in needles {
        let [_, narrow] = needle.variances().map(|v| v + DILATION);
        for (value, [distance, power]) in shape(&needle)?.into_iter().zip(needle.powers()) {
            if !(0.05..2.0).contains(&power) || distance > 8.0 {
                continue;
            }
            // Possible rounding of the two distances, each of which is up to the distance divided
            // by the smaller standard deviation.
            let reach = (2.0 * power).sqrt() * distance / narrow.sqrt();
            let limit = match precision {
                // 2e-6 of the determinant; three roundings of each distance; alpha >= 0.13 is 1 -
                // T, rounded at 6e-8; and 2^-q has an error of 2e-7.
                FloatPrecision::Single => 2e-6 * power + 6.0 * 6e-8 * reach + 1e-6,
                // 1e-13, and the same roundings 2^-29 times as large.
                FloatPrecision::Double => 1e-13 * power + 6.0 * 1.2e-16 * reach + 2e-15,
            };
            let point = StressPoint::absolute_error(-libm::log(value), power, limit);
            worst.see(point, || format!("{needle:?}"));
        }
    }
    Ok(worst.found())
}

/// At half the needle's standard deviation from the mean, 99 % of the pixels must agree. In 64 bits
/// the tolerance is 1e-13; at 1500 px, doubles are 2e-13 px apart, and the edge of a needle is 0.6
/// px wide.
pub(super) fn far_case(by: CaseRenderer<'_>) -> Outcome {
    let mut worst = WorstPoint::default();
    for (long_px, single, double) in [(300.0, 8e-6, 1e-13), (1000.0, 4.7e-5, 1e-13), (3000.0, 7.5e-5, 3e-13)]
    {
        let mut errors = Vec::new();
        for needle in by.some(oblique_needles(long_px)) {
            let wanted = needle.powers().into_iter().map(|[_, power]| libm::exp(-power));
            // Pixels that the rules leave out have no value to compare.
            let pairs =
                needle_shape(by, &needle, EXACT)?.into_iter().zip(wanted).filter(|(found, _)| *found > 0.0);
            errors.extend(pairs.map(|(found, wanted)| (found - wanted).abs()));
        }
        errors.sort_by(f64::total_cmp);
        let limit = if by.precision() == FloatPrecision::Single { single } else { double };
        let most = errors[errors.len() * 99 / 100];
        worst.see(StressPoint::absolute_error(most, 0.0, limit), || {
            format!("{long_px} px, {} pixels", errors.len())
        });
    }
    Ok(worst.found())
}

/// Needles that cross the picture diagonally, with means half a standard deviation away.
fn oblique_needles(long_px: f64) -> Vec<NeedleGaussian> {
    let shapes =
        [10.0, 100.0, 1e3, 1e4].into_iter().flat_map(|a| [0.1, 0.3, 0.7, 1.2, 1.5].map(|angle| (a, angle)));
    shapes.map(|(aspect, angle)| NeedleGaussian { long_px, aspect, angle, offset: long_px / 2.0 }).collect()
}

/// The antialiased rule scales a needle by the root of its determinant without dilation divided by
/// that with dilation.
pub(super) fn undilated_case(by: CaseRenderer<'_>) -> Outcome {
    /// Ratio below which the rule is constant.
    const FLOOR: f64 = 2.5e-5;
    /// Ratio from which on a pixel shows it with six digits.
    const VISIBLE_RATIO: f64 = 0.02;
    let mut worst = WorstPoint::default();
    for needle in by.some(scenes::all_needles()) {
        let [a, b] = needle.variances();
        let ratio = (a / (a + DILATION)) * (b / (b + DILATION));
        let values = needle_shape(by, &needle, RenderStyle { antialiased: true, ..EXACT })?;
        let nearest = needle.powers().into_iter().zip(values).min_by(|(a, _), (b, _)| a[0].total_cmp(&b[0]));
        let Some(([_, power], found)) = nearest else { continue };
        let wanted = ratio.sqrt() * libm::exp(-power);
        if ratio <= FLOOR || wanted < VISIBLE_RATIO {
            continue;
        }
        let limit = match by.precision() {
            // 2e-6 of the determinants; 1 - T, rounded at 6e-8; and 2^-q, with an error of 2e-7.
            FloatPrecision::Single => 2e-6 + 2.6e-7 / wanted,
            FloatPrecision::Double => 1e-13,
        };
        worst.see(StressPoint::relative_error(found, wanted, limit), || format!("{needle:?}"));
    }
    Ok(worst.found())
}
