//! Sensors by name, one of several sensors of a recipe, and contrast thresholds.

use super::{RIGHT, workspace};
use std::fs;

#[test]
fn names_stand_for_sensors_and_thresholds_for_contrast() {
    let place = workspace();
    place.write("several.yaml", "sensors:\n  a: { esim: {} }\n  b: { v2e: { preset: noisy } }\n");
    place.write("noisy.yaml", "v2e: { preset: noisy }\n");
    place.write("esim.yaml", "esim: { threshold: { on: 0.3, off: 0.25 } }\n");
    let events = |sensor: &str| {
        place.ok(&RIGHT.replace("dvs346", sensor));
        fs::read(place.path("e.txt")).unwrap()
    };
    let noisy = events("noisy.yaml");
    assert!(noisy.len() > 1000);
    assert!(noisy == events("v2e-noisy") && noisy == events("several.yaml:b"));
    assert!(noisy != events("v2e-clean"));
    assert!(events("esim.yaml") == events("esim --threshold 0.3,0.25"));
    // 5.265 is k1 of the preset, so the threshold in its unit is 5.265 times the contrast.
    place.write(
        "dvs.yaml",
        "voltmeter: { preset: dvs346, threshold: { on: 1.579_5, off: 1.579_5 } }\n".replace('_', ""),
    );
    assert!(events("dvs.yaml") == events("dvs346 --threshold 0.3"));
}

#[test]
fn wrong_names_and_thresholds_are_refused() {
    let place = workspace();
    place.write("several.yaml", "sensors:\n  a: { esim: {} }\n  b: { v2e: {} }\n");
    let t = |sensor: &str, part: &str| {
        let ended = place.gs2e(&RIGHT.replace("dvs346", sensor));
        assert_eq!(ended.code, 2, "{sensor}: {}", ended.stderr);
        assert!(ended.stderr.contains(part), "{sensor}: {part}\n{}", ended.stderr);
    };
    t("several.yaml", "it has several sensors: a, b");
    t("several.yaml:c", "it has no sensor c");
    t(
        "gone.yaml:a",
        "gone.yaml:a is neither a file nor a preset: davis346, evk4, dvxplorer, dvs346-paper, dvs240, gs2e-si, v2e-noisy, v2e-clean, esim",
    );
    t("esim --threshold 0", "`0` is not a number above 0");
    t("esim --threshold 0.2,nan", "`0.2,nan` is not a number above 0");
    t("esim --threshold 0.2,0.3,0.4", "is not a number above 0");
}
