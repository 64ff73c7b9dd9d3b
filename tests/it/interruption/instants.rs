//! An interrupt, step by step: a step that was reported as finished stays and is never made again,
//! and the products are those of an undisturbed build.

use crate::support::steps::{keys, products, recipe};
use crate::support::workspace::Workspace;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, Stdio};

const SCENES: usize = 4;

fn place() -> Workspace {
    let place = Workspace::new();
    for i in 0..SCENES {
        let mut value = recipe(&format!("s{i}"));
        value["source"]["procedural"]["seed"] = i.into();
        place.write(&format!("recipes/{i}.yaml"), value.to_string());
    }
    place
}

fn start(place: &Workspace) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gs2e"));
    command.args(["build", "--json", "-j", "2"]).current_dir(place.path("")).stdin(Stdio::null());
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// The step that a line of `build --json` reports as made.
fn made(line: &str) -> Option<String> {
    let found: Value = serde_json::from_str(line).ok()?;
    (found["state"] == "made").then(|| found["step"].as_str().unwrap().to_owned())
}

fn files_in(place: &Workspace, folder: &str) -> usize {
    std::fs::read_dir(place.path(folder)).unwrap().count()
}

#[test]
fn an_interrupt_reports_the_number_of_kept_steps() {
    let place = place();
    let mut child = start(&place);
    let mut found = BufReader::new(child.stdout.take().unwrap());
    let (mut finished, mut line) = (BTreeSet::new(), String::new());
    while finished.len() < 3 {
        line.clear();
        assert_ne!(found.read_line(&mut line).unwrap(), 0, "it ended by itself");
        finished.extend(made(line.trim()));
    }
    kill_process(Pid::from_child(&child), Signal::INT).unwrap();
    let mut rest = String::new();
    found.read_to_string(&mut rest).unwrap();
    finished.extend(rest.lines().filter_map(made));
    let ended = child.wait_with_output().unwrap();
    let stderr = String::from_utf8(ended.stderr).unwrap();
    assert_eq!(ended.status.code(), Some(130), "{stderr}");
    let all = 6 * SCENES;
    let said = format!("interrupted: {} of {all} steps are finished and kept", finished.len());
    assert!(stderr.contains(&said), "not `{said}`:\n{stderr}");
    assert_eq!(files_in(&place, ".gs2e/gs2e-tmp"), 0);

    let after: BTreeSet<String> = place.build("recipes").into_iter().collect();
    assert!(after.is_disjoint(&finished), "made twice: {after:?} and {finished:?}");
    assert_eq!(after.len() + finished.len(), all);
    let undisturbed = self::place();
    undisturbed.ok("build");
    assert_eq!(keys(&place, "recipes"), keys(&undisturbed, "recipes"));
    assert_eq!(products(&place, "recipes"), products(&undisturbed, "recipes"));
}
