//! A console that scripts can rely on: lost results are an error, a wrong command line gives one
//! object, and failed checks are named on stderr.

use crate::hostile_console::{acts, inert, objects, released};
use crate::support::given;
use crate::support::workspace::{TINY, Workspace};
use serde_json::Value;
use std::fs::{self, File};
use std::process::Stdio;

/// All commands that print results, over a folder in which they succeed.
const RESULTS: [&str; 14] = [
    "--version",
    "--help",
    "build --help",
    "plan tiny.yaml",
    "plan --json tiny.yaml",
    "plan --json --estimate tiny.yaml",
    "build --json tiny.yaml",
    "why tiny --recipes tiny.yaml",
    "check --recipes tiny.yaml",
    "check --json --tree out",
    "audit --json out",
    "diff --json out out",
    "gc --json --dry-run tiny.yaml",
    "release --json --no-build --to out tiny.yaml",
];

#[test]
fn lost_results_are_an_error_in_every_verb() {
    let place = released();
    for arguments in RESULTS {
        let full = File::options().write(true).open("/dev/full").unwrap();
        let output = place.command(arguments).stdout(full).output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "gs2e {arguments}: {stderr}");
        assert_eq!(stderr.matches("error: failed to write results to stdout").count(), 1, "{stderr}");
        assert!(stderr.contains("No space left"), "{stderr}");
    }
}

#[test]
fn a_reader_may_close_the_pipe_early() {
    let place = released();
    for arguments in RESULTS {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = place.command(arguments).stdout(writer).output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(0), "gs2e {arguments}: {stderr}");
        assert!(!stderr.contains("error") && !stderr.contains("panicked"), "gs2e {arguments}: {stderr}");
    }
}

#[test]
fn a_lost_stderr_is_no_error() {
    let place = released();
    for arguments in RESULTS {
        let full = File::options().write(true).open("/dev/full").unwrap();
        let status = place.command(arguments).stdout(Stdio::null()).stderr(full).status().unwrap();
        assert_eq!(status.code(), Some(0), "gs2e {arguments}");
    }
}

#[test]
fn programs_get_an_object_for_every_wrong_command_line() {
    let place = Workspace::with_tiny();
    let verbs = [
        "build",
        "plan",
        "why",
        "check",
        "release",
        "audit",
        "diff",
        "convert",
        "init",
        "gc",
        "render",
        "simulate",
        "stress",
        "study",
        "trajectory",
    ];
    let mut lines: Vec<String> = verbs.iter().map(|verb| format!("{verb} --json --no-such-option")).collect();
    lines.extend(
        [
            "--json",
            "--json frobnicate",
            "build --json -j 0",
            "why --json",
            "check --json --tree nope",
            "audit --json nope",
            "diff --json nope nope",
            "plan --json nope",
            "gc --json nope",
            "build -C nope --json",
            "stress --json nope",
        ]
        .map(str::to_owned),
    );
    for arguments in lines {
        let ended = inert(&place, &arguments);
        assert_eq!(ended.code, 2, "gs2e {arguments}: {}", ended.stderr);
        let objects = objects(&ended);
        assert_eq!(objects.len(), 1, "gs2e {arguments}: {}", ended.stdout);
        let (level, exit) = (&objects[0]["level"], &objects[0]["exit"]);
        assert_eq!((level, exit), (&"error".into(), &2.into()), "gs2e {arguments}");
        assert!(objects[0]["code"].is_string(), "gs2e {arguments}");
        let message = objects[0]["message"].as_str().unwrap();
        assert!(!message.is_empty() && !message.starts_with("error"), "gs2e {arguments}: {message}");
        assert!(!ended.stderr.is_empty(), "people are found too: gs2e {arguments}");
    }
}

#[test]
fn names_of_failed_checks_are_on_stderr() {
    let place = Workspace::new();
    place.write("tiny.yaml", TINY.to_owned() + "checks: { event_rate: { max: 0.001 } }\n");
    place.ok("build -q tiny.yaml");
    for quiet in ["", "-q "] {
        let checked = place.gs2e(&format!("check {quiet}--recipes tiny.yaml"));
        assert_eq!(checked.code, 3, "{}", checked.stderr);
        assert!(checked.stderr.contains("event_rate failed"), "{}", checked.stderr);
        assert!(checked.stdout.contains("FAIL"), "the table is the result: {}", checked.stdout);
    }
    let refused = place.gs2e("release --to out tiny.yaml");
    assert_eq!((refused.code, refused.stdout.as_str()), (3, ""), "{}", refused.stderr);
    assert!(refused.stderr.contains("error: tiny/base#rate: event_rate: "), "{}", refused.stderr);
    let refused = place.gs2e("release --json --to out tiny.yaml");
    assert!(objects(&refused).iter().any(|object| object["check"] == "event_rate"), "{}", refused.stdout);
    assert!(refused.stderr.contains("error: tiny/base#rate: event_rate: "), "{}", refused.stderr);
}

#[test]
fn numbers_are_short_and_a_sign_is_no_option() {
    let place = Workspace::new();
    place.write("tiny.yaml", TINY.replace("on: 1.0", "on: 1e300"));
    let ended = place.gs2e("plan tiny.yaml");
    assert!(ended.code == 2 && ended.stderr.contains(" is 1e300, wanted"), "{}", ended.stderr);
    for (arguments, wanted) in [
        ("build -j -1", "-1"),
        ("init colmap x --to y --limit -1", "-1"),
        ("simulate --exposure -1", "--frames"),
        ("plan -1", "-1"),
    ] {
        let ended = place.gs2e(arguments);
        assert_eq!(ended.code, 2, "{}", ended.stderr);
        assert!(
            ended.stderr.contains(wanted) && !ended.stderr.contains("use '--"),
            "gs2e {arguments}: {}",
            ended.stderr
        );
    }
}

#[test]
fn init_writes_no_recipe_that_other_verbs_miss() {
    let place = Workspace::new();
    let names = [".hid", "defaults", "release", "sources", "usual", "a/b", "a_b"];
    for (i, name) in names.iter().enumerate() {
        let frames = given::transforms(1.0).replace("images/000", &format!("images/{i}"));
        place.write(&format!("data/{name}/transforms.json"), frames);
        place.write(&format!("data/{name}/point_cloud.ply"), given::ply(|_, value| value));
    }
    let init = "init nerfstudio data --to recipes --min-views 1 --min-side 1 --json";
    let result: Value = serde_json::from_str(&place.ok(init).stdout).unwrap();
    assert_eq!(
        (result["written"].as_array().unwrap().len(), &result["rejected"]),
        (7, &Value::Array(Vec::new()))
    );
    let noticed = result["noticed"].to_string();
    for name in [".hid", "defaults", "release", "sources", "a_b"] {
        assert!(noticed.contains(&format!("nerfstudio/{name}\"")), "{name} is said: {noticed}");
    }
    let scenes: std::collections::BTreeSet<String> = place
        .plan("recipes")
        .into_iter()
        .filter_map(|(step, _)| Some(step.strip_suffix("/capture")?.to_owned()))
        .collect();
    assert_eq!(scenes, names.map(|name| format!("nerfstudio/{name}")).into());
    let again: Value = serde_json::from_str(&place.ok(init).stdout).unwrap();
    assert_eq!((&again["kept"], again["written"].as_array().unwrap().len()), (&7.into(), 0));
}

#[test]
fn the_list_of_rejected_scenes_has_four_columns() {
    let place = Workspace::new();
    for name in ["a\tb", "a\nb", "\u{1b}[31m", "\u{202e}x"] {
        place.write(&format!("data/{name}/transforms.json"), given::transforms(1.0));
    }
    inert(&place, "init nerfstudio data --to recipes");
    let list = fs::read_to_string(place.path("recipes/rejected.tsv")).unwrap();
    assert_eq!(list.lines().count(), 5, "{list}");
    assert!(list.lines().all(|line| line.split('\t').count() == 4), "{list:?}");
    assert!(!list.replace('\t', "").contains(acts), "{list:?}");
}
