//! ROS 2: a reader of the tests judges a recording by the specifications of MCAP and CDR, and ours reads back
//! every event.

mod convert;
mod foreign;
mod long;
mod recording;
mod written;

use super::plane::{self, FOCAL, POSES, SIZE, THRESHOLD};
use super::steps::{Path, ReadEvent, residual};
use super::{TestExport, export};
use glam::{DQuat, DVec3};
use gs2e_event::file::{EventFormat, ReadHints};
use gs2e_event::{Event, Polarity, file};
use gs2e_image::png;
use recording::{Fields, McapFile, Message};
use std::io::Cursor;
use std::path::PathBuf;

const NS_PER_US: i64 = 1000;
/// Epoch of an export, ns.
const EPOCH_NS: i64 = 1_000_000_000;

/// All events of a file, in its order.
fn all_events(path: &std::path::Path) -> Vec<Event> {
    let format = EventFormat::for_path(path, gs2e_event::evt::EvtVersion::Evt2).unwrap();
    let mut opened = file::open(path, format, ReadHints::default()).unwrap();
    let (mut all, mut chunk) = (Vec::new(), Vec::new());
    while opened.source.next_chunk(&mut chunk).unwrap() {
        all.append(&mut chunk);
    }
    assert_eq!(opened.source.untimed(), 0);
    all
}

/// The path of the recording of an export.
fn recorded(exported: &TestExport) -> PathBuf {
    let names = exported.list(".");
    let name = names.iter().find(|name| name.ends_with(".mcap")).expect("there is a recording");
    exported.path(name)
}

/// The poses of a topic, in microseconds from the start of the interval.
fn poses(messages: &[Message], read: impl Fn(&mut Fields<'_>)) -> Path {
    let mut path = Path { times: Vec::new(), centres: Vec::new(), turns: Vec::new() };
    for message in messages {
        let mut fields = Fields::of(&message.data);
        read(&mut fields);
        let numbers: Vec<f64> = (0..7).map(|_| fields.f64()).collect();
        assert!(fields.is_at_end());
        path.times.push((message.log_time - EPOCH_NS) as f64 / NS_PER_US as f64);
        path.centres.push(DVec3::new(numbers[0], numbers[1], numbers[2]));
        path.turns.push(DQuat::from_xyzw(numbers[3], numbers[4], numbers[5], numbers[6]));
    }
    path
}

#[test]
fn steps_along_its_rays_are_thresholds() {
    let plane = plane::centred();
    let exported = TestExport::of(plane, "mcap", &[]);
    assert_eq!(exported.losses("approximate"), Vec::<String>::new());
    let file = McapFile::read(&recorded(&exported));
    let path = poses(&file.messages("/pose"), |fields| {
        fields.header("world");
    });
    assert_eq!(path.times.len(), POSES);
    let transforms = poses(&file.messages("/tf"), |fields| {
        assert_eq!(fields.u32(), 1);
        fields.header("world");
        assert_eq!(fields.text(), "camera");
    });
    assert_eq!((&transforms.times, &transforms.centres), (&path.times, &path.centres));
    assert_eq!(transforms.turns, path.turns);
    // The poses themselves, as numbers of 64 bits: text of 17 digits loses nothing.
    for (k, (centre, turn)) in path.centres.iter().zip(&path.turns).enumerate() {
        let wanted = plane::pose(plane::stamp_us(k) as f64 * 1e-6);
        // A unit quaternion that is written, read and normalised again loses a few bits.
        assert_eq!(*centre, wanted.translation, "{k}");
        assert!(turn.dot(wanted.rotation).abs() > 1.0 - 1e-15, "{k}");
    }
    let events = all_events(&recorded(&exported));
    assert_eq!(events.len(), plane.events);
    let seen: Vec<ReadEvent> = events
        .iter()
        .map(|event| ReadEvent {
            x: event.x,
            y: event.y,
            t: event.t.floor_micros() as f64,
            sign: if event.polarity == Polarity::On { 1.0 } else { -1.0 },
        })
        .collect();
    let k = camera_matrix(&file.messages("/image/camera_info")[0]);
    // Pixel centres of ROS are at integers.
    let ray = |x: u16, y: u16| DVec3::new((f64::from(x) - k[2]) / k[0], (f64::from(y) - k[5]) / k[4], 1.0);
    let residual = residual(&seen, &path, ray);
    eprintln!("mcap: {residual:.6} thresholds");
    // Times are cut to microseconds, as in the other formats: the pixel moves by 300 px/s at most there.
    assert!(residual < 2e-4, "{residual}");
    let about = file.metadata("gs2e");
    assert_eq!(about["contrast_on"].parse::<f64>().unwrap(), THRESHOLD);
    assert_eq!(about["licence"], exported.json("export.json")["source"]["licence"].as_str().unwrap());
}

/// k of a camera info whose other fields are those of a pinhole camera without distortion.
fn camera_matrix(message: &Message) -> [f64; 9] {
    let mut fields = Fields::of(&message.data);
    fields.header("camera");
    assert_eq!([fields.u32(), fields.u32()], [SIZE.height, SIZE.width]);
    assert_eq!(fields.text(), "plumb_bob");
    assert_eq!(fields.u32(), 5);
    assert_eq!([(); 5].map(|()| fields.f64()), [0.0; 5]);
    let k = [(); 9].map(|()| fields.f64());
    assert_eq!([(); 9].map(|()| fields.f64()), [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    let p = [(); 12].map(|()| fields.f64());
    assert_eq!([&p[0..3], &p[4..7], &p[8..11]].concat(), k);
    assert_eq!([p[3], p[7], p[11]], [0.0; 3]);
    assert_eq!([(); 6].map(|()| fields.u32()), [0; 6]);
    assert_eq!(fields.u8(), 0);
    assert!(fields.is_at_end());
    let [cx, cy] = [SIZE.width, SIZE.height].map(|side| f64::from(side) / 2.0 - 0.5);
    assert_eq!(k, [FOCAL, 0.0, cx, 0.0, FOCAL, cy, 0.0, 0.0, 1.0]);
    k
}

/// Pictures have the pixels of the release, and each has a camera info of its time.
#[test]
fn pictures_are_those_of_the_release() {
    let plane = plane::centred();
    let exported = TestExport::of(plane, "mcap", &[]);
    let file = McapFile::read(&recorded(&exported));
    let images = file.messages("/image/image_raw");
    assert_eq!(images.len(), POSES.div_ceil(plane.sharp_every));
    let infos = file.messages("/image/camera_info");
    assert!(images.iter().map(|m| m.log_time).eq(infos.iter().map(|m| m.log_time)));
    for (number, message) in images.iter().enumerate() {
        let pose = number * plane.sharp_every;
        assert_eq!(message.log_time, EPOCH_NS + plane::stamp_us(pose) * NS_PER_US);
        let bytes = std::fs::read(plane.folder(&format!("sharp/{pose:06}.png"))).unwrap();
        let picture = png::read_sized(Cursor::new(bytes), SIZE).unwrap();
        assert!(image_data(message, "rgb8", 3) == picture.pixels().as_flattened(), "{pose}");
    }
    let depths = file.messages("/depth");
    assert_eq!(depths.len(), 9);
    for (number, message) in depths.iter().enumerate() {
        // NumPy's header has 128 bytes; the numbers follow by rows.
        let bytes = std::fs::read(plane.folder(&format!("depth/{:06}.npy", number * 60))).unwrap();
        assert!(*image_data(message, "32FC1", 4) == bytes[bytes.len() - 346 * 260 * 4..], "{number}");
    }
}

/// The data of a picture of this encoding, with `bytes` per pixel.
fn image_data<'a>(message: &'a Message, encoding: &str, bytes: u32) -> &'a [u8] {
    let mut fields = Fields::of(&message.data);
    assert_eq!(fields.header("camera"), message.log_time);
    assert_eq!([fields.u32(), fields.u32()], [SIZE.height, SIZE.width]);
    assert_eq!(fields.text(), encoding);
    assert_eq!(fields.u8(), 0);
    assert_eq!(fields.u32(), SIZE.width * bytes);
    let data = fields.list();
    assert!(fields.is_at_end());
    data
}

/// Blurred frames stand at the middle of their exposure.
#[test]
fn blurred_frames_stand_at_the_middle_of_their_exposure() {
    let folder = tempfile::tempdir().unwrap();
    let release = crate::release::small::release();
    let output = export(release, &folder.path().join("out"), "mcap", &["--trajectory", "base"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let exported = TestExport { folder };
    let file = McapFile::read(&recorded(&exported));
    let transforms = std::fs::read(release.join("small/one/base/transforms.json")).unwrap();
    let transforms: serde_json::Value = serde_json::from_slice(&transforms).unwrap();
    let frames = transforms["frames"].as_array().unwrap().iter();
    let exposures = frames.filter(|frame| frame["blur_file_path"].is_string()).map(|frame| {
        let us = |key: &str| frame[key].as_i64().unwrap();
        EPOCH_NS + (us("exposure_start_us") + us("exposure_end_us")) * NS_PER_US / 2
    });
    let blurred = file.messages("/image/blurred");
    assert!(!blurred.is_empty());
    assert!(blurred.iter().map(|message| message.log_time).eq(exposures));
    // Sharp and blurred frames of one time share their camera info.
    let mut times: Vec<i64> =
        file.messages("/image/image_raw").iter().chain(&blurred).map(|m| m.log_time).collect();
    times.sort_unstable();
    times.dedup();
    assert!(file.messages("/image/camera_info").iter().map(|m| m.log_time).eq(times));
}

/// Inertial measurements have the times and values of their file.
#[test]
fn inertial_measurements_are_those_of_the_release() {
    let place = crate::support::workspace::Workspace::new();
    let mut recipe = crate::support::steps::recipe("tiny");
    recipe["outputs"] = serde_json::json!(["events", "imu"]);
    recipe["scale"] = serde_json::json!({ "metres_per_unit": 2 });
    place.write("tiny.yaml", recipe.to_string());
    place.ok("release --to out tiny.yaml");
    let folder = tempfile::tempdir().unwrap();
    let options = ["--trajectory", "base"];
    let output = export(&place.path("out"), &folder.path().join("out"), "mcap", &options);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let file = McapFile::read(&recorded(&TestExport { folder }));
    let text = std::fs::read_to_string(place.path("out/tiny/base/imu/imu.csv")).unwrap();
    let lines = text.lines().skip(1);
    let messages = file.messages("/imu/data_raw");
    assert!(messages.len() >= 5);
    assert_eq!(messages.len(), lines.clone().count());
    for (message, line) in messages.iter().zip(lines) {
        let wanted: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
        assert_eq!((message.log_time - EPOCH_NS) as f64, wanted[0]);
        let mut fields = Fields::of(&message.data);
        let stamp = (i64::from(fields.u32()) * 1_000_000_000) + i64::from(fields.u32());
        assert_eq!((stamp, fields.text()), (message.log_time, "camera".to_owned()));
        let numbers: Vec<f64> = (0..37).map(|_| fields.f64()).collect();
        assert!(fields.is_at_end());
        assert_eq!(numbers[4], -1.0);
        assert_eq!(numbers[13..16], wanted[1..4]);
        assert_eq!(numbers[25..28], wanted[4..7]);
    }
}

/// Two exports are equal bytes, and a damaged claim of the command line is refused.
#[test]
fn bytes_are_the_same_and_the_epoch_is_a_choice() {
    let plane = plane::centred();
    let one = TestExport::of(plane, "mcap", &["--window", "0..50000"]);
    let other = TestExport::of(plane, "mcap", &["--window", "0..50000"]);
    let bytes = |exported: &TestExport| std::fs::read(recorded(exported)).unwrap();
    assert!(bytes(&one) == bytes(&other));
    let late = TestExport::of(plane, "mcap", &["--window", "0..50000", "--epoch", "1700000000.5"]);
    let file = McapFile::read(&recorded(&late));
    assert_eq!(file.messages("/pose")[0].log_time, 1_700_000_000_500_000_000);
    assert_eq!(all_events(&recorded(&late)), all_events(&recorded(&one)));
    let folder = tempfile::tempdir().unwrap();
    for (format, epoch, code, words) in [
        ("mcap", "-1", 2, "wanted seconds from 0"),
        ("mcap", "2147483648", 2, "wanted seconds from 0"),
        ("mcap", "2147483647.9", 2, "an earlier --epoch"),
        ("colmap", "1", 2, "no absolute times"),
    ] {
        let epoch = format!("--epoch={epoch}");
        let output =
            export(plane.release(), &folder.path().join("out"), format, &["--trajectory", "base", &epoch]);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{said}");
        assert!(said.contains(words), "{said}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
