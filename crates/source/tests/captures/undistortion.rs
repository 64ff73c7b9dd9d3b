//! Undistorted photos, compared with OpenCV's `undistort`.
//!
//! Both start from one decoded picture. OpenCV rounds positions in the photo to 1/32 px and its
//! weights to 1/32,768, so that a pixel at a sharp edge may have another grey. If Python lacks
//! OpenCV, the test is reported as not run; with `REQUIRE_OPENCV=1` that is a failure.

use super::shared;
use gs2e_image::{Image, jpeg, png};
use gs2e_source::undistort::undistort_photo;
use gs2e_source::{CapturedView, colmap};
use gs2e_testing::absent::absent;
use std::fs::File;
use std::io::{BufReader, BufWriter, Write as _};
use std::path::Path;
use std::process::{Command, Output};

/// Undistorts a picture: from, to, fx, fy, cx, cy with pixel centres at integers, and k1, k2, p1,
/// p2.
const OPENCV: &str = "
import sys, cv2, numpy
fx, fy, cx, cy, *lens = map(float, sys.argv[3:])
picture = cv2.imread(sys.argv[1], cv2.IMREAD_COLOR)
matrix = numpy.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
assert cv2.imwrite(sys.argv[2], cv2.undistort(picture, matrix, numpy.array(lens)))
";

fn python(arguments: &[&str]) -> Option<Output> {
    Command::new("python3").args(arguments).output().ok()
}

/// Returns true if Python has OpenCV. If not, a message goes to stderr.
fn opencv_is_there() -> bool {
    if python(&["-c", "import cv2"]).is_some_and(|output| output.status.success()) {
        return true;
    }
    absent("REQUIRE_OPENCV", "python3 with OpenCV is absent");
    false
}

/// The photo of a view as it was taken.
fn photo(capture: &Path, view: &CapturedView) -> Image<[u8; 3]> {
    let bytes = std::fs::read(capture.join("images").join(&view.name)).unwrap();
    let colours = jpeg::read_colours(&bytes, None).unwrap().colours.unwrap();
    png::to_bytes(&Image::from_vec(
        colours.size(),
        colours.pixels().iter().map(|rgb| rgb.map(|v| v / 255.0)).collect(),
    ))
}

/// OpenCV's undistorted picture of a photo.
fn by_opencv(place: &Path, photo: &Image<[u8; 3]>, view: &CapturedView) -> Image<[u8; 3]> {
    let (taken, straight) = (place.join("taken.png"), place.join("straight.png"));
    png::write_image(photo, BufWriter::new(File::create(&taken).unwrap())).unwrap();
    let camera = view.camera;
    let centre = [camera.cx - 0.5, camera.cy - 0.5];
    let [k1, k2, p1, p2, rest @ ..] = view.lens.coefficients();
    assert!(rest.iter().all(|k| k.abs() < f64::MIN_POSITIVE), "{:?}", view.lens);
    let numbers = [camera.fx, camera.fy, centre[0], centre[1], k1, k2, p1, p2].map(|v| v.to_string());
    let files = [taken.to_str().unwrap(), straight.to_str().unwrap()];
    let arguments: Vec<&str> =
        ["-c", OPENCV].into_iter().chain(files).chain(numbers.iter().map(String::as_str)).collect();
    let output = python(&arguments).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    png::read_rgb(BufReader::new(File::open(&straight).unwrap())).unwrap()
}

/// The share of pixels in which no channel differs by more than one grey level.
fn share_within_one(a: &Image<[u8; 3]>, b: &Image<[u8; 3]>) -> f64 {
    assert_eq!(a.size(), b.size());
    let near = |(a, b): &(&[u8; 3], &[u8; 3])| a.iter().zip(*b).all(|(a, b)| a.abs_diff(*b) <= 1);
    a.pixels().iter().zip(b.pixels()).filter(near).count() as f64 / a.pixels().len() as f64
}

#[test]
fn photos_without_their_lens_are_opencvs() {
    for (name, views) in [("castle", &[0, 5, 10][..]), ("fox", &[0, 49])] {
        let Some(dir) = shared(&format!("captures/{name}")) else { return };
        if !opencv_is_there() {
            return;
        }
        let place = tempfile::tempdir().unwrap();
        let (capture, _) = colmap::read_capture(&dir).unwrap();
        for &index in views {
            let view = &capture.views[index];
            let taken = photo(&dir, view);
            let straight = undistort_photo(&taken, &view.camera, &view.lens);
            let share = share_within_one(&straight, &by_opencv(place.path(), &taken, view));
            drop(writeln!(std::io::stderr(), "{name} {}: {share:.5} within one grey level", view.name));
            assert!(share >= 0.99, "{name} {}: {share}", view.name);
            assert!(share_within_one(&straight, &taken) < 0.9, "{name}: the lens does something");
        }
    }
}
