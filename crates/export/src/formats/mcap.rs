//! ROS 2: one recording in an MCAP file (mcap.dev, profile `ros2`), and the description of a bag by rosbag2.
//!
//! | topic | type | content |
//! |---|---|---|
//! | `/event_camera/events` | `event_camera_msgs/msg/EventPacket` | EVT 3.0, at most 10 ms each |
//! | `/image/image_raw` | `sensor_msgs/msg/Image` | sharp frames, `rgb8` |
//! | `/image/blurred` | `sensor_msgs/msg/Image` | blurred frames, `rgb8`, at the middle of the exposure |
//! | `/image/camera_info` | `sensor_msgs/msg/CameraInfo` | with each of both |
//! | `/depth` | `sensor_msgs/msg/Image` | `32FC1`, units of the poses |
//! | `/imu/data_raw` | `sensor_msgs/msg/Imu` | inertial measurements, in the axes of the camera |
//! | `/pose`, `/tf` | `geometry_msgs/msg/PoseStamped`, `tf2_msgs/msg/TFMessage` | every pose |
//!
//! Traps of its readers: pixel centres of `CameraInfo` are at integers, so half a pixel is subtracted from
//! the principal point. The clock of EVT 3.0 overflows every 16.8 s, and a reader counts what it sees: a
//! packet is written every [`SILENCE_US`] at least, and across each overflow. Tools refuse or hide a stamp of
//! 0: times begin at the epoch, 1 s by default.

mod bag;
mod cdr;
mod container;
mod messages;
mod packets;
mod recording;
mod schemas;
mod timeline;

use super::camera_needs::{products, unmet_events, unmet_held_out_views};
use crate::{ExportError, ExportFolder, ExportFormat, ExportLoss, ExportPlan, UnmetNeed};
use packets::EventPackets;
use recording::Recording;
use serde_json::{Value, json};
use timeline::Timeline;

/// The layout of ROS 2.
pub(super) static FORMAT: ExportFormat =
    ExportFormat::new("mcap", CONSUMER, unmet, losses, write).for_any_lens().with_epoch();

const CONSUMER: &str = "mcap.dev, github.com/ros-event-camera/event_camera_msgs at 65111f9";

/// Columns and rows of EVT 3.0 have 11 bits.
const EDGE: u32 = 1 << 11;

/// Length of a packet, us: a reader shows events after that long at the latest.
const PACKET_US: i64 = 10_000;

/// Longest pause without a packet, us: a quarter of the clock's range, and half of what readers bear.
const SILENCE_US: i64 = 4_000_000;

/// End of the stamps: `builtin_interfaces/msg/Time` has signed seconds of 32 bits.
const END_US: i64 = (1 << 31) * 1_000_000;

/// Times from here on overflow in `event_camera_py`: microseconds in 32 bits.
const INT32_US: i64 = 1 << 31;

fn unmet(plan: &ExportPlan<'_>) -> Vec<Option<UnmetNeed>> {
    let size = plan.subject.camera.size;
    let large = (size.width > EDGE || size.height > EDGE).then(|| {
        let what = format!("pictures of {size}, wanted at most {EDGE} columns and rows: EVT 3.0");
        UnmetNeed::new(what, format!("camera: {{ width: {EDGE} }} or less"))
    });
    let late = (plan.epoch_us.saturating_add(plan.length_us()) >= END_US).then(|| {
        let what = format!("times up to {} us, wanted less than {END_US}", plan.length_us());
        UnmetNeed::new(what, "an earlier --epoch")
    });
    vec![unmet_events(plan), unmet_held_out_views(plan), large, late]
}

fn losses(plan: &ExportPlan<'_>) -> Vec<ExportLoss> {
    let mut losses = vec![products(&["flow", "labels of events"])];
    losses.push(ExportLoss::lost("views", "held-out frames are not marked"));
    if plan.length_us() >= INT32_US {
        let what = "event_camera_py holds microseconds in 32 bits: times overflow after 2147 s";
        losses.push(ExportLoss::lost("times", what));
    }
    losses
}

fn write(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<Value, ExportError> {
    let name = format!("{}.mcap", file_name(plan));
    let inertial = plan.subject.tree.inertial()?;
    let mut timeline = Timeline::new(plan, &inertial);
    let mut recording = Recording::create(out.file(&name)?, plan, inertial, &timeline)?;
    let mut packets = EventPackets::new();
    plan.for_each_event(|event, t_us| {
        out.count_event()?;
        packets.add(event, t_us, |packet| {
            timeline.write_before(packet.t_us, &mut recording, out)?;
            recording.events(&packet)
        })
    })?;
    packets.finish(|packet| {
        timeline.write_before(packet.t_us, &mut recording, out)?;
        recording.events(&packet)
    })?;
    timeline.write_rest(&mut recording, out)?;
    let written = recording.finish()?;
    out.write_file(bag::NAME, bag::describe(&name, &written).as_bytes())?;
    let counts: serde_json::Map<String, Value> =
        written.topics.iter().map(|topic| (topic.name.to_owned(), topic.messages.into())).collect();
    Ok(json!({
        "file": name, "epoch_us": plan.epoch_us, "events": packets.events(), "messages": counts,
        "command": format!("ros2 bag play {name}"),
    }))
}

/// The name of the recording without its ending: letters, digits, `-` and `_` of the names of scene,
/// trajectory and sensor.
fn file_name(plan: &ExportPlan<'_>) -> String {
    let subject = plan.subject;
    let names = [Some(subject.scene.as_str()), Some(&subject.trajectory), subject.sensor_name.as_deref()];
    let joined = names.into_iter().flatten().collect::<Vec<_>>().join("-");
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '_' { c } else { '-' };
    // Names of files have 255 bytes at most, and this one gets an ending.
    joined.chars().take(200).map(plain).collect()
}
