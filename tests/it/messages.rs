//! Every message of the engine, as the program prints it: exit code, text for users, objects for
//! programs.

use crate::command::trained_by;
use crate::support::absent::not_run;
use crate::support::given::sound;
use crate::support::steps::steps;
use crate::support::workspace::{RunOutcome, TINY, Workspace, hidden_gpus};
use gs2e_store::record::{StepProvenance, StepRecord};
use gs2e_store::{Digest, Key, LockClaim, Store, StoreAccess, StoreOptions};
use rustix::process::{Pid, Signal, kill_process};
use std::fs;
use std::io::{BufRead as _, BufReader, Read as _};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

/// Returns true for the line at the end of a build that counts its steps.
fn is_count(line: &str) -> bool {
    line.contains(" built, ") && line.contains(" reused, ")
}

/// Snapshots the result of a run: its exit code, its messages, and their objects.
#[track_caller]
pub(crate) fn check(place: &Workspace, name: &str, ended: &RunOutcome) {
    let mut text = format!("exit {}\n", ended.code);
    let mut in_message = false;
    for line in ended.stderr.lines() {
        let starts = ["error:", "warning:", "waiting:", "interrupted:", "failed:"];
        in_message = starts.iter().any(|word| line.starts_with(word))
            || is_count(line)
            || in_message
                && (line.starts_with([' ', '|']) || line.starts_with("help:") || line.contains('│'));
        if in_message {
            // The time taken differs from run to run.
            let line = if is_count(line) { line.split(';').next().unwrap() } else { line };
            text.push_str(&format!("{line}\n"));
        }
    }
    ended.stdout.lines().filter(|line| line.contains("\"level\"")).for_each(|line| {
        text.push_str(&format!("{line}\n"));
    });
    let mut settings = insta::Settings::clone_current();
    settings.set_snapshot_path(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/snapshots/messages"));
    settings.set_prepend_module_to_snapshot(false);
    settings.set_omit_expression(true);
    settings.bind(|| insta::assert_snapshot!(name, masked(place, &text)));
}

/// The text without the parts that differ between two runs or machines.
fn masked(place: &Workspace, text: &str) -> String {
    let folder = place.path("").canonicalize().unwrap();
    let host = rustix::system::uname().nodename().to_string_lossy().into_owned();
    let mut text = text.replace(folder.to_str().unwrap().trim_end_matches('/'), "PLACE");
    text = text.replace(&format!("host {host}"), "host HOST");
    for (before, mask) in [("pid ", "PID"), ("wrote ", "SIZE"), ("knows ", "N")] {
        text = after(&text, before, mask, |c| c.is_ascii_digit() || c == '.');
    }
    text = after(&text, "PLACE/.gs2e/gs2e-tmp/", "FRESH", |c| c != '/');
    text = after(&text, "(cas/", "DIGEST", |c| c.is_ascii_hexdigit() || "/…".contains(c));
    hex(&text)
}

/// The text with `mask` in place of the characters of a kind that follow each `before`.
fn after(text: &str, before: &str, mask: &str, kind: impl Fn(char) -> bool) -> String {
    let mut parts = text.split(before);
    let mut out = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let rest = part.trim_start_matches(&kind);
        out.push_str(&format!("{before}{}{rest}", if rest.len() < part.len() { mask } else { "" }));
    }
    out
}

/// The text with `DIGEST` in place of each run of 64 hexadecimal digits.
fn hex(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some(at) = rest.find(|c: char| c.is_ascii_hexdigit()) {
        let run = rest[at..].find(|c: char| !c.is_ascii_hexdigit()).map_or(rest.len() - at, |n| n);
        out.push_str(&rest[..at]);
        out.push_str(if run == 64 { "DIGEST" } else { &rest[at..at + run] });
        rest = &rest[at + run..];
    }
    out + rest
}

#[test]
fn recipe_invalid() {
    let place = Workspace::new();
    place.write("a.yaml", TINY.replace("threshold:", "treshold:"));
    check(&place, "recipe-invalid", &place.gs2e("build --json a.yaml"));
    assert!(!place.path(".gs2e").exists(), "nothing ran");
}

#[test]
fn input_missing() {
    let place = sound();
    place.write("tiny.yaml", TINY);
    fs::remove_file(place.path("scene.ply")).unwrap();
    let stopped = place.gs2e("build --json recipe.yaml tiny.yaml");
    check(&place, "input-missing", &stopped);
    assert!(!stopped.stdout.contains("made"), "nothing ran");
    check(&place, "input-missing-keep-going", &place.gs2e("build -k --json recipe.yaml tiny.yaml"));
    assert_eq!(place.stale("tiny.yaml"), [""; 0], "the other scene is built");
}

/// A source that the step's own program writes to.
#[test]
fn input_moved() {
    let place = trained_by("cp \"$3\" \"$2/scene.ply\"; printf more >> \"$3\"");
    check(&place, "input-moved", &place.gs2e("build -j 1 --json --allow-commands recipe.yaml"));
}

#[test]
fn step_failed() {
    let place = sound();
    place.write("scene.ply", "ply\nformat ascii 1.0\n");
    check(&place, "step-failed", &place.gs2e("build -j 1 --json recipe.yaml"));
}

/// Two scenes fail. Each failure is reported when it happens and again at the end, with a command.
#[test]
fn failures_again() {
    let place = sound();
    place.write("scene.ply", "ply\nformat ascii 1.0\n");
    let recipe = fs::read_to_string(place.path("recipe.yaml")).unwrap();
    place.write("another.yaml", recipe.replace("scene: given", "scene: another"));
    check(&place, "failures-again", &place.gs2e("build -k -j 1 recipe.yaml another.yaml"));
}

/// Replaces a blob's bytes.
fn alter(path: &Path) {
    fs::set_permissions(path, fs::Permissions::from_mode(0o644)).unwrap();
    fs::write(path, "other").unwrap();
}

#[test]
fn blob_altered() {
    let place = Workspace::with_tiny();
    place.ok("build -q tiny.yaml");
    alter(&steps(&place, "tiny.yaml")["tiny/base/events"].outputs["events.h5"]);
    check(&place, "blob-altered", &place.gs2e("build --json tiny.yaml"));
}

#[test]
fn altered() {
    let place = Workspace::with_tiny();
    place.ok("release -q --copy --to out tiny.yaml");
    alter(&place.path("out/tiny/base/poses.txt"));
    check(&place, "altered", &place.gs2e("audit out --json"));
}

#[test]
fn state_rebuilt() {
    let place = Workspace::with_tiny();
    place.ok("build -q tiny.yaml");
    place.write(".gs2e/state.db", "no database");
    check(&place, "state-rebuilt", &place.gs2e("build --json tiny.yaml"));
}

fn hold(place: &Workspace) -> Store {
    let claim = LockClaim {
        command: "gs2e build -j8".into(),
        since: "2026-03-01T14:02:59Z".into(),
        ..LockClaim::default()
    };
    Store::open(
        &place.path(".gs2e"),
        StoreOptions { claim: claim.clone(), ..StoreAccess::Write.into() },
        &mut |_| {},
    )
    .unwrap()
}

#[test]
fn locked() {
    let place = Workspace::with_tiny();
    let holder = hold(&place);
    check(&place, "locked-no-wait", &place.gs2e("build --no-wait --json tiny.yaml"));
    let mut child = place.spawn("build tiny.yaml");
    let mut message = BufReader::new(child.stderr.take().unwrap());
    let mut stderr = String::new();
    message.read_line(&mut stderr).unwrap();
    drop(holder);
    message.read_to_string(&mut stderr).unwrap();
    let code = child.wait().unwrap().code().unwrap();
    let stderr = stderr.lines().filter(|line| !is_count(line)).collect::<Vec<_>>().join("\n");
    check(&place, "locked", &RunOutcome { code, stdout: String::new(), stderr });
}

#[test]
fn a_lock_of_a_dead_process_gives_no_message() {
    let place = Workspace::with_tiny();
    let left = "host: node3\npid: 4711\nboot: x\nsince: 2026-03-01T14:02:59Z\ncommand: gs2e build\n";
    drop(Store::open(&place.path(".gs2e"), StoreAccess::Write, &mut |_| {}).unwrap());
    place.write(".gs2e/lock", left);
    let ended = place.ok("build --no-wait -q tiny.yaml");
    assert_eq!((ended.stderr.as_str(), ended.stdout.as_str()), ("", ""));
    let now = fs::read_to_string(place.path(".gs2e/lock")).unwrap();
    assert!(now.ends_with("command: gs2e build --no-wait -q tiny.yaml\n") && !now.contains("node3"), "{now}");
}

#[test]
fn store_newer() {
    let place = Workspace::with_tiny();
    place.write(".gs2e/VERSION", "gs2e store, format 4000\n");
    check(&place, "store-newer", &place.gs2e("build --json tiny.yaml"));
}

/// A record differs in one file from the bytes that the step makes. The record stays if the two are
/// only compared, and is replaced if another of its blobs is lost.
#[test]
fn nondeterministic() {
    let place = Workspace::with_tiny();
    place.ok("build -q tiny.yaml");
    let step = steps(&place, "tiny.yaml").remove("tiny/base/trajectory").unwrap();
    let drawing = fs::read(&step.outputs["trajectory.svg"]).unwrap();
    fs::remove_file(&step.outputs["trajectory.svg"]).unwrap();
    {
        let store = Store::open(&place.path(".gs2e"), StoreAccess::Write, &mut |_| {}).unwrap();
        let workspace = store.workspace().unwrap();
        for (role, path) in &step.outputs {
            let mut bytes = if role == "trajectory.svg" { drawing.clone() } else { fs::read(path).unwrap() };
            if role == "trajectory.svg" {
                bytes[100] ^= 1;
            }
            fs::write(workspace.path().join(role), bytes).unwrap();
        }
        let key = Key(step.key.unwrap().parse::<Digest>().unwrap());
        let provenance =
            StepProvenance { tool: "0.0.9".into(), seconds: 2.5, threads: 7, ..StepProvenance::default() };
        let record = StepRecord::new(key, "trajectory", vec![], provenance);
        let replaced = store.publish(&workspace, record).unwrap_err();
        assert!(replaced.to_string().starts_with("nondeterministic step"), "{replaced}");
        store.flush().unwrap();
    }
    let build = |name: &str, options: &str| {
        let mut ended = place.gs2e(&format!("build -j 1 --json {options} tiny.yaml"));
        for text in [&mut ended.stderr, &mut ended.stdout] {
            *text = text.replace(concat!("gs2e ", env!("CARGO_PKG_VERSION"), ", "), "gs2e VERSION, ");
            *text = after(text, "VERSION, ", "SECONDS", |c| c.is_ascii_digit() || c == '.');
        }
        check(&place, name, &ended);
    };
    build("nondeterministic", "-k --recheck 100%");
    fs::remove_file(&step.outputs["poses.txt"]).unwrap();
    build("nondeterministic-replaced", "");
    place.ok("build -q tiny.yaml");
}

#[test]
fn interrupted() {
    let place = Workspace::new();
    place.write("tiny.yaml", TINY.replace("factor: 2", "factor: 40"));
    let mut child = place.spawn("build -j 1 tiny.yaml");
    let mut message = BufReader::new(child.stderr.take().unwrap());
    let mut stderr = String::new();
    while !stderr.contains("[1/") {
        assert_ne!(message.read_line(&mut stderr).unwrap(), 0, "it ended before its first step:\n{stderr}");
    }
    kill_process(Pid::from_child(&child), Signal::INT).unwrap();
    message.read_to_string(&mut stderr).unwrap();
    let code = child.wait().unwrap().code().unwrap();
    let stderr = after(&stderr, "interrupted: ", "N", |c| c.is_ascii_digit());
    check(&place, "interrupted", &RunOutcome { code, stdout: String::new(), stderr });
}

#[test]
fn no_adapter() {
    let place = Workspace::with_tiny();
    check(&place, "no-adapter", &place.gs2e("build --backend gpu --json tiny.yaml"));
    assert!(!place.path(".gs2e").exists(), "nothing ran");
}

/// A store on a file system of its own that is soon full: the build ends with figures, and
/// continues once there is room.
#[test]
fn disk_full() {
    let place = Workspace::new();
    place.write("a.yaml", TINY.replace("scene: tiny", "scene: a").replace("factor: 2", "factor: 20"));
    place.write("b.yaml", TINY.replace("scene: tiny", "scene: b"));
    let program = env!("CARGO_BIN_EXE_gs2e");
    let script = format!(
        "mkdir .gs2e && mount -t tmpfs -o size=300k tmpfs .gs2e || exit 77
         {program} build -k -j 1 --json a.yaml b.yaml; code=$?
         mount -o remount,size=64m .gs2e || exit 79
         {program} build -q a.yaml b.yaml >&2 || exit 78
         exit $code"
    );
    let mut command = hidden_gpus(std::process::Command::new("unshare"));
    command.args(["-rm", "sh", "-c", &script]).current_dir(place.path(""));
    let output = command.output();
    let Some(output) = output
        .ok()
        .filter(|output| ![Some(77), Some(1)].contains(&output.status.code()) || !output.stdout.is_empty())
    else {
        return not_run("no file system can be mounted here");
    };
    if output.status.code() == Some(79) {
        return not_run("this user may mount a file system and not enlarge it");
    }
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    let (code, mut stdout, mut stderr) =
        (output.status.code().unwrap(), text(output.stdout), text(output.stderr));
    assert_ne!(code, 78, "it goes on once there is room:\n{stderr}");
    // With one core no other step is at work when the step fails, and no step may start afterwards.
    let states: Vec<&str> = stdout.lines().filter_map(|line| line.split("\"state\":\"").nth(1)).collect();
    assert!(states.last().is_some_and(|state| state.starts_with("failed")), "{stdout}");
    // The point at which the disk is full, within the step and among the steps, depends on the
    // machine.
    let causes = [" because ", "kept: "];
    for (text, cause) in [&mut stderr, &mut stdout].into_iter().zip(causes) {
        assert!(text.contains("No space left on device"), "{text}");
        *text = after(text, cause, "CAUSE", |c| c != '\n' && c != '"');
        *text = after(text, "(tmpfs); ", "N", |c| c.is_ascii_digit());
    }
    stderr = stderr.lines().filter(|line| !is_count(line)).collect::<Vec<_>>().join("\n");
    check(&place, "disk-full", &RunOutcome { code, stdout, stderr });
}
