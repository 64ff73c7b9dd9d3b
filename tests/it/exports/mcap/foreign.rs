//! Recordings read by the field's own programs, all from PyPI: `mcap` with `mcap-ros2-support`, and
//! `rosbags`. `evt3` decodes the packets. `read_recording.py` compares the events one by one, and reports
//! what both libraries found.
//!
//! If Python lacks one of them, a message goes to stderr; with `REQUIRE_ROS_READERS=1` that is a failure.

use super::recording::{Fields, McapFile, Message, crc};
use super::{NS_PER_US, TestExport, plane, recorded};
use crate::release::small::{gs2e, said};
use crate::support::absent::absent;
use crate::support::foreign::python;
use serde_json::{Value, json};
use std::path::Path;

/// Findings of both libraries in the recording of an export; `None` if they are absent.
fn found(exported: &TestExport, events: &Path) -> Option<Value> {
    let imports = "import numpy, evt3, mcap.reader, mcap_ros2.decoder, rosbags.highlevel";
    if !python(&["-c", imports]).is_some_and(|output| output.status.success()) {
        absent("REQUIRE_ROS_READERS", "python3 with rosbags, mcap, mcap-ros2-support and evt3 is absent");
        return None;
    }
    let folder = tempfile::tempdir().unwrap();
    let output = gs2e(folder.path(), &["convert", events.to_str().unwrap(), "events.npz"]);
    assert!(output.status.success(), "{}", said(&output));
    let program = format!("{}/tests/it/exports/mcap/read_recording.py", env!("CARGO_MANIFEST_DIR"));
    let (recording, reference) = (recorded(exported), folder.path().join("events.npz"));
    let output = python(&[&program, recording.to_str().unwrap(), reference.to_str().unwrap()]).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(serde_json::from_slice(&output.stdout).unwrap())
}

/// The numbers at the end of a message.
fn numbers(message: &Message, before: impl Fn(&mut Fields<'_>)) -> Value {
    let mut fields = Fields::of(&message.data);
    before(&mut fields);
    let numbers = [(); 7].map(|()| fields.f64());
    json!([message.log_time, numbers])
}

/// Time and sum of the pixels of a picture.
fn picture(message: &Message) -> Value {
    let mut fields = Fields::of(&message.data);
    fields.header("camera");
    fields.u32();
    fields.u32();
    fields.text();
    fields.u8();
    fields.u32();
    json!([message.log_time, crc(fields.list())])
}

#[test]
fn foreign_readers_find_the_same() {
    let plane = plane::centred();
    let exported = TestExport::of(plane, "mcap", &[]);
    let Some(found) = found(&exported, &plane.folder("events.h5")) else { return };
    let file = McapFile::read(&recorded(&exported));
    let list = |topic: &str, one: &dyn Fn(&Message) -> Value| {
        file.messages(topic).iter().map(one).collect::<Vec<Value>>()
    };
    let topics = file
        .channels
        .values()
        .map(|channel| (channel.topic.clone(), json!([channel.kind, file.messages(&channel.topic).len()])));
    let wanted = json!({
        "topics": topics.collect::<serde_json::Map<_, _>>(),
        "events": plane.events,
        "images": list("/image/image_raw", &picture),
        "depths": list("/depth", &picture),
        "poses": list("/pose", &|m| numbers(m, |fields| { fields.header("world"); })),
        "transforms": list("/tf", &|m| numbers(m, |fields| {
            assert_eq!(fields.u32(), 1);
            fields.header("world");
            assert_eq!(fields.text(), "camera");
        })),
        "k": [300.0, 0.0, 172.5, 0.0, 300.0, 129.5, 0.0, 0.0, 1.0],
    });
    assert_eq!(found.as_object().unwrap().len(), 3);
    for (reader, found) in found.as_object().unwrap() {
        for (key, wanted) in wanted.as_object().unwrap() {
            assert!(found[key] == *wanted, "{reader}: {key}: {}", found[key]);
        }
    }
    assert_eq!(wanted["poses"][1][0], super::EPOCH_NS + plane::stamp_us(1) * NS_PER_US);
    eprintln!("mcap: {} events equal by {} readers", plane.events, found.as_object().unwrap().len());
}

/// The same for a recording over several overflows of the clock, with silence longer than one.
#[test]
fn foreign_readers_read_long_recordings() {
    let Some(found) = found(super::long::exported(), &super::long::stream()) else { return };
    for (reader, found) in found.as_object().unwrap() {
        assert_eq!(found["events"], super::long::count(), "{reader}");
    }
}
