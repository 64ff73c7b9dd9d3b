//! EVREAL (Ercan et al., CVPR Workshops 2023; GitHub ercanburak/EVREAL at 398f035), a benchmark of
//! reconstruction.
//!
//! | file | content |
//! |---|---|
//! | `events_ts.npy` | float64 (N), s |
//! | `events_xy.npy` | int16 (N, 2) |
//! | `events_p.npy` | int8 (N), 1 for ON, 0 for OFF |
//! | `images.npy` | uint8 (F, H, W, 1) |
//! | `images_ts.npy` | float64 (F, 1), s |
//! | `image_event_indices.npy` | int64 (F, 1), numbers of events before the frames |
//! | `metadata.json` | `sensor_resolution`: height, width |
//!
//! Types are signed, because readers subtract: `2 p - 1` of an unsigned 0 is 255.

use super::camera_needs::{products, unmet_events, unmet_frames, unmet_held_out_views, unmet_int16};
use super::marks::{EventMarks, grey_picture};
use crate::npy::GrowingArray;
use crate::{ExportError, ExportFolder, ExportFormat, ExportLoss, ExportPlan, UnmetNeed, npy};
use gs2e_image::Size;
use serde_json::{Value, json};

/// The layout of EVREAL.
pub(super) static FORMAT: ExportFormat =
    ExportFormat::new("evreal", "github.com/ercanburak/EVREAL at 398f035", unmet, losses, write)
        .for_any_lens();

fn unmet(plan: &ExportPlan<'_>) -> Vec<Option<UnmetNeed>> {
    vec![unmet_events(plan), unmet_frames(plan, 2), unmet_held_out_views(plan), unmet_int16(plan)]
}

fn losses(_: &ExportPlan<'_>) -> Vec<ExportLoss> {
    vec![
        products(&["blur", "depth", "flow", "labels of events"]),
        ExportLoss::lost("sharp", "colours: the pictures are grey"),
        ExportLoss::lost("poses", "poses, camera matrix and thresholds"),
    ]
}

fn write(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<Value, ExportError> {
    let mut marks = EventMarks::at(plan, &plan.frames);
    let events = write_events(plan, &mut marks, out)?;
    let Size { width, height } = plan.subject.camera.size;
    let path = out.file("images.npy")?;
    let mut images = GrowingArray::of_rows(&path, "|u1", vec![height.into(), width.into(), 1])?;
    for frame in &plan.frames {
        images.push(&grey_picture(plan, *frame)?)?;
        out.report()?;
    }
    images.finish()?;
    let shape = [plan.frames.len() as u64, 1];
    let seconds = npy::float64(marks.stamps_us.iter().map(|t_us| *t_us as f64 / 1e6));
    out.write_file("images_ts.npy", &npy::array("<f8", &shape, &seconds))?;
    let before: Vec<u8> = marks.before.iter().flat_map(|count| count.to_le_bytes()).collect();
    out.write_file("image_event_indices.npy", &npy::array("<i8", &shape, &before))?;
    let metadata = json!({ "sensor_resolution": [height, width] }).to_string();
    out.write_file("metadata.json", metadata.as_bytes())?;
    Ok(json!({ "events": events, "frames": plan.frames.len() }))
}

fn write_events(
    plan: &ExportPlan<'_>,
    marks: &mut EventMarks,
    out: &mut ExportFolder<'_>,
) -> Result<u64, ExportError> {
    let mut t = GrowingArray::create(&out.file("events_ts.npy")?, "<f8", None)?;
    let mut xy = GrowingArray::create(&out.file("events_xy.npy")?, "<i2", Some(2))?;
    let mut p = GrowingArray::create(&out.file("events_p.npy")?, "|i1", None)?;
    plan.for_each_event(|event, t_us| {
        marks.see(t_us, t.rows());
        t.push(&(t_us as f64 / 1e6).to_le_bytes())?;
        xy.push([event.x.to_le_bytes(), event.y.to_le_bytes()].as_flattened())?;
        p.push(&[event.polarity as u8])?;
        out.count_event()
    })?;
    let events = t.rows();
    marks.finish(events);
    [t, xy, p].into_iter().try_for_each(|array| array.finish().map(drop))?;
    Ok(events)
}
