//! No process of a trainer is left when its build ends, for every way of ending.

use crate::command::{COPY, trained_by, write_script};
use crate::support::workspace::Workspace;
use rustix::process::{Pid, Signal, kill_process};
use std::fs;
use std::io::Read as _;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// Starts a build with a trainer that holds the pipe `held`, together with its child processes, and
/// creates the file `at work` when `script` does. The build's signals are set to their defaults,
/// even if the test was started with some ignored.
fn training(script: &str) -> (Workspace, Child) {
    let place = trained_by(&format!("exec 9> \"$beside/held\"; {script}"));
    assert!(Command::new("mkfifo").arg(place.path("held")).status().unwrap().success());
    let gs2e = place.command("build -j 1 --allow-commands recipe.yaml");
    let mut command = Command::new("env");
    command.args(["--default-signal", "--"]).arg(gs2e.get_program()).args(gs2e.get_args());
    let variables = gs2e.get_envs().filter_map(|(name, value)| Some((name, value?)));
    command.envs(variables).current_dir(place.path("")).stdin(Stdio::null());
    let child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    (place, child)
}

fn wait_for(place: &Workspace, name: &str, child: &mut Child) {
    while !place.path(name).exists() {
        assert!(child.try_wait().unwrap().is_none(), "it ended before `{name}` was there");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn send(child: &Child, signal: Signal) {
    kill_process(Pid::from_child(child), signal).unwrap();
}

/// Runs `act` once the trainer is at work, and returns when no process of the trainer is left. The
/// number is the build's exit code.
fn until_nothing_is_left(script: &str, act: impl FnOnce(&Workspace, &mut Child)) -> (Workspace, Option<i32>) {
    let (place, mut child) = training(script);
    let code = std::thread::scope(|scope| {
        let reader = scope.spawn(|| fs::read(place.path("held")).unwrap());
        wait_for(&place, "at work", &mut child);
        act(&place, &mut child);
        let mut said = String::new();
        child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        let code = child.wait().unwrap().code();
        // This returns when every holder of the pipe has ended.
        reader.join().unwrap();
        code
    });
    (place, code)
}

const GROUP: &str = "sleep 600 & : > \"$beside/at work\"; wait";
/// The first process leaves the trainer's group; the parent of the second has ended.
const ESCAPED: &str =
    "setsid sleep 600 & (setsid sh -c 'sleep 600 & sleep 600' &) ; : > \"$beside/at work\"; wait; sleep 600";

#[test]
fn every_signal_that_ends_a_terminal_or_a_session_stops_the_trainer() {
    for signal in [Signal::HUP, Signal::QUIT, Signal::TERM, Signal::INT] {
        let (place, code) = until_nothing_is_left(GROUP, |_, child| send(child, signal));
        assert_eq!(code, Some(130), "{signal:?}");
        write_script(&place, COPY);
        place.ok("build --allow-commands recipe.yaml");
    }
}

#[test]
fn a_build_that_is_killed_leaves_no_trainer() {
    for script in [GROUP, ESCAPED] {
        let (place, code) = until_nothing_is_left(script, |_, child| child.kill().unwrap());
        assert_eq!(code, None, "a signal ended it");
        write_script(&place, COPY);
        let said = place.ok("build --allow-commands recipe.yaml").stderr;
        assert!(!said.contains("could not be read"), "{said}");
    }
}

#[test]
fn processes_that_left_the_group_of_a_trainer_end_with_it() {
    let script = format!("setsid sleep 600 & : > \"$beside/at work\"; {COPY}");
    let (place, code) = until_nothing_is_left(&script, |_, _| {});
    assert_eq!(code, Some(0));
    assert_eq!(place.stale("recipe.yaml"), [""; 0]);
}

/// The trainer ignores the first request to end, so only the second interrupt ends it before its
/// time is over.
#[test]
fn a_second_interrupt_ends_a_trainer_that_ignores_the_first() {
    let script = "trap ': > \"$beside/asked\"' TERM; : > \"$beside/at work\"; while :; do sleep 1; done";
    let (_, code) = until_nothing_is_left(script, |place, child| {
        send(child, Signal::INT);
        wait_for(place, "asked", child);
        send(child, Signal::INT);
    });
    assert_eq!(code, Some(130));
}

/// The next build starts at once, and empties the folders of the killed one.
#[test]
fn the_next_build_takes_no_folder_from_under_a_trainer() {
    let script = "cd \"$2\"; : > \"$beside/at work\"; \
                  while :; do (: > alive) 2> /dev/null || : > \"$beside/lost\"; done";
    let (place, mut child) = training(script);
    std::thread::scope(|scope| {
        let reader = scope.spawn(|| fs::read(place.path("held")).unwrap());
        wait_for(&place, "at work", &mut child);
        write_script(&place, COPY);
        child.kill().unwrap();
        place.ok("build --allow-commands recipe.yaml");
        reader.join().unwrap();
        child.wait().unwrap();
    });
    assert!(!place.path("lost").exists(), "its folder was deleted while it ran");
}

/// The name of a process with this parent. A line of `stat` is `pid (name) state parent …`.
fn name_of_child(parent: u32) -> Option<String> {
    let lines = fs::read_dir("/proc").unwrap().flatten().map(|entry| entry.path().join("stat"));
    let mut lines = lines.filter_map(|path| fs::read_to_string(path).ok());
    lines.find_map(|line| {
        let (before, after) = line.rsplit_once(") ")?;
        let (_, name) = before.split_once(" (")?;
        let found = after.split(' ').nth(1)?.parse::<u32>().ok()?;
        (found == parent).then(|| name.to_owned())
    })
}

/// Killing processes by the program's name spares the supervisor, which then does its work.
#[test]
fn the_supervisor_has_another_name_than_the_program() {
    let (_, code) = until_nothing_is_left(GROUP, |_, child| {
        let name = name_of_child(child.id()).expect("it has a supervisor");
        assert!(!name.contains("gs2e"), "{name}");
        child.kill().unwrap();
    });
    assert_eq!(code, None);
}
