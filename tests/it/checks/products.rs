//! Faults in products that frames do not show: disparity, masks and places of objects, inertial data, labels, and the
//! stream of a sensor with hot pixels. Each is found by a check that measures.

use super::planted_tree::{PlantedRelease, PlantedTree};
use gs2e::event::{Event, EventLabel};
use gs2e::units::Timestamp;
use std::fs;
use std::sync::OnceLock;

/// Folder of the first camera.
const LEFT: &str = "planted/products/base/left";
const SIZE: [u16; 2] = [120, 90];

/// A stereo pair that passes a moving orange; its sensor has hot pixels, and labels its events.
const RECIPE: &str = "\
version: 1
scene: planted/products
seed: 3
source:
  procedural: { kind: still-life, gaussians: 6000, views: 8, arc: 6, seed: 1 }
camera: { width: 120, height: 90 }
trajectories:
  - name: base
    refine: { window: 1, factor: 5 }
sampling: { rate: 1200 }
sensor:
  voltmeter:
    preset: dvs346
    threshold: { on: 0.5, off: 0.5 }
    hot_pixels: { share: 0.004, rate: 2000 }
    labels: true
rig:
  cameras:
    - { name: left }
    - { name: right, extrinsic: { position: [0.1, 0.01, 0], rotation: [0, 0.02, 0, 0.9998] }, outputs: [sharp] }
  stereo: [[left, right]]
objects:
  - name: orange
    select: { sphere: { centre: [0.32, -0.66, -0.04], radius: 0.24 } }
    path: { straight: { velocity: [6, -4, 0], spin: [0, 0, 500] } }
  - name: board
    select: { box: { low: [-2, 0.5, -2], high: [2, 0.9, 2] } }
    path: { orbit: { centre: [0, 0, 0], axis: [0, 1, 0], degrees_per_second: 90 } }
outputs: [events, sharp, depth, flow, disparity, segmentation, imu]
scale: { metres_per_unit: 0.5 }
imu: { up: [0, -1, 0] }
";

fn planted() -> PlantedTree {
    static RELEASE: PlantedRelease = OnceLock::new();
    PlantedTree::of(&RELEASE, RECIPE, LEFT)
}

/// The unsound findings after `plant`.
fn faults(plant: impl FnOnce(&PlantedTree)) -> Vec<String> {
    let tree = planted();
    plant(&tree);
    tree.faults().1
}

fn finds(name: &str, wanted: &[&str], plant: impl FnOnce(&PlantedTree)) {
    let faults = faults(plant);
    for check in wanted {
        assert!(faults.iter().any(|fault| fault.starts_with(check)), "{name}: {check} not in {faults:#?}");
    }
}

fn edit(tree: &PlantedTree, path: &str, change: impl FnOnce(&mut Vec<u8>)) {
    let mut bytes = fs::read(tree.path().join(path)).unwrap();
    change(&mut bytes);
    tree.write(path, &bytes);
}

/// Changes the numbers of an array with this many per pixel.
fn numbers(tree: &PlantedTree, picture: &str, per_pixel: usize, change: impl Fn(usize, f32) -> f32) {
    edit(tree, &format!("{LEFT}/{picture}.npy"), |bytes| {
        let head = bytes.len() - 4 * per_pixel * usize::from(SIZE[0]) * usize::from(SIZE[1]);
        for (i, number) in bytes[head..].as_chunks_mut().0.iter_mut().enumerate() {
            *number = change(i, f32::from_le_bytes(*number)).to_le_bytes();
        }
    });
}

fn disparities(tree: &PlantedTree, change: impl Fn(f32) -> f32) {
    for pose in 0..tree.stamps().len() {
        numbers(tree, &format!("disparity/{pose:06}"), 1, |_, value| change(value));
    }
}

/// Changes the columns of each line but the first.
fn lines(tree: &PlantedTree, path: &str, change: impl Fn(usize, &mut Vec<String>)) {
    edit(tree, path, |bytes| {
        let text = String::from_utf8(bytes.clone()).unwrap();
        let mut lines = text.lines();
        let mut out = format!("{}\n", lines.next().unwrap());
        for (i, line) in lines.enumerate() {
            let mut columns: Vec<String> = line.split(',').map(str::to_owned).collect();
            change(i, &mut columns);
            if !columns.is_empty() {
                out += &format!("{}\n", columns.join(","));
            }
        }
        *bytes = out.into_bytes();
    });
}

fn scaled(columns: &mut [String], factor: f64) {
    for column in columns {
        *column = (factor * column.parse::<f64>().unwrap()).to_string();
    }
}

fn swap(tree: &PlantedTree, kind: &str, [a, b]: [&str; 2]) {
    let name = |pose: &str| format!("{LEFT}/{kind}/{pose}");
    let [first, second] = [a, b].map(|pose| fs::read(tree.path().join(name(pose))).unwrap());
    tree.write(&name(a), &second);
    tree.write(&name(b), &first);
}

#[test]
fn an_untouched_tree_is_sound_and_nothing_is_left_out() {
    let (code, found) = planted().findings();
    let unsound: Vec<_> = found.iter().filter(|(verdict, _)| ["fail", "warn"].contains(&verdict.as_str())).collect();
    assert!(code == Some(0) && unsound.is_empty(), "{unsound:#?}");
    for check in [
        "depth_consistency#disparity",
        "flow_projection#:",
        "flow_projection#objects",
        "records#objects",
        "records#imu",
        "noise_floor#labels",
        "event_frame#residual",
        "completeness#time",
        "event_times#offset",
    ] {
        let passes = found.iter().any(|(verdict, text)| verdict == "pass" && text.starts_with(check));
        assert!(passes, "{check}: {found:#?}");
    }
}

#[test]
fn other_disparities_are_found() {
    let wanted = &["depth_consistency#disparity"];
    finds("1.001 times", wanted, |tree| disparities(tree, |v| 1.001 * v));
    finds("another sign", wanted, |tree| disparities(tree, |v| -v));
    finds("all zero", wanted, |tree| disparities(tree, |_| 0.0));
    finds("one without values", wanted, |tree| numbers(tree, "disparity/000004", 1, |_, _| f32::NAN));
    finds("of another pose", wanted, |tree| swap(tree, "disparity", ["000003.npy", "000020.npy"]));
    // Rounding, a hundred times as large as that of the files, is no fault.
    let spared = faults(|tree| disparities(tree, |v| v * (1.0 + 6e-6)));
    assert!(!spared.iter().any(|fault| fault.starts_with("depth_consistency")), "{spared:#?}");
}

#[test]
fn other_places_of_objects_are_found() {
    let path = &format!("{LEFT}/segmentation/objects.csv");
    let wanted = &["records#objects"];
    finds("another sign of velocities", wanted, |tree| lines(tree, path, |_, c| scaled(&mut c[10..13], -1.0)));
    finds("places twice as far", wanted, |tree| lines(tree, path, |_, c| scaled(&mut c[3..6], 2.0)));
    finds("turns in degrees", wanted, |tree| lines(tree, path, |_, c| scaled(&mut c[13..16], 57.3)));
    finds("half of the lines", wanted, |tree| {
        lines(tree, path, |i, c| if i % 4 > 1 { c.clear() });
    });
    finds("numbers exchanged", wanted, |tree| {
        lines(tree, path, |_, c| c[1] = if c[1] == "1" { "2".into() } else { "1".into() });
    });
}

#[test]
fn other_masks_flow_and_depth_of_objects_are_found() {
    let wanted = &["flow_projection#objects"];
    let mask = |tree: &PlantedTree, pose: usize, change: &dyn Fn(u8) -> u8| {
        edit(tree, &format!("{LEFT}/segmentation/{pose:06}.png"), |bytes| {
            let read = gs2e::image::png::read_rgb(std::io::Cursor::new(bytes.clone())).unwrap();
            let numbers = read.pixels().iter().map(|[number, ..]| change(*number)).collect();
            let changed = gs2e::image::Image::from_vec(read.size(), numbers);
            bytes.clear();
            gs2e::image::png::write_image(&changed, bytes).unwrap();
        });
    };
    let numbers_at = |tree: &PlantedTree, pose: usize| -> Vec<u8> {
        let bytes = fs::read(tree.path().join(format!("{LEFT}/segmentation/{pose:06}.png"))).unwrap();
        let read = gs2e::image::png::read_rgb(std::io::Cursor::new(bytes)).unwrap();
        read.pixels().iter().map(|[number, ..]| *number).collect()
    };
    finds("no object", wanted, |tree| mask(tree, 5, &|_| 0));
    finds("one object", wanted, |tree| mask(tree, 5, &|_| 1));
    finds("numbers exchanged", wanted, |tree| mask(tree, 5, &|n| [0, 2, 1][usize::from(n)]));
    finds("an object that is not there", wanted, |tree| mask(tree, 5, &|n| if n > 0 { 9 } else { 0 }));
    finds("of another pose", wanted, |tree| swap(tree, "segmentation", ["000005.png", "000006.png"]));
    finds("depth twice as far", wanted, |tree| {
        let shown = numbers_at(tree, 5);
        numbers(tree, "depth/000005", 1, |i, z| if shown[i] > 0 { 2.0 * z } else { z });
    });
    finds("another sign of the flow", wanted, |tree| {
        let shown = numbers_at(tree, 5);
        numbers(tree, "flow/000005", 2, |i, v| if shown[i / 2] == 1 { -v } else { v });
    });
}

#[test]
fn other_inertial_data_are_found() {
    let path = "planted/products/base/imu/";
    let wanted = &["records#imu"];
    let samples = |change: &'static dyn Fn(&mut [String])| {
        move |tree: &PlantedTree| lines(tree, &format!("{path}imu.csv"), |_, columns| change(columns))
    };
    let to = |columns: &mut [String], values: [f64; 3]| {
        columns.iter_mut().zip(values).for_each(|(column, value)| *column = value.to_string());
    };
    finds("degrees", wanted, samples(&|c| scaled(&mut c[1..4], 57.295_78)));
    finds("saturated", wanted, |tree| {
        lines(tree, &format!("{path}imu.csv"), |_, c| to(&mut c[1..4], [2000_f64.to_radians(), 0.0, 0.0]));
    });
    finds("beyond", wanted, |tree| {
        lines(tree, &format!("{path}imu.csv"), |_, c| to(&mut c[4..7], [1e6, 0.0, 0.0]));
    });
    for (from, with) in [
        ("data: [1.0", "data: [-1.0"),
        ("rate_hz: 1000", "rate_hz: 200"),
        ("metres_per_unit: 0.5", "metres_per_unit: 1"),
        ("gyroscope_noise_density: 0.0002", "gyroscope_noise_density: 0.02"),
    ] {
        finds(with, wanted, |tree| {
            edit(tree, &format!("{path}sensor.yaml"), |bytes| {
                let text = String::from_utf8(bytes.clone()).unwrap();
                assert!(text.contains(from), "{text}");
                *bytes = text.replacen(from, with, 1).into_bytes();
            });
        });
    }
}

#[test]
fn other_labels_are_found() {
    let wanted = &["noise_floor#labels"];
    let label = |change: fn(EventLabel) -> EventLabel| {
        move |tree: &PlantedTree| tree.events(|events| events.iter_mut().for_each(|e| e.label = change(e.label)))
    };
    finds("all signal", wanted, label(|_| EventLabel::Signal));
    finds("inverted", wanted, label(|label| match label {
        EventLabel::Noise => EventLabel::Signal,
        EventLabel::Signal => EventLabel::Noise,
    }));
}

#[test]
fn faults_in_a_stream_with_hot_pixels_are_found() {
    let plant = |change: &'static dyn Fn(&mut Vec<Event>)| move |tree: &PlantedTree| tree.events(change);
    finds("3 % dropped", &["event_frame#residual"], plant(&|events| {
        let mut i = 0;
        events.retain(|_| {
            i += 1;
            i % 33 != 0
        });
    }));
    finds("a cluster at 400 Hz", &["hot_pixels#stray"], plant(&|events| {
        let one = events[0];
        let end = events.last().unwrap().t.floor_micros();
        for (x, y) in (40..45).flat_map(|x| (40..45).map(move |y| (x, y))) {
            let at = |t_us| Event { t: Timestamp::from_micros(t_us), x, y, polarity: gs2e::event::Polarity::On, ..one };
            events.extend((i64::from(x)..end).step_by(2500).map(at));
        }
    }));
    finds("100 us late", &["event_times#offset"], plant(&|events| {
        events.iter_mut().for_each(|e| e.t = Timestamp::from_micros(e.t.floor_micros() + 100));
    }));
    finds("2 ms dropped", &["event_frame#residual"], plant(&|events| {
        events.retain(|e| !(10_000..12_000).contains(&e.t.floor_micros()));
    }));
}
