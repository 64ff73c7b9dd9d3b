//! The contract of the command line: verbs, exit codes, and the contents of stdout and stderr.

use crate::support::given::sound;
use crate::support::workspace::{TINY, Workspace};
use serde_json::Value;
use std::collections::BTreeSet;

#[test]
fn a_command_line_that_is_wrong_runs_nothing() {
    let place = Workspace::with_tiny();
    for args in [
        "",
        "frobnicate",
        "build --no-such-option",
        "build -j 0 tiny.yaml",
        "build -j many tiny.yaml",
        "release tiny.yaml",
    ] {
        let ended = place.gs2e(args);
        assert_eq!(ended.code, 2, "gs2e {args}: {}", ended.stderr);
        assert!(
            !ended.stderr.is_empty() && ended.stdout.is_empty(),
            "people are message on stderr: gs2e {args}"
        );
    }
    assert!(!place.path(".gs2e").exists(), "nothing ran");
}

#[test]
fn help_and_version_are_results() {
    let place = Workspace::new();
    let help = place.ok("--help").stdout;
    for verb in ["build", "plan", "why", "check", "release", "audit"] {
        assert!(help.contains(verb), "{verb} is not in --help");
        assert!(!place.ok(&format!("{verb} --help")).stdout.is_empty());
    }
    assert_eq!(place.ok("--version").stdout.trim(), concat!("gs2e ", env!("CARGO_PKG_VERSION")));
}

#[test]
fn a_plan_runs_nothing_and_gives_a_reason_for_each_step() {
    let place = Workspace::with_tiny();
    let steps: Vec<Value> =
        serde_json::from_str(&place.ok("plan --json tiny.yaml").stdout).expect("one JSON array");
    let names: BTreeSet<&str> = steps.iter().filter_map(|step| step["step"].as_str()).collect();
    let wanted = ["capture", "reconstruct", "base/trajectory", "base/sharp", "base/events", "base/checks"];
    assert_eq!(names, wanted.into());
    for step in &steps {
        assert_eq!(step["scene"], "tiny");
        assert!(["run", "may-run", "keep"].iter().any(|action| step["action"] == *action), "{step}");
        assert!(step["reason"]["code"].is_string(), "{step}");
        assert_eq!(
            step["key"].is_null(),
            step["action"] == "may-run",
            "a key is known unless an input may change: {step}"
        );
    }
    assert_eq!(place.stale("tiny.yaml").len(), steps.len());
    place.ok("build tiny.yaml");
    assert_eq!(place.stale("tiny.yaml"), [""; 0]);
}

#[test]
fn another_folder_and_another_store() {
    let place = Workspace::new();
    place.write("project/tiny.yaml", TINY);
    place.ok("build -C project --store ../elsewhere tiny.yaml");
    assert!(place.path("elsewhere").is_dir());
    assert!(!place.path("project/.gs2e").exists() && !place.path(".gs2e").exists());
}

#[test]
fn quiet_means_only_failures() {
    let place = Workspace::with_tiny();
    let ended = place.ok("build -q tiny.yaml");
    assert_eq!((ended.stdout.as_str(), ended.stderr.as_str()), ("", ""));
}

/// A scene that fails does not stop the others under `-k`, and the run still ends with 1.
#[test]
fn keep_going_builds_the_other_scenes() {
    let place = sound();
    place.write("scene.ply", "ply\nformat ascii 1.0\n");
    place.write("tiny.yaml", TINY);
    let ended = place.gs2e("build -k recipe.yaml tiny.yaml");
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    assert!(ended.stderr.contains("given/reconstruct"), "{}", ended.stderr);
    assert_eq!(place.stale("tiny.yaml"), [""; 0]);
}

#[test]
fn why_names_the_change() {
    let place = Workspace::with_tiny();
    place.ok("build tiny.yaml");
    place.write("tiny.yaml", TINY.replace("on: 1.0", "on: 1.2"));
    let message = place.ok("why tiny/base/events --recipes tiny.yaml").stdout;
    assert!(message.contains("threshold") && message.contains("1.2"), "{message}");
}

#[test]
fn an_unbuilt_scene_is_neither_checked_nor_released() {
    let place = Workspace::with_tiny();
    assert_eq!(place.gs2e("check tiny --recipes tiny.yaml").code, 1, "an unbuilt scene");
    assert_eq!(place.gs2e("release --no-build --to out tiny.yaml").code, 1, "a stale step");
    assert!(!place.path("out").exists());
    place.ok("build tiny.yaml");
    place.ok("release --no-build --to out tiny.yaml");
}

/// Recipes are named by path, by folder, or by the id of their scene.
#[test]
fn verbs_take_recipes_folders_and_ids() {
    let place = Workspace::new();
    place.write("recipes/tiny.yaml", TINY);
    place.write("recipes/other.yaml", TINY.replace("scene: tiny", "scene: lab/other"));
    assert_eq!(place.ok("build --json lab/other").stdout.matches("\"step\":\"lab/other/").count(), 6);
    assert!(!place.ok("plan lab/other").stdout.contains("tiny"), "one scene is named");
    for words in ["lab/other", "recipes/other.yaml", "--recipes recipes lab/other"] {
        let message = place.ok(&format!("check {words}")).stdout;
        assert!(message.contains("lab/other/base") && !message.contains("tiny"), "{words}: {message}");
    }
    place.ok("build --to plain lab/other");
    assert!(place.path("plain/lab/other/base/events/events.h5").is_file());
    let refused = place.gs2e("build no/such");
    assert_eq!(refused.code, 2);
    assert!(
        refused.stderr.contains("no/such is not a recipe, a folder, or a scene of recipes"),
        "{}",
        refused.stderr
    );
}

#[test]
fn skipped_work_is_shown_on_request() {
    let place = Workspace::with_tiny();
    assert!(!place.ok("build tiny.yaml").stderr.contains("skipped"), "without -v");
    place.write("tiny.yaml", TINY.replace("seed: 7", "seed: 8"));
    let message = place.ok("build -v tiny.yaml").stderr;
    assert!(message.contains("tiny/base"), "{message}");
}

/// The help of a verb lists the options that have an effect in it; the others are still accepted.
#[test]
fn the_help_of_a_verb_lists_its_own_options() {
    let place = Workspace::with_tiny();
    let help = |verb: &str| place.ok(&format!("{verb} --help")).stdout;
    for (verb, own, others) in [
        ("convert", "--lossy", ["--backend", "--store", "--allow-commands", "--keep-going"]),
        ("diff", "--json", ["--gpu", "--no-omit", "--no-wait", "--jobs"]),
    ] {
        let help = help(verb);
        assert!(help.contains(own), "{verb}: {help}");
        others.iter().for_each(|other| assert!(!help.contains(other), "{verb} {other}: {help}"));
    }
    assert!(help("build").contains("--backend"));
    assert_eq!(place.ok("diff --backend cpu --store other --json --help").code, 0);
}
