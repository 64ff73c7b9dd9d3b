//! The recording: which message goes to which topic.

use super::container::McapWriter;
use super::messages;
use super::packets::EventPacket;
use super::schemas::{ENCODING, MessageType};
use super::timeline::{DueKind, DueMessage, Timeline};
use crate::{ExportError, ExportPlan};
use glam::DVec3;
use gs2e_tree::PictureKind;
use serde_json::Value;
use std::collections::BTreeMap;
use std::io;
use std::path::PathBuf;

const EVENTS: &str = "/event_camera/events";
const SHARP: &str = "/image/image_raw";
const BLURRED: &str = "/image/blurred";
const CAMERA_INFO: &str = "/image/camera_info";
const DEPTH: &str = "/depth";
const INERTIAL: &str = "/imu/data_raw";
const POSE: &str = "/pose";
const TRANSFORMS: &str = "/tf";

/// The recording of a plan.
#[derive(Debug)]
pub(super) struct Recording<'a> {
    plan: &'a ExportPlan<'a>,
    inertial: Vec<(i64, [DVec3; 2])>,
    path: PathBuf,
    file: McapWriter,
    /// Number of each topic.
    channels: BTreeMap<&'static str, u16>,
    packets: u64,
    /// Time of the last camera info, which frames of one time share.
    last_info_ns: Option<i64>,
}

/// The topics and the span of a written recording.
#[derive(Debug)]
pub(super) struct WrittenRecording {
    pub(super) topics: Vec<WrittenTopic>,
    /// First and last time, ns.
    pub(super) span_ns: [u64; 2],
}

/// A topic that was written.
#[derive(Debug)]
pub(super) struct WrittenTopic {
    pub(super) name: &'static str,
    pub(super) kind: &'static str,
    pub(super) messages: u64,
}

impl<'a> Recording<'a> {
    /// Creates the file, with the topics of the messages that are due.
    pub(super) fn create(
        path: PathBuf,
        plan: &'a ExportPlan<'a>,
        inertial: Vec<(i64, [DVec3; 2])>,
        timeline: &Timeline,
    ) -> Result<Self, ExportError> {
        let library = concat!("gs2e ", env!("CARGO_PKG_VERSION"));
        let file = McapWriter::create(&path, "ros2", library).map_err(ExportError::unwritten(&path))?;
        let channels = BTreeMap::new();
        let mut recording = Self { plan, inertial, path, file, channels, packets: 0, last_info_ns: None };
        let about = about(plan)?;
        let added = recording.file.add_metadata("gs2e", &about);
        recording.written(added)?;
        let [sharp, blurred, depth, inertial] =
            [DueKind::Sharp, DueKind::Blurred, DueKind::Depth, DueKind::Inertial]
                .map(|kind| timeline.has(kind));
        for (topic, kind, is_used) in [
            (EVENTS, MessageType::EventPacket, true),
            (SHARP, MessageType::Image, sharp),
            (BLURRED, MessageType::Image, blurred),
            (CAMERA_INFO, MessageType::CameraInfo, sharp || blurred),
            (DEPTH, MessageType::Image, depth),
            (INERTIAL, MessageType::Imu, inertial),
            (POSE, MessageType::PoseStamped, true),
            (TRANSFORMS, MessageType::Transforms, true),
        ] {
            if is_used {
                let channel = recording.file.add_channel(topic, kind.name(), ENCODING, || kind.definition());
                recording.channels.insert(topic, channel);
            }
        }
        Ok(recording)
    }

    /// Writes a packet of events.
    pub(super) fn events(&mut self, packet: &EventPacket) -> Result<(), ExportError> {
        let t_ns = self.stamp_ns(packet.t_us * 1000);
        let message = messages::event_packet(t_ns, self.plan.subject.camera.size, self.packets, packet);
        self.packets += 1;
        self.send(EVENTS, t_ns, &message)
    }

    /// Writes a message that is due.
    pub(super) fn due(&mut self, message: DueMessage) -> Result<(), ExportError> {
        let subject = self.plan.subject;
        let (t_ns, pose) = (self.stamp_ns(message.t_ns), message.number);
        match message.kind {
            DueKind::Pose => {
                let world_from_camera = &subject.poses.world_from_camera[pose];
                self.send(POSE, t_ns, &messages::pose(t_ns, world_from_camera))?;
                self.send(TRANSFORMS, t_ns, &messages::transform(t_ns, world_from_camera))
            }
            DueKind::Inertial => {
                let measured = messages::imu(t_ns, &self.inertial[message.number].1);
                self.send(INERTIAL, t_ns, &measured)
            }
            DueKind::Sharp => {
                self.camera_info(t_ns)?;
                self.send(SHARP, t_ns, &messages::colour(t_ns, &subject.sharp_picture(pose)?))
            }
            DueKind::Blurred => {
                self.camera_info(t_ns)?;
                let picture = subject.tree.colours(PictureKind::Blur, pose)?;
                self.send(BLURRED, t_ns, &messages::colour(t_ns, &picture))
            }
            DueKind::Depth => self.send(DEPTH, t_ns, &messages::depth(t_ns, &subject.depth_picture(pose)?)),
        }
    }

    fn camera_info(&mut self, t_ns: i64) -> Result<(), ExportError> {
        if self.last_info_ns.replace(t_ns) == Some(t_ns) {
            return Ok(());
        }
        self.send(CAMERA_INFO, t_ns, &messages::camera_info(t_ns, &self.plan.subject.camera))
    }

    /// A time from the start of the interval as a stamp.
    fn stamp_ns(&self, t_ns: i64) -> i64 {
        self.plan.epoch_us * 1000 + t_ns
    }

    fn send(&mut self, topic: &str, t_ns: i64, message: &[u8]) -> Result<(), ExportError> {
        let channel = self.channels[topic];
        let t_ns = u64::try_from(t_ns).expect("times begin at the epoch, which is not negative");
        let sent = self.file.write_message(channel, t_ns, message);
        self.written(sent)
    }

    fn written(&self, result: io::Result<()>) -> Result<(), ExportError> {
        result.map_err(ExportError::unwritten(&self.path))
    }

    /// Completes the file.
    pub(super) fn finish(self) -> Result<WrittenRecording, ExportError> {
        let topics = self.file.counts().into_iter();
        let topics = topics.map(|c| WrittenTopic { name: c.topic, kind: c.kind, messages: c.messages });
        let written = WrittenRecording { topics: topics.collect(), span_ns: self.file.span() };
        self.file.finish().map_err(ExportError::unwritten(&self.path))?;
        Ok(written)
    }
}

/// The origin of the recording and its terms, since the file is passed on without its folder.
fn about(plan: &ExportPlan<'_>) -> Result<Vec<(&'static str, String)>, ExportError> {
    let subject = plan.subject;
    let (on, off) = plan.sensor()?.as_model().contrast();
    let [start, end] = plan.window_us();
    let shown = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    let release = ["release", "version", "licence", "scene_licence"].map(|key| {
        let value = &subject.release[key];
        (key, if value.is_null() { String::new() } else { shown(value) })
    });
    let own = [
        ("scene", subject.scene.clone()),
        ("trajectory", subject.trajectory.clone()),
        ("window_us", format!("{start}..{end}")),
        ("epoch_us", plan.epoch_us.to_string()),
        ("contrast_on", on.to_string()),
        ("contrast_off", off.to_string()),
    ];
    Ok(release.into_iter().chain(own).filter(|(_, value)| !value.is_empty()).collect())
}
