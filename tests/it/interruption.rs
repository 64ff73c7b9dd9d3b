//! Builds that are interrupted keep their finished steps. The next run succeeds, and its tree is
//! that of an undisturbed build.

mod instants;

use crate::support::workspace::{RunOutcome, TINY, Workspace, same_tree};
use rustix::process::{Pid, Signal, kill_process};
use std::fs::{self, File};
use std::io::{BufRead as _, BufReader, Read as _};
use std::process::Child;

/// [`TINY`] and a scene whose events and frames take a second or more: long enough to be
/// interrupted.
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
    let mut message = BufReader::new(child.stderr.take().expect("stderr is piped"));
    let mut line = String::new();
    while !line.starts_with("[1/") && !line.starts_with("[ 1/") {
        line.clear();
        assert_ne!(
            message.read_line(&mut line).expect("stderr can be read"),
            0,
            "it ended before its first step"
        );
    }
    (child, message)
}

fn signal(child: &Child, signal: Signal) {
    let pid = Pid::from_raw(child.id().try_into().expect("process ids are small")).expect("it is not 0");
    kill_process(pid, signal).expect("it is ours");
}

fn ended((mut child, mut message): (Child, BufReader<std::process::ChildStderr>)) -> RunOutcome {
    let mut stderr = String::new();
    message.read_to_string(&mut stderr).expect("it speaks UTF-8");
    let status = child.wait().expect("it can be waited for");
    RunOutcome { code: status.code().unwrap_or(-1), stdout: String::new(), stderr }
}

#[test]
fn an_interrupted_build_keeps_finished_steps() {
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

/// A clip too long to be finished. In a sparse file its zeros take no space.
#[test]
fn an_interrupted_simulation_leaves_no_file() {
    const FRAMES: u64 = 1_000_000;
    let place = Workspace::new();
    let head = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': ({FRAMES}, 130, 173), }}");
    let head = [b"\x93NUMPY\x01\x00\x76\x00", format!("{head:117}\n").as_bytes()].concat();
    let length = head.len() as u64 + FRAMES * 130 * 173;
    place.write("frames.npy", head);
    File::options().write(true).open(place.path("frames.npy")).unwrap().set_len(length).unwrap();
    let mut child = place.spawn("simulate --frames frames.npy --fps 1000 --sensor dvs346 --out e.h5");
    let mut message = BufReader::new(child.stderr.take().expect("stderr is piped"));
    message.read_line(&mut String::new()).expect("it tells what the sensor will do");
    signal(&child, Signal::INT);
    let ended = ended((child, message));
    assert_eq!(ended.code, 130, "{}", ended.stderr);
    let names = fs::read_dir(place.path(".")).unwrap().map(|entry| entry.unwrap().file_name());
    assert_eq!(names.collect::<Vec<_>>(), ["frames.npy"]);
}

fn finishes(place: &Workspace) {
    place.ok("release --to out tiny.yaml long.yaml");
    place.ok("audit out");
    let undisturbed = two_scenes();
    undisturbed.ok("release --to out tiny.yaml long.yaml");
    same_tree(&place.path("out"), &undisturbed.path("out"));
}
