//! Every mistake ends with its exit code and its message, and leaves all files unchanged.

use super::{COUNT, RIGHT, SHAPE, STAMPS_US, as_lines, by_library, greys, lines, npy, workspace};
use crate::support::workspace::{Workspace, tree};
use gs2e_event::Event;
use gs2e_image::{Image, Size, png};
use gs2e_sensor::voltmeter::{VoltmeterModel, VoltmeterPreset};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs::{self, File};

const N: u64 = COUNT as u64;

fn wrong() -> Workspace {
    let place = workspace();
    place.write("e.txt", "as it was");
    let with = |at: usize, to: i64| {
        let mut stamps = STAMPS_US;
        stamps[at] = to;
        stamps
    };
    npy(&place.path("back.npy"), &[N], &with(4, 1250));
    npy(&place.path("few.npy"), &[N - 1], &STAMPS_US[1..]);
    npy(&place.path("one.npy"), &[1, 16, 24], &greys()[..16 * 24]);
    npy(&place.path("one_stamp.npy"), &[1], &STAMPS_US[..1]);
    npy(&place.path("doubles.npy"), &SHAPE, &[0.5f64; 24 * 16 * COUNT]);
    npy(&place.path("flat.npy"), &[N, 16 * 24], &greys());
    let mut floats: Vec<f32> = greys().into_iter().map(f32::from).collect();
    npy(&place.path("rates.npy"), &SHAPE, &floats);
    floats[5 * 24 * 16 + 50] = f32::NAN;
    npy(&place.path("nan.npy"), &SHAPE, &floats);
    let whole = fs::read(place.path("frames.npy")).unwrap();
    place.write("cut.npy", &whole[..whole.len() - 1]);
    place.write("text.npy", "no array");
    place.write("text.yaml", "voltmeter: { presett: dvs346 }\n");
    place.write(
        "loud.yaml",
        "voltmeter: { k: [0.5, 1e-3, 0.1, 0.01, 0.1, 1e-5], units: { time: us, brightness: 255 } }\n",
    );
    place.write("unitless.yaml", "voltmeter: { k: [0.5, 1e-3, 0.1, 0.01, 0.1, 1e-5] }\n");
    place.write("capped.yaml", "voltmeter: { max_events_per_pixel_frame: 1 }\n");
    place.write("empty/a.txt", "");
    place.write("info/info.txt", "a.png 0\na.png 10\na.png 10\n");
    place.write("gone/info.txt", "a.png 0\nb.png 10\n");
    place.write("fraction/info.txt", "a.png 0.0\n");
    for (folder, names) in [("info", &["a.png"][..]), ("gone", &["a.png"]), ("two", &["1.png", "2.png"])] {
        for (i, name) in (0..).zip(names) {
            let size = Size { width: 4 + i, height: 3 };
            fs::create_dir_all(place.path(folder)).unwrap();
            let file = File::create(place.path(folder).join(name)).unwrap();
            png::write_image(&Image::filled(size, 9u8), file).unwrap();
        }
    }
    place
}

#[test]
fn mistakes_are_named_and_nothing_is_written() {
    let place = wrong();
    let before = tree(&place.path(""));
    let t = |change: [&str; 2], code: i32, part: &str| {
        assert!(RIGHT.contains(change[0]), "{}", change[0]);
        let args = RIGHT.replace(change[0], change[1]);
        let ended = place.gs2e(&args);
        assert_eq!((ended.code, ended.stdout.as_str()), (code, ""), "gs2e {args}\n{}", ended.stderr);
        assert!(ended.stderr.contains(part), "gs2e {args}\n{part}\n{}", ended.stderr);
        assert!(tree(&place.path("")) == before, "gs2e {args} has touched a file");
    };
    let (frames, stamps, both) = ("frames.npy", "stamps.npy", "frames.npy --stamps stamps.npy");
    t([frames, "gone.npy"], 2, "frames: gone.npy does not exist");
    t([frames, "text.npy"], 1, "text.npy: not a supported .npy file");
    t([frames, "cut.npy"], 1, "cut.npy: 9343 bytes, wanted 9344 according to its header");
    t([frames, "doubles.npy"], 1, "an array of float64 and shape [24, 16, 24], wanted uint8 or float32");
    t([frames, "flat.npy"], 1, "shape [24, 384], wanted the shape [N, H, W]");
    t([frames, "text.yaml"], 2, "text.yaml is neither a .npy nor a folder of images");
    t([frames, "nan.npy"], 1, "frame 5: pixel (2, 2) is NaN");
    t([both, "one.npy --stamps one_stamp.npy"], 2, "one.npy holds 1 frames, wanted at least 2");
    t([stamps, "gone.npy"], 2, "stamps: gone.npy does not exist");
    t([stamps, "back.npy"], 2, "back.npy: stamp 4 is 1250 us, not later than the previous one, 1250 us");
    t([stamps, "few.npy"], 2, "frames.npy: 24 frames, but 23 stamps");
    t([stamps, "rates.npy"], 1, "wanted int64 of shape [N]");
    t(["--stamps stamps.npy", ""], 2, "no timestamps for frames.npy");
    t(["--stamps stamps.npy", "--fps 0"], 2, "`0` is not a positive number");
    t(["--stamps stamps.npy", "--stamps stamps.npy --fps 30"], 2, "cannot be used with");
    t([both, "empty --fps 30"], 2, "it contains neither info.txt nor a .png or .jpg file");
    t([both, "info"], 2, "info.txt:3: 10 us is not later than the previous stamp, 10 us");
    t([both, "gone"], 2, "info.txt:2: b.png is not there");
    t([both, "fraction"], 2, "info.txt:1: the timestamp is 0.0, wanted an integer in microseconds");
    t([both, "two --fps 30"], 2, "2.png: 5x3, wanted 4x3 like the first image");
    t(
        ["dvs346", "dvs347"],
        2,
        "dvs347 is neither a file nor a preset: davis346, evk4, dvxplorer, dvs346-paper, dvs240",
    );
    t(["dvs346", "text.yaml"], 2, "unknown field \"presett\"");
    t(["dvs346", "loud.yaml"], 2, "events per second from noise only");
    t(["dvs346", "unitless.yaml"], 2, "missing field \"sensor.voltmeter.units\"");
    t(["dvs346", "capped.yaml"], 1, "fires more than 1 events between frames");
    t(["dvs346", "dvs346 --law other"], 2, "unknown variant `other`");
    t(["dvs346", "dvs346 --origin 5"], 2, "`5` is not X,Y");
    t(["dvs346", "dvs346 --origin 65530,0"], 2, "exceed the 65536 columns and rows that events can address");
    t(["dvs346", "dvs346 --full-scale 2"], 2, "`2` is neither 1 nor 255");
    t(
        ["dvs346", "dvs346 --rates rates.npy"],
        2,
        "--rates applies to hermite, but the sensor interpolates with linear",
    );
    t(["dvs346", "dvs346 --h5-filter blosc"], 2, "found `blosc`, wanted gzip[:0-9]");
    t(["e.txt", "e.dat"], 2, "e.dat: not an event format");
    t(["e.txt", "gone/e/e.txt"], 2, "is in a folder that does not exist");
    t(["e.txt", "frames.npy"], 2, "frames.npy is an input and would be overwritten");
}

/// The first events of each pixel and frame, and the number of omitted ones.
#[test]
fn events_above_the_cap_are_omitted_if_allowed() {
    let place = workspace();
    let whole = by_library(&VoltmeterModel::new(VoltmeterPreset::Dvs346.k()), 7);
    place.write("s.yaml", "voltmeter: { preset: dvs346-paper, max_events_per_pixel_frame: 2 }\n");
    let args = format!("{} --allow-cap --json", RIGHT.replace("dvs346", "s.yaml"));
    let found: Value = serde_json::from_str(&place.ok(&args).stdout).unwrap();
    // An event at a stamp belongs to the interval before it.
    let interval = |event: &Event| STAMPS_US.partition_point(|&stamp| 1000 * stamp < event.t.0);
    let mut seen = BTreeMap::new();
    let mut first = |event: &&Event| {
        let count = seen.entry((interval(event), event.x, event.y)).or_insert(0);
        *count += 1;
        *count <= 2
    };
    let wanted: Vec<Event> = whole.iter().filter(|event| first(event)).copied().collect();
    assert!(wanted.len() < whole.len());
    assert_eq!(lines(&place, "e.txt"), as_lines(&wanted));
    assert_eq!(found["capped"], whole.len() - wanted.len());
    assert_eq!(found["account"]["events"], wanted.len());
}

#[test]
fn a_stamp_beyond_nanoseconds_is_refused() {
    let place = wrong();
    let far = i64::MAX / 1000;
    npy(&place.path("far.npy"), &[2], &[-far, far]);
    npy(&place.path("two.npy"), &[2, 1, 1], &[1u8, 2]);
    let ended = place.gs2e("simulate --frames two.npy --stamps far.npy --sensor dvs346 --out e.npz");
    assert_eq!(ended.code, 2, "{}", ended.stderr);
    assert!(ended.stderr.contains("too far from the first"), "{}", ended.stderr);
}
