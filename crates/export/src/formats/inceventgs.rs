//! IncEventGS (Huang et al., CVPR 2025; GitHub WU-CVGL/IncEventGS at 28d070f).
//!
//! | file | content |
//! |---|---|
//! | `event_threshold_0.1/gray_events_data.npy` | float64 (N, 4): x, y, t in s, polarity -1 or +1 |
//! | `traj.txt` | 16 numbers per line, camera to world by rows, OpenCV axes |
//! | `poses_ts.txt` | seconds, uniform |
//! | `images/NNNNNN.jpg` | a picture per pose |
//! | `config.yaml` | keys of the program's configuration |
//!
//! The poses serve evaluation alone: the method finds its own. Traps: the name of the folder of events is in
//! the code, whatever the threshold; pictures are JPEG; times become float32 of seconds.

use super::camera_needs::{
    mean_threshold, products, thresholds, unmet_events, unmet_frames, unmet_held_out_views,
};
use super::marks::{event_sign, frame_lines};
use crate::brightness::BrightnessFormula;
use crate::npy::GrowingArray;
use crate::plan::seconds_text;
use crate::{ExportError, ExportFolder, ExportFormat, ExportLoss, ExportPlan, UnmetNeed, npy, poses};
use gs2e_image::jpeg;
use gs2e_trajectory::text::significant_digits;
use serde_json::{Value, json};

/// The layout of IncEventGS.
pub(super) static FORMAT: ExportFormat =
    ExportFormat::new("inceventgs", "github.com/WU-CVGL/IncEventGS at 28d070f", unmet, losses, write);

const FORMULA: BrightnessFormula = BrightnessFormula::LinLog;
/// The program starts from a first and a second picture.
const MIN_FRAMES: usize = 2;
/// Quality of the pictures.
const QUALITY: u8 = 100;
/// Difference of two distances of stamps of equal distance: both are rounded to a microsecond.
const ROUNDING_US: i64 = 2;
/// Time from which on float32 seconds are more than a microsecond apart, us, and their distance there: a
/// fraction has 23 bits, and each doubling of the time doubles the distance.
const FLOAT32_US: i64 = 16_000_000;
const SPACING_US: f64 = 16e6 / (1 << 23) as f64;

fn unmet(plan: &ExportPlan<'_>) -> Vec<Option<UnmetNeed>> {
    let stamps: Vec<i64> = plan.frames.iter().map(|pose| plan.stamp_us(*pose)).collect();
    let steps = stamps.windows(2).map(|pair| pair[1] - pair[0]);
    let unequal = steps.clone().min().zip(steps.max()).filter(|(least, most)| most - least > ROUNDING_US);
    let unequal = unequal.map(|(least, most)| {
        let what = format!("sharp frames {least} to {most} us apart, wanted equal distances");
        UnmetNeed::new(what, "a sharp.every that divides blur.frames, or outputs without blur")
    });
    vec![unmet_events(plan), unmet_frames(plan, MIN_FRAMES), unmet_held_out_views(plan), unequal]
}

fn losses(plan: &ExportPlan<'_>) -> Vec<ExportLoss> {
    let mut losses = thresholds(plan, FORMULA, true);
    if plan.length_us() >= FLOAT32_US {
        let octave = (plan.length_us() / FLOAT32_US).ilog2();
        // At most 30, because one bit more does not fit into the i32 that is shifted.
        let spacing = SPACING_US * f64::from(1 << octave.min(30));
        let what =
            format!("times become float32 of seconds: they are up to {spacing:.1} us apart at the end");
        losses.push(ExportLoss::approximate("events.t", spacing, what));
    }
    losses.push(ExportLoss::lost("sharp", "exact greys: the pictures are JPEG, for evaluation"));
    losses.push(ExportLoss::lost("poses", "poses between the sharp frames, for evaluation alone"));
    losses.push(products(&["blur", "depth", "flow", "labels of events"]));
    losses
}

fn write(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<Value, ExportError> {
    let events = write_events(plan, out)?;
    let mut path = String::new();
    for (index, frame) in plan.frames.iter().enumerate() {
        let rows = poses::matrix(&plan.subject.poses.world_from_camera[*frame]);
        let numbers = rows.as_flattened().iter().copied().map(significant_digits).collect::<Vec<_>>();
        path += &(numbers.join(" ") + "\n");
        let picture = jpeg::encode(&plan.subject.sharp_picture(*frame)?, QUALITY);
        let picture = picture.ok_or_else(|| ExportError::Data("a picture is too large".to_owned()))?;
        out.write_file(&format!("images/{index:06}.jpg"), &picture)?;
        out.report()?;
    }
    out.write_file("traj.txt", path.as_bytes())?;
    out.write_file("poses_ts.txt", frame_lines(plan, seconds_text).as_bytes())?;
    let threshold = mean_threshold(plan, FORMULA);
    write_config(plan, threshold, out)?;
    Ok(json!({
        "events": events, "frames": plan.frames.len(), "threshold": threshold,
        "command": "python main.py --config config.yaml",
    }))
}

fn write_events(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<u64, ExportError> {
    let path = out.file("event_threshold_0.1/gray_events_data.npy")?;
    let mut array = GrowingArray::create(&path, "<f8", Some(4))?;
    plan.for_each_event(|event, t_us| {
        out.count_event()?;
        array.push(&npy::float64([event.x.into(), event.y.into(), t_us as f64 / 1e6, event_sign(event)]))
    })?;
    let events = array.rows();
    array.finish()?;
    Ok(events)
}

fn write_config(
    plan: &ExportPlan<'_>,
    threshold: Option<f64>,
    out: &mut ExportFolder<'_>,
) -> Result<(), ExportError> {
    let camera = &plan.subject.camera;
    let text = format!(
        "data:\n  datadir: DIR\n  interval_selection: 1\n  training_start_index: 0\n  training_end_index: {}\n  \
         downsample: 1\ncam:\n  H: {}\n  W: {}\n  fx: {}\n  fy: {}\n  cx: {}\n  cy: {}\n  png_depth_scale: 1\n\
         event:\n  threshold: {}\n",
        plan.frames.len() - 1,
        camera.size.height,
        camera.size.width,
        camera.fx,
        camera.fy,
        camera.cx,
        camera.cy,
        threshold.unwrap_or_default()
    );
    out.write_file("config.yaml", text.as_bytes())
}
