//! Builds that are asked to stop: they keep what is finished. The next run just works, and its tree is that of a build
//! that nobody disturbed.

mod instants;

use crate::support::workspace::{Ended, TINY, Workspace, same_tree};
use rustix::process::{Pid, Signal, kill_process};
use std::io::{BufRead as _, BufReader, Read as _};
use std::process::Child;

/// [`TINY`] and a scene whose events and frames take a second or more: enough to be caught at.
fn two_scenes() -> Workspace {
    let place = Workspace::with_tiny();
    let long = TINY
        .replace("scene: tiny", "scene: long")
        .replace("width: 64, height: 48", "width: 128, height: 96")
        .replace("factor: 2", "factor: 10");
    place.write("long.yaml", long);
    place
}

/// Starts the build and returns when its first step is finished.
fn started(place: &Workspace) -> (Child, BufReader<std::process::ChildStderr>) {
    let mut child = place.spawn("build -j 1 tiny.yaml long.yaml");
    let mut told = BufReader::new(child.stderr.take().expect("stderr is piped"));
    let mut line = String::new();
    while !line.starts_with("[1/") && !line.starts_with("[ 1/") {
        line.clear();
        assert_ne!(
            told.read_line(&mut line).expect("stderr can be read"),
            0,
            "it ended before its first step"
        );
    }
    (child, told)
}

fn signal(child: &Child, signal: Signal) {
    let pid = Pid::from_raw(child.id().try_into().expect("process ids are small")).expect("it is not 0");
    kill_process(pid, signal).expect("it is ours");
}

fn ended((mut child, mut told): (Child, BufReader<std::process::ChildStderr>)) -> Ended {
    let mut stderr = String::new();
    told.read_to_string(&mut stderr).expect("it speaks UTF-8");
    let status = child.wait().expect("it can be waited for");
    Ended { code: status.code().unwrap_or(-1), stdout: String::new(), stderr }
}

#[test]
fn an_interrupted_build_keeps_what_is_finished() {
    let place = two_scenes();
    let build = started(&place);
    signal(&build.0, Signal::INT);
    let ended = ended(build);
    assert_eq!(ended.code, 130, "{}", ended.stderr);
    assert!(ended.stderr.contains("interrupted"), "{}", ended.stderr);
    let kept = place.plan("tiny.yaml long.yaml").iter().filter(|(_, action)| action == "keep").count();
    assert!((1..12).contains(&kept), "{kept} of 12 steps are kept");
    finishes(&place);
}

fn finishes(place: &Workspace) {
    place.ok("release --to out tiny.yaml long.yaml");
    place.ok("audit out");
    let undisturbed = two_scenes();
    undisturbed.ok("release --to out tiny.yaml long.yaml");
    same_tree(&place.path("out"), &undisturbed.path("out"));
}
