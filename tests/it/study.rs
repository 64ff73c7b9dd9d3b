//! `gs2e study thresholds`, through the program. What it counts is held against planted jumps in the library.

use crate::support::workspace::{TINY, Workspace};
use serde_json::Value;
use std::fs;

#[test]
fn thresholds_are_swept_over_a_built_scene() {
    let place = Workspace::with_tiny();
    let told = place.gs2e("study thresholds tiny.yaml");
    assert_eq!(told.code, 1, "{}", told.stderr);
    assert!(told.stderr.contains("tiny/capture is not built"), "{}", told.stderr);
    place.ok("build tiny.yaml");
    let sweep = "study thresholds tiny.yaml --span 0,5 --csv t.csv --picture t.png";
    let told = place.ok(sweep).stdout;
    assert!(told.starts_with("tiny/base: 12 frames, 4.6 ms, rendered by two rules"), "{told}");
    assert!(told.lines().last().unwrap().starts_with("recommended: "), "{told}");
    let table = fs::read_to_string(place.path("t.csv")).unwrap();
    let rows: Vec<Vec<f64>> =
        table.lines().skip(1).map(|row| row.split(',').map(|v| v.parse().unwrap()).collect()).collect();
    let thresholds: Vec<f64> = rows.iter().map(|row| row[0]).collect();
    assert_eq!(thresholds, [0.25, 0.5, 0.75, 1.0, 1.25, 1.5]);
    for row in &rows {
        let [events, smooth, near, other] = [row[2], row[6], row[7], row[8]];
        assert!((smooth + near + other - events).abs() < 0.5, "{row:?}");
    }
    assert!(rows.windows(2).all(|pair| pair[0][2] > pair[1][2]), "the lower the more");
    assert!(fs::read(place.path("t.png")).unwrap().starts_with(b"\x89PNG"));
    // The same numbers again, for programs; and nothing in the store was touched.
    let json: Value = serde_json::from_str(&place.ok(&format!("{sweep} --json")).stdout).unwrap();
    assert_eq!(json["rows"].as_array().unwrap().len(), 6);
    assert_eq!(json["rows"][0]["events"].as_f64(), Some(rows[0][2]));
    assert!(place.stale("tiny.yaml").is_empty());
}

#[test]
fn what_is_swept_is_seen_through_the_front_end() {
    let place = Workspace::with_tiny();
    let events = |front_end: &str| {
        let sensor = format!("preset: dvs346, front_end: {front_end},");
        place.write("tiny.yaml", TINY.replace("preset: dvs346,", &sensor));
        place.ok("build tiny.yaml");
        let told = place.ok("study thresholds tiny.yaml --span 0,5 --thresholds 1 --json").stdout;
        let told: Value = serde_json::from_str(&told).unwrap();
        told["rows"][0]["events"].as_u64().unwrap()
    };
    let plain = events("{}");
    assert!(plain > 100, "{plain}");
    assert_eq!(events("{ exposure: 1, luminance: rec601 }"), plain);
    assert_ne!(events("{ decode: srgb }"), plain);
    // Nothing changes in a brightness that is held.
    let dark = events("{ range: { min: 254, max: 255 } }");
    assert!(dark < plain / 10, "{dark}");
}

#[test]
fn what_cannot_be_swept_is_told() {
    let place = Workspace::with_tiny();
    place.ok("build tiny.yaml");
    let refused = |args: &str, wanted: &str| {
        let told = place.gs2e(&format!("study thresholds tiny.yaml {args}"));
        assert_eq!(told.code, 2, "{args}: {}", told.stderr);
        assert!(told.stderr.contains(wanted), "{args}: {}", told.stderr);
    };
    refused("--trajectory other", "tiny has no trajectory `other`; it has base");
    refused("--thresholds 1,0.5", "wanted rising numbers");
    refused("--thresholds 0", "wanted rising numbers");
    refused("--span 5,1", "is not T0,T1");
    refused("--span 1e6,2e6", "0 poses lie from");
    refused("--csv nowhere/t.csv", "a folder that is not there");
    place.write(
        "two.yaml",
        TINY.replace("voltmeter: { preset: dvs346, threshold: { on: 1.0, off: 1.0 } }", "v2e: {}"),
    );
    let told = place.gs2e("study thresholds two.yaml");
    assert_eq!(told.code, 2);
    assert!(told.stderr.contains("is v2e, wanted a voltmeter"), "{}", told.stderr);
}
