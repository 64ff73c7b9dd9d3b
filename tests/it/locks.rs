//! Two programs on one store.

use crate::support::steps::recipe;
use crate::support::workspace::Workspace;
use gs2e::store::{Access, Store};
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, Stdio};

fn place() -> Workspace {
    let place = Workspace::new();
    for scene in ["a", "b"] {
        place.write(&format!("recipes/{scene}.yaml"), recipe(scene).to_string());
    }
    place
}

fn start(place: &Workspace) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gs2e"));
    command.args(["build", "--json"]).current_dir(place.path("")).stdin(Stdio::null());
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

#[test]
fn two_builds_at_once_make_each_step_once() {
    let place = place();
    let children = [start(&place), start(&place)];
    let ended = children.map(|child| child.wait_with_output().unwrap());
    let mut made: Vec<String> = Vec::new();
    for output in &ended {
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        made.extend(text.lines().filter(|line| line.contains("\"made\"")).map(str::to_owned));
    }
    // Scene b has its own events and verdicts, and shares the other four steps.
    assert_eq!(made.len(), 6 + 2, "{made:?}");
    assert_eq!(place.stale("recipes"), [""; 0]);
}

#[test]
fn who_waits_says_for_whom_and_goes_on() {
    let place = place();
    let holder = Store::open(&place.path(".gs2e"), Access::Write, &mut |_| {}).unwrap();
    let mut waiting = start(&place);
    let mut told = BufReader::new(waiting.stderr.take().unwrap());
    let mut line = String::new();
    while !line.starts_with("waiting:") {
        line.clear();
        assert_ne!(told.read_line(&mut line).unwrap(), 0, "it did not wait");
    }
    let us = format!("pid {}", std::process::id());
    assert!(line.contains(".gs2e is in use by") && line.contains(&us), "{line}");
    drop(holder);
    let mut rest = String::new();
    told.read_to_string(&mut rest).unwrap();
    assert!(waiting.wait_with_output().unwrap().status.success(), "{rest}");
    assert!(rest.contains("made 8, up to date 4, failed 0"), "{rest}");
}

#[test]
fn who_does_not_wait_fails_with_the_name() {
    let place = place();
    let holder = Store::open(&place.path(".gs2e"), Access::Write, &mut |_| {}).unwrap();
    let ended = place.gs2e("build --no-wait");
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    let us = format!("in use by pid {}", std::process::id());
    assert!(ended.stderr.contains(&us) && ended.stderr.contains("help:"), "{}", ended.stderr);
    drop(holder);
    place.ok("build --no-wait");
}

/// `plan`, `why` and `check` take no lock, and change nothing in a store that somebody works in.
#[test]
fn looking_needs_no_lock() {
    let place = place();
    place.ok("build");
    let holder = Store::open(&place.path(".gs2e"), Access::Write, &mut |_| {}).unwrap();
    place.ok("plan");
    place.ok("why a");
    place.ok("check");
    drop(holder);
    assert_eq!(place.build("recipes"), [""; 0]);
}
