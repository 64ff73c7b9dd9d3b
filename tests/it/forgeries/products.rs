//! Forgeries of products that follow from the recipe, the poses and the depth. Each is found under the name
//! of its file.

use super::rich::{FileForgery, change, found_in_rounds, judged, released};
use gs2e_event::h5::{Reader, Writer};
use gs2e_event::{EventLabel, EventSink as _, EventSource as _, StreamHeader};
use gs2e_image::npy;
use std::fs;
use std::io::Cursor;
use std::path::Path;

const IMU: &str = "rich/rig/base/imu/imu.csv";
const STATE: &str = "rich/rig/base/imu/state.csv";
const SENSOR: &str = "rich/rig/base/imu/sensor.yaml";
const PLACES: &str = "rich/rig/base/left/segmentation/objects.csv";
const STATED: &str = "rich/single/alone/segmentation/objects.csv";
const OTHER_IMU: &str = "rich/single/alone/imu/imu.csv";
const OTHER_SENSOR: &str = "rich/single/alone/imu/sensor.yaml";
/// Pose 2 has depth, and pose 1 does not.
const DISPARITY: &str = "rich/rig/base/left/disparity/000002.npy";
const ALONE: &str = "rich/rig/base/left/disparity/000001.npy";
const LABELLED: &str = "rich/rig/base/left/events.h5";
const PLAIN: &str = "rich/single/alone/events.h5";
const SEGMENTATION: &str = "rich/rig/base/left/segmentation";

/// Changes columns of a table, from `first` on, in every line but the head.
fn columns(
    file: &'static str,
    columns: std::ops::Range<usize>,
    forge: impl Fn(f64) -> f64 + 'static,
) -> FileForgery {
    change(file, "not-composed", move |bytes| {
        let text = String::from_utf8(bytes).unwrap();
        let mut lines = text.lines();
        let mut out = format!("{}\n", lines.next().unwrap());
        for line in lines {
            let field = |(k, field): (usize, &str)| match columns.contains(&k) {
                true => forge(field.parse().unwrap()).to_string(),
                false => field.to_owned(),
            };
            out += &line.split(',').enumerate().map(field).collect::<Vec<_>>().join(",");
            out.push('\n');
        }
        out.into_bytes()
    })
}

fn text(file: &'static str, from: &'static str, to: &'static str) -> FileForgery {
    change(file, "not-composed", move |bytes| {
        let text = String::from_utf8(bytes).unwrap();
        assert!(text.contains(from), "{text}");
        text.replacen(from, to, 1).into_bytes()
    })
}

fn picture(file: &'static str, forge: impl Fn(f32) -> f32 + 'static) -> FileForgery {
    change(file, "not-composed", move |bytes| {
        let mut values = npy::read_values(&[24, 32], &mut Cursor::new(bytes)).unwrap();
        values.iter_mut().for_each(|v| *v = forge(*v));
        let mut out = Vec::new();
        npy::write_values(&[24, 32], &values, &mut out).unwrap();
        out
    })
}

#[test]
fn inertial_data_and_their_sensor_follow_from_the_poses() {
    let half_of = |bytes: Vec<u8>| {
        let text = String::from_utf8(bytes).unwrap();
        let lines: Vec<&str> = text.split_inclusive('\n').collect();
        lines[..lines.len() / 2].concat().into_bytes()
    };
    found_in_rounds(vec![
        vec![
            // Degrees per second.
            columns(IMU, 1..4, f64::to_degrees),
            text(SENSOR, "[1.0, 0.0, 0.0, 0.0", "[-1.0, 0.0, 0.0, 0.0"),
            columns(OTHER_IMU, 6..7, |v| -v),
        ],
        // Every sample is saturated in one axis, and 0 in the others.
        vec![columns(IMU, 1..2, |_| 34.9), text(SENSOR, "rate_hz: 1000", "rate_hz: 200")],
        vec![columns(IMU, 1..2, |_| 1e6), text(SENSOR, "metres_per_unit: 0.5", "metres_per_unit: 1")],
        // In g.
        vec![columns(IMU, 4..7, |v| v / 9.80665), text(SENSOR, "9.80665", "1.62")],
        vec![columns(STATE, 8..11, |v| v + 3.0), text(SENSOR, "9.80665", "-9.80665")],
        vec![
            change(STATE, "not-composed", half_of),
            change(SENSOR, "not-composed", |mut bytes| {
                bytes.extend(b"extra: !!python/object/apply:os.system [id]\n".repeat(10_000));
                bytes
            }),
            text(OTHER_SENSOR, "accelerometer_noise_density: ", "accelerometer_noise_density: 1"),
        ],
        vec![change(OTHER_SENSOR, "not-composed", |bytes| {
            let text = String::from_utf8(bytes).unwrap();
            let line = text.lines().find(|line| line.starts_with("gravity")).unwrap();
            text.replace(line, "gravity: [0, 0, 1.62]            # m/s^2, in R").into_bytes()
        })],
    ]);
}

#[test]
fn places_of_objects_follow_from_their_paths() {
    let first_half = |bytes: Vec<u8>| {
        let text = String::from_utf8(bytes).unwrap();
        let lines: Vec<&str> = text.split_inclusive('\n').collect();
        lines[..lines.len() / 2].concat().into_bytes()
    };
    found_in_rounds(vec![
        // Velocities of an object without a stated pivot, and of one with it.
        vec![columns(PLACES, 10..13, |v| -v), columns(STATED, 10..13, |v| -v)],
        vec![columns(PLACES, 3..6, |v| 2.0 * v), columns(STATED, 3..6, |v| v + 1e-12)],
        vec![change(PLACES, "not-composed", first_half), change(STATED, "not-composed", first_half)],
        vec![columns(PLACES, 13..16, |v| v * 1.001), columns(STATED, 0..1, |v| v + 1.0)],
        vec![text(PLACES, "orange", "lemon"), text(STATED, ",1,orange", ",2,orange")],
    ]);
}

#[test]
fn disparity_follows_from_the_depth_and_has_its_sign() {
    found_in_rounds(vec![
        vec![picture(DISPARITY, |v| 1.01 * v), picture(ALONE, |v| -v)],
        vec![picture(DISPARITY, |v| -v), picture(ALONE, |_| 0.0)],
        vec![change(DISPARITY, "not-composed", |_| {
            fs::read(released().path("tree").join(DISPARITY.replace("000002", "000004"))).unwrap()
        })],
    ]);
}

/// Writes a stream again, with other labels.
fn relabel(path: &Path, labelled: bool, label: impl Fn(EventLabel) -> EventLabel) {
    let mut reader = Reader::open(path).unwrap();
    let (header, mut events, mut chunk) = (reader.header().unwrap(), Vec::new(), Vec::new());
    while reader.next_chunk(&mut chunk).unwrap() {
        events.extend_from_slice(&chunk);
    }
    events.iter_mut().for_each(|event| event.label = label(event.label));
    let mut writer = Writer::create(path, &StreamHeader { labelled, ..header }).unwrap();
    writer.append(&events).unwrap();
    let stamps = fs::read_to_string(path.with_file_name("timestamps_us.txt")).unwrap();
    writer.finish(stamps.lines().next_back().unwrap().parse().unwrap()).unwrap();
}

fn stream(file: &'static str, code: &'static str, forge: impl Fn(&Path) + 'static) -> FileForgery {
    FileForgery { file, code, forge: Box::new(forge) }
}

#[test]
fn labels_are_those_that_the_sensor_can_make() {
    found_in_rounds(vec![
        vec![
            // The sensor has no noise, so that all of its events are signal.
            stream(LABELLED, "claims-disagree", |path| relabel(path, true, |_| EventLabel::Noise)),
            stream(PLAIN, "claims-disagree", |path| relabel(path, true, |label| label)),
        ],
        vec![stream(LABELLED, "claims-disagree", |path| relabel(path, false, |label| label))],
    ]);
}

#[test]
fn files_of_events_have_the_objects_of_the_format_alone() {
    let add = |path: &Path, add: fn(&rust_hdf5::H5File)| {
        let file = rust_hdf5::H5File::open_rw(path).unwrap();
        add(&file);
        file.close().unwrap();
    };
    found_in_rounds(vec![
        vec![
            stream(LABELLED, "unreadable", move |path| {
                add(path, |file| file.set_attr_string("note", "import os").unwrap());
            }),
            stream(PLAIN, "unreadable", move |path| {
                add(path, |file| {
                    let new = file.new_dataset::<u8>().shape([4]).create("payload").unwrap();
                    new.write_raw(&[1_u8; 4]).unwrap();
                });
            }),
        ],
        vec![stream(PLAIN, "unreadable", move |path| {
            add(path, |file| drop(file.create_group("events/more").unwrap()));
        })],
    ]);
}

/// Changes that a tree does not show. `docs/publish.md` lists each.
#[test]
fn what_a_tree_does_not_show_is_on_the_page() {
    let swapped = |tree: &Path| {
        let [a, b] = ["000000.png", "000001.png"].map(|name| tree.join(SEGMENTATION).join(name));
        let (first, second) = (fs::read(&a).unwrap(), fs::read(&b).unwrap());
        assert!(first != second);
        fs::write(a, second).unwrap();
        fs::write(b, first).unwrap();
    };
    let found = judged(|tree| {
        swapped(tree);
        (picture(ALONE, |v| 1.01 * v).forge)(&tree.join(ALONE));
    });
    assert_eq!(found.into_iter().collect::<Vec<_>>(), [""; 0]);
    let page = include_str!("../../../docs/publish.md");
    let (_, unproved) = page.split_once("## Not proved").unwrap();
    for row in
        ["`segmentation/*.png`", "`disparity/*.npy`", "`imu/sensor.yaml`", "`segmentation/objects.csv`"]
    {
        assert!(unproved.contains(&format!("| {row} |")), "{row}");
    }
}
