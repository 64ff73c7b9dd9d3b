//! Events that are late, through the binary.

use crate::support::workspace::{TINY, Workspace, same_tree};
use std::fs;

/// The tiny recipe with this latency.
fn tiny(latency: &str) -> String {
    TINY.replace("off: 1.0 } }", &format!("off: 1.0 }}, latency: {latency} }}"))
}

fn released(latency: &str, threads: u32) -> Workspace {
    Workspace::released(&tiny(latency), &format!("-j {threads}"))
}

/// The delays are counted, no check takes them for a fault, and threads change no byte.
#[test]
fn late_events_are_counted_and_no_fault() {
    let latency = "{ us: 100, jitter_us: 10, tau_us: 4 }";
    let [one, two] = [1, 2].map(|threads| released(latency, threads));
    same_tree(&one.path("tree"), &two.path("tree"));
    one.ok("audit tree");
    let scene = one.json("tree/tiny/scene.json");
    let counts = &scene["trajectories"][0]["statistics"];
    let count = |key: &str| counts["latency"][key].as_u64().unwrap();
    assert!(count("kept") > 100 && count("unread") > 0, "{counts}");
    assert_eq!(count("kept") + count("unread"), count("made"));
    assert_eq!(count("kept"), counts["events"].as_u64().unwrap());
    // 100 us and 4 us times 1000 lux over the light, which is 250 lux at most and 20 lux in dark parts.
    let mean = counts["latency"]["mean_us"].as_f64().unwrap();
    assert!((116.0..300.0).contains(&mean), "{mean}");
    let sensor = &scene["trajectories"][0]["sensor"];
    assert_eq!(sensor["latency"]["tau_us"], 4.0, "{sensor}");
    assert_eq!(sensor["front_end"]["lux"], 250.0, "{sensor}");
    place_checks(&one);
}

/// No pass fails, and those that would take a delay for a fault say that they do not judge it.
fn place_checks(place: &Workspace) {
    let mut findings = place.json("tree/tiny/base/checks.json").as_array().unwrap().clone();
    // One finding a line.
    let all = place.ok("check --tree tree --json").stdout;
    assert!(!all.contains("\"fail\""), "{all}");
    for check in ["event_frame", "time_offset"] {
        let found = findings.iter().find(|f| f["check"] == check).unwrap();
        assert_eq!(found["verdict"], "not-run", "{found}");
        assert!(found["because"].as_str().unwrap().contains("latency"), "{found}");
    }
    findings.retain(|finding| finding["verdict"] == "fail");
    assert!(findings.is_empty(), "{findings:?}");
    // From the frames at every pose.
    assert!(all.contains("not applicable with a latency"), "{all}");
}

#[test]
fn a_latency_of_nothing_changes_no_event() {
    let events = |place: &Workspace| fs::read(place.path("tree/tiny/base/events.h5")).unwrap();
    let without = Workspace::with_tiny();
    without.ok("release --to tree tiny.yaml");
    assert!(events(&without) == events(&released("{ us: 0 }", 2)));
    assert!(events(&without) != events(&released("{ us: 5 }", 2)));
}

#[test]
fn a_latency_outside_its_range_is_refused() {
    let place = Workspace::new();
    let t = |latency: &str, wanted: &str| {
        place.write("tiny.yaml", tiny(latency));
        let ended = place.gs2e("plan tiny.yaml");
        assert_eq!(ended.code, 2, "{latency}: {}", ended.stderr);
        assert!(ended.stderr.contains("tiny.yaml:12:"), "{latency}: {}", ended.stderr);
        assert!(ended.stderr.contains(wanted), "{latency}: {}", ended.stderr);
    };
    t("{ jitter_us: 10 }", "missing field \"sensor.voltmeter.latency.us\"");
    t("{ us: -1 }", "\"sensor.voltmeter.latency.us\" is -1, wanted a number from 0 to 1000000");
    t("{ us: 1, jitter_us: -1 }", "\"sensor.voltmeter.latency.jitter_us\" is -1");
    t("{ us: 1, max_us: 0 }", "\"sensor.voltmeter.latency.max_us\" is 0");
    t("{ us: 20000 }", "is 20000, above the largest delay of 10000 us");
    t("{ us: { uniform: [-5, 5] } }", "is -5");
}
