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
    // Fractions are seconds, and this is said.
    place.write("seconds.csv", "t,x,y,p\n5.005,3,4,1\n5.0061,3,4,0\n99.5,3,4,1\n");
    let run = place.ok(&format!("study real {INPUTS} --events seconds.csv --size 24x16 --json"));
    let found: Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!((&found["recording"]["events"], &found["outside"]), (&2.into(), &1.into()));
    assert!(run.stderr.contains("read as seconds"), "{}", run.stderr);
    place.write("b.csv", "t,x,y,p\n5000100,3,4,1\n");
    let message = place.refused(&format!("study real {INPUTS} --events b.csv --size 32x16"));
    assert!(message.contains("events of 32x16 and frames of 24x16"), "{message}");
}

/// Frames every 20 ms for a second, 12 columns of which stand still, and stamps that are later by 1,700 us
/// for the camera that makes the recording.
fn write_late(place: &Workspace) {
    let grey = |i: usize| {
        let (frame, x, y) = (i / 384, i % 24, i / 24 % 16);
        let time = if x < 12 { 0.0 } else { frame as f64 };
        ((40.0 + 7.0 * y as f64) * (1.0 + 0.6 * (0.5 * x as f64 - 0.7 * time).sin())).round()
    };
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a grey")]
    let values: Vec<u8> = (0..50 * 384).map(|i| grey(i) as u8).collect();
    write_array(place, "slow.npy", &[50, 16, 24], values);
    write_array(place, "slow_us.npy", &[50], (0..50).map(|i: i64| 20_000 * i).collect());
    write_array(place, "late_us.npy", &[50], (0..50).map(|i: i64| 20_000 * i + 1700).collect());
}

fn write_array<T: npyz::AutoSerialize>(place: &Workspace, name: &str, shape: &[u64], values: Vec<T>) {
    let file = File::create(place.path(name)).unwrap();
    let mut writer = npyz::WriteOptions::new().default_dtype().shape(shape).writer(file).begin_nd().unwrap();
    writer.extend(values).unwrap();
    writer.finish().unwrap();
}

fn study(place: &Workspace, events: &str, more: &str) -> Value {
    let inputs = format!("--frames slow.npy --stamps slow_us.npy --events {events} --size 24x16");
    serde_json::from_str(&place.ok(&format!("study real {inputs} {more} --json")).stdout).unwrap()
}

fn row<'a>(found: &'a Value, sensor: &str) -> &'a Value {
    found["sensors"].as_array().unwrap().iter().find(|row| row["sensor"] == sensor).unwrap()
}

#[test]
fn a_late_recording_is_aligned_and_read_outs_are_masked() {
    let place = Workspace::new();
    write_late(&place);
    place.ok("simulate --frames slow.npy --stamps late_us.npy --sensor esim --out late.csv");
    let found = study(&place, "late.csv", "");
    let esim = row(&found, "esim");
    // ESIM has no noise: the same events, but for those near the ends.
    assert!((esim["delay_us"].as_i64().unwrap() - 1700).abs() <= 200, "{esim}");
    for figure in ["ncc", "counts_r"] {
        assert!(esim[figure].as_f64().unwrap() > 0.97, "{figure}: {esim}");
    }
    // Half of the columns stand still, and no sensor without noise sees them.
    assert_eq!(found["pixels"], serde_json::json!({ "still": 192, "moving": 192, "clipped": 0 }));
    assert_eq!(esim["still_rate_ev_px_s"], 0.0);
    let moving = esim["moving_rate_ev_px_s"].as_f64().unwrap();
    assert!((moving - 2.0 * esim["rate_ev_px_s"].as_f64().unwrap()).abs() < 1e-9, "{esim}");
    assert!(row(&found, "v2e-noisy")["still_rate_ev_px_s"].as_f64().unwrap() > 0.1);
    let recording = &found["recording"];
    for side in ["contrast_on", "contrast_off"] {
        let [real, made] = [recording, esim].map(|row| row[side].as_f64().unwrap());
        assert!((real / made - 1.0).abs() < 0.1, "{side}: {real} {made}");
    }

    // A burst 300 us after each stamp, in every pixel.
    let events = fs::read_to_string(place.path("late.csv")).unwrap();
    let burst = (0..49).flat_map(|frame| (0..384).map(move |i| (20_000 * frame + 300, i % 24, i / 24)));
    let burst = burst.map(|(us, x, y)| format!("{us},{x},{y},1"));
    let mut lines: Vec<String> = events.lines().map(str::to_owned).chain(burst).collect();
    // The head of the file stays first.
    lines.sort_by_key(|line| line.split(',').next().and_then(|us| us.parse::<i64>().ok()));
    place.write("burst.csv", lines.join("\n") + "\n");
    let disturbed = study(&place, "burst.csv", "");
    let [masked, clean] =
        ["burst.csv", "late.csv"].map(|events| study(&place, events, "--mask -200..600 --csv masked.csv"));
    assert_eq!(masked["recording"], clean["recording"]);
    assert_eq!(row(&masked, "esim"), row(&clean, "esim"));
    // 800 us of 20 ms do not count, and neither do the events that fall there.
    let seconds = masked["seconds"].as_f64().unwrap();
    assert!((seconds - (0.98 - 49.0 * 800e-6)).abs() < 1e-9, "{seconds}");
    assert!(masked["masked"].as_u64().unwrap() >= 49 * 384);
    let share = |of: &Value| of["recording"]["on_share"].as_f64().unwrap();
    assert!(share(&disturbed) > share(&clean) + 0.1);
    let table = fs::read_to_string(place.path("masked.csv")).unwrap();
    assert!(table.lines().next().unwrap().ends_with(",distance,still_rate_ev_px_s,still_on_share,moving_rate_ev_px_s,moving_on_share,delay_us,ncc,counts_r,contrast_on,contrast_off,lag_us"), "{table}");

    let inputs = "--frames slow.npy --stamps slow_us.npy --events late.csv";
    let message = place.ok(&format!("study real {inputs}")).stdout;
    assert!(
        message.contains("pixels: 192 still, 192 moving") && message.lines().all(|line| line.len() <= 100)
    );
    let message = place.refused(&format!("study real {inputs} --mask=-10000..10000"));
    assert!(message.contains("outside of the mask"), "{message}");
    let message = place.refused(&format!("study real {inputs} --mask 600"));
    assert!(message.contains("wanted two whole numbers of microseconds"), "{message}");
}

/// Frames and events of one file, which another program wrote.
#[test]
fn a_camera_file_has_frames_and_events() {
    let place = Workspace::new();
    let file = fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fuzz/corpus/davis.aedat4")).unwrap();
    place.write("davis.aedat4", &file);
    let ended = place.ok("study real --frames davis.aedat4 --events davis.aedat4 --json");
    assert!(ended.stderr.contains("at the middle of their exposures of 4000 us"), "{}", ended.stderr);
    let found: Value = serde_json::from_str(&ended.stdout).unwrap();
    // Stamps from 1.002 s to 1.062 s.
    assert_eq!(found["seconds"], 0.06);
    let outside = found["outside"].as_u64().unwrap();
    assert_eq!(found["recording"]["events"].as_u64().unwrap() + outside, 80, "{found:#}");
    place.ok("simulate --frames davis.aedat4 --sensor esim --out events.csv");
    let message = place.refused("simulate --frames davis.aedat4 --fps 50 --sensor esim --out other.csv");
    assert!(message.contains("the frames of davis.aedat4 have stamps"), "{message}");
    place.write("cut.aedat4", &file[..2500]);
    let ended = place.gs2e("study real --frames cut.aedat4 --events davis.aedat4");
    assert!(ended.code == 1 && ended.stderr.contains("truncated"), "{}", ended.stderr);
    place.ok("convert davis.aedat4 frameless.aedat4");
    let ended = place.gs2e("study real --frames frameless.aedat4 --events davis.aedat4");
    assert!(ended.code == 1 && ended.stderr.contains("it has no stream of frames"), "{}", ended.stderr);
}
