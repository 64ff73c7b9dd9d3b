//! The motion of a picture along a path, and the shift of events at twice the frames: numbers that hold for
//! any rate.

use crate::support::workspace::Workspace;
use serde_json::Value;

/// A path along a still life at a speed of 100 px/s, or of a number of poses.
fn recipe(path: &str, sampling: &str, sensor: &str) -> String {
    format!(
        "version: 1\nscene: one\nsource: {{ procedural: {{ kind: still-life, gaussians: 2000, views: 8, arc: 12, seed: 1 }} }}\n\
         camera: {{ width: 96, height: 72 }}\ntrajectories:\n  - name: base\n    {path}\n\
         sampling: {{ {sampling} }}\nsensor: {{ {sensor} }}\noutputs: [events]\n"
    )
}

/// The finding of a check, with `subject` ending in these words.
fn finding(place: &Workspace, check: &str, part: &str) -> Value {
    let said = place.gs2e("check --json one").stdout;
    let all = said.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let is_it = |value: &Value| {
        value["check"] == check && value["subject"].as_str().is_some_and(|subject| subject.ends_with(part))
    };
    all.into_iter().find(is_it).unwrap_or_else(|| panic!("{check}#{part}: {said}"))
}

/// The speed times the time is the length of the path in pixels, however the sensor sees it.
#[test]
fn a_path_has_one_length_for_every_sampling() {
    let mut lengths = Vec::new();
    for sampling in ["rate: 1200", "rate: 1200, tolerance: 0.2", "rate: 4800, tolerance: 0.2"] {
        let place = Workspace::new();
        let path = "refine: { window: 2 }\n    speed: { flow: { px_s: 100 } }";
        place.write("recipes/one.yaml", recipe(path, sampling, "voltmeter: { preset: davis346 }"));
        place.ok("build");
        let found = finding(&place, "event_rate", "#flow");
        let because = found["because"].as_str().unwrap();
        let px = because.split_once(" px in total").unwrap_or_else(|| panic!("{found}")).0;
        lengths.push(px.rsplit('(').next().unwrap().parse::<f64>().unwrap());
    }
    // Nine instants of a path whose speed is constant to 1 % at the places where it was measured: with the
    // pixels in between, within a tenth.
    let mean = lengths.iter().sum::<f64>() / 3.0;
    assert!(mean > 3.0 && lengths.iter().all(|px| (px / mean - 1.0).abs() < 0.1), "{lengths:?}");
}

/// Six poses that are far apart. Ten times the rate is a tenth of the time for the same motion: the
/// events between two frames are as wrong, and noise must not hide it.
#[test]
fn noise_does_not_hide_frames_that_are_far_apart() {
    let shift = |rate: &str, sensor: &str| {
        let place = Workspace::new();
        place.write("recipes/one.yaml", recipe("refine: { frames: 6 }", rate, sensor));
        place.ok("build");
        finding(&place, "sampling", "#shift")
    };
    let share = |found: &Value, rate: f64| {
        found["measured"].as_f64().unwrap_or_else(|| panic!("{found}")) * 1e-6 * rate
    };
    let noisy = "voltmeter: { preset: davis346 }";
    let [slow, fast] = [("rate: 2", 2.0), ("rate: 1000", 1000.0)].map(|(text, rate)| {
        let found = shift(text, noisy);
        assert_eq!(found["verdict"], "warn", "{found}");
        share(&found, rate)
    });
    // In parts of a step both are one number, up to the noise of the voltage between the frames.
    assert!(slow > 0.03 && fast > 0.03, "{slow} {fast}");
}
