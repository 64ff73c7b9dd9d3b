//! Two releases to one folder, and releases that are stopped.

use super::{POSES, neighbours, out, place, released};
use crate::release::small::said;
use crate::support::workspace::{Workspace, same_tree};
use gs2e_store::{LockClaim, LockRequest, StoreLock};
use rustix::process::{Pid, Signal, kill_process};
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::Path;
use std::process::{Child, ChildStderr, Stdio};
use std::time::Duration;

const ROUNDS: u32 = 20;

/// Starts the release of one of two recipes, each with its own store.
fn start(place: &Workspace, which: &str) -> Child {
    let mut command = place.command(&format!("release --store {which}.store --to out {which}.yaml"));
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

#[test]
fn two_releases_to_one_folder_leave_one_whole_release() {
    let place = Workspace::new();
    for (which, seed) in [("a", "seed: 7"), ("b", "seed: 8")] {
        place.write(&format!("{which}.yaml"), POSES.replace("seed: 7", seed));
        place.ok(&format!("release -q --store {which}.store --to {which} {which}.yaml"));
    }
    let mut whole = [0, 0];
    for round in 0..ROUNDS {
        if round % 3 == 0 {
            let _ = std::fs::remove_dir_all(place.path("out"));
        }
        let ended = [start(&place, "a"), start(&place, "b")].map(|child| child.wait_with_output().unwrap());
        for output in &ended {
            assert!(output.status.success(), "round {round}: {}", said(output));
        }
        place.ok("audit out");
        let won = usize::from(out(&place) == crate::support::workspace::tree(&place.path("b")));
        same_tree(&place.path("out"), &place.path(["a", "b"][won]));
        whole[won] += 1;
        let left = ["a", "a.store", "a.yaml", "b", "b.store", "b.yaml", "out"];
        assert_eq!(neighbours(&place), left, "round {round}");
    }
    assert_eq!(whole[0] + whole[1], ROUNDS);
}

#[test]
fn a_waiting_release_names_the_holder_of_its_folder() {
    let place = place();
    let path = place.path(".out.gs2e-lock");
    let holder = hold(&path, "gs2e release");
    let ended = place.gs2e("release --no-wait --to out r.yaml");
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    let us = format!("out is in use by pid {}", std::process::id());
    assert!(ended.stderr.contains(&us), "{}", ended.stderr);
    let (mut waiting, mut stderr, line) = spawn_until_waiting(&place);
    assert!(line.contains(&us) && line.contains("(gs2e release)"), "{line}");
    drop(holder);
    let mut rest = String::new();
    stderr.read_to_string(&mut rest).unwrap();
    assert!(waiting.wait().unwrap().success(), "{rest}");
    assert_eq!(neighbours(&place), ["out"]);
}

/// Takes the lock of a folder for a command.
fn hold(path: &Path, command: &str) -> StoreLock {
    let claim = &LockClaim { command: command.into(), ..LockClaim::default() };
    let request = LockRequest { path, of: path, claim, wait: false, cancel: &false.into() };
    StoreLock::take_temporary(&request, &mut |_| {}).unwrap()
}

/// Starts a release and reads its stderr up to the line about waiting, which comes last.
fn spawn_until_waiting(place: &Workspace) -> (Child, BufReader<ChildStderr>, String) {
    let mut waiting = place.spawn("release --to out r.yaml");
    let mut stderr = BufReader::new(waiting.stderr.take().unwrap());
    let mut line = String::new();
    while !line.starts_with("waiting:") {
        line.clear();
        assert_ne!(stderr.read_line(&mut line).unwrap(), 0, "it did not wait");
    }
    (waiting, stderr, line)
}

#[test]
fn an_interrupt_while_waiting_ends_it() {
    let place = place();
    let path = place.path(".out.gs2e-lock");
    let _holder = hold(&path, "");
    let (mut waiting, _stderr, _) = spawn_until_waiting(&place);
    kill_process(Pid::from_child(&waiting), Signal::INT).unwrap();
    assert_eq!(waiting.wait().unwrap().code(), Some(130));
    assert_eq!(neighbours(&place), [".out.gs2e-lock"], "it is the other one's");
}

/// A release is stopped at instants that cover its whole run. It leaves the old tree or the new
/// one, and the next run removes the leftovers.
#[test]
fn a_release_that_is_stopped_anywhere_is_made_whole_by_the_next() {
    for signal in [Signal::KILL, Signal::INT] {
        let place = released();
        let old = out(&place);
        place.write("r.yaml", POSES.replace("seed: 7", "seed: 8"));
        place.ok("release -q --to new r.yaml");
        let new = crate::support::workspace::tree(&place.path("new"));
        for step in 0..12 {
            let mut child = place.spawn("release --to out r.yaml");
            std::thread::sleep(Duration::from_millis(7 * step));
            // The process may have ended by itself.
            let _ = kill_process(Pid::from_child(&child), signal);
            child.wait().unwrap();
            let stands = out(&place);
            assert!(stands == old || stands == new, "{signal:?} {step}: {:?}", stands.keys());
            // Back to the old tree, with leftovers of the stopped run in place.
            place.write("r.yaml", POSES);
            place.ok("release -q --to out r.yaml");
            assert!(out(&place) == old, "{signal:?} {step}");
            assert_eq!(neighbours(&place), ["new", "out"], "{signal:?} {step}");
            place.write("r.yaml", POSES.replace("seed: 7", "seed: 8"));
        }
    }
}
