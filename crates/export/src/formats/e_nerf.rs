//! E-NeRF (Klenk et al., RA-L 2023; GitHub knelk/enerf at 3fb17cd), mode `esim`.
//!
//! | file | content |
//! |---|---|
//! | `events/K.npy` | float64 (N, 4): x, y, t in ns, polarity -1 or +1; events from frame K to frame K+1 |
//! | `poses_all.txt` | a header line, then `t_ns px py pz qx qy qz qw`, camera to world, OpenCV axes |
//! | `poses_bounds.npy` | float64 (N, 17): rows of `[R t (H, W, f)]`, then near and far |
//! | `images/*.png`, `images/image_stamps_ns.txt` | frames, and their stamps |
//! | `config.txt` | options of the program |
//!
//! Traps of its loader: polarity 0 fails, as does a batch without an OFF event; the first line of
//! the poses is skipped; times are float32, and an event that is rounded past the last pose fails.

use super::camera_needs::{
    centred_camera, mean_threshold, products, thresholds, unmet_events, unmet_frames, unmet_held_out_views,
    unmet_poses,
};
use super::marks::{event_sign, frame_lines};
use crate::brightness::BrightnessFormula;
use crate::npy::GrowingArray;
use crate::{
    ExportError, ExportFolder, ExportFormat, ExportLoss, ExportPlan, UnmetNeed, geometry, npy, poses,
};
use gs2e_event::Polarity;
use gs2e_trajectory::text::significant_digits;
use serde_json::{Value, json};
use std::fmt::Write as _;

/// The layout of E-NeRF.
pub(super) static FORMAT: ExportFormat =
    ExportFormat::new("e-nerf", "github.com/knelk/enerf at 3fb17cd", unmet, losses, write);

const FORMULA: BrightnessFormula = BrightnessFormula::LinLog;
/// Its loader asserts more poses than this.
const MIN_POSES: usize = 101;
/// Its loader asserts larger pictures than this.
const MIN_SIDE: u32 = 201;
/// Its loader asserts coordinates below these.
const MAX_SIDES: [u32; 2] = [1280, 720];
/// Two frames for training, two for validation, and the last one, which starts no batch.
const MIN_FRAMES: usize = 5;
const NS_PER_US: i64 = 1000;

fn unmet(plan: &ExportPlan<'_>) -> Vec<Option<UnmetNeed>> {
    let size = plan.subject.camera.size;
    let [w, h] = MAX_SIDES;
    let fits = (MIN_SIDE..=w).contains(&size.width) && (MIN_SIDE..=h).contains(&size.height);
    let side = (!fits).then(|| {
        let what = format!("pictures of {size}, wanted {MIN_SIDE}x{MIN_SIDE} to {w}x{h}");
        UnmetNeed::new(what, "camera: { width: 346, height: 260 }")
    });
    vec![
        unmet_events(plan),
        unmet_frames(plan, MIN_FRAMES),
        unmet_poses(plan, MIN_POSES),
        unmet_held_out_views(plan),
        geometry::unmet_depth(plan),
        side,
    ]
}

fn losses(plan: &ExportPlan<'_>) -> Vec<ExportLoss> {
    let mut losses = centred_camera(plan, 0.0, true);
    losses.extend(thresholds(plan, FORMULA, true));
    losses.push(products(&["blur", "depth", "flow", "labels of events"]));
    let what = "scale, bound, near and far in config.txt and poses_bounds.npy follow from the points seen";
    losses.push(ExportLoss::derived("geometry", what));
    losses
}

fn write(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<Value, ExportError> {
    let files = write_events(plan, out)?;
    write_poses(plan, out)?;
    out.write_frames("images", plan.subject, &plan.frames)?;
    let stamps = frame_lines(plan, |t_us| (t_us * NS_PER_US).to_string());
    out.write_file("images/image_stamps_ns.txt", stamps.as_bytes())?;
    let bounds = geometry::scene_box(plan)?;
    write_bounds(plan, bounds.depth, out)?;
    let views = choose_views(plan, &files.off)?;
    // The program's box is the cube [-bound, bound], and it does not move the poses.
    let reach = bounds.corners.iter().map(|corner| corner.abs().max_element()).fold(0.0, f64::max);
    let scale = 1.0 / reach;
    let threshold = mean_threshold(plan, FORMULA);
    write_config(plan, &views, threshold, scale, out)?;
    Ok(json!({
        "events": files.off.iter().zip(&files.on).map(|(off, on)| off + on).sum::<u64>(),
        "events_before_the_first_frame": files.early,
        "events_after_the_last_pose_in_float32": files.late,
        "threshold": threshold, "scale": scale, "bound": 1, "bound_from": bounds.basis,
        "train_idxs": views.train, "val_idxs": views.validation,
        "command": "python main_nerf.py --config config.txt --datadir DIR",
    }))
}

/// Counts of the files of events.
#[derive(Debug, Default)]
struct EventFiles {
    on: Vec<u64>,
    off: Vec<u64>,
    /// Events before the first frame.
    early: u64,
    /// Events that would be past the last pose in float32.
    late: u64,
}

/// The frames of a set, as indices of the frames.
#[derive(Debug)]
struct FrameSets {
    train: Vec<usize>,
    validation: Vec<usize>,
}

/// Distance of two float32 numbers at a time of 1 ns and more.
fn float32_spacing(t_ns: i64) -> i64 {
    // The exponent is the number of bits above the lowest; a fraction has 23 bits.
    let bits = i64::BITS - t_ns.max(1).leading_zeros() - 1;
    1 << bits.saturating_sub(23)
}

fn write_events(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<EventFiles, ExportError> {
    let starts: Vec<i64> = plan.frames.iter().map(|pose| plan.stamp_us(*pose)).collect();
    // Two steps, because an interpolation after the rounding fails at times past the last pose.
    let end_ns = plan.length_us() * NS_PER_US;
    let last_ns = end_ns - 2 * float32_spacing(end_ns);
    let mut files = EventFiles::default();
    let mut array: Option<GrowingArray> = None;
    plan.for_each_event(|event, t_us| {
        let t_ns = t_us * NS_PER_US;
        while starts.get(files.on.len()).is_some_and(|start| *start <= t_us) {
            next_file(&mut array, &mut files, out)?;
        }
        let Some(array) = array.as_mut() else {
            files.early += 1;
            return Ok(());
        };
        if t_ns > last_ns {
            files.late += 1;
            return Ok(());
        }
        let of = if event.polarity == Polarity::On { &mut files.on } else { &mut files.off };
        *of.last_mut().expect("a file is open") += 1;
        out.count_event()?;
        array.push(&npy::float64([event.x.into(), event.y.into(), t_ns as f64, event_sign(event)]))
    })?;
    // The loader counts on one file per frame, also after the last event.
    while files.on.len() < starts.len() {
        next_file(&mut array, &mut files, out)?;
    }
    array.map(GrowingArray::finish).transpose()?;
    Ok(files)
}

/// Completes a file of events, and starts the next one.
fn next_file(
    array: &mut Option<GrowingArray>,
    files: &mut EventFiles,
    out: &mut ExportFolder<'_>,
) -> Result<(), ExportError> {
    let path = out.file(&format!("events/{:06}.npy", files.on.len()))?;
    array.replace(GrowingArray::create(&path, "<f8", Some(4))?).map(GrowingArray::finish).transpose()?;
    files.on.push(0);
    files.off.push(0);
    Ok(())
}

fn write_poses(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<(), ExportError> {
    // The loader skips the first line whatever it holds; without it the first pose would be lost.
    let mut text = "# t_ns px py pz qx qy qz qw\n".to_owned();
    for (t_us, pose) in plan.poses() {
        let (c, q) = (pose.translation, pose.rotation);
        let numbers = [c.x, c.y, c.z, q.x, q.y, q.z, q.w].map(significant_digits).join(" ");
        writeln!(text, "{} {numbers}", t_us * NS_PER_US).expect("a String takes any text");
    }
    out.write_file("poses_all.txt", text.as_bytes())
}

/// One row per frame. Its columns are those of the pose as it is, not LLFF's.
fn write_bounds(
    plan: &ExportPlan<'_>,
    depth: [f64; 2],
    out: &mut ExportFolder<'_>,
) -> Result<(), ExportError> {
    let camera = &plan.subject.camera;
    // The last column of the three rows of a pose holds height, width and focal length.
    let sides = [f64::from(camera.size.height), f64::from(camera.size.width), camera.fx];
    let mut values = Vec::new();
    for (_, pose) in plan.poses() {
        let rows = poses::matrix(&pose);
        values.extend(rows[..3].iter().zip(sides).flat_map(|(row, side)| row.iter().copied().chain([side])));
        values.extend(depth);
    }
    let array = npy::array("<f8", &[plan.pose_count() as u64, 17], &npy::float64(values));
    out.write_file("poses_bounds.npy", &array)
}

/// Frames for training and validation. A batch of events goes from one training frame to the next,
/// and the last one is the file of the last training frame. Each needs an OFF event.
fn choose_views(plan: &ExportPlan<'_>, off: &[u64]) -> Result<FrameSets, ExportError> {
    let held_out = plan.test_frames().1;
    // The file of the last frame may be empty.
    let places = 0..plan.frames.len() - 1;
    let validation: Vec<usize> = places.clone().filter(|k| held_out.contains(&plan.frames[*k])).collect();
    let mut train: Vec<usize> = Vec::new();
    for place in places.filter(|k| !held_out.contains(&plan.frames[*k])) {
        if train.last().is_none_or(|last| off[*last..place].iter().any(|count| *count > 0)) {
            train.push(place);
        }
    }
    // Its own file is the last batch.
    while train.last().is_some_and(|last| off[*last] == 0) {
        train.pop();
    }
    if train.len() < 2 || validation.len() < 2 {
        let found = [train.len(), validation.len()];
        let because = format!(
            "{} frames start a batch with an OFF event and {} are held out, wanted 2 of each: choose a larger \
             sharp.every or another --test-every",
            found[0], found[1]
        );
        return Err(ExportError::Data(because));
    }
    Ok(FrameSets { train, validation })
}

fn write_config(
    plan: &ExportPlan<'_>,
    views: &FrameSets,
    threshold: Option<f64>,
    scale: f64,
    out: &mut ExportFolder<'_>,
) -> Result<(), ExportError> {
    let list = |set: &[usize]| set.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
    let size = plan.subject.camera.size;
    let text = format!(
        "mode = esim\npp_poses_sphere = 0\nscale = {scale}\nbound = 1\nC_thres = {}\ntrain_idxs = [{}]\n\
         val_idxs = [{}]\nout_dim_color = 1\nevents = 1\nevent_only = 1\nimages_corrupted = 0\nH = {}\nW = {}\n",
        // -1 makes the program normalise, which needs no threshold.
        threshold.unwrap_or(-1.0),
        list(&views.train),
        list(&views.validation),
        size.height,
        size.width
    );
    out.write_file("config.txt", text.as_bytes())
}
