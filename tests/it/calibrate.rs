//! `gs2e calibrate`: a recording that a known sensor made.

use crate::support::shared;
use crate::support::workspace::Workspace;
use npyz::WriterBuilder as _;
use serde_json::Value;
use std::fs::{self, File};

const FRAMES: usize = 600;
const EVERY: usize = 10;

/// Light of a pixel of 32x24: two waves that move over a ramp; 8 columns stand still.
fn grey(frame: usize, pixel: usize) -> f64 {
    let (x, y) = ((pixel % 32) as f64, (pixel / 32) as f64);
    let t = if x < 8.0 { 0.0 } else { frame as f64 * 2e-3 };
    let wave = 0.5 * (0.35 * x + 0.2 * y - 12.0 * t).sin() + 0.4 * (0.1 * x - 0.3 * y + 8.0 * t).sin();
    (25.0 + 2.5 * y) * wave.exp()
}

fn write_array<T: npyz::AutoSerialize>(place: &Workspace, name: &str, shape: &[u64], values: Vec<T>) {
    let file = File::create(place.path(name)).unwrap();
    let mut writer = npyz::WriteOptions::new().default_dtype().shape(shape).writer(file).begin_nd().unwrap();
    writer.extend(values).unwrap();
    writer.finish().unwrap();
}

/// Dense frames for the simulator, and every tenth of them, in bytes, as those of the camera.
fn write_frames(place: &Workspace) {
    #[expect(clippy::cast_possible_truncation, reason = "a grey")]
    let dense: Vec<f32> = (0..FRAMES * 768).map(|i| grey(i / 768, i % 768) as f32).collect();
    let frames = (0..FRAMES).step_by(EVERY).flat_map(|i| &dense[i * 768..(i + 1) * 768]);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a grey")]
    let frames: Vec<u8> = frames.map(|v| v.round().clamp(0.0, 255.0) as u8).collect();
    let count = FRAMES.div_ceil(EVERY) as u64;
    write_array(place, "dense.npy", &[FRAMES as u64, 24, 32], dense);
    write_array(place, "frames.npy", &[count, 24, 32], frames);
    let stamps: Vec<i64> = (0..FRAMES as i64).map(|i| 5_000_000 + 2000 * i).collect();
    let coarse: Vec<i64> = stamps.iter().copied().step_by(EVERY).collect();
    write_array(place, "dense_us.npy", &[FRAMES as u64], stamps);
    write_array(place, "stamps.npy", &[count], coarse);
    place.write("planted.yaml", "esim: { contrast: { on: 0.16, off: 0.2 }, eps: 0.004 }\n");
    place.ok(
        "simulate --frames dense.npy --stamps dense_us.npy --full-scale 255 --sensor planted.yaml --out events.npz",
    );
}

const INPUTS: &str = "--frames frames.npy --stamps stamps.npy --events events.npz";

#[test]
fn a_recipe_takes_the_sensor_of_a_recording() {
    let place = Workspace::new();
    write_frames(&place);
    let message =
        place.ok(&format!("calibrate {INPUTS} --hold-out 0.4 --out sensor.yaml --page c.html --json")).stdout;
    let found: Value = serde_json::from_str(&message).unwrap();
    for (name, want) in [("contrast_on", 0.16), ("contrast_off", 0.2)] {
        let value = found[name]["value"].as_f64().unwrap();
        assert!(found[name]["determined"] == true && (value / want - 1.0).abs() < 0.03, "{name}: {value}");
    }
    for name in ["spread", "dead_time_us", "cutoff_hz", "delay_us", "offset", "black_level"] {
        assert!(found[name]["determined"].is_boolean(), "{name}");
    }
    for name in ["leak_hz", "noise", "hot_pixels"] {
        assert!(found[name].get("se").is_some(), "{name}");
    }
    // The calibrated sensor is nearer to what was held out than the default one.
    let [before, after] = ["before", "after"].map(|of| found["held_out"][of]["distance"].as_f64().unwrap());
    println!("{before} {after}");
    assert!(after < before, "{before} {after}");
    let written = fs::read_to_string(place.path("sensor.yaml")).unwrap();
    assert_eq!(found["sensor"], written.as_str());
    let page = fs::read_to_string(place.path("c.html")).unwrap();
    assert!(page.contains("contrast_off") && page.matches("data:image/svg+xml").count() == 2);
    // Recorded and simulated events of one moment.
    assert_eq!(page.matches("data:image/png").count(), 2);
    place.ok("simulate --frames frames.npy --stamps stamps.npy --sensor sensor.yaml --out again.npz");
    let message = place.ok(&format!("calibrate {INPUTS}")).stdout;
    assert!(message.contains("contrast_on") && message.contains("trust contrast_on"), "{message}");
}

#[test]
fn recordings_that_do_not_fit_are_refused() {
    let place = Workspace::new();
    write_frames(&place);
    let message = place.refused("calibrate --frames frames.npy --fps 50 --events events.npz");
    assert!(message.contains("wanted the same clock"), "{message}");
    place.write("few.csv", "t,x,y,p\n5100000,3,4,1\n");
    let message =
        place.refused("calibrate --frames frames.npy --stamps stamps.npy --events few.csv --size 32x24");
    assert!(message.contains("wanted at least 1000"), "{message}");
    let message =
        place.refused("calibrate --frames frames.npy --stamps stamps.npy --events few.csv --size 24x24");
    assert!(message.contains("events of 24x24 and frames of 32x24"), "{message}");
    let message = place.refused(&format!("calibrate {INPUTS} --from 1.15"));
    assert!(message.contains("wanted at least 4"), "{message}");
}

/// A room, where the events of a pixel come in pairs (98.8 % alternate, and their Fano factor is 2.9), a dark
/// camera, whose events do not know of each other, and a lamp on the mains of 60 Hz.
#[test]
fn events_of_constant_light_need_no_frames() {
    let Some(real) = shared::path("data/real") else { return };
    let place = Workspace::new();
    let found = |name: &str, size: &str| -> Value {
        let events = real.join(name).join("events.npz");
        let run = place.ok(&format!("calibrate --events {} --size {size} --json", events.display()));
        serde_json::from_str(&run.stdout).unwrap()
    };
    let close = |found: &Value, wanted: [(&str, [f64; 2]); 3]| {
        for (name, [low, high]) in wanted {
            let Value::Object(estimate) = &found[name] else { panic!("{name}: {found}") };
            let value = estimate["value"].as_f64().unwrap();
            assert!(estimate["determined"] == true && (low..=high).contains(&value), "{name}: {value}");
        }
        assert_eq!(found["contrast_on"]["determined"], false);
    };
    let room = found("evk4_static_room", "1280x720");
    close(&room, [("alternate", [0.985, 0.991]), ("fano", [2.8, 3.0]), ("hot_pixels", [0.0017, 0.0021])]);
    let dark = found("dvxplorer_dark_noise", "640x480");
    close(&dark, [("alternate", [0.45, 0.47]), ("fano", [0.98, 1.04]), ("hot_pixels", [0.0013, 0.0017])]);
    let lamp = found("gen31_vga_mains_flicker", "640x480");
    let lines = lamp["flicker"].as_array().unwrap().iter();
    let lines: Vec<u64> = lines.map(|line| line["hz"].as_u64().unwrap()).collect();
    assert_eq!(lines, [120, 240, 360]);
    let slider = real.join("slider_depth/events.npz");
    let message = place.refused(&format!("calibrate --events {} --size 240x180", slider.display()));
    assert!(message.contains("wanted constant light where there are no frames"), "{message}");
}
