//! DSEC (Gehrig et al., RA-L 2021; GitHub uzh-rpg/DSEC at af90ef1), in the tree that E-RAFT (GitHub
//! uzh-rpg/E-RAFT at c58ce05) opens; RVT (GitHub uzh-rpg/RVT at b80f568) reads its events.
//!
//! | file in `test/NAME` | content |
//! |---|---|
//! | `events_left/events.h5` | as in a release, with `events/height` and `events/width`, uint16 |
//! | `events_left/rectify_map.h5` | `rectify_map`, float32 (H, W, 2): a pixel's own column and row |
//! | `image_timestamps.txt` | stamps of the sharp frames, us |
//! | `images/left/NNNNNN.png` | sharp frames |
//! | `flow/forward/NNNNNN.png` | flow from frame N to the next, PNG of 16 bits |
//! | `flow/forward_timestamps.txt`, `test_forward_flow_timestamps.csv` | start and end of each flow, us |
//!
//! A flow is a displacement: red and green are `128 u + 2^15` and `128 v + 2^15` to the right and down, and
//! blue is 1 where it is valid, and all three are 0 elsewhere. It follows from the depth of the first frame
//! and both poses, so a point that is hidden in the second frame has a flow too.
//!
//! The two scalars are in this file alone: in the files of a release they would change the bytes of every
//! stream, and the attributes `width` and `height` of the root state the same.

use super::camera_needs::{products, unmet_events, unmet_held_out_views};
use super::marks::frame_lines;
use crate::hdf5::Hdf5File;
use crate::{ExportError, ExportFolder, ExportFormat, ExportLoss, ExportPlan, UnmetNeed};
use gs2e_event::{Event, EventFileError, EventSink as _, StreamHeader, h5};
use gs2e_image::{Image, Size, png};
use gs2e_num::units::Timestamp;
use gs2e_scene::camera::flow::flow_between;
use gs2e_scene::camera::view::CameraView;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io;
use std::path::Path;

/// The layout of DSEC.
pub(super) static FORMAT: ExportFormat = ExportFormat::new(
    "dsec",
    "github.com/uzh-rpg/DSEC at af90ef1, github.com/uzh-rpg/E-RAFT at c58ce05",
    unmet,
    losses,
    write,
);

/// Steps of a flow per pixel, and the number that stands for 0.
const STEPS_PER_PX: f64 = 128.0;
const ZERO: f64 = 32_768.0;
/// Number of events that are given to the writer together.
const AT_ONCE: usize = 65_536;
/// The size in E-RAFT's code.
const E_RAFT: Size = Size { width: 640, height: 480 };

fn unmet(plan: &ExportPlan<'_>) -> Vec<Option<UnmetNeed>> {
    vec![unmet_events(plan), unmet_held_out_views(plan)]
}

fn losses(plan: &ExportPlan<'_>) -> Vec<ExportLoss> {
    let mut losses = vec![
        products(&["blur", "depth", "velocities of the flow"]),
        ExportLoss::lost("poses", "poses and camera matrix"),
    ];
    if steps_with_depth(plan).is_empty() {
        losses.push(ExportLoss::lost("flow", "no frame but the last has depth, so there is no displacement"));
    } else {
        let what = "displacements from depth and poses, in steps of 1/128 px; hidden points have one too";
        losses.push(ExportLoss::derived("flow", what));
    }
    if plan.subject.camera.size != E_RAFT {
        let what = format!("E-RAFT has {E_RAFT}, windows of 100 ms and pictures each 50 ms in its code");
        losses.push(ExportLoss::lost("e-raft", what));
    }
    losses
}

fn write(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<Value, ExportError> {
    let name = format!("{}-{}", plan.subject.scene, plan.subject.trajectory).replace('/', "-");
    let root = format!("test/{name}");
    let events = write_events(plan, &format!("{root}/events_left/events.h5"), out)?;
    write_map(plan, &out.file(&format!("{root}/events_left/rectify_map.h5"))?)?;
    out.write_frames(&format!("{root}/images/left"), plan.subject, &plan.frames)?;
    let stamps = frame_lines(plan, |t_us| t_us.to_string());
    out.write_file(&format!("{root}/image_timestamps.txt"), stamps.as_bytes())?;
    let [flows, beyond] = write_flows(plan, &root, out)?;
    Ok(json!({
        "events": events, "frames": plan.frames.len(), "flows": flows, "sequence": name,
        "pixels_beyond_256_px": beyond,
    }))
}

/// Places in the list of frames whose frame has depth, and is not the last.
fn steps_with_depth(plan: &ExportPlan<'_>) -> Vec<usize> {
    let places = 0..plan.frames.len().saturating_sub(1);
    places.filter(|k| plan.subject.depth.binary_search(&plan.frames[*k]).is_ok()).collect()
}

/// Writes the events, with their labels, and the size of the sensor.
fn write_events(plan: &ExportPlan<'_>, name: &str, out: &mut ExportFolder<'_>) -> Result<u64, ExportError> {
    let path = out.file(name)?;
    let failed = |error: EventFileError| {
        let source = match error {
            EventFileError::Io(e) => e,
            other => io::Error::other(other.to_string()),
        };
        ExportError::unwritten(&path)(source)
    };
    let Size { width, height } = plan.subject.camera.size;
    let [rows, columns] = [height, width].map(u16::try_from);
    let (Ok(rows), Ok(columns)) = (rows, columns) else {
        return Err(ExportError::Data(
            "the sensor has 65536 columns or rows, wanted 65535 at most".to_owned(),
        ));
    };
    let header = StreamHeader { size: plan.subject.camera.size, ..plan.subject.event_header()? };
    let mut writer = h5::Writer::create(&path, &header).map_err(failed)?;
    let mut held: Vec<Event> = Vec::with_capacity(AT_ONCE);
    plan.for_each_event(|event, t_us| {
        held.push(Event { t: Timestamp::from_micros(t_us), ..*event });
        if held.len() == AT_ONCE {
            writer.append(&held).map_err(ExportError::unwritten(&path))?;
            held.clear();
        }
        out.count_event()
    })?;
    writer.append(&held).map_err(ExportError::unwritten(&path))?;
    let events = writer.finish(plan.length_us()).map_err(failed)?;
    // Only after the writer has closed the file: the writer is that of a release, which does not have these
    // scalars.
    let file = Hdf5File::extend(&path)?;
    file.add(|file| {
        for (name, side) in [("height", rows), ("width", columns)] {
            file.root_group()
                .group("events")?
                .new_dataset::<u16>()
                .scalar()
                .create(name)?
                .write_raw(&[side])?;
        }
        Ok(())
    })?;
    file.close()?;
    Ok(events)
}

/// Writes the map of a camera without a lens: each pixel stays where it is.
fn write_map(plan: &ExportPlan<'_>, path: &Path) -> Result<(), ExportError> {
    let Size { width, height } = plan.subject.camera.size;
    let file = Hdf5File::create(path)?;
    let pixel = |(x, y): (u32, u32)| [x as f32, y as f32];
    let map: Vec<[f32; 2]> = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(pixel).collect();
    file.add(|file| {
        let new = file.new_dataset::<f32>().shape([height as usize, width as usize, 2]);
        new.create("rectify_map")?.write_raw(map.as_flattened())
    })?;
    file.close()
}

/// Writes the flows. Returns their number, and the number of pixels that move too far for the layout.
fn write_flows(
    plan: &ExportPlan<'_>,
    root: &str,
    out: &mut ExportFolder<'_>,
) -> Result<[usize; 2], ExportError> {
    let steps = steps_with_depth(plan);
    let (mut stamps, mut table) = ("# from_timestamp_us, to_timestamp_us\n".to_owned(), String::new());
    table.push_str("# from_timestamp_us, to_timestamp_us, flow_file_index\n");
    let mut beyond = 0;
    for step in &steps {
        let view = |frame: usize| {
            CameraView::at_rest(plan.subject.camera, plan.subject.poses.world_from_camera[frame])
        };
        let [from, to] = [plan.frames[*step], plan.frames[step + 1]];
        let flow = flow_between(&plan.subject.depth_picture(from)?, &view(from), &view(to));
        let known = flow.pixels().iter().filter(|flow| !flow[0].is_nan()).count();
        let coded = Image::from_vec(flow.size(), flow.pixels().iter().copied().map(coded_flow).collect());
        beyond += known - coded.pixels().iter().filter(|coded| coded[2] == 1).count();
        let mut file = Vec::new();
        png::write_wide(&coded, &mut file).map_err(|e| ExportError::Data(e.to_string()))?;
        out.write_file(&format!("{root}/flow/forward/{step:06}.png"), &file)?;
        let [start, end] = [from, to].map(|frame| plan.stamp_us(frame));
        writeln!(stamps, "{start}, {end}").expect("a String takes any text");
        // The name of the file and not a count: frames without depth have no file, so the numbers have gaps.
        writeln!(table, "{start}, {end}, {step}").expect("a String takes any text");
        out.report()?;
    }
    if !steps.is_empty() {
        out.write_file(&format!("{root}/flow/forward_timestamps.txt"), stamps.as_bytes())?;
        out.write_file(&format!("{root}/test_forward_flow_timestamps.csv"), table.as_bytes())?;
    }
    Ok([steps.len(), beyond])
}

/// The channels of a displacement, px.
fn coded_flow(flow: [f32; 2]) -> [u16; 3] {
    let steps = flow.map(|v| (f64::from(v) * STEPS_PER_PX + ZERO).round());
    // NaN is in no range.
    if !steps.iter().all(|step| (0.0..=f64::from(u16::MAX)).contains(step)) {
        return [0; 3];
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the range is that of u16")]
    let [u, v] = steps.map(|step| step as u16);
    [u, v, 1]
}
