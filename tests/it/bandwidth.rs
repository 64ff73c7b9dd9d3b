//! Pixels of a limited bandwidth, through the binary.

use crate::support::workspace::{TINY, Workspace, same_tree};
use std::fs;

/// The tiny recipe with this bandwidth.
fn tiny(bandwidth: &str) -> String {
    TINY.replace("off: 1.0 } }", &format!("off: 1.0 }}, bandwidth: {bandwidth} }}"))
}

fn released(bandwidth: &str, threads: u32) -> Workspace {
    Workspace::released(&tiny(bandwidth), &format!("-j {threads}"))
}

/// No check takes the filter for a fault, and threads change no byte.
#[test]
fn slow_pixels_are_no_fault() {
    let bandwidth = "{ points: [{ lux: 1, cutoff_hz: 20 }, { lux: 100, cutoff_hz: 200 }] }";
    let [one, two] = [1, 2].map(|threads| released(bandwidth, threads));
    same_tree(&one.path("tree"), &two.path("tree"));
    one.ok("audit tree");
    let scene = one.json("tree/tiny/scene.json");
    let sensor = &scene["trajectories"][0]["sensor"];
    assert_eq!(sensor["bandwidth"]["order"], 1, "{sensor}");
    assert_eq!(sensor["bandwidth"]["points"][1]["cutoff_hz"], 200.0, "{sensor}");
    assert_eq!(sensor["front_end"]["lux"], 250.0, "{sensor}");
    place_checks(&one);
}

/// No pass fails, and those that would take a delay for a fault say that they do not judge it.
fn place_checks(place: &Workspace) {
    let findings = place.json("tree/tiny/base/checks.json").as_array().unwrap().clone();
    let failed: Vec<_> = findings.iter().filter(|finding| finding["verdict"] == "fail").collect();
    assert!(failed.is_empty(), "{failed:?}");
    for check in ["event_frame", "time_offset"] {
        let found = findings.iter().find(|f| f["check"] == check).unwrap();
        assert_eq!(found["verdict"], "not-run", "{found}");
        assert!(found["because"].as_str().unwrap().contains("low-pass filter"), "{found}");
    }
    // From the frames at every pose, one finding a line.
    let all = place.ok("check --tree tree --json").stdout;
    assert!(!all.contains("\"fail\"") && all.contains("not applicable with a low-pass filter"), "{all}");
}

#[test]
fn no_points_are_no_filter() {
    let events = |place: &Workspace| fs::read(place.path("tree/tiny/base/events.h5")).unwrap();
    let without = Workspace::with_tiny();
    without.ok("release --to tree tiny.yaml");
    assert!(events(&without) == events(&released("{ order: 2, points: [] }", 2)));
    assert!(events(&without) != events(&released("{ points: [{ lux: 1, cutoff_hz: 100 }] }", 2)));
}

#[test]
fn a_bandwidth_outside_its_range_is_refused() {
    let place = Workspace::new();
    let t = |bandwidth: &str, wanted: &str| {
        place.write("tiny.yaml", tiny(bandwidth));
        let ended = place.gs2e("plan tiny.yaml");
        assert_eq!(ended.code, 2, "{bandwidth}: {}", ended.stderr);
        assert!(ended.stderr.contains("tiny.yaml:12:"), "{bandwidth}: {}", ended.stderr);
        assert!(ended.stderr.contains(wanted), "{bandwidth}: {}", ended.stderr);
    };
    t("{ order: 3 }", "\"sensor.voltmeter.bandwidth.order\" is 3, wanted a whole number from 1 to 2");
    t("{ points: [{ lux: 1 }] }", "cutoff_hz");
    t("{ points: [{ lux: 1, cutoff_hz: 0 }] }", "is 0, wanted a number above 0");
    t(
        "{ points: [{ lux: 9, cutoff_hz: 1 }, { lux: 1, cutoff_hz: 1 }] }",
        "has lights that do not rise from point to point",
    );
    t("{ points: [{ lux: 1, cutoff_hz: 1 }] }, law: official", "`bandwidth` requires `law: exact`");
}
