//! Two programs on one store.

use crate::support::steps::recipe;
use crate::support::workspace::Workspace;
use gs2e_store::{LockClaim, Store, StoreAccess, StoreOptions};
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

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
fn a_waiting_build_names_the_holder_and_continues() {
    let place = place();
    let holder = Store::open(&place.path(".gs2e"), StoreAccess::Write, &mut |_| {}).unwrap();
    let mut waiting = start(&place);
    let mut message = BufReader::new(waiting.stderr.take().unwrap());
    let mut line = String::new();
    while !line.starts_with("waiting:") {
        line.clear();
        assert_ne!(message.read_line(&mut line).unwrap(), 0, "it did not wait");
    }
    let us = format!("pid {}", std::process::id());
    assert!(line.contains(".gs2e is in use by") && line.contains(&us), "{line}");
    drop(holder);
    let mut rest = String::new();
    message.read_to_string(&mut rest).unwrap();
    assert!(waiting.wait_with_output().unwrap().status.success(), "{rest}");
    assert!(rest.contains("8 steps built, 4 reused, 0 failed"), "{rest}");
}

#[test]
fn no_wait_fails_with_the_name_of_the_holder() {
    let place = place();
    let holder = Store::open(&place.path(".gs2e"), StoreAccess::Write, &mut |_| {}).unwrap();
    let ended = place.gs2e("build --no-wait");
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    let us = format!("in use by pid {}", std::process::id());
    assert!(ended.stderr.contains(&us) && ended.stderr.contains("help:"), "{}", ended.stderr);
    drop(holder);
    place.ok("build --no-wait");
}

/// The lock's text is for users; it names the process, the host, the time and the command.
#[test]
fn the_lock_names_its_holder() {
    let place = place();
    place.ok("build -j 2 -q");
    let text = std::fs::read_to_string(place.path(".gs2e/lock")).unwrap();
    let field = |name: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(name)).map(str::trim);
        line.unwrap_or_else(|| panic!("no `{name}` in\n{text}"))
    };
    let host = rustix::system::uname();
    assert_eq!(field("host:"), host.nodename().to_str().unwrap());
    assert!(field("pid:").parse::<u32>().is_ok_and(|pid| pid != std::process::id()), "{text}");
    let boot = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default();
    assert_eq!(field("boot:"), boot.trim());
    assert_eq!(field("command:"), "gs2e build -j 2 -q");
    let since: Vec<&str> = field("since:").split(['-', 'T', ':']).collect();
    assert!(
        since.len() == 6 && since[5].ends_with('Z') && since[0].parse::<u32>().unwrap() >= 2025,
        "{text}"
    );
}

/// A waiting process is notified again from time to time, at the interval of its own claim.
#[test]
fn a_long_wait_is_reported_again() {
    let folder = tempfile::tempdir().unwrap();
    let claim =
        LockClaim { command: "gs2e build".into(), remind: Duration::from_millis(1), ..LockClaim::default() };
    let mut held = Some(
        Store::open(
            folder.path(),
            StoreOptions { claim: claim.clone(), ..StoreAccess::Write.into() },
            &mut |_| {},
        )
        .unwrap(),
    );
    let mut message = 0;
    let store = Store::open(
        folder.path(),
        StoreOptions { claim: claim.clone(), ..StoreAccess::Write.into() },
        &mut |holder| {
            assert!(holder.ends_with("(gs2e build)"), "{holder}");
            message += 1;
            if message == 4 {
                held.take();
            }
        },
    );
    assert!(store.is_ok() && message == 4, "counted {message} times: {store:?}");
}

/// `plan`, `why` and `check` take no lock, and change nothing in a store that is in use.
#[test]
fn looking_needs_no_lock() {
    let place = place();
    place.ok("build");
    let holder = Store::open(&place.path(".gs2e"), StoreAccess::Write, &mut |_| {}).unwrap();
    place.ok("plan");
    place.ok("why a");
    place.ok("check");
    drop(holder);
    assert_eq!(place.build("recipes"), [""; 0]);
}
