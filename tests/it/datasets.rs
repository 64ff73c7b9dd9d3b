//! `gs2e check --events`: datasets that this program did not make.
//!
//! The dataset is made here in closed form: a texture moves over the sensor, and a pixel has an event
//! where the logarithm of its brightness crosses a multiple of a threshold from a random start.

mod faults;

use crate::support::workspace::Workspace;
use gs2e_image::{Image, Size, png};
use serde_json::Value;
use std::fmt::Write as _;
use std::fs;

/// Columns and rows.
pub(crate) const WIDTH: u16 = 48;
pub(crate) const HEIGHT: u16 = 36;
/// Length, us, and the step at which crossings are looked for.
pub(crate) const END_US: i64 = 100_000;
const STEP_US: usize = 25;
/// Interval of the frames, us.
const FRAME_US: usize = 1000;
/// The planted thresholds.
const ON: f64 = 0.15;
const OFF: f64 = 0.22;

/// Logarithm of the brightness on the scale 0..1, between 0.1 and 0.9.
fn log_brightness(x: f64, y: f64, t_us: f64) -> f64 {
    // 600 px/s to the right, 180 down.
    let (u, v) = (x - 6e-4 * t_us, y - 1.8e-4 * t_us);
    let waves = [(0.31, 0.17, 0.3), (0.11, -0.29, 1.7), (-0.23, 0.07, 4.1), (0.05, 0.41, 2.2)];
    -1.2 + 0.27 * waves.iter().map(|(a, b, c)| (a * u + b * v + c).sin()).sum::<f64>()
}

/// A fixed number between 0 and 1 for a pixel.
pub(crate) fn phase(pixel: u16) -> f64 {
    (f64::from(pixel) * 0.618_033_988_749_895).fract()
}

/// The events: time, column, row, polarity; sorted.
fn events() -> Vec<(i64, u16, u16, u8)> {
    let mut found = Vec::new();
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let at = |t_us: i64| log_brightness(f64::from(x), f64::from(y), t_us as f64);
            // The pixel is anywhere between two events at the first instant.
            let mut level = at(0) + (phase(y * WIDTH + x) * (ON + OFF) - ON);
            for t_us in (25..=END_US).step_by(STEP_US) {
                let value = at(t_us);
                while value >= level + ON {
                    level += ON;
                    found.push((t_us, x, y, 1));
                }
                while value <= level - OFF {
                    level -= OFF;
                    found.push((t_us, x, y, 0));
                }
            }
        }
    }
    found.sort_unstable();
    found
}

pub(crate) type Row = (i64, u16, u16, u8);

/// The folder `set` in the layout of the Event-Camera Dataset, with each event changed by `change`.
pub(crate) fn write_set<I: IntoIterator<Item = Row>>(place: &Workspace, change: impl Fn(Row) -> I) {
    let mut rows: Vec<Row> = events().into_iter().flat_map(change).collect();
    rows.sort_unstable();
    let mut text = String::new();
    for (t_us, x, y, p) in rows {
        writeln!(text, "{}.{:06} {x} {y} {p}", t_us / 1_000_000, t_us % 1_000_000).unwrap();
    }
    place.write("set/events.txt", text);
    let mut stamps = String::new();
    for (number, t_us) in (0..=END_US).step_by(FRAME_US).enumerate() {
        let grey = |pixel: u16| {
            let (x, y) = (pixel % WIDTH, pixel / WIDTH);
            let value = 255.0 * log_brightness(f64::from(x), f64::from(y), t_us as f64).exp();
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 25 to 230")]
            let value = value.round() as u8;
            [value; 3]
        };
        let size = Size { width: WIDTH.into(), height: HEIGHT.into() };
        let image = Image::from_vec(size, (0..WIDTH * HEIGHT).map(grey).collect());
        let name = format!("images/frame_{number:08}.png");
        let mut bytes = Vec::new();
        png::write_image(&image, &mut bytes).unwrap();
        place.write(&format!("set/{name}"), bytes);
        writeln!(stamps, "{}.{:06} {name}", t_us / 1_000_000, t_us % 1_000_000).unwrap();
    }
    place.write("set/images.txt", stamps);
    let pose = |t_us: i64| format!("0.{t_us:06} {} 0 0 0 0 0 1\n", t_us as f64 * 1e-6);
    place.write("set/groundtruth.txt", (0..100).map(|i| pose(1000 * i)).collect::<String>());
}

/// The exit code, and the findings by `check#part`.
pub(crate) fn check(place: &Workspace, args: &str) -> (i32, Vec<(String, Value)>) {
    let ended = place.gs2e(&format!("check --events set --as tum --json {args}"));
    let named = |line: &str| {
        let finding: Value = serde_json::from_str(line).unwrap();
        let part = finding["subject"].as_str().unwrap().strip_prefix("set").unwrap().to_owned();
        (format!("{}{part}", finding["check"].as_str().unwrap()), finding)
    };
    assert!(!ended.stdout.is_empty(), "{}", ended.stderr);
    (ended.code, ended.stdout.lines().map(named).collect())
}

pub(crate) fn measured(findings: &[(String, Value)], name: &str) -> f64 {
    let found = findings.iter().find(|(own, _)| own == name);
    found.unwrap_or_else(|| panic!("no {name}: {findings:#?}")).1["measured"].as_f64().unwrap()
}

pub(crate) fn verdict(findings: &[(String, Value)], name: &str) -> String {
    let found = findings.iter().find(|(own, _)| own == name);
    found.unwrap_or_else(|| panic!("no {name}: {findings:#?}")).1["verdict"].as_str().unwrap().to_owned()
}

#[test]
fn a_sound_set_shows_its_thresholds_and_its_clock() {
    let place = Workspace::new();
    write_set(&place, Some);
    let (code, found) = check(&place, "--report page.html");
    assert_eq!(code, 0, "{found:#?}");
    assert!(found.iter().all(|(_, f)| f["verdict"] != "fail" && f["verdict"] != "warn"), "{found:#?}");
    // The estimate of thousands of pixels of random phase is within a few of its standard errors.
    let [on, off] = ["on", "off"].map(|side| measured(&found, &format!("event_frame#threshold-{side}")));
    assert!((on / ON - 1.0).abs() < 0.05 && (off / OFF - 1.0).abs() < 0.05, "{on} {off}");
    // Brightness is the grey of the frames here, not linear light.
    let decode = found.iter().find(|(name, _)| name == "event_frame#decode").unwrap();
    assert!(decode.1["because"].as_str().unwrap().contains("% in the grey of the frames, and by"));
    let offset = measured(&found, "time_offset");
    assert!(offset.abs() < 100.0, "{offset}");
    assert!((measured(&found, "stamps#grid") - 1.0).abs() < 1e-9);
    assert_eq!(verdict(&found, "pose_continuity#translation"), "pass");
    let page = fs::read_to_string(place.path("page.html")).unwrap();
    assert!(page.contains("This dataset looks sound"), "{page}");
    assert!(page.starts_with("<!DOCTYPE html>") && page.matches("<img").count() == 2, "{page}");
}

#[test]
fn planted_faults_are_named() {
    let place = Workspace::new();
    let t = |change: &dyn Fn(Row) -> Option<Row>, name: &str, wanted: &str| {
        write_set(&place, change);
        let (_, found) = check(&place, "");
        assert_eq!(verdict(&found, name), wanted, "{found:#?}");
        found
    };
    let because = |found: &[(String, Value)], name: &str| {
        let found = found.iter().find(|(own, _)| own == name).unwrap();
        found.1["because"].as_str().unwrap().to_owned()
    };
    let found = t(&|(t, x, y, p)| Some((t, x, y, 1 - p)), "event_frame#correlation", "fail");
    assert!(because(&found, "event_frame#correlation").contains("polarity is reversed"));
    let found = t(&|(t, x, y, p)| Some((t, 47 - x, y, p)), "event_frame#correlation", "fail");
    assert!(because(&found, "event_frame#correlation").contains("mirrored left to right"));
    let found = t(&|(t, x, y, p)| Some((t, x, 35 - y, p)), "event_frame#correlation", "fail");
    assert!(because(&found, "event_frame#correlation").contains("mirrored top to bottom"));
    let found = t(&|(t, x, y, p)| Some((t + 2500, x, y, p)), "time_offset", "fail");
    let offset = measured(&found, "time_offset");
    assert!((offset - 2500.0).abs() < 150.0, "{offset}");
    // 3 % slow.
    let found = t(&|(t, x, y, p)| Some((t * 103 / 100, x, y, p)), "time_offset#drift", "fail");
    let drift = measured(&found, "time_offset#drift");
    assert!((drift - 0.03).abs() < 0.004, "{drift}");
    let found = t(&|(t, x, y, p)| Some((t / 100 * 100, x, y, p)), "stamps#grid", "warn");
    assert!((measured(&found, "stamps#grid") - 100.0).abs() < 1e-9);
    let found = t(&|(t, x, y, p)| Some((t / 1000 * 1000, x, y, p)), "stamps#grid", "fail");
    assert!((measured(&found, "stamps#grid") - 1000.0).abs() < 1e-9);
    // Every second OFF event is lost: their threshold doubles, as far as the files show.
    let lost = |(t, x, y, p): Row| (p == 1 || (t / 25) % 2 == 0).then_some((t, x, y, p));
    let found = t(&lost, "event_frame#threshold-off", "pass");
    assert!((measured(&found, "event_frame#threshold-off") / (2.0 * OFF) - 1.0).abs() < 0.15);
}

#[test]
fn inputs_that_do_not_fit_are_refused() {
    let place = Workspace::new();
    write_set(&place, Some);
    let t = |args: &str, code: i32, words: &str| {
        let ended = place.gs2e(args);
        assert_eq!(ended.code, code, "gs2e {args}: {}", ended.stderr);
        assert!(ended.stderr.contains(words), "gs2e {args}: {}", ended.stderr);
    };
    t("check --events gone.h5", 2, "events: gone.h5 does not exist");
    t("check --events set/events.txt", 1, "--size");
    t("check --events set --as tom", 2, "invalid value 'tom'");
    t("check --frames set/images", 2, "--events");
    t("check --events set/events.txt --size 48x36 --time-unit s --frames set/images", 2, "no timestamps");
    t("check --events set/events.txt --size 48x36 --poses set/images.txt", 1, "images.txt: line 1");
    place.write("set/images.txt", "0.1 a\n");
    t("check --events set --as tum", 2, "101 images, and there are 1 stamps");
    assert_eq!(place.gs2e("check --events set/events.txt --size 48x36 --time-unit s").code, 0);
}
