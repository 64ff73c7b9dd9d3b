//! `gs2e simulate`: events of the user's own frames, through the binary.

mod front_end;
mod mistakes;
mod motion;
mod named;
mod video;

use crate::support::shared;
use crate::support::workspace::Workspace;
use gs2e_event::{Event, EventLabel, EventSource as _, h5};
use gs2e_image::{Image, Size, png};
use gs2e_num::seed::Seed;
use gs2e_render::backend::Backend;
use gs2e_render::{AntialiasMode, LayerOrder, RenderChoice, RenderRules};
use gs2e_sampling::rendered::RenderedFrames;
use gs2e_scene as scene;
use gs2e_scene::camera::Camera;
use gs2e_sensor::frames::array::{ArrayFrames, ArraySamples};
use gs2e_sensor::frames::{DenseFrame, FrameSequence as _};
use gs2e_sensor::noise::HotPixelNoise;
use gs2e_sensor::voltmeter::{VoltmeterModel, VoltmeterPreset};
use gs2e_sensor::{SensorSettings, simulate_one};
use gs2e_trajectory::Trajectory;
use npyz::{AutoSerialize, WriterBuilder as _};
use serde_json::Value;
use std::fs::{self, File};
use std::io::BufReader;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

const SIZE: Size = Size { width: 24, height: 16 };
const COUNT: usize = 24;
/// Stamps as uneven as a camera's.
const STAMPS_US: [i64; COUNT] = [
    0, 417, 833, 1250, 1667, 2083, 2500, 2917, 3333, 3750, 4167, 4583, 5200, 5900, 6000, 6001, 7100, 7900,
    8300, 9100, 9500, 9900, 10_000, 12_345,
];

/// A grating that moves over a ramp, in whole greys.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 28 to 243")]
fn greys() -> Vec<u8> {
    let grey = |i: usize| {
        let (frame, x, y) = (i / SIZE.pixels(), i % 24, i / 24 % 16);
        let wave = (0.6 * x as f64 - 0.9 * frame as f64 + 0.2 * y as f64).sin();
        (128.0 + 100.0 * wave + y as f64).round() as u8
    };
    (0..COUNT * SIZE.pixels()).map(grey).collect()
}

/// Writes an array as numpy does.
fn npy<T: AutoSerialize + Copy>(path: &Path, shape: &[u64], values: &[T]) {
    let out = File::create(path).unwrap();
    let mut writer = npyz::WriteOptions::new().default_dtype().shape(shape).writer(out).begin_nd().unwrap();
    writer.extend(values.iter().copied()).unwrap();
    writer.finish().unwrap();
}

const SHAPE: [u64; 3] = [COUNT as u64, 16, 24];

/// The clip as `frames.npy` and `stamps.npy`.
fn workspace() -> Workspace {
    let place = Workspace::new();
    npy(&place.path("frames.npy"), &SHAPE, &greys());
    npy(&place.path("stamps.npy"), &[COUNT as u64], &STAMPS_US);
    place
}

const RIGHT: &str = "simulate --frames frames.npy --stamps stamps.npy --sensor dvs346 --seed 7 --out e.txt";

/// The lines of a `.txt` after its comment, as numbers.
fn lines(place: &Workspace, name: &str) -> Vec<[i64; 4]> {
    let text = fs::read_to_string(place.path(name)).unwrap();
    let numbers = |line: &str| {
        let numbers: Vec<i64> = line.split(' ').map(|word| word.parse().unwrap()).collect();
        <[i64; 4]>::try_from(numbers).unwrap()
    };
    text.lines().skip(1).map(numbers).collect()
}

fn as_lines(events: &[Event]) -> Vec<[i64; 4]> {
    let line = |e: &Event| [e.t.floor_micros(), e.x.into(), e.y.into(), i64::from(e.polarity as u8)];
    events.iter().map(line).collect()
}

fn read_h5(path: &Path) -> (h5::Reader, Vec<Event>) {
    let mut reader = h5::Reader::open(path).unwrap();
    let (mut all, mut chunk) = (Vec::new(), Vec::new());
    while reader.next_chunk(&mut chunk).unwrap() {
        all.append(&mut chunk);
    }
    (reader, all)
}

/// The library's events for the clip.
fn by_library(sensor: &VoltmeterModel, seed: u64) -> Vec<Event> {
    let mut frames = ArrayFrames::new(SIZE, ArraySamples::Bytes(greys()), &STAMPS_US).unwrap();
    let mut events = Vec::new();
    let mut go_on = |_: &DenseFrame| ControlFlow::Continue(());
    simulate_one(&mut frames, sensor, Seed(seed), &mut events, &mut go_on).unwrap();
    events
}

#[test]
fn the_library_makes_the_same_events() {
    let place = workspace();
    let ended = place.ok(&format!("{RIGHT} --json"));
    let wanted = as_lines(&by_library(&VoltmeterModel::new(VoltmeterPreset::Dvs346.k()), 7));
    assert!(wanted.len() > 1000);
    assert_eq!(lines(&place, "e.txt"), wanted);
    let found: Value = serde_json::from_str(&ended.stdout).unwrap();
    assert_eq!(found["account"]["events"], wanted.len());
    assert_eq!(found["frames"]["count"], COUNT);
    assert_eq!((&found["frames"]["first_us"], &found["frames"]["last_us"]), (&0.into(), &12_345.into()));
    let seconds = 12_345e-6;
    let rate = wanted.len() as f64 / SIZE.pixels() as f64 / seconds;
    assert!((found["events_per_pixel_second"].as_f64().unwrap() - rate).abs() < 1e-9 * rate);
    // the table of docs/design/numerics-sensor.md, "Units and presets"
    assert!((found["contrast"][0].as_f64().unwrap() - 0.19).abs() < 0.001);
    assert!((found["noise"][3]["leak_hz"].as_f64().unwrap() - 0.74).abs() < 0.001);
    assert!(ended.stderr.contains("at grey 128: leak 0.7400 Hz"), "{}", ended.stderr);
    assert_eq!(place.ok(&format!("{RIGHT} -q")).stderr, "");
}

#[test]
fn options_beat_the_file() {
    let place = workspace();
    let k = VoltmeterPreset::Dvs240.k();
    place.write(
        "s.yaml",
        "voltmeter: { preset: dvs240, threshold: { on: 2.0 }, gain: midpoint, initial: stationary }\n",
    );
    place.ok(&RIGHT.replace("dvs346", "s.yaml --gain log --initial zero --law exact --between linear"));
    let found = lines(&place, "e.txt");
    assert_eq!(
        found,
        as_lines(&by_library(&VoltmeterModel { threshold_on: 2.0, ..VoltmeterModel::new(k) }, 7))
    );
    place.write(
        "r.yaml",
        "version: 1\nscene: a/b\nsensor:\n  voltmeter: { preset: dvs240, threshold: { on: 2.0 } }\n",
    );
    place.ok(&RIGHT.replace("dvs346", "r.yaml"));
    assert_eq!(lines(&place, "e.txt"), found);
    place.ok(&RIGHT.replace("--seed 7", "--seed 8"));
    assert_ne!(lines(&place, "e.txt"), found);
}

/// Frames give the same events as bytes, floats, images, and as a sequence of DVS-Voltmeter.
#[test]
fn frames_of_every_format_are_the_same() {
    let place = workspace();
    place.ok(RIGHT);
    let wanted = fs::read(place.path("e.txt")).unwrap();
    let same = |args: &str| {
        place.ok(args);
        assert!(fs::read(place.path("e.txt")).unwrap() == wanted, "{args}");
    };
    let floats: Vec<f32> = greys().into_iter().map(f32::from).collect();
    npy(&place.path("floats.npy"), &SHAPE, &floats);
    same(&RIGHT.replace("frames.npy", "floats.npy"));
    same(&RIGHT.replace("frames.npy", "floats.npy --full-scale 255"));
    let mut info = String::new();
    for (i, (grey, t)) in greys().chunks(SIZE.pixels()).zip(STAMPS_US).enumerate() {
        for name in [format!("plain/{i}.png"), format!("clip/f/{i}.png")] {
            fs::create_dir_all(place.path(&name).parent().unwrap()).unwrap();
            let image = Image::from_vec(SIZE, grey.iter().map(|&v| [v; 3]).collect());
            png::write_image(&image, File::create(place.path(&name)).unwrap()).unwrap();
        }
        info += &format!("f/{i}.png {t}\n");
    }
    place.write("clip/info.txt", info);
    same(&RIGHT.replace("frames.npy", "plain"));
    same(&RIGHT.replace("frames.npy --stamps stamps.npy", "clip"));
}

#[test]
fn a_rate_replaces_stamps() {
    let place = workspace();
    let stamps: Vec<i64> = (0..COUNT as i64).map(|i| (2 * i * 1_001_000_000 / 30_000 + 1) / 2).collect();
    npy(&place.path("stamps.npy"), &[COUNT as u64], &stamps);
    place.ok(RIGHT);
    let wanted = fs::read(place.path("e.txt")).unwrap();
    place.ok(&RIGHT.replace("--stamps stamps.npy", "--fps 30000/1001"));
    assert!(fs::read(place.path("e.txt")).unwrap() == wanted);
}

/// The printed noise is the mean of unequal pixels: 8.6 % more than a pixel of nominal thresholds makes.
#[test]
fn the_printed_noise_is_that_of_the_array() {
    let place = Workspace::new();
    npy(&place.path("still.npy"), &[51, 48, 48], &vec![64u8; 51 * 48 * 48]);
    let ended = place
        .ok("simulate --frames still.npy --fps 10 --sensor v2e-noisy --seed 3 --out e.h5 --allow-cap --json");
    let found: Value = serde_json::from_str(&ended.stdout).unwrap();
    let noise = found["noise"].as_array().unwrap().iter().find(|row| row["grey"] == 64.0).unwrap();
    let stated = noise["total_hz"].as_f64().unwrap();
    let events = found["account"]["events"].as_f64().unwrap();
    let made = events / (48.0 * 48.0) / 5.0;
    println!("{made:.4} Hz of {stated:.4} Hz");
    // Five standard deviations of a count of about 40,000 are 2.5 %, a third of the difference to a nominal
    // pixel.
    assert!(events > 30_000.0 && (made / stated - 1.0).abs() < 0.025, "{made} Hz of {stated} Hz");
}

/// A crop at its place draws the noise of the whole clip.
#[test]
fn a_crop_makes_the_events_of_the_whole() {
    let place = workspace();
    let ([left, top], [width, height]) = ([5, 3], [11, 9]);
    let inside = |i: &usize| {
        let (x, y) = (i % 24, i / 24 % 16);
        (left..left + width).contains(&x) && (top..top + height).contains(&y)
    };
    let crop: Vec<u8> = greys().into_iter().enumerate().filter(|(i, _)| inside(i)).map(|(_, v)| v).collect();
    npy(&place.path("crop.npy"), &[COUNT as u64, 9, 11], &crop);
    // much noise, and a random initial state
    place.write(
        "s.yaml",
        "voltmeter: { k: [2, 0.1, 1, 1, 1, 0.1], units: { time: ms, brightness: 1 }, initial: stationary }\n",
    );
    let noisy = RIGHT.replace("dvs346", "s.yaml");
    place.ok(&noisy);
    let whole = lines(&place, "e.txt");
    let within = |[t, x, y, p]: [i64; 4]| {
        let (x, y) = (x - 5, y - 3);
        ((0..11).contains(&x) && (0..9).contains(&y)).then_some([t, x, y, p])
    };
    let wanted: Vec<[i64; 4]> = whole.into_iter().filter_map(within).collect();
    assert!(wanted.len() > 500, "{}", wanted.len());
    place.ok(&noisy.replace("frames.npy", "crop.npy --origin 5,3"));
    assert_eq!(lines(&place, "e.txt"), wanted);
    place.ok(&noisy.replace("frames.npy", "crop.npy"));
    assert_ne!(lines(&place, "e.txt"), wanted, "elsewhere on the sensor the noise is another");
}

/// The first stamp may be far from zero, or before it: only the stamps change.
#[test]
fn the_first_stamp_may_lie_anywhere() {
    let place = workspace();
    place.ok(RIGHT);
    let near = lines(&place, "e.txt");
    place.ok(&RIGHT.replace("e.txt", "near.h5"));
    for by in [5_000, 1_000_000_000_000_000_i64] {
        npy(&place.path("stamps.npy"), &[COUNT as u64], &STAMPS_US.map(|t| t + by));
        place.ok(RIGHT);
        let moved = |[t, x, y, p]: &[i64; 4]| [t + by, *x, *y, *p];
        let wanted: Vec<[i64; 4]> = near.iter().map(moved).collect();
        assert_eq!(lines(&place, "e.txt"), wanted);
        place.ok(&RIGHT.replace("e.txt", "e.h5"));
        let (reader, events) = read_h5(&place.path("e.h5"));
        assert_eq!(as_lines(&events), wanted);
        assert_eq!(reader.offset_us(), if by > 1 << 32 { by } else { 0 });
        place.ok("convert e.h5 far.txt --lossy");
        assert_eq!(lines(&place, "far.txt"), wanted);
        place.ok("convert far.txt back.h5");
        assert_eq!(as_lines(&read_h5(&place.path("back.h5")).1), wanted);
    }
    npy(&place.path("stamps.npy"), &[COUNT as u64], &STAMPS_US.map(|t| t - 9_000));
    place.ok(&RIGHT.replace("e.txt", "e.h5"));
    let (reader, events) = read_h5(&place.path("e.h5"));
    assert_eq!(reader.offset_us(), -9_000);
    assert_eq!(
        as_lines(&events),
        near.iter().map(|[t, x, y, p]| [t - 9_000, *x, *y, *p]).collect::<Vec<_>>()
    );
    assert_eq!(place.gs2e(RIGHT).code, 1, "a text has no time before 0");
}

#[test]
fn every_format_and_every_filter_holds_the_stream() {
    let place = workspace();
    place.ok(RIGHT);
    let wanted = lines(&place, "e.txt");
    let mut sizes = Vec::new();
    let options = [
        "e.h5",
        "e.h5 --h5-filter none",
        "e.h5 --h5-filter gzip:1",
        "e.h5 --h5-filter zstd",
        "e.h5 --h5-filter lz4",
        "e.npz",
        "e.csv",
        "e.aedat4",
        "e.raw",
        "e.raw --codec evt3",
    ];
    for option in options {
        let name = option.split(' ').next().unwrap();
        place.ok(&RIGHT.replace("e.txt", option));
        sizes.push(fs::metadata(place.path(name)).unwrap().len());
        let size = if name.ends_with("npz") || name.ends_with("csv") { "--size 24x16" } else { "" };
        place.ok(&format!("convert {name} back.txt --lossy {size}"));
        assert_eq!(lines(&place, "back.txt"), wanted, "{option}");
    }
    assert!(sizes[1] > sizes[0] && sizes[1] > sizes[3] && sizes[1] > sizes[4], "{sizes:?}");
    let (reader, _) = read_h5(&place.path("e.h5"));
    let law = reader.header().unwrap().law.unwrap();
    assert!((law.c_on - 1.0 / 5.265).abs() < 1e-12, "the contrast is kept");
}

/// The library's labels pass through every format that can hold them.
#[test]
fn labels_are_written_on_request() {
    let place = workspace();
    place.write("s.yaml", "voltmeter: { preset: dvs346-paper, hot_pixels: { share: 0.1, rate: 900 } }\n");
    place.ok(&RIGHT.replace("e.txt", "e.h5 --labels").replace("dvs346", "s.yaml"));
    let hot_pixels = HotPixelNoise { share: 0.1, rate: 900.0, ..HotPixelNoise::default() };
    let sensor = VoltmeterModel {
        settings: SensorSettings { labels: true, hot_pixels, ..SensorSettings::default() },
        ..VoltmeterModel::new(VoltmeterPreset::Dvs346.k())
    };
    let wanted = by_library(&sensor, 7);
    let (reader, events) = read_h5(&place.path("e.h5"));
    let labels = |events: &[Event]| events.iter().map(|event| event.label).collect::<Vec<_>>();
    assert!(reader.labelled() && as_lines(&events) == as_lines(&wanted));
    assert_eq!(labels(&events), labels(&wanted));
    assert!(labels(&events).contains(&EventLabel::Noise) && labels(&events).contains(&EventLabel::Signal));
    // To a format without labels, and to one with labels.
    let refused = place.gs2e("convert e.h5 e.txt");
    assert_eq!(refused.code, 2);
    assert!(refused.stderr.contains("labels (signal or noise) are dropped"), "{}", refused.stderr);
    let found = place.ok("convert --lossy e.h5 e.txt");
    assert!(format!("{}{}", found.stdout, found.stderr).contains("labels (signal or noise) are dropped"));
    let found = place.ok("convert --lossy e.h5 e.npz");
    assert!(!format!("{}{}", found.stdout, found.stderr).contains("labels (signal or noise) are dropped"));
    place.ok("convert e.npz back.h5 --size 24x16");
    assert_eq!(labels(&read_h5(&place.path("back.h5")).1), labels(&wanted));
    let refused = place.gs2e(&RIGHT.replace("e.txt", "l.txt --labels"));
    assert_eq!(refused.code, 2);
    assert!(refused.stderr.contains("l.txt cannot store the labels"), "{}", refused.stderr);
    assert!(!place.path("l.txt").exists());
}

/// Numerics 1.2: if the maximum of the first two frames is above 16, full scale is 255; from 2 to
/// 16 it is an error; else it is 1.
#[test]
fn the_scale_of_floats_is_decided_by_two_frames() {
    let place = workspace();
    let floats = |scale: f32| {
        let values: Vec<f32> = greys().into_iter().map(|v| f32::from(v) / 255.0 * scale).collect();
        npy(&place.path("frames.npy"), &SHAPE, &values);
    };
    floats(1.0);
    let ended = place.ok(&format!("{RIGHT} --json"));
    assert!(
        ended.stderr.contains("full scale: 1, because the brightest value of the first two frames is 0.9")
    );
    let found: Value = serde_json::from_str(&ended.stdout).unwrap();
    assert_eq!(found["frames"]["full_scale"], 1);
    floats(255.0);
    assert!(place.ok(RIGHT).stderr.contains("full scale: 255, because"));
    floats(8.0);
    let ended = place.gs2e(RIGHT);
    assert_eq!(ended.code, 2);
    assert!(
        ended.stderr.contains("white may be 1 or 255: the brightest value of the first two frames is 7.")
    );
    assert!(ended.stderr.contains("--full-scale 1 or --full-scale 255"));
    place.ok(&format!("{RIGHT} --full-scale 1"));
    // later frames do not matter
    let mut values: Vec<f32> = greys().into_iter().map(|v| f32::from(v) / 255.0).collect();
    values[2 * SIZE.pixels()..].iter_mut().for_each(|v| *v *= 100.0);
    npy(&place.path("frames.npy"), &SHAPE, &values);
    assert!(place.ok(&format!("{RIGHT} --law exact")).stderr.contains("full scale: 1"));
}

/// A crop of a real video. On whole clips of this kind the sensors make 8.6 and 0.044 events per
/// pixel and second (docs/design/numerics-sensor.md, "Units and presets"), and this part moves like
/// the rest.
#[test]
fn a_real_clip_makes_the_expected_number_of_events() {
    let Some(folder) = shared::path("data/heldout") else { return };
    let place = Workspace::new();
    let run = |sensor: &str| -> Value {
        let args = format!("simulate --sensor {sensor} --out e.h5 --json --frames");
        let mut command = place.command(&args);
        command.arg(folder.join("real_frames.npy")).arg("--stamps").arg(folder.join("real_ts_us.npy"));
        let ended = command.output().unwrap();
        assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
        serde_json::from_slice(&ended.stdout).unwrap()
    };
    let rate = |found: &Value| found["events_per_pixel_second"].as_f64().unwrap();
    let (dvs346, si) = (run("dvs346"), run("gs2e-si"));
    eprintln!("dvs346 {}, gs2e-si {} events per pixel and second", rate(&dvs346), rate(&si));
    assert!((2.0..40.0).contains(&rate(&dvs346)), "{dvs346}");
    assert!(rate(&si) < 0.1 * rate(&dvs346), "{si}");
    assert_eq!(dvs346["account"]["drift_violations"], 0);
    let share = dvs346["account"]["on"].as_f64().unwrap() / dvs346["account"]["events"].as_f64().unwrap();
    assert!((0.1..0.9).contains(&share), "{share}");
}

/// A build renders its frames and shows them to the sensor. The same frames from a file give the
/// same event file.
#[test]
fn rendered_frames_make_the_events_of_a_build() {
    let place = Workspace::with_tiny();
    place.build("tiny.yaml");
    let steps: Value = serde_json::from_str(&place.ok("plan --json tiny.yaml").stdout).unwrap();
    let outputs = || steps.as_array().unwrap().iter().flat_map(|step| step["outputs"].as_array().unwrap());
    let built = |role: &str| {
        let output = outputs().find(|output| output["role"] == role).unwrap();
        place.path(output["path"].as_str().unwrap())
    };
    let poses = BufReader::new(File::open(built("poses.txt")).unwrap());
    let trajectory = Trajectory::read_poses(poses).unwrap();
    let simulation: Value = serde_json::from_slice(&fs::read(built("simulation.json")).unwrap()).unwrap();
    let camera: Camera = serde_json::from_value(simulation["camera"].clone()).unwrap();
    let scene = scene::read_file(&built("scene.ply")).unwrap();
    let (rules, order, antialiased) = (RenderRules::Official, LayerOrder::Depth, AntialiasMode::Auto);
    let style = RenderChoice { rules, order, antialiased, background: [0.0; 3], near: None }
        .resolve(scene.antialiased);
    let renderer = Backend::Cpu.renderer(Arc::new(scene), style).unwrap();
    let mut frames = RenderedFrames::new(renderer, camera, trajectory.clone());
    let mut greys = Vec::new();
    while let Some(frame) = frames.next().unwrap() {
        greys.extend(frame.luminance.into_pixels());
    }
    let count = trajectory.stamps_us.len() as u64;
    let shape = [count, camera.size.height.into(), camera.size.width.into()];
    npy(&place.path("frames.npy"), &shape, &greys);
    npy(&place.path("stamps.npy"), &[count], &trajectory.stamps_us);
    place.write("s.yaml", "voltmeter: { preset: dvs346, threshold: { on: 1.0, off: 1.0 } }\n");
    let seed = simulation["seed"].as_u64().unwrap();
    let frames = "--frames frames.npy --stamps stamps.npy --full-scale 255";
    place.ok(&format!("simulate {frames} --sensor s.yaml --seed {seed} --out e.h5"));
    assert!(!read_h5(&place.path("e.h5")).1.is_empty());
    assert!(fs::read(place.path("e.h5")).unwrap() == fs::read(built("events.h5")).unwrap());
}
