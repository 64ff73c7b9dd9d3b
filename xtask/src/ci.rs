//! The steps of CI, each with its seconds. The first failure stops them.

use crate::command::{Outcome, cargo, program, root, say};
use crate::suite::PACKAGES;
use crate::{alone, bombs, container, demo, faults, fuzz, python, suite};
use std::ffi::OsStr;
use std::time::{Duration, Instant};

type Step = (&'static str, fn() -> Outcome);

/// Less than 25 minutes on two cores, from a clean checkout.
const STEPS: [Step; 6] = [
    ("formatting", || cargo(&["fmt", "--all", "--check"]).run()),
    ("clippy", || {
        // `--all-targets` does not include targets that plain `cargo test` leaves out. The optional feature
        // is compiled here alone.
        let by_name = ["--test", "faults", "--test", "fuzz", "--test", "bombs", "--", "-D", "warnings"];
        let all = ["clippy", "--quiet", "--all-targets", "--features", "gs2e/s3"];
        cargo(&all).args(PACKAGES).args(by_name).run()
    }),
    ("tests", suite::run_all),
    ("documentation, faults, fuzzing, bombs and Python", trials),
    ("packages", || {
        // Without the lock file, so that the module is packed although no registry has the library.
        let pack =
            ["package", "--quiet", "--workspace", "--exclude-lockfile", "--no-verify", "--allow-dirty"];
        cargo(&pack).run()
    }),
    ("licences", licences),
];

/// What `--long` adds: slow tests, a second build of everything, in release mode, and longer trials.
const LONG: [Step; 7] = [
    ("slow tests", suite::run_slow_tests),
    ("faults in release mode", || faults::run(&[])),
    ("crates alone", alone::run),
    ("longer fuzzing", || fuzz::run(&["--seconds", "60", "--jobs", "2"].map(str::to_owned))),
    ("the README's first command in release mode", demo::first_command_twice),
    ("a read-only root", || container::run(&[])),
    ("builds beside ninja", builds_beside_ninja),
];

/// With the features of the clippy step, whose checks of the dependencies then serve.
fn documentation() -> Outcome {
    // Cargo lets one command at a time find out what is to be compiled: the trials, which compile nothing,
    // come first.
    std::thread::sleep(Duration::from_secs(5));
    let all = ["doc", "--quiet", "--no-deps", "--features", "gs2e/s3"];
    cargo(&all).args(PACKAGES).env("RUSTDOCFLAGS", "-D warnings").run()
}

/// Documentation, trials of the whole program and the tests of the wheel, at the same time: each waits for
/// processes, or keeps one core busy.
fn trials() -> Outcome {
    // Compiled first, because cargo compiles for one command at a time.
    let binaries = ["faults", "fuzz", "bombs"].into_iter().flat_map(|name| ["--test", name]);
    cargo(&["test", "--quiet", "--no-run"]).args(PACKAGES).args(binaries).run()?;
    let trials: [fn() -> Outcome; 5] =
        [documentation, faults::short, fuzz::short, || bombs::run(&[]), python::in_ci];
    std::thread::scope(|scope| {
        let running = trials.map(|trial| scope.spawn(trial));
        // All are waited for, so that one failure does not hide another.
        let ended = running.map(|thread| thread.join().expect("a trial does not panic"));
        ended.into_iter().collect()
    })
}

/// Checks the licences and origins of all dependencies, if cargo-deny is there.
fn licences() -> Outcome {
    if !cargo(&["deny", "--version"]).succeeds() {
        say("absent: cargo-deny: the licences of the dependencies are not checked");
        return Ok(());
    }
    cargo(&["deny", "--log-level", "error", "check", "licenses", "bans", "sources"]).run()
}

/// Compares builds that have little or nothing to do with ninja's, if ninja is there.
fn builds_beside_ninja() -> Outcome {
    let has_ninja = program(OsStr::new("ninja"), &["--version"]).succeeds();
    if !has_ninja || !root().join("../shared").is_dir() {
        say("absent: ninja, or ../shared with its graph: builds are not timed beside it");
        return Ok(());
    }
    let check = ["bench", "--quiet", "--bench", "build", "--", "--check", "--scenes", "1000", "--runs", "7"];
    cargo(&check).run()
}

/// Runs every step, and those of [`LONG`] if `long` is set.
pub(crate) fn run(long: bool) -> Outcome {
    let begin = Instant::now();
    let steps: Vec<Step> = STEPS.into_iter().chain(LONG.into_iter().filter(|_| long)).collect();
    for (name, step) in &steps {
        say(&format!("ci: {name}"));
        let start = Instant::now();
        let done = step();
        let seconds = start.elapsed().as_secs_f64();
        done.map_err(|why| format!("ci: {name} failed after {seconds:.1} s: {why}"))?;
        say(&format!("ci: {name}: ok, {seconds:.1} s"));
    }
    say(&format!("ci: all {} steps ok, {:.1} s", steps.len(), begin.elapsed().as_secs_f64()));
    Ok(())
}
