//! `gs2e study real`: a recording that a known sensor made.

use crate::support::workspace::Workspace;
use npyz::WriterBuilder as _;
use serde_json::Value;
use std::fs::{self, File};

const FRAMES: usize = 60;

/// Gratings that move over a ramp, and stamps on a clock that does not start at 0.
fn write_frames(place: &Workspace) {
    let grey = |i: usize| {
        let (frame, x, y) = (i / 384, i % 24, i / 24 % 16);
        let wave = (0.5 * x as f64 - 0.2 * frame as f64).sin();
        (8.0 + 13.0 * y as f64) * (1.0 + 0.6 * wave) / 255.0
    };
    #[expect(clippy::cast_possible_truncation, reason = "brightness from 0 to 1.3")]
    let values: Vec<f32> = (0..FRAMES * 384).map(|i| grey(i) as f32).collect();
    let file = File::create(place.path("frames.npy")).unwrap();
    let mut writer = npyz::WriteOptions::new()
        .default_dtype()
        .shape(&[FRAMES as u64, 16, 24])
        .writer(file)
        .begin_nd()
        .unwrap();
    writer.extend(values).unwrap();
    writer.finish().unwrap();
    let file = File::create(place.path("stamps.npy")).unwrap();
    let mut writer =
        npyz::WriteOptions::new().default_dtype().shape(&[FRAMES as u64]).writer(file).begin_nd().unwrap();
    writer.extend((0..FRAMES as i64).map(|i| 5_000_000 + 2000 * i)).unwrap();
    writer.finish().unwrap();
}

const INPUTS: &str = "--frames frames.npy --stamps stamps.npy --full-scale 1";

#[test]
fn the_sensor_of_the_recording_is_the_nearest() {
    let place = Workspace::new();
    write_frames(&place);
    place.write("noisy.yaml", "sensor: { v2e: { preset: noisy } }\n");
    for (sensor, file, nearest) in [
        ("dvs240", "a.h5", "dvs240"),
        ("noisy.yaml", "b.h5", "v2e-noisy"),
        ("dvs346-paper", "c.txt", "dvs346-paper"),
    ] {
        place.ok(&format!("simulate {INPUTS} --sensor {sensor} --seed 5 --out {file}"));
        let out = "--csv table.csv --picture intervals.svg";
        let message = place.ok(&format!("study real {INPUTS} --events {file} {out} --json")).stdout;
        let found: Value = serde_json::from_str(&message).unwrap();
        assert_eq!(found["nearest"], nearest, "{found:#}");
        assert_eq!(found["outside"], 0);
        let [first, second] = [0, 1].map(|i| found["sensors"][i]["distance"].as_f64().unwrap());
        println!("{nearest}: {first:.4}, the next {second:.4}");
        // No other law explains the recorded intervals better than their own.
        let own = found["recording"]["ln_density"].as_f64().unwrap();
        for row in found["sensors"].as_array().unwrap() {
            assert!(row["ln_density"].as_f64().is_none_or(|other| other <= own + 1e-9), "{row}");
        }
        let table = fs::read_to_string(place.path("table.csv")).unwrap();
        assert!(table.lines().nth(1).unwrap().starts_with("recording,"), "{table}");
        assert!(fs::read_to_string(place.path("intervals.svg")).unwrap().contains(">recording<"));
    }
    let message = place.ok(&format!("study real {INPUTS} --events a.h5 --sensor noisy.yaml")).stdout;
    assert!(message.contains("nearest: dvs240") && message.contains("noisy.yaml"), "{message}");
}

#[test]
fn other_clocks_and_pixels_are_refused() {
    let place = Workspace::new();
    write_frames(&place);
    place.ok(&format!("simulate {INPUTS} --sensor dvs346 --out a.h5"));
    let message = place.refused("study real --frames frames.npy --fps 500 --full-scale 1 --events a.h5");
    assert!(message.contains("events is between the first frame, 0 us"), "{message}");
    place.write("b.csv", "t,x,y,p\n5000100,3,4,1\n");
    let message = place.refused(&format!("study real {INPUTS} --events b.csv --size 32x16"));
    assert!(message.contains("events of 32x16 and frames of 24x16"), "{message}");
}
