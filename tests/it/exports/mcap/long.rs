//! Long recordings: the clock of EVT 3.0 overflows every 16.777216 s, and silence may be longer than that.

use super::convert::builder::{self, Packet};
use super::recording::{Fields, McapFile, Message};
use super::{EPOCH_NS, NS_PER_US, TestExport, all_events, export, recorded};
use crate::release::forger::edit;
use crate::release::small;
use glam::{DQuat, DVec3};
use gs2e_event::{Event, EventLabel, EventSink as _, Polarity, StreamHeader, h5};
use gs2e_image::Size;
use gs2e_num::se3::Se3;
use gs2e_num::units::Timestamp;
use gs2e_trajectory::Trajectory;
use serde_json::json;
use std::fs;
use std::path::Path;
use std::sync::OnceLock;
use tempfile::TempDir;

/// The largest sensor of EVT 3.0.
const SIDE: u16 = 2048;

/// Starts of bursts of 40 ms, us: on both sides of the first two overflows and across them, then after 20 s
/// and after 25 s of silence.
const BURSTS: [i64; 9] =
    [3, 1_000_000, 8_000_000, 16_760_000, 17_500_000, 33_540_000, 34_200_000, 54_300_000, 79_400_000];

/// Length of the trajectory, us.
const END_US: i64 = 80_000_000;

fn event(t_us: i64, x: u16, y: u16, on: bool) -> Event {
    let polarity = if on { Polarity::On } else { Polarity::Off };
    Event { t: Timestamp::from_micros(t_us), x, y, polarity, label: EventLabel::Signal }
}

/// Events at places without a pattern, runs of neighbours, and the corners of the sensor.
fn events() -> Vec<Event> {
    let last = SIDE - 1;
    let mut all = Vec::new();
    for (burst, start) in (0_u32..).zip(BURSTS) {
        for k in 0..400_u32 {
            let hash = (k + 1000 * burst).wrapping_mul(2_654_435_769) >> 9;
            let place = |bits: u32| (hash >> bits & 2047) as u16;
            all.push(event(start + i64::from(k) * 100, place(0), place(11), hash & 1 == 0));
        }
        all.extend((0..40).map(|x| event(start + 777, 3 * x / 2, 100, true)));
        all.extend((last - 30..=last).map(|x| event(start + 777, x, last, false)));
        for (x, y) in [(0, 0), (last, 0), (0, last), (last, last)] {
            all.extend([event(start + 39_999, x, y, true), event(start + 39_999, x, y, false)]);
        }
    }
    all.sort_by_key(Event::file_order);
    all
}

/// A release with these events and a pose for each second.
fn release() -> &'static Path {
    static RELEASE: OnceLock<TempDir> = OnceLock::new();
    let folder = RELEASE.get_or_init(|| {
        let folder = small::copy();
        let base = folder.path().join("small/one/base");
        edit(folder.path(), "small/one/scene.json", |scene| {
            scene["camera"]["width"] = json!(SIDE);
            scene["camera"]["height"] = json!(SIDE);
        });
        for name in ["sharp", "blur", "depth"] {
            fs::remove_dir_all(base.join(name)).unwrap();
        }
        let stamps_us: Vec<i64> = (0..=END_US / 1_000_000).map(|s| s * 1_000_000).collect();
        let pose =
            |t: &i64| Se3 { rotation: DQuat::IDENTITY, translation: DVec3::new(*t as f64 * 1e-6, 0.0, 0.0) };
        let path = Trajectory { world_from_camera: stamps_us.iter().map(pose).collect(), stamps_us };
        path.write_poses(fs::File::create(base.join("poses.txt")).unwrap()).unwrap();
        let size = Size { width: SIDE.into(), height: SIDE.into() };
        let header = StreamHeader { size, law: None, labelled: false };
        let mut writer = h5::Writer::create(&base.join("events.h5"), &header).unwrap();
        writer.append(&events()).unwrap();
        writer.finish(END_US).unwrap();
        folder
    });
    folder.path()
}

/// Its events.
pub(super) fn stream() -> std::path::PathBuf {
    release().join("small/one/base/events.h5")
}

/// Their number.
pub(super) fn count() -> usize {
    events().len()
}

pub(super) fn exported() -> &'static TestExport {
    static EXPORTED: OnceLock<TestExport> = OnceLock::new();
    EXPORTED.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let output = export(release(), &folder.path().join("out"), "mcap", &["--trajectory", "base"]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        TestExport { folder }
    })
}

/// Time and words of a packet.
fn packet(message: &Message) -> (i64, Vec<u16>) {
    let mut fields = Fields::of(&message.data);
    assert_eq!(fields.header("camera"), message.log_time);
    assert_eq!([fields.u32(), fields.u32()], [u32::from(SIDE); 2]);
    assert_eq!([fields.u64(), fields.u64()], [message.sequence.into(), 0]);
    assert_eq!((fields.text().as_str(), fields.u8()), ("evt3", 0));
    let words = fields.list().as_chunks().0.iter().map(|word| u16::from_le_bytes(*word)).collect();
    assert!(fields.is_at_end());
    ((message.log_time - EPOCH_NS) / NS_PER_US, words)
}

#[test]
fn every_event_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let output = small::gs2e(folder.path(), &["convert", recorded(exported()).to_str().unwrap(), "back.h5"]);
    assert!(output.status.success(), "{}", small::said(&output));
    let found = all_events(&folder.path().join("back.h5"));
    assert_eq!(found.len(), events().len());
    for (found, wanted) in found.iter().zip(&events()) {
        assert_eq!(found, wanted);
    }
}

/// A packet states its own time and row, is short, and none is missing for long.
#[test]
fn packets_are_short_and_pauses_are_bridged() {
    let messages = McapFile::read(&recorded(exported())).messages("/event_camera/events");
    let (mut last, mut silent, mut across) = (0, 0, 0);
    for message in &messages {
        let (t_us, words) = packet(message);
        // 4 s after the last event of a packet of 10 ms.
        assert!((0..=4_010_000).contains(&(t_us - last)), "{last} to {t_us}");
        last = t_us;
        // The clock: 12 bits of 4,096 us each, then 12 bits of 1 us.
        let [high, low] = [words[0], words[1]];
        assert_eq!([high >> 12, low >> 12], [8, 6], "{t_us}");
        let clock = i64::from(high & 0xfff) << 12 | i64::from(low & 0xfff);
        assert_eq!(clock, t_us % (1 << 24));
        silent += usize::from(words.len() == 2);
        across += usize::from(words == [0x8fff, 0x6fff, 0x8000, 0x6000]);
        assert!(words.get(2).is_none_or(|word| word >> 12 == 0 || *word == 0x8000), "{t_us}");
        // Times in a packet ascend, so the last ones are its end.
        let part = |kind: u16| words.iter().rev().find(|word| **word >> 12 == kind).unwrap() & 0xfff;
        let end = i64::from(part(8)) << 12 | i64::from(part(6));
        assert!((end - clock).rem_euclid(1 << 24) < 10_000, "{t_us}");
    }
    // Pauses of 7 s, 8.7 s, 16 s, 20 s and 25 s: one for each 4 s, which count from the overflow on in the
    // last two.
    assert_eq!((silent, across), (1 + 2 + 4 + 4 + 6, 2));
}

/// The messages of events, as a recording of their own.
fn without(messages: &[Message], is_lost: impl Fn(i64) -> bool) -> Vec<u8> {
    let kept = messages.iter().filter(|message| !is_lost((message.log_time - EPOCH_NS) / NS_PER_US));
    let packets: Vec<Packet> = kept
        .map(|message| {
            let words: Vec<u8> = packet(message).1.iter().flat_map(|word| word.to_le_bytes()).collect();
            let [sec, nanosec] = [message.log_time / 1_000_000_000, message.log_time % 1_000_000_000];
            Packet {
                stamp: (sec as i32, nanosec as u32),
                size: [SIDE.into(); 2],
                seq: message.sequence.into(),
                events: words,
                ..Packet::default()
            }
        })
        .collect();
    builder::recording(&packets)
}

/// The times of the headers show the overflows that lost packets hide.
#[test]
fn lost_packets_lose_no_overflow() {
    let messages = McapFile::read(&recorded(exported())).messages("/event_camera/events");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lossy.mcap");
    let is_lost =
        |t_us: i64| (500_000..34_000_000).contains(&t_us) || (34_300_000..79_000_000).contains(&t_us);
    fs::write(&path, without(&messages, is_lost)).unwrap();
    let kept: Vec<Event> = events().into_iter().filter(|e| !is_lost(e.t.floor_micros())).collect();
    assert_eq!(kept.len(), events().len() / 3);
    assert!(all_events(&path) == kept);
}

/// A recording that begins late has times from the last overflow before it on: EVT 3.0 states no more.
#[test]
fn a_late_start_counts_from_its_own_overflow() {
    let messages = McapFile::read(&recorded(exported())).messages("/event_camera/events");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("late.mcap");
    fs::write(&path, without(&messages, |t_us| t_us < 34_000_000)).unwrap();
    let late = events().into_iter().filter(|e| e.t.floor_micros() >= 34_000_000);
    let shifted: Vec<Event> = late.map(|e| Event { t: Timestamp(e.t.0 - (2 << 24) * 1000), ..e }).collect();
    assert!(all_events(&path) == shifted);
}
