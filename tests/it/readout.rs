//! A bus of limited rate behind the pixels, through the binary.

use crate::support::workspace::{TINY, Workspace};
use std::fs;

/// The tiny recipe with this readout.
fn tiny(readout: &str) -> String {
    TINY.replace("off: 1.0 } }", &format!("off: 1.0 }}, readout: {readout} }}"))
}

/// 20,000 events per second are fewer than the scene makes. The counts are in the release, agree
/// with the stream, and no check takes the late events for a fault.
#[test]
fn a_slow_bus_is_counted_and_no_fault() {
    let place = Workspace::released(&tiny("{ rate_mev_s: 0.02, queue: 100 }"), "");
    place.ok("audit tree");
    let scene = place.json("tree/tiny/scene.json");
    let counts = &scene["trajectories"][0]["statistics"];
    let bus = |key: &str| counts["readout"][key].as_u64().unwrap();
    let lost = bus("lost_in_pixel") + bus("lost_in_queue") + bus("unread");
    assert!(lost > 0 && bus("kept") > 0, "{counts}");
    assert_eq!((bus("kept"), bus("kept") + lost), (counts["events"].as_u64().unwrap(), bus("made")));
    assert_eq!(scene["trajectories"][0]["sensor"]["readout"]["rate_mev_s"], 0.02);
    let findings = place.json("tree/tiny/base/checks.json");
    for finding in findings.as_array().unwrap() {
        assert_ne!(finding["verdict"], "fail", "{finding}");
    }
    // The compared events are late, and the check says so.
    let compared = findings.as_array().unwrap().iter().find(|f| f["check"] == "event_frame").unwrap();
    assert_eq!(compared["verdict"], "not-run", "{compared}");
    assert!(compared["because"].as_str().unwrap().contains("readout"), "{compared}");
}

#[test]
fn a_fast_bus_changes_no_event() {
    let place = Workspace::new();
    let events = |recipe: String, tree: &str| {
        place.write("tiny.yaml", recipe);
        place.ok(&format!("release --to {tree} tiny.yaml"));
        let part = place.json(&format!("{tree}/tiny/scene.json"))["trajectories"][0].clone();
        (fs::read(place.path(&format!("{tree}/tiny/base/events.h5"))).unwrap(), part)
    };
    let (without, _) = events(TINY.to_owned(), "without");
    let (with, part) = events(tiny("{ rate_mev_s: 1.0e+6, arbiter: none }"), "with");
    let counts = &part["statistics"]["readout"];
    assert_eq!((counts["lost_in_pixel"].as_u64(), counts["unread"].as_u64()), (Some(0), Some(0)));
    // An event may wait for another one of its own nanosecond.
    assert!(counts["max_delay_us"].as_f64().unwrap() <= 0.002, "{counts}");
    assert_eq!(with.len(), without.len());
}

#[test]
fn a_bus_without_a_rate_is_refused() {
    let place = Workspace::new();
    let t = |readout: &str, wanted: &str| {
        place.write("tiny.yaml", tiny(readout));
        let message = place.refused("plan tiny.yaml");
        assert!(message.contains("tiny.yaml:12:") && message.contains(wanted), "{message}");
    };
    t("{ rate_mev_s: 0 }", "\"sensor.voltmeter.readout.rate_mev_s\" is 0, wanted a number from 0.000001");
    t("{ rate_mev_s: -5 }", "is -5, wanted a number");
    t("{ arbiter: rows }", "missing field \"sensor.voltmeter.readout.rate_mev_s\"");
    t("{ rate_mev_s: 12, arbiter: tree }", "rows");
    t("{ rate_mev_s: 12, queue: -1 }", "queue");
}
