//! Faults in products that frames do not show: disparity, segmentation and places of objects, inertial data,
//! labels, and the stream of a sensor with hot pixels. Each is found by a check that measures.

use super::planted_tree::{PlantedRelease, PlantedTree};
use gs2e_event::{Event, EventLabel, Polarity};
use gs2e_image::{Image, Size, png};
use gs2e_num::units::Timestamp;
use std::fs;
use std::io::Cursor;
use std::sync::OnceLock;

/// Folder of the first camera.
const LEFT: &str = "planted/products/base/left";
/// Folder of the body.
const BODY: &str = "planted/products/base";
const SIZE: [u16; 2] = [120, 90];
const DISPARITY: &str = "depth_consistency#disparity";
const OBJECTS: &str = "flow_projection#objects";
const PLACES: &str = "records#objects";
const INERTIAL: &str = "records#imu";
const LABELS: &str = "noise_floor#labels";

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
    select: { box: { low: [-1.5, -0.6, -1], high: [-0.35, 0.3, 1] } }
    path: { orbit: { centre: [0, 0, 0], axis: [0, 1, 0], degrees_per_second: 90 } }
outputs: [events, sharp, depth, flow, disparity, segmentation, imu]
scale: { metres_per_unit: 0.5 }
imu: { up: [0, -1, 0] }
";

fn planted() -> PlantedTree {
    static RELEASE: PlantedRelease = OnceLock::new();
    PlantedTree::of(&RELEASE, RECIPE, LEFT)
}

/// A fault: its name, the statement that finds it, and its plant.
type ProductFault = (&'static str, &'static str, fn(&PlantedTree));

/// Plants faults that do not touch each other, and requires that each is found by its own statement.
fn finds(faults: &[ProductFault]) -> Vec<String> {
    let tree = planted();
    faults.iter().for_each(|(_, _, plant)| plant(&tree));
    let found = tree.faults().1;
    for (name, check, _) in faults {
        assert!(found.iter().any(|fault| fault.starts_with(check)), "{name}: {check} not in {found:#?}");
    }
    found
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
    let unsound: Vec<_> =
        found.iter().filter(|(verdict, _)| ["fail", "warn"].contains(&verdict.as_str())).collect();
    assert!(code == Some(0) && unsound.is_empty(), "{unsound:#?}");
    for check in [
        DISPARITY,
        OBJECTS,
        PLACES,
        INERTIAL,
        LABELS,
        "flow_projection#:",
        "hot_pixels#stray",
        "event_frame#residual",
        "completeness#time",
        "event_times#offset",
    ] {
        let passes = found.iter().any(|(verdict, text)| verdict == "pass" && text.starts_with(check));
        assert!(passes, "{check}: {found:#?}");
    }
}

/// The build compares disparity with the depth of the simulation, which has no values at moving objects.
#[test]
fn disparity_of_moving_objects_needs_no_depth() {
    static RELEASE: PlantedRelease = OnceLock::new();
    let recipe = RECIPE
        .replace("gaussians: 6000", "gaussians: 1500")
        .replace("depth, flow, disparity, segmentation", "disparity");
    let tree = PlantedTree::of(&RELEASE, &recipe, LEFT);
    let checks = fs::read(tree.path().join(LEFT).join("checks.json")).unwrap();
    let checks: Vec<serde_json::Value> = serde_json::from_slice(&checks).unwrap();
    let judged = checks.iter().find(|finding| finding["subject"] == format!("{LEFT}#disparity")).unwrap();
    assert_eq!(judged["verdict"], "pass", "{judged}");
}

/// Changes the segmentation of a pose.
fn change_segmentation(tree: &PlantedTree, pose: usize, change: impl Fn(u8) -> u8) {
    let changed = segmentation_at(tree, pose).into_iter().map(change).collect();
    let size = Size { width: SIZE[0].into(), height: SIZE[1].into() };
    let mut bytes = Vec::new();
    png::write_image(&Image::from_vec(size, changed), &mut bytes).unwrap();
    tree.write(&format!("{LEFT}/segmentation/{pose:06}.png"), &bytes);
}

/// The numbers of the objects at the pixels of a pose.
fn segmentation_at(tree: &PlantedTree, pose: usize) -> Vec<u8> {
    let bytes = fs::read(tree.path().join(format!("{LEFT}/segmentation/{pose:06}.png"))).unwrap();
    let read = png::read_rgb(Cursor::new(bytes)).unwrap();
    read.pixels().iter().map(|[number, ..]| *number).collect()
}

fn places(tree: &PlantedTree, change: impl Fn(usize, &mut Vec<String>)) {
    lines(tree, &format!("{LEFT}/segmentation/objects.csv"), change);
}

fn samples(tree: &PlantedTree, change: impl Fn(&mut [String])) {
    lines(tree, &format!("{BODY}/imu/imu.csv"), |_, columns| change(columns));
}

fn set_values(columns: &mut [String], values: [f64; 3]) {
    columns.iter_mut().zip(values).for_each(|(column, value)| *column = value.to_string());
}

fn labels(tree: &PlantedTree, change: impl Fn(EventLabel) -> EventLabel) {
    tree.events(|events| events.iter_mut().for_each(|event| event.label = change(event.label)));
}

#[test]
fn other_scales_signs_and_units_are_found() {
    finds(&[
        ("disparity 1.001 times", DISPARITY, |tree| disparities(tree, |v| 1.001 * v)),
        ("a rate in degrees", INERTIAL, |tree| samples(tree, |c| scaled(&mut c[1..4], 57.295_78))),
        ("velocities of another sign", PLACES, |tree| places(tree, |_, c| scaled(&mut c[10..13], -1.0))),
        ("all events a signal", LABELS, |tree| labels(tree, |_| EventLabel::Signal)),
    ]);
    finds(&[
        ("disparity of another sign at a pose", DISPARITY, |tree| {
            numbers(tree, "disparity/000004", 1, |_, value| -value);
        }),
        ("a sensor of another rate, pose and noise", INERTIAL, |tree| {
            edit(tree, &format!("{BODY}/imu/sensor.yaml"), |bytes| {
                let text = String::from_utf8(bytes.clone()).unwrap();
                *bytes = text.replacen("data: [1.0", "data: [-1.0", 1).into_bytes();
            });
        }),
        ("places twice as far", PLACES, |tree| places(tree, |_, c| scaled(&mut c[3..6], 2.0))),
        ("labels inverted", LABELS, |tree| {
            labels(tree, |label| match label {
                EventLabel::Noise => EventLabel::Signal,
                EventLabel::Signal => EventLabel::Noise,
            });
        }),
    ]);
}

#[test]
fn absent_and_exchanged_parts_are_found() {
    finds(&[
        ("a disparity without values", DISPARITY, |tree| {
            numbers(tree, "disparity/000004", 1, |_, _| f32::NAN)
        }),
        ("a saturated gyroscope", INERTIAL, |tree| {
            samples(tree, |c| set_values(&mut c[1..4], [2000_f64.to_radians(), 0.0, 0.0]));
        }),
        ("a mask without objects", OBJECTS, |tree| change_segmentation(tree, 5, |_| 0)),
        ("one event in 33 dropped", "event_frame#residual", |tree| {
            tree.events(|events| {
                let mut i = 0;
                events.retain(|_| {
                    i += 1;
                    i % 33 != 0
                });
            });
        }),
    ]);
    finds(&[
        ("disparities exchanged", DISPARITY, |tree| swap(tree, "disparity", ["000003.npy", "000020.npy"])),
        ("forces beyond the range", INERTIAL, |tree| {
            samples(tree, |c| set_values(&mut c[4..7], [1e6, 0.0, 0.0]))
        }),
        ("half of the places", PLACES, |tree| {
            places(tree, |i, c| {
                if i % 4 > 1 {
                    c.clear();
                }
            });
        }),
        ("a cluster at 400 Hz", "hot_pixels#stray", |tree| {
            tree.events(|events| {
                let (one, end) = (events[0], events.last().unwrap().t.floor_micros());
                for (x, y) in (40..45).flat_map(|x| (40..45).map(move |y| (x, y))) {
                    let t = Timestamp::from_micros;
                    let at = |t_us| Event { t: t(t_us), x, y, polarity: Polarity::On, ..one };
                    events.extend((i64::from(x)..end).step_by(2500).map(at));
                }
            });
        }),
    ]);
}

#[test]
fn other_segmentation_flow_and_depth_of_objects_are_found() {
    finds(&[("numbers exchanged", OBJECTS, |tree| {
        change_segmentation(tree, 5, |n| [0, 2, 1][usize::from(n)])
    })]);
    finds(&[("a number of no object", OBJECTS, |tree| change_segmentation(tree, 5, |n| 9 * n))]);
    finds(&[("masks exchanged", OBJECTS, |tree| swap(tree, "segmentation", ["000005.png", "000006.png"]))]);
    let found = finds(&[
        ("depth twice as far", OBJECTS, |tree| {
            let shown = segmentation_at(tree, 5);
            numbers(tree, "depth/000005", 1, |i, z| if shown[i] > 0 { 2.0 * z } else { z });
        }),
        ("events 100 us late", "event_times#offset", |tree| {
            tree.events(|events| {
                events.iter_mut().for_each(|e| e.t = Timestamp::from_micros(e.t.floor_micros() + 100));
            });
        }),
        ("flow of another sign", OBJECTS, |tree| {
            let shown = segmentation_at(tree, 7);
            numbers(tree, "flow/000007", 2, |i, v| if shown[i / 2] == 1 { -v } else { v });
        }),
    ]);
    assert!(!found.iter().any(|fault| fault.starts_with("records#objects")), "{found:#?}");
}

#[test]
fn rounding_is_spared() {
    let tree = planted();
    disparities(&tree, |value| value * (1.0 + 6e-6));
    // One pixel in a thousand of those of objects.
    let shown = segmentation_at(&tree, 5);
    let one = shown.iter().position(|number| *number > 0).unwrap();
    numbers(&tree, "flow/000005", 2, |i, value| if i / 2 == one { 1.1 * value } else { value });
    let found = tree.faults().1;
    let judged = [DISPARITY, OBJECTS, PLACES, INERTIAL];
    assert!(!found.iter().any(|fault| judged.iter().any(|check| fault.starts_with(check))), "{found:#?}");
}
