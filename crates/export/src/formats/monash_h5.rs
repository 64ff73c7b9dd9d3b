//! The HDF5 layout of Monash University (Stoffregen et al., ECCV 2020; GitHub TimoStoff/event_cnn_minimal at
//! 78aa471), which E2VID++, FireNet and their relatives read.
//!
//! | path in `events.h5` | content |
//! |---|---|
//! | `events/xs`, `events/ys` | int16 |
//! | `events/ts` | float64, s |
//! | `events/ps` | bool, true for ON |
//! | `images/imageNNNNNNNNN` | uint8 (H, W), with `size`, `timestamp` in s, `type`, `event_idx` |
//! | `flow/flowNNNNNNNNN` | float32 (2, H, W), px/s, with `size`, `timestamp`, `event_idx` |
//! | attributes of the root | `num_events`, `num_pos`, `num_neg`, `duration`, `t0`, `tk`, `num_imgs`, `num_flow`, `sensor_resolution`, `source` |
//!
//! `event_idx` is the number of events before a picture: item i of its loader has the events between two of
//! them, so that an event at the stamp of a picture belongs to the next item. The layout has no mask of the
//! flow, so pixels without a flow are 0.

use super::camera_needs::{products, unmet_events, unmet_frames, unmet_held_out_views, unmet_int16};
use super::marks::{EventMarks, grey_picture};
use crate::hdf5::{GrowingColumn, Hdf5File};
use crate::{ExportError, ExportFolder, ExportFormat, ExportLoss, ExportPlan, UnmetNeed};
use gs2e_image::Size;
use rust_hdf5::types::HBool;
use rust_hdf5::{H5Dataset, Hdf5Error};
use serde_json::{Value, json};

/// The HDF5 layout of Monash University.
pub(super) static FORMAT: ExportFormat =
    ExportFormat::new("monash-h5", "github.com/TimoStoff/event_cnn_minimal at 78aa471", unmet, losses, write)
        .for_any_lens();

/// An item has the events between two frames.
const MIN_FRAMES: usize = 2;

fn unmet(plan: &ExportPlan<'_>) -> Vec<Option<UnmetNeed>> {
    vec![unmet_events(plan), unmet_frames(plan, MIN_FRAMES), unmet_held_out_views(plan), unmet_int16(plan)]
}

fn losses(plan: &ExportPlan<'_>) -> Vec<ExportLoss> {
    let mut losses = vec![
        products(&["blur", "depth", "labels of events"]),
        ExportLoss::lost("sharp", "colours: the pictures are grey"),
        ExportLoss::lost("poses", "poses, camera matrix and thresholds"),
    ];
    if !plan.subject.flow.is_empty() {
        losses.push(ExportLoss::lost("flow", "the mask: pixels without a flow are 0"));
    }
    losses
}

fn write(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<Value, ExportError> {
    let file = Hdf5File::create(&out.file("events.h5")?)?;
    let flows = flow_poses(plan);
    let [mut images, mut marks] = [&plan.frames, &flows].map(|poses| EventMarks::at(plan, poses));
    let counts = write_events(plan, &file, [&mut images, &mut marks], out)?;
    let group = file.add(|file| file.create_group("images"))?;
    for (index, frame) in plan.frames.iter().enumerate() {
        let grey = grey_picture(plan, *frame)?;
        let Size { width, height } = plan.subject.camera.size;
        file.add(|_| {
            let new = group.new_dataset::<u8>().shape([height as usize, width as usize]);
            let image = new.create(&format!("image{index:09}"))?;
            image.write_raw(&grey)?;
            image.new_attr::<u8>().shape(()).create("type")?.write_string("greyscale")?;
            describe(&image, plan.subject.camera.size, &images, index)
        })?;
        out.report()?;
    }
    if !flows.is_empty() {
        write_flows(plan, &file, &flows, &marks, out)?;
    }
    describe_file(plan, &file, counts, flows.len())?;
    file.close()?;
    Ok(json!({ "events": counts[0] + counts[1], "frames": plan.frames.len(), "flows": flows.len() }))
}

/// Poses of the interval with a flow.
fn flow_poses(plan: &ExportPlan<'_>) -> Vec<usize> {
    let [first, last] = plan.window_us();
    let within = |pose: &usize| (first..=last).contains(&plan.subject.poses.stamps_us[*pose]);
    plan.subject.flow.iter().copied().filter(within).collect()
}

/// Writes the events, and returns the numbers of OFF and ON events.
fn write_events(
    plan: &ExportPlan<'_>,
    file: &Hdf5File,
    marks: [&mut EventMarks; 2],
    out: &mut ExportFolder<'_>,
) -> Result<[u64; 2], ExportError> {
    let group = file.add(|file| file.create_group("events"))?;
    let mut x = GrowingColumn::create::<i16>(file, &group, "xs")?;
    let mut y = GrowingColumn::create::<i16>(file, &group, "ys")?;
    let mut t = GrowingColumn::create::<f64>(file, &group, "ts")?;
    let mut p = GrowingColumn::create::<HBool>(file, &group, "ps")?;
    let mut counts = [0; 2];
    let [images, flows] = marks;
    plan.for_each_event(|event, t_us| {
        // Before this event is counted: at equal times it belongs to the next item.
        let before = counts[0] + counts[1];
        images.see(t_us, before);
        flows.see(t_us, before);
        counts[event.polarity as usize] += 1;
        x.push(&event.x.to_le_bytes())?;
        y.push(&event.y.to_le_bytes())?;
        t.push(&(t_us as f64 / 1e6).to_le_bytes())?;
        p.push(&[event.polarity as u8])?;
        out.count_event()
    })?;
    [x, y, t, p].into_iter().try_for_each(GrowingColumn::finish)?;
    images.finish(counts[0] + counts[1]);
    flows.finish(counts[0] + counts[1]);
    Ok(counts)
}

/// Writes the pictures of the flow, by channels.
fn write_flows(
    plan: &ExportPlan<'_>,
    file: &Hdf5File,
    poses: &[usize],
    marks: &EventMarks,
    out: &mut ExportFolder<'_>,
) -> Result<(), ExportError> {
    let group = file.add(|file| file.create_group("flow"))?;
    let Size { width, height } = plan.subject.camera.size;
    for (index, pose) in poses.iter().enumerate() {
        let flow = plan.subject.flow_picture(*pose)?;
        let channel = |k: usize| flow.iter().map(move |v| if v[k].is_nan() { 0.0 } else { v[k] });
        let values: Vec<f32> = channel(0).chain(channel(1)).collect();
        file.add(|_| {
            let new = group.new_dataset::<f32>().shape([2, height as usize, width as usize]);
            let image = new.create(&format!("flow{index:09}"))?;
            image.write_raw(&values)?;
            describe(&image, plan.subject.camera.size, marks, index)
        })?;
        out.report()?;
    }
    Ok(())
}

/// The attributes that pictures of both kinds have.
fn describe(image: &H5Dataset, size: Size, marks: &EventMarks, index: usize) -> Result<(), Hdf5Error> {
    image
        .new_attr::<i64>()
        .shape([2])
        .create("size")?
        .write_array(&[i64::from(size.height), i64::from(size.width)])?;
    let seconds = marks.stamps_us[index] as f64 / 1e6;
    image.new_attr::<f64>().shape(()).create("timestamp")?.write_numeric(&seconds)?;
    image.new_attr::<u64>().shape(()).create("event_idx")?.write_numeric(&marks.before[index])
}

/// The attributes of the root.
fn describe_file(
    plan: &ExportPlan<'_>,
    file: &Hdf5File,
    [off, on]: [u64; 2],
    flows: usize,
) -> Result<(), ExportError> {
    let Size { width, height } = plan.subject.camera.size;
    let seconds = plan.length_us() as f64 / 1e6;
    file.add(|file| {
        for (name, count) in [
            ("num_events", off + on),
            ("num_pos", on),
            ("num_neg", off),
            ("num_imgs", plan.frames.len() as u64),
            ("num_flow", flows as u64),
        ] {
            file.set_attr_numeric(name, &count)?;
        }
        for (name, seconds) in [("t0", 0.0), ("tk", seconds), ("duration", seconds)] {
            file.set_attr_numeric(name, &seconds)?;
        }
        file.set_attr_array_numeric("sensor_resolution", &[i64::from(height), i64::from(width)])?;
        file.set_attr_string("source", "gs2e")
    })
}
