//! `gs2e simulate` with a front end.

use super::{COUNT, RIGHT, SHAPE, SIZE, STAMPS_US, as_lines, greys, lines, npy, workspace};
use crate::support::workspace::Workspace;
use gs2e_event::Event;
use gs2e_image::{Image, png};
use gs2e_num::seed::Seed;
use gs2e_sensor::frames::DenseFrame;
use gs2e_sensor::frames::array::{ArrayFrames, ArraySamples};
use gs2e_sensor::simulate_one;
use gs2e_sensor::voltmeter::{VoltmeterModel, VoltmeterPreset};
use serde_json::Value;
use std::fs::{self, File};
use std::ops::ControlFlow;

/// Lines sorted by pixel, so that events of one pixel can be compared.
fn by_pixel(mut lines: Vec<[i64; 4]>) -> Vec<[i64; 4]> {
    lines.sort_by_key(|[t, x, y, _]| (*y, *x, *t));
    lines
}

/// Above its straight piece the curve is `((v + 0.055)/1.055)^2.4`, so the logarithm of light is
/// 2.4 times that of `v + 0.055`, plus a constant. ESIM with this eps and the threshold divided by
/// 2.4 therefore sees the encoded clip as ESIM without an eps sees its light. Small multiples of
/// the thresholds up and down do not coincide, so that no whole grey returns to a level exactly.
#[test]
fn the_logarithm_of_light_is_that_of_the_display_value() {
    let place = workspace();
    assert!(greys().into_iter().all(|v| f64::from(v) / 255.0 > 0.041));
    place.write(
        "light.yaml",
        "esim: { threshold: { on: 0.24, off: 0.33936 }, eps: 1e-12, front_end: { decode: srgb } }\n",
    );
    place.write("encoded.yaml", "esim: { threshold: { on: 0.1, off: 0.1414 }, eps: 0.055 }\n");
    place.ok(&RIGHT.replace("dvs346", "light.yaml"));
    let light = by_pixel(lines(&place, "e.txt"));
    place.ok(&RIGHT.replace("dvs346", "encoded.yaml"));
    let encoded = by_pixel(lines(&place, "e.txt"));
    assert!(light.len() > 5000);
    assert_eq!(light.len(), encoded.len());
    for (a, b) in light.iter().zip(&encoded) {
        // Brightness of 24 bits moves a crossing by less than a microsecond, which is one step of
        // the written times.
        assert!((a[0] - b[0]).abs() <= 1 && a[1..] == b[1..], "{a:?} {b:?}");
    }
    // Another order of magnitude of light is another zero of its logarithm.
    place.ok(&RIGHT.replace("dvs346", "light.yaml --exposure 4096"));
    assert_eq!(by_pixel(lines(&place, "e.txt")).len(), light.len());
    place.ok(&RIGHT.replace("dvs346", "light.yaml --decode none"));
    assert_ne!(by_pixel(lines(&place, "e.txt")).len(), light.len());
}

/// A folder of colour images. The clip is in red; green and blue are constant.
fn colours(place: &Workspace) {
    fs::create_dir(place.path("rgb")).unwrap();
    for (i, red) in greys().chunks(SIZE.pixels()).enumerate() {
        let image = Image::from_vec(SIZE, red.iter().map(|r| [*r, 100, 50]).collect());
        png::write_image(&image, File::create(place.path(&format!("rgb/{i:02}.png"))).unwrap()).unwrap();
    }
}

/// The library's events for these greys.
fn of_greys(greys: Vec<u8>) -> Vec<Event> {
    let mut frames = ArrayFrames::new(SIZE, ArraySamples::Bytes(greys), &STAMPS_US).unwrap();
    let mut events = Vec::new();
    let mut go_on = |_: &DenseFrame| ControlFlow::Continue(());
    let sensor = VoltmeterModel::new(VoltmeterPreset::Dvs346.k());
    simulate_one(&mut frames, &sensor, Seed(7), &mut events, &mut go_on).unwrap();
    events
}

#[test]
fn weights_choose_the_visible_colours() {
    let place = workspace();
    colours(&place);
    let run = |options: &str| {
        let ended = place.ok(&format!("{} {options} --json", RIGHT.replace("frames.npy", "rgb")));
        let found: Value = serde_json::from_str(&ended.stdout).unwrap();
        (lines(&place, "e.txt"), found, ended.stderr)
    };
    let (plain, found, words) = run("");
    assert_eq!(found["sensor"]["voltmeter"].get("front_end"), None);
    assert!(!words.contains("brightness:"), "{words}");
    assert_eq!(run("--luminance rec601 --decode none --exposure 1 --range 0,inf").0, plain);
    let (red, found, words) = run("--luminance 1,0,0");
    assert_eq!(red, as_lines(&of_greys(greys())));
    assert_eq!(found["sensor"]["voltmeter"]["front_end"]["luminance"]["weights"][0], 1.0);
    assert!(words.contains("brightness: 1 R + 0 G + 0 B, display-encoded\n"), "{words}");
    // A constant channel makes the same noise as a constant grey.
    assert_eq!(run("--luminance 0,0,1").0, as_lines(&of_greys(vec![50; greys().len()])));
    let held = greys().into_iter().map(|v| v.clamp(90, 140)).collect();
    assert_eq!(run("--luminance 1,0,0 --range 90,140").0, as_lines(&of_greys(held)));
    assert_ne!(run("--luminance rec709").0, plain);
    assert_ne!(run("--decode srgb").0, plain);
    // Grey frames need no weights.
    place.ok(RIGHT);
    let grey = lines(&place, "e.txt");
    place.ok(&format!("{RIGHT} --luminance rec709"));
    assert_eq!(lines(&place, "e.txt"), grey);
}

#[test]
fn rates_of_greys_go_through_the_curve_and_those_of_colours_are_refused() {
    let place = workspace();
    colours(&place);
    let rates: Vec<f32> = (0..greys().len()).map(|i| (i % 7) as f32 * 100.0).collect();
    npy(&place.path("rates.npy"), &SHAPE, &rates);
    let hermite = format!("{RIGHT} --rates rates.npy --between hermite --full-scale 255");
    place.ok(&hermite);
    let plain = lines(&place, "e.txt");
    place.ok(&format!("{hermite} --decode srgb"));
    assert_ne!(lines(&place, "e.txt"), plain);
    let of_colours = hermite.replace("frames.npy", "rgb");
    place.ok(&of_colours);
    let refused = place.gs2e(&format!("{of_colours} --decode srgb"));
    assert_eq!(refused.code, 2, "{}", refused.stderr);
    assert!(refused.stderr.contains("rates of change of luminance rec601"), "{}", refused.stderr);
    assert_eq!(COUNT, STAMPS_US.len());
}

#[test]
fn invalid_options_are_refused() {
    let place = workspace();
    let t = |options: &str, wanted: &str| {
        let ended = place.gs2e(&format!("{RIGHT} {options}"));
        assert_eq!(ended.code, 2, "{options}: {}", ended.stderr);
        assert!(ended.stderr.contains(wanted), "{options}: {}", ended.stderr);
        assert!(!place.path("e.txt").exists());
    };
    t("--luminance 1,1,1", "sum to 3, wanted three weights of at least 0 with a sum of 1");
    t("--luminance 0.5,0.5", "is not R,G,B: three numbers");
    t("--luminance rec2020", "is not rec601, rec709, or R,G,B");
    t("--decode gamma", "unknown variant `gamma`");
    t("--exposure 0", "the exposure is 0, wanted a finite number above 0");
    t("--range 9,5", "the range is 9 to 5, wanted 0 <= min < max");
    t("--range 9", "is not MIN,MAX");
}
