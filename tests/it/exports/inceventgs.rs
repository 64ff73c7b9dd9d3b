//! IncEventGS.

use super::arrays::{read_npy, rows};
use super::plane::{self, FOCAL, POSES, Plane, SIZE};
use super::{TestExport, refusals, samples};
use glam::DVec3;
use gs2e_event::Polarity;
use gs2e_image::{jpeg, png};
use std::io::BufReader;

#[test]
fn events_are_those_of_the_stream_one_by_one() {
    let plane: &Plane = plane::centred();
    let exported = TestExport::of(plane, "inceventgs", &["--lossy"]);
    assert_eq!(exported.losses("approximate"), ["sensor.brightness"]);
    // The name is in the program's code.
    let array = read_npy::<f64>(&exported.path("event_threshold_0.1/gray_events_data.npy"));
    assert_eq!((array.kind.as_str(), &array.shape[..]), ("'<f8'", &[plane.events as u64, 4][..]));
    for (row, event) in array.values.as_chunks::<4>().0.iter().zip(samples::stream(plane)) {
        let sign = if event.polarity == Polarity::On { 1.0 } else { -1.0 };
        let t_us = event.t.floor_micros();
        assert_eq!([row[0], row[1], row[3]], [f64::from(event.x), f64::from(event.y), sign]);
        assert_eq!((row[2] * 1e6).round() as i64, t_us);
        // In float32, a time below 0.25 s is off by half a spacing at most, 7.5 ns.
        assert!((f64::from(row[2] as f32) - t_us as f64 * 1e-6).abs() < 7.5e-9, "{}", row[2]);
    }
}

#[test]
fn every_picture_has_a_pose_and_a_time() {
    let plane: &Plane = plane::centred();
    let exported = TestExport::of(plane, "inceventgs", &["--lossy"]);
    let (path, stamps) = (rows(&exported.text("traj.txt")), rows(&exported.text("poses_ts.txt")));
    let names = exported.list("images");
    let frames = POSES.div_ceil(plane.sharp_every);
    assert_eq!([path.len(), stamps.len(), names.len()], [frames; 3]);
    for (k, row) in path.iter().enumerate() {
        let t_us = plane::stamp_us(k * plane.sharp_every);
        assert_eq!((stamps[k][0] * 1e6).round() as i64, t_us);
        let truth = plane::pose(t_us as f64 * 1e-6);
        let wanted = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| truth.rotation * axis);
        for (axis, found) in row.chunks(4).take(3).enumerate() {
            let wanted = [wanted[0][axis], wanted[1][axis], wanted[2][axis], truth.translation[axis]];
            // Poses in text have 17 digits; sums of products of numbers up to 2 lose a few bits.
            assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-14), "{k}");
        }
        assert_eq!(row[12..], [0.0, 0.0, 0.0, 1.0]);
    }
    // A JPEG of the highest quality: greys are off by the steps of its transform, 1 each, at most.
    let found = jpeg::read_rgb(&std::fs::read(exported.path("images/000003.jpg")).unwrap(), None).unwrap();
    let file = std::fs::File::open(plane.folder(&format!("sharp/{:06}.png", 3 * plane.sharp_every))).unwrap();
    let truth = png::read_rgb(BufReader::new(file)).unwrap();
    assert_eq!(found.size(), SIZE);
    let apart = found.pixels().iter().zip(truth.pixels()).map(|(a, b)| a[0].abs_diff(b[0]));
    let far = apart.filter(|apart| *apart > 3).count();
    // The planted black pixel has no even neighbourhood.
    assert!(far <= 64, "{far} pixels");
    let config = exported.text("config.yaml");
    assert!(config.contains(&format!("fx: {FOCAL}\n  fy: {FOCAL}\n  cx: 173\n  cy: 130\n")), "{config}");
}

/// The program takes the times of its pictures for uniform.
#[test]
fn frames_at_unequal_distances_are_refused() {
    let release = crate::release::small::copy();
    let sharp = release.path().join("small/one/base/sharp");
    let mut names: Vec<_> = std::fs::read_dir(&sharp).unwrap().map(|entry| entry.unwrap().path()).collect();
    names.sort();
    std::fs::remove_file(&names[2]).unwrap();
    let base = ["--trajectory", "base", "--lossy"];
    refusals::refused(release.path(), "inceventgs", &base, 2, &["us apart, wanted equal distances"]);
}
