//! EventNeRF and E-3DGS: the count of events between two poses against the change of the logarithm.

use super::TestExport;
use super::arrays::{read_npz, rows};
use super::plane::{self, FOCAL, POSES, Plane, SIZE, THRESHOLD};
use glam::{DMat3, DQuat, DVec2, DVec3};
use std::collections::BTreeMap;
use std::path::Path;

/// Events as the loaders read them: x, y, t and a sign.
fn events(file: &Path) -> Vec<(u16, u16, f64, i64)> {
    let sides = ["x", "y"].map(|name| read_npz::<i32>(file, name).values);
    let (t, p) = (read_npz::<f64>(file, "t").values, read_npz::<i64>(file, "p").values);
    assert!(t.is_sorted() && p.iter().all(|p| p.abs() == 1), "a polarity of 0 would count nothing");
    let [x, y] = sides.map(|side| side.into_iter().map(|v| u16::try_from(v).unwrap()).collect::<Vec<_>>());
    (0..t.len()).map(|k| (x[k], y[k], t[k], p[k])).collect()
}

/// A pose of a text of 4x4 numbers.
fn pose(text: &str) -> (DVec3, DQuat) {
    let rows = rows(text);
    assert_eq!((rows.len(), &rows[3][..]), (4, &[0.0, 0.0, 0.0, 1.0][..]));
    let column = |at: usize| DVec3::new(rows[0][at], rows[1][at], rows[2][at]);
    (column(3), DQuat::from_mat3(&DMat3::from_cols(column(0), column(1), column(2))))
}

/// RMS and largest difference of signed count and change of the logarithm, in events, over windows of
/// the poses. `poses` are in the world of the plane, with their times.
fn count_errors(
    events: &[(u16, u16, f64, i64)],
    poses: &[(f64, (DVec3, DQuat))],
    camera: &[Vec<f64>],
) -> [f64; 2] {
    let mut counts: BTreeMap<(u16, u16, usize), i64> = BTreeMap::new();
    let mut pixels: BTreeMap<(u16, u16), ()> = BTreeMap::new();
    for (x, y, t, p) in events.iter().filter(|event| [event.0, event.1] != plane::ODD) {
        let window = poses[1..].partition_point(|(end, _)| end < t);
        *counts.entry((*x, *y, window)).or_default() += p;
        pixels.insert((*x, *y), ());
    }
    let (mut squares, mut largest, mut n) = (0.0, 0.0f64, 0u32);
    for (x, y) in pixels.into_keys() {
        let place = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let ray =
            DVec3::new((place.x - camera[0][2]) / camera[0][0], (place.y - camera[1][2]) / camera[1][1], 1.0);
        let logs: Vec<f64> =
            poses.iter().map(|(_, (centre, turn))| plane::log_brightness(*centre, *turn * ray)).collect();
        for window in 0..poses.len() - 1 {
            let count = counts.get(&(x, y, window)).copied().unwrap_or(0);
            let off = (logs[window + 1] - logs[window]) / THRESHOLD - count as f64;
            squares += off * off;
            largest = largest.max(off.abs());
            n += 1;
        }
    }
    [(squares / f64::from(n)).sqrt(), largest]
}

/// Counts are whole numbers. The level lags the logarithm by less than a threshold at either end of a
/// window, so no window is 2 off; two independent lags, uniform from -1 to 1, have an RMS of
/// sqrt(2/3). A polarity of 0 would give 0.99, windows that are shifted by 8 % 1.16.
const MOST: [f64; 2] = [0.8165, 2.0];

#[test]
fn windows_of_eventnerf_count_the_change_between_their_poses() {
    let plane: &Plane = plane::centred();
    let exported = TestExport::of(plane, "eventnerf", &[]);
    assert_eq!(exported.losses("approximate"), Vec::<String>::new());
    let facts = &exported.json("export.json")["facts"];
    let origin: [f64; 3] = serde_json::from_value(facts["similarity"]["origin"].clone()).unwrap();
    let scale = facts["similarity"]["scale"].as_f64().unwrap();
    let found = events(&exported.path("train/events/events.npz"));
    // Its windows are shares of the last event's time.
    assert_eq!((found.len(), found.last().unwrap().2), (plane.events, 1000.0));
    let names = exported.list("train/pose");
    assert_eq!(names.len(), 101);
    for kind in ["intrinsics", "rgb"] {
        let stems = |names: Vec<String>| names.iter().map(|n| n[..7].to_owned()).collect::<Vec<_>>();
        assert_eq!(stems(exported.list(&format!("train/{kind}"))), stems(names.clone()));
    }
    let camera = rows(&exported.text("train/intrinsics/r_00000.txt"));
    assert_eq!([camera[0][0], camera[0][2], camera[1][2]], [FOCAL, plane.centre.x, plane.centre.y]);
    let mut poses = Vec::new();
    for (k, name) in names.iter().enumerate() {
        let (centre, turn) = pose(&exported.text(&format!("train/pose/{name}")));
        assert!(centre.length() < 1.0, "a camera outside of the unit sphere");
        let share = k as f64 / (names.len() - 1) as f64;
        poses.push((1000.0 * share, (centre / scale + DVec3::from_array(origin), turn)));
    }
    for step in [1, 10] {
        let windows: Vec<_> = poses.iter().copied().step_by(step).collect();
        let [rms, largest] = count_errors(&found, &windows, &camera);
        eprintln!("eventnerf, windows of {step}: {rms:.3} RMS, {largest:.2} at most");
        assert!(rms < MOST[0] && largest < MOST[1], "{rms} {largest}");
    }
    // The other sets have the same events, and the held-out frames.
    let held_out = POSES.div_ceil(plane.sharp_every).div_ceil(8);
    for set in ["validation", "test"] {
        assert_eq!(exported.list(&format!("{set}/rgb")).len(), held_out);
        assert!(exported.path(&format!("{set}/events/events.npz")).exists());
    }
}

#[test]
fn windows_of_e_3dgs_end_at_the_times_in_their_names() {
    let plane: &Plane = plane::centred();
    let exported = TestExport::of(plane, "e-3dgs", &["--lossy"]);
    let found = events(&exported.path("train/events/events.npz"));
    assert_eq!(found.len(), plane.events);
    let names = exported.list("train/pose");
    assert_eq!(names.len(), POSES);
    let camera = rows(&exported.text("train/intrinsics/intrinsics_000000.txt"));
    let timed = |name: &String| {
        let t = name[7..19].parse::<f64>().unwrap();
        (t, pose(&exported.text(&format!("train/pose/{name}"))))
    };
    let poses: Vec<_> = names.iter().step_by(20).map(timed).collect();
    let [rms, largest] = count_errors(&found, &poses, &camera);
    eprintln!("e-3dgs: {rms:.3} RMS, {largest:.2} at most");
    assert!(rms < MOST[0] && largest < MOST[1], "{rms} {largest}");
    let file = std::fs::File::open(exported.path("train/intrinsics/color_mask_undistorted.png")).unwrap();
    let mask = gs2e_image::png::read_rgb(std::io::BufReader::new(file)).unwrap();
    assert!(mask.size() == SIZE && mask.pixels().iter().all(|rgb| *rgb == [255; 3]));
}

/// The loader divides by the time of the last event, which ends before the last pose.
#[test]
fn the_last_event_of_a_window_is_at_its_last_pose() {
    let plane: &Plane = plane::centred();
    // Pose 300 of 2,400 a second.
    let exported = TestExport::of(plane, "eventnerf", &["--window", "50000..125000"]);
    let found = events(&exported.path("train/events/events.npz"));
    assert_eq!(found.last().unwrap().2, 1000.0);
    assert_eq!(exported.json("export.json")["selection"]["window_us"], serde_json::json!([50000, 125_000]));
    let whole = events(&TestExport::of(plane, "eventnerf", &[]).path("train/events/events.npz"));
    // Times of the whole are shares of its 200 ms.
    let us = |t: f64| (t * 200.0).round();
    let inside = whole.iter().filter(|event| (50_000.0..=125_000.0).contains(&us(event.2))).count();
    assert_eq!(found.len(), inside);
}
