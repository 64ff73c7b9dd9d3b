//! EventNeRF (Rudnev et al., CVPR 2023; GitHub r00tman/EventNeRF at 44297dd), and E-3DGS (3DV 2025;
//! GitHub KwanWaiPang/E-3DGS at 652292b), which reads a variant.
//!
//! | file | content |
//! |---|---|
//! | `SET/events/events.npz` | x, y; t float64, 0 to 1000; p int64 -1 or +1 |
//! | `SET/pose/r_NNNNN.txt` | 4x4 camera to world, OpenCV axes, at uniform times |
//! | `SET/intrinsics/r_NNNNN.txt` | 4x4, pixel centres at 0.5 |
//! | `SET/rgb/r_NNNNN.png` | a picture for each pose, for display and validation |
//!
//! SET is `train`, `validation` or `test`. Traps: a polarity of 0 counts nothing; pose i of n is at
//! the share i / (n - 1) of the last event's time, so the last event is moved to the last pose.
//! E-3DGS names each pose by its time, in microseconds here, and reads `train` and `validation`.

use super::camera_needs::{
    centred_camera, mean_threshold, products, thresholds, unmet_events, unmet_frames, unmet_poses,
};
use super::marks::event_sign;
use crate::brightness::{BrightnessFormula, log_offset};
use crate::geometry::{SceneBox, Similarity};
use crate::npy::{Entry, GrowingArray};
use crate::{
    ExportError, ExportFolder, ExportFormat, ExportLoss, ExportPlan, UnmetNeed, geometry, npy, poses,
};
use glam::DVec3;
use gs2e_event::Event;
use gs2e_image::{Image, Size, png};
use gs2e_num::se3::Se3;
use gs2e_sensor::SensorChoice;
use gs2e_sensor::front_end::ChannelDecode;
use serde_json::{Value, json};

/// The layout of EventNeRF.
pub(super) static EVENTNERF: ExportFormat = ExportFormat::new(
    "eventnerf",
    "github.com/r00tman/EventNeRF at 44297dd",
    eventnerf_unmet,
    eventnerf_losses,
    write_eventnerf,
);

/// The layout of E-3DGS.
pub(super) static E_3DGS: ExportFormat = ExportFormat::new(
    "e-3dgs",
    "github.com/KwanWaiPang/E-3DGS at 652292b",
    e3dgs_unmet,
    e3dgs_losses,
    write_e3dgs,
);

/// The size in the loaders' code.
const SIZE: Size = Size { width: 346, height: 260 };
/// Numbers of poses: that of its authors' sets, and one for short trajectories.
const POSES: [u32; 2] = [1001, 101];
/// Margin of the unit sphere.
const MARGIN: f64 = 1.1;
/// Time of the last event.
const LAST: f64 = 1000.0;
/// Offset of EventNeRF's logarithm unless its config has another.
const EPS: f64 = 1e-5;

fn eventnerf_unmet(plan: &ExportPlan<'_>) -> Vec<Option<UnmetNeed>> {
    let least = usize::try_from(POSES[1]).unwrap_or(usize::MAX);
    vec![unmet_events(plan), unmet_frames(plan, 1), unmet_poses(plan, least), geometry::unmet_depth(plan)]
}

fn eventnerf_losses(plan: &ExportPlan<'_>) -> Vec<ExportLoss> {
    let mut losses = losses_of_both(plan);
    losses.push(ExportLoss::derived(
        "events.t",
        "the last event is moved to the last pose, because the loader divides by its time",
    ));
    losses.push(ExportLoss::derived(
        "poses",
        "poses at uniform times between those of the release; each has the nearest sharp frame",
    ));
    losses
}

fn write_eventnerf(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<Value, ExportError> {
    let bounds = geometry::scene_box(plan)?;
    let similarity = unit_sphere(plan, &bounds);
    let count = pose_count(plan);
    let events = write_events(plan, EventClock::Shares, out)?;
    write_train(plan, count, similarity, out)?;
    for set in ["validation", "test"] {
        // Every set is read with events, also one whose pictures alone are used.
        out.repeat("train/events/events.npz", &format!("{set}/events/events.npz"))?;
        write_held_out(plan, set, similarity, out)?;
    }
    let threshold = mean_threshold(plan, formula(plan));
    let eps = offset(plan);
    let window = (count / 10).max(1);
    let text = format!(
        "event_threshold = {}\ntonemap_eps = {eps}\nwinsize = {window}\nuse_random_window_len = True\n\
         is_colored = False\nis_cycled = False\npolarity_offset = 0\nbg_color = 159\nneg_ratio = 0.1\n",
        threshold.unwrap_or_default()
    );
    out.write_file("config.txt", text.as_bytes())?;
    Ok(json!({
        "events": events, "poses": count, "threshold": threshold, "tonemap_eps": eps,
        "similarity": similarity.facts(), "bound_from": bounds.basis,
        "command": "python ddp_train_nerf.py --config config.txt --datadir PARENT --scene NAME",
    }))
}

fn e3dgs_unmet(plan: &ExportPlan<'_>) -> Vec<Option<UnmetNeed>> {
    vec![unmet_events(plan), unmet_frames(plan, 1)]
}

fn e3dgs_losses(plan: &ExportPlan<'_>) -> Vec<ExportLoss> {
    let mut losses = losses_of_both(plan);
    losses.extend(centred_camera(plan, 0.5, true));
    losses
}

fn write_e3dgs(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<Value, ExportError> {
    let events = write_events(plan, EventClock::Micros, out)?;
    out.repeat("train/events/events.npz", "validation/events/events.npz")?;
    let camera = poses::matrix_text(&poses::intrinsics(plan, 0.0));
    let mut white = Vec::new();
    let mask = Image::filled(plan.subject.camera.size, [u8::MAX; 3]);
    png::write_image(&mask, &mut white).map_err(|e| ExportError::Data(e.to_string()))?;
    for set in ["train", "validation"] {
        out.write_file(&format!("{set}/intrinsics/intrinsics_000000.txt"), camera.as_bytes())?;
        // Without a white mask, a mosaic of colours is assumed.
        out.write_file(&format!("{set}/intrinsics/color_mask_undistorted.png"), &white)?;
    }
    for (index, (t_us, pose)) in plan.poses().enumerate() {
        write_pose(&format!("train/pose/{index:06}_{t_us:012}.txt"), &pose, out)?;
    }
    let (held_out, frames) = plan.test_frames();
    // Another trajectory has a clock of its own.
    let first_us = held_out.poses.stamps_us[0];
    for (index, frame) in frames.iter().enumerate() {
        let t_us = held_out.poses.stamps_us[*frame] - first_us;
        let pose = &held_out.poses.world_from_camera[*frame];
        write_pose(&format!("validation/pose/{index:06}_{t_us:012}.txt"), pose, out)?;
        out.write_file(&format!("validation/rgb/{index:06}.png"), &held_out.sharp_file(*frame)?)?;
    }
    let threshold = mean_threshold(plan, formula(plan));
    Ok(json!({
        "events": events, "threshold": threshold, "tonemap_eps": offset(plan),
        // With fewer events than its default after the first pose, nothing is trained on.
        "max_events": events / 4,
        "command": "python train.py -s DIR --event_threshold THRESHOLD --max_events MAX_EVENTS",
    }))
}

/// The offset of the method's logarithm. A sensor in linear light has its own.
fn offset(plan: &ExportPlan<'_>) -> f64 {
    let linear = |sensor: &&SensorChoice| sensor.as_model().front_end().decode != ChannelDecode::None;
    plan.subject.sensor.as_ref().filter(linear).map_or(EPS, log_offset)
}

fn formula(plan: &ExportPlan<'_>) -> BrightnessFormula {
    BrightnessFormula::Gamma { offset: offset(plan) }
}

fn losses_of_both(plan: &ExportPlan<'_>) -> Vec<ExportLoss> {
    let size = plan.subject.camera.size;
    let mut losses = thresholds(plan, formula(plan), true);
    if size != SIZE {
        let what = format!("pictures of {size}: the loader has {SIZE} in its code, two numbers to edit");
        let other = f64::from(size.width.abs_diff(SIZE.width) + size.height.abs_diff(SIZE.height));
        losses.push(ExportLoss::approximate("camera.size", other, what));
    }
    losses.push(products(&["blur", "depth", "flow", "labels of events"]));
    losses
}

/// Number of poses of a training set.
fn pose_count(plan: &ExportPlan<'_>) -> u32 {
    let [many, few] = POSES;
    if plan.pose_count() >= many as usize { many } else { few }
}

/// Origin and factor that move cameras and content into the unit sphere.
fn unit_sphere(plan: &ExportPlan<'_>, bounds: &SceneBox) -> Similarity {
    let [low, high] = bounds.corners;
    // Bit a of k picks the upper end of axis a.
    let corners = (0..8).map(|k| {
        let pick = |axis: usize| if k >> axis & 1 == 0 { low[axis] } else { high[axis] };
        DVec3::new(pick(0), pick(1), pick(2))
    });
    let cameras = plan.poses().map(|(_, pose)| pose.translation);
    let reach = corners.chain(cameras).map(|place| (place - bounds.centre).length()).fold(0.0, f64::max);
    Similarity { origin: bounds.centre, scale: 1.0 / (MARGIN * reach) }
}

fn write_pose(name: &str, pose: &Se3, out: &mut ExportFolder<'_>) -> Result<(), ExportError> {
    out.write_file(name, poses::matrix_text(&poses::matrix(pose)).as_bytes())
}

/// Times of events.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum EventClock {
    /// From 0 to [`LAST`]. The last event is moved to the last pose.
    Shares,
    /// Microseconds.
    Micros,
}

/// Writes the events of the training set.
fn write_events(
    plan: &ExportPlan<'_>,
    clock: EventClock,
    out: &mut ExportFolder<'_>,
) -> Result<u64, ExportError> {
    let archive = out.file("train/events/events.npz")?;
    let time = |t_us: i64| match clock {
        // Divided last, so that the end is exact.
        EventClock::Shares => t_us as f64 * LAST / plan.length_us() as f64,
        EventClock::Micros => t_us as f64,
    };
    let spool = |kind, name: &str| GrowingArray::create(&archive.with_file_name(name), kind, None);
    let (mut x, mut y) = (spool("<i4", "x.spool")?, spool("<i4", "y.spool")?);
    let (mut t, mut p) = (spool("<f8", "t.spool")?, spool("<i8", "p.spool")?);
    // Held back by one, so that the time of the last event can be another.
    let mut held: Option<(Event, i64)> = None;
    let mut push = |event: &Event, t_us: i64| {
        out.count_event()?;
        x.push(&i32::from(event.x).to_le_bytes())?;
        y.push(&i32::from(event.y).to_le_bytes())?;
        t.push(&time(t_us).to_le_bytes())?;
        p.push(&event_sign::<i64>(event).to_le_bytes())
    };
    plan.for_each_event(|event, t_us| match held.replace((*event, t_us)) {
        Some((event, t_us)) => push(&event, t_us),
        None => Ok(()),
    })?;
    let Some((last, t_us)) = held else {
        return Err(ExportError::Data("the interval has no event".to_owned()));
    };
    push(&last, if clock == EventClock::Shares { plan.length_us() } else { t_us })?;
    let events = t.rows();
    let entries = [("x", x), ("y", y), ("t", t), ("p", p)];
    npy::write_archive(&archive, entries.map(|(name, array)| (name, Entry::Spooled(array))).into())?;
    Ok(events)
}

/// Poses at uniform times, each with the nearest sharp frame.
fn write_train(
    plan: &ExportPlan<'_>,
    count: u32,
    similarity: Similarity,
    out: &mut ExportFolder<'_>,
) -> Result<(), ExportError> {
    let camera = poses::matrix_text(&poses::intrinsics(plan, 0.0));
    let mut written: Option<(usize, String)> = None;
    for index in 0..count {
        let t_us = plan.length_us() as f64 * f64::from(index) / f64::from(count - 1);
        let pose = similarity.moved(&poses::pose_at(plan, t_us));
        let name = format!("r_{index:05}");
        write_pose(&format!("train/pose/{name}.txt"), &pose, out)?;
        out.write_file(&format!("train/intrinsics/{name}.txt"), camera.as_bytes())?;
        let distance = |frame: &&usize| (plan.stamp_us(**frame) as f64 - t_us).abs();
        let nearest = plan.frames.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let frame = *nearest.ok_or_else(|| ExportError::Data("there are no sharp frames".to_owned()))?;
        let picture = format!("train/rgb/{name}.png");
        match &written {
            // Neighbouring poses mostly share a frame, so its bytes are on the disk once.
            Some((of, first)) if *of == frame => out.repeat(first, &picture)?,
            _ => {
                out.write_file(&picture, &plan.subject.sharp_file(frame)?)?;
                written = Some((frame, picture));
            }
        }
        out.report()?;
    }
    Ok(())
}

/// The held-out views.
fn write_held_out(
    plan: &ExportPlan<'_>,
    set: &str,
    similarity: Similarity,
    out: &mut ExportFolder<'_>,
) -> Result<(), ExportError> {
    let camera = poses::matrix_text(&poses::intrinsics(plan, 0.0));
    let (subject, frames) = plan.test_frames();
    for (index, frame) in frames.iter().enumerate() {
        let name = format!("r_{index:05}");
        let pose = similarity.moved(&subject.poses.world_from_camera[*frame]);
        write_pose(&format!("{set}/pose/{name}.txt"), &pose, out)?;
        out.write_file(&format!("{set}/intrinsics/{name}.txt"), camera.as_bytes())?;
        out.write_file(&format!("{set}/rgb/{name}.png"), &subject.sharp_file(*frame)?)?;
    }
    Ok(())
}
