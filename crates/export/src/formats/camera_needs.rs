//! Needs and losses that several layouts share.

use crate::brightness::{BrightnessFactor, BrightnessFormula};
use crate::{ExportLoss, ExportPlan, TestViews, UnmetNeed};

/// Difference below which two numbers of pixels count as equal: a millionth of a threshold at any
/// contrast.
const SAME_PX: f64 = 1e-6;

/// The need for events.
pub(super) fn unmet_events(plan: &ExportPlan<'_>) -> Option<UnmetNeed> {
    let found = format!("{} has no events", plan.subject.trajectory);
    plan.subject.sensor.is_none().then(|| UnmetNeed::new(found, "outputs: [events]"))
}

/// The need for this number of sharp frames.
pub(super) fn unmet_frames(plan: &ExportPlan<'_>, least: usize) -> Option<UnmetNeed> {
    let found = plan.frames.len();
    let what = format!("{found} sharp frames, wanted at least {least}");
    (found < least).then(|| UnmetNeed::new(what, "outputs: [sharp] and a smaller sharp.every"))
}

/// The need for more than `least` poses.
pub(super) fn unmet_poses(plan: &ExportPlan<'_>, least: usize) -> Option<UnmetNeed> {
    let found = plan.pose_count();
    let what = format!("{found} poses, wanted at least {least}");
    (found < least).then(|| UnmetNeed::new(what, "a longer trajectory, or a higher sampling.rate"))
}

/// The need for held-out views among the frames of the trajectory itself.
pub(super) fn unmet_held_out_views(plan: &ExportPlan<'_>) -> Option<UnmetNeed> {
    matches!(plan.test, TestViews::From(_)).then(|| {
        UnmetNeed::new(
            "the layout holds out frames of the trajectory itself only",
            "--test-every instead of --test-from",
        )
    })
}

/// Losses of a loader that reads one focal length and puts the centre in the middle. `ray` is where
/// its rays leave a pixel: 0.5 for the middle, 0 for the corner.
pub(super) fn centred_camera(plan: &ExportPlan<'_>, ray: f64, one_focal: bool) -> Vec<ExportLoss> {
    let camera = &plan.subject.camera;
    let [middle_x, middle_y] = [camera.size.width, camera.size.height].map(|side| f64::from(side) / 2.0);
    // Our ray of pixel x goes through x + 0.5 - cx, the loader's through x + ray - W/2.
    let off = [camera.cx - 0.5 - (middle_x - ray), camera.cy - 0.5 - (middle_y - ray)];
    let furthest = off[0].abs().max(off[1].abs());
    let mut losses = Vec::new();
    if furthest > SAME_PX {
        let [cx, cy] = [middle_x + 0.5 - ray, middle_y + 0.5 - ray];
        let name = if ray > 0.0 { "middle" } else { "corner-half" };
        let what = format!(
            "the loader's rays miss the pixel centres by {furthest} px; only a camera with its centre at ({cx}, {cy}) px \
             is exact: camera: {{ principal: {name} }}"
        );
        losses.push(ExportLoss::approximate("camera.centre", furthest, what));
    }
    let unequal = (camera.fx - camera.fy).abs() / camera.fx * middle_y;
    if one_focal && unequal > SAME_PX {
        let what =
            format!("fx {} stands for fy {} too: {unequal} px at the upper edge", camera.fx, camera.fy);
        losses.push(ExportLoss::approximate("camera.fy", unequal, what));
    }
    losses
}

/// Losses of one threshold in a formula of brightness.
pub(super) fn thresholds(plan: &ExportPlan<'_>, formula: BrightnessFormula, one: bool) -> Vec<ExportLoss> {
    let Some(sensor) = &plan.subject.sensor else { return Vec::new() };
    let mut losses = Vec::new();
    let factor = BrightnessFactor::between(sensor, formula);
    if !factor.is_exact() {
        let BrightnessFactor { median, p5, p95 } = factor;
        let what = format!(
            "the loss of the method takes brightness otherwise: the threshold is {median:.3} times the sensor's, {p5:.3} to {p95:.3} by grey"
        );
        losses.push(ExportLoss::approximate("sensor.brightness", factor.spread(), what));
    }
    let (on, off) = sensor.as_model().contrast();
    let unequal = (on - off).abs() / (on + off);
    if one && unequal > 0.0 {
        let what = format!("one threshold stands for {on} (ON) and {off} (OFF)");
        losses.push(ExportLoss::approximate("sensor.threshold", unequal, what));
    }
    if sensor.dead_us() > 0 && one {
        losses.push(ExportLoss::lost("sensor.refractory", format!("{} us", sensor.dead_us())));
    }
    losses
}

/// The threshold of a method with one threshold for both polarities.
pub(super) fn mean_threshold(plan: &ExportPlan<'_>, formula: BrightnessFormula) -> Option<f64> {
    let sensor = plan.subject.sensor.as_ref()?;
    let (on, off) = sensor.as_model().contrast();
    Some((on + off) / 2.0 * BrightnessFactor::between(sensor, formula).median)
}

/// Products without a place in any of these layouts.
pub(super) fn products(names: &[&str]) -> ExportLoss {
    ExportLoss::lost("outputs", names.join(", "))
}

/// The need for this number of blurred pictures, each with a sharp frame in the middle of its exposure.
pub(super) fn unmet_exposures(plan: &ExportPlan<'_>, least: usize) -> Option<UnmetNeed> {
    let exposures = plan.exposures();
    let sharp = |pose: &usize| plan.frames.binary_search(pose).is_ok();
    let found = exposures.iter().filter(|exposure| sharp(&exposure.pose)).count();
    let what = format!(
        "{} blurred pictures, {found} of them with a sharp frame in the middle, wanted at least {least} of both",
        exposures.len()
    );
    (found < least || found < exposures.len()).then(|| {
        UnmetNeed::new(what, "outputs: [sharp, blur] and a longer trajectory or a smaller blur.frames")
    })
}

/// The need for columns and rows that int16 holds.
pub(super) fn unmet_int16(plan: &ExportPlan<'_>) -> Option<UnmetNeed> {
    let size = plan.subject.camera.size;
    let most = i16::MAX;
    let what = format!("pictures of {size}, wanted at most {most} columns and rows: places are int16");
    (i16::try_from(size.width.max(size.height)).is_err()).then(|| UnmetNeed::new(what, "a smaller camera"))
}
