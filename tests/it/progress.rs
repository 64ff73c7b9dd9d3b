//! Messages of a running build: lines for users, objects for programs.

use crate::support::workspace::{TINY, Workspace};
use gs2e_store::Digest;
use serde_json::Value;

fn two_scenes() -> Workspace {
    let place = Workspace::with_tiny();
    place.write("other.yaml", TINY.replace("scene: tiny", "scene: other").replace("seed: 1 }", "seed: 2 }"));
    place
}

/// Checks lines such as `[ 7/12] scene/step 0.1 s`, with the step's remark. Large builds do not
/// show every step; these few are all shown.
#[test]
fn finished_steps_are_printed_in_plain_lines() {
    let place = Workspace::with_tiny();
    let message = place.ok("build -j 1 tiny.yaml").stderr;
    let lines: Vec<&str> = message.lines().filter(|line| line.starts_with('[')).collect();
    assert_eq!(lines.len(), 6, "{message}");
    let mut names = Vec::new();
    for (i, line) in lines.iter().enumerate() {
        let rest = line.strip_prefix(&format!("[{}/6] tiny/", i + 1));
        let words: Vec<&str> = rest.unwrap_or_else(|| panic!("{line}")).split(' ').collect();
        assert!(words[1].parse::<f64>().is_ok() && words[2] == "s", "{line}");
        // Only the events have a remark: their number, and the size of the frames that the build of
        // one scene keeps.
        let remark = words[3..].join(" ");
        let is_of_events = remark.contains("ev, ") && remark.ends_with(" MB of frames kept");
        assert!(if words[0] == "base/events" { is_of_events } else { remark.is_empty() }, "{line}");
        names.push(words[0]);
    }
    names.sort_unstable();
    assert_eq!(
        names,
        ["base/checks", "base/events", "base/sharp", "base/trajectory", "capture", "reconstruct"]
    );
    let last = message.lines().last().unwrap();
    assert!(last.starts_with("6 steps built, 0 reused, 0 failed; ") && last.ends_with(" s"), "{last}");
}

/// A step for programs: the paths of its products, and their digests.
#[test]
fn finished_steps_are_printed_as_objects() {
    let place = two_scenes();
    for state in ["made", "kept"] {
        let found = place.ok("build --json tiny.yaml other.yaml").stdout;
        let mut steps: Vec<Value> = found.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        // Findings of checks follow the steps, as messages.
        let messages = steps.split_off(12);
        assert!(messages.iter().all(|message| message["code"] == "check"), "{found}");
        for step in &steps {
            assert_eq!((step["state"].as_str(), step["key"].as_str().map(str::len)), (Some(state), Some(64)));
            assert_eq!(step["seconds"].is_number(), state == "made", "{step}");
            let outputs = step["outputs"].as_array().unwrap();
            assert!(!outputs.is_empty(), "{step}");
            for output in outputs {
                let text = |field: &str| output[field].as_str().unwrap();
                let bytes = std::fs::read(place.path(text("path"))).unwrap();
                assert_eq!(Digest::of_bytes(&bytes).to_string(), text("digest"), "{}", text("role"));
            }
        }
    }
}

/// With `-q` only failures are reported.
#[test]
fn a_quiet_build_prints_failures_once() {
    let place = two_scenes();
    place.write(
        "wrong.yaml",
        TINY.replace(
            "procedural: { kind: still-life, gaussians: 500, views: 6, arc: 6, seed: 1 }",
            "nerfstudio: { path: wrong.json }",
        )
        .replace("camera:", "reconstruct: { given: { path: wrong.ply } }\ncamera:")
        .replace("scene: tiny", "scene: wrong"),
    );
    place.write("wrong.json", "{}");
    place.write("wrong.ply", "ply");
    let ended = place.gs2e("build -k -q -j 1 tiny.yaml wrong.yaml");
    assert_eq!(ended.code, 1);
    assert_eq!(ended.stderr.matches("error: ").count(), 2, "{}", ended.stderr);
    assert!(!ended.stderr.contains("failed:") && !ended.stderr.contains(" reused, "), "{}", ended.stderr);
    assert_eq!(place.stale("tiny.yaml"), [""; 0]);
}

/// Scenes known at a glance count among the steps, in the lines and in the final line.
#[test]
fn settled_steps_count() {
    let place = two_scenes();
    place.ok("build -q tiny.yaml other.yaml");
    // Longer than a file could change unseen, so that the next build needs no closer look.
    std::thread::sleep(std::time::Duration::from_millis(2100));
    place.ok("build -q tiny.yaml other.yaml");
    place.write("other.yaml", TINY.replace("scene: tiny", "scene: other").replace("seed: 1 }", "seed: 3 }"));
    let message = place.ok("build -j 1 tiny.yaml other.yaml").stderr;
    // The last step is one of checks or pictures: the order of steps depends on their earlier
    // times.
    assert!(message.contains("[12/12] other/base/"), "{message}");
    assert!(message.contains("6 steps built, 6 reused, 0 failed; "), "{message}");
}
