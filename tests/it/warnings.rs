//! Warnings of checks reach the person at the end of a build and of a release.

use crate::support::workspace::{TINY, Workspace};
use serde_json::Value;

/// Recipes with one fault each: its name, the change of a sound recipe, and the words of the warning.
const FAULTS: [(&str, &str, &str, &str); 4] = [
    ("a large step", "factor: 2", "frames: 3", "sampling: "),
    ("one frame", "factor: 2", "frames: 1", "event_rate: there is only one frame"),
    ("no events", "on: 1.0, off: 1.0", "on: 80, off: 80", "event_rate: no events"),
    (
        "an empty view",
        "refine: { window: 2, factor: 2, curve: cubic }",
        "orbit: { centre: [990, 0, 0], from: [900, 0, 0], up: [0, 1, 0], arc: 6, frames: 12 }",
        "coverage: ",
    ),
];

fn faulty((_, from, to, _): (&str, &str, &str, &str)) -> String {
    let recipe = TINY.replace(from, to);
    assert_ne!(recipe, TINY, "{from}");
    if to.starts_with("orbit") {
        recipe.replace("    speed: { function: \"0.25*sin(t) + 1.1\" }\n", "")
    } else {
        recipe
    }
}

#[test]
fn builds_and_releases_end_with_their_warnings() {
    for fault in FAULTS {
        let (name, .., words) = fault;
        let place = Workspace::new();
        place.write("r.yaml", faulty(fault));
        for command in ["build r.yaml", "release --to out r.yaml", "build r.yaml"] {
            let ended = place.ok(command);
            let warning = ended
                .stderr
                .lines()
                .find(|line| line.starts_with("warning: tiny/base") && line.contains(words));
            assert!(warning.is_some(), "{name}, {command}: {}", ended.stderr);
            assert!(ended.stderr.contains("help: "), "{name}: {}", ended.stderr);
            assert!(ended.stderr.contains(" warn, 0 fail, 0 waived, "), "{name}: {}", ended.stderr);
        }
        let ended = place.ok("build --json r.yaml");
        let values = ended.stdout.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
        let is_it =
            |value: &Value| value["code"] == "check" && value["message"].as_str().unwrap().contains(words);
        assert!(values.into_iter().any(|value| is_it(&value)), "{name}: {}", ended.stdout);
    }
}

#[test]
fn strict_makes_warnings_fail() {
    let place = Workspace::new();
    place.write("r.yaml", faulty(FAULTS[2]));
    let ended = place.gs2e("build --strict r.yaml");
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    let ended = place.gs2e("release --strict --to out r.yaml");
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    assert!(ended.stderr.contains("nothing was released"), "{}", ended.stderr);
    assert!(!place.path("out").exists());
    assert_eq!(place.gs2e("check --strict --recipes r.yaml").code, 3);
    assert_eq!(place.gs2e("check --recipes r.yaml").code, 0);
}

#[test]
fn a_quiet_build_keeps_quiet() {
    let place = Workspace::new();
    place.write("r.yaml", faulty(FAULTS[2]));
    assert_eq!(place.ok("build -q r.yaml").stderr, "");
}
