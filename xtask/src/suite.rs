//! Tests through plain `cargo test`, then the total, and last the tests that did not run.

use crate::changed;
use crate::command::{Outcome, cargo, program, root, say};
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::io::Write as _;
use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::Instant;

/// The packages that are tested, checked and documented together: all. A command that leaves one of them out
/// may compile others again, because dependencies have fewer features without it.
pub(crate) const PACKAGES: [&str; 1] = ["--workspace"];

/// Integration tests of one binary.
struct TestChoice {
    binary: &'static str,
    /// Names, each with what the tests show.
    tests: &'static [(&'static str, &'static str)],
}

/// What tells in minutes whether a checkout is sound on this machine, besides the unit tests of every crate.
const SMOKE: [TestChoice; 2] = [
    TestChoice { binary: "rendering", tests: &[("golden::", "pictures equal those of another program")] },
    TestChoice {
        binary: "it",
        tests: &[
            ("golden_digests::", "every step makes its pinned bytes"),
            ("manifest::", "the demo equals its manifest"),
            ("bad_input::a_recipe_with_faulty_text_is_refused", "a build with a fault"),
            ("hostile_files::sources_are_regular_files", "hostile files"),
        ],
    },
];

/// The integration tests with slow parts: names of binaries.
const WITH_SLOW: [&str; 5] = ["it", "event_statistics", "recipes", "rendering", "trajectories"];

/// Runs the tests that `args` ask for: none, a short selection; `--all`; `--changed`, what depends on the
/// crates that differ from `main`; others go to `cargo test`.
pub(crate) fn run(args: &[String]) -> Outcome {
    match args {
        [] => run_short(),
        [first] if first == "--all" => run_all(),
        [first, rest @ ..] if first == "--all" => run_each(&[to_test(&PACKAGES, rest)]),
        [first, rest @ ..] if first == "--changed" => {
            let Some(calls) = changed::calls()? else {
                say("nothing differs from main");
                return Ok(());
            };
            let calls: Vec<_> = calls.iter().map(|call| to_test(call, rest)).collect();
            run_each(&calls)
        }
        args => run_each(&[to_test(&PACKAGES, args)]),
    }
}

/// Every test: those of the program beside all others, because many of them wait for what they start.
pub(crate) fn run_all() -> Outcome {
    // Compiled first: tests would meet a compiler at work.
    cargo(&["test", "--quiet", "--no-run"]).args(PACKAGES).run()?;
    let mut others = vec!["--lib".to_owned(), "--bins".to_owned()];
    others.extend(tests_of_crates()?.into_iter().flat_map(|name| ["--test".to_owned(), name]));
    let program = to_test(&PACKAGES, &["--test", "it"]);
    run_beside(&[program], &[to_test(&PACKAGES, &others), to_test(&PACKAGES, &["--doc"])])
}

/// Names of the integration tests in `crates/`: `NAME.rs` and `NAME/main.rs`.
fn tests_of_crates() -> Outcome<BTreeSet<String>> {
    let entries = |folder: &Path| -> Outcome<Vec<PathBuf>> {
        let failed = |e| format!("{}: {e}", folder.display());
        std::fs::read_dir(folder).map_err(failed)?.map(|entry| Ok(entry.map_err(failed)?.path())).collect()
    };
    let mut names = BTreeSet::new();
    for folder in entries(&root().join("crates"))?.iter().map(|path| path.join("tests")) {
        for path in if folder.is_dir() { entries(&folder)? } else { Vec::new() } {
            if path.extension().is_some_and(|extension| extension == "rs") || path.join("main.rs").is_file() {
                names.insert(path.file_stem().unwrap_or_default().to_string_lossy().into_owned());
            }
        }
    }
    Ok(names)
}

fn run_short() -> Outcome {
    say("1 of 2: the unit tests of every crate");
    let mut calls = vec![to_test(&PACKAGES, &["--lib"])];
    for TestChoice { binary, tests } in SMOKE {
        for (name, shows) in tests {
            say(&format!("2 of 2: {name}: {shows}"));
        }
        let names: Vec<&str> = tests.iter().map(|(name, _)| *name).collect();
        let chosen = PACKAGES.into_iter().chain(["--test", binary, "--"]);
        calls.push(to_test(&chosen.collect::<Vec<_>>(), &names));
    }
    let done = run_each(&calls);
    say(
        "left out: the other integration tests (`cargo xtask test --all`, or `cargo xtask test --test it NAME`),",
    );
    say("and faults, fuzzing, bombs, Python and documentation (`cargo xtask ci`)");
    done
}

/// Arguments of `cargo test`.
fn to_test(packages: &[impl AsRef<str>], args: &[impl AsRef<str>]) -> Vec<String> {
    let packages = packages.iter().map(|text| text.as_ref().to_owned());
    packages.chain(args.iter().map(|text| text.as_ref().to_owned())).collect()
}

/// Runs `cargo test` with each list of arguments.
fn run_each(calls: &[Vec<String>]) -> Outcome {
    run_beside(calls, &[])
}

/// Runs `cargo test` with each list of arguments, and beside it, on half of the cores, with each of `others`.
fn run_beside(calls: &[Vec<String>], others: &[Vec<String>]) -> Outcome {
    name_what_is_absent();
    let begin = Instant::now();
    let total = Mutex::new(Total::default());
    let list = root().join("target/not-run.txt");
    // A list of an earlier run would name tests that have run since.
    match std::fs::remove_file(&list) {
        Err(why) if why.kind() != std::io::ErrorKind::NotFound => {
            return Err(format!("{}: {why}", list.display()));
        }
        _ => {}
    }
    let cores = std::thread::available_parallelism().map_or(1, NonZero::get);
    let half = cores.div_ceil(2);
    let run = |calls: &[Vec<String>], threads: usize| -> Outcome<bool> {
        let mut passed = true;
        for call in calls {
            let test = cargo(&["test", "--no-fail-fast"]).args(call);
            let mut test = test.env("NOT_RUN_LIST", &list.to_string_lossy());
            if std::env::var_os("RUST_TEST_THREADS").is_none() {
                test = test.env("RUST_TEST_THREADS", &threads.to_string());
            }
            passed &= test.each_line(|line| {
                total.lock().expect("no thread panics with the sums").add(line);
                // A closed pipe (`| head`) is no failed test.
                let _ = writeln!(std::io::stdout(), "{line}");
            })?;
        }
        Ok(passed)
    };
    let passed = std::thread::scope(|scope| {
        let beside = scope.spawn(|| run(others, half));
        // Every third test waits for programs that it starts.
        let passed = run(calls, cores + half)?;
        Ok::<_, String>(beside.join().expect("a call of cargo does not panic")? && passed)
    })?;
    let total = total.into_inner().expect("no thread panics with the sums");
    let _ = writeln!(std::io::stdout(), "{}", total.summary(passed, begin.elapsed().as_secs_f64()));
    let _ = writeln!(std::io::stdout(), "{}", not_run(&std::fs::read_to_string(list).unwrap_or_default()));
    if passed { Ok(()) } else { Err("tests failed, see above".into()) }
}

/// Runs the integration tests with those that are slow.
pub(crate) fn run_slow_tests() -> Outcome {
    let binaries = WITH_SLOW.iter().flat_map(|name| ["--test", name]);
    cargo(&["test"]).args(PACKAGES).args(binaries).env("RUN_SLOW_TESTS", "1").run()
}

/// Rewrites the generated parts of the documentation: the tests that compare them do this on
/// request.
pub(crate) fn rewrite_docs() -> Outcome {
    let reference = ["--test", "it", "--", "docs::the_reference"];
    cargo(&["test", "--quiet"]).args(PACKAGES).args(reference).env("WRITE_DOCS", "1").run()
}

/// The closing line: the tests of a list with lines `TEST (WHY)`, grouped by the reason why they
/// did not run in full.
fn not_run(list: &str) -> String {
    let mut by_reason: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for line in list.lines() {
        let (test, why) = line.split_once(" (").unwrap_or((line, "no reason)"));
        by_reason.entry(why.strip_suffix(')').unwrap_or(why)).or_default().push(test);
    }
    for tests in by_reason.values_mut() {
        tests.sort_unstable();
        // A test that asks for several files has a line for each.
        tests.dedup();
    }
    let count: usize = by_reason.values().map(Vec::len).sum();
    let reasons: Vec<String> =
        by_reason.iter().map(|(why, tests)| format!("{why}: {}", tests.join(", "))).collect();
    match count {
        0 => "0 tests not run".to_owned(),
        _ => format!("{count} tests not run: {}", reasons.join("; ")),
    }
}

fn name_what_is_absent() {
    if !root().join("../shared").is_dir() {
        say("absent: ../shared (captured scenes and clips): the tests over them are left out");
    }
    let reads_back = program(OsStr::new("python3"), &["-c", "import h5py, numpy"]).succeeds();
    if !reads_back {
        say(
            "absent: python3 with numpy and h5py: reading event files back with foreign programs is left out",
        );
    }
    if std::env::var_os("RUN_SLOW_TESTS").is_none_or(|value| value != "1") {
        say("left out: slow tests (RUN_SLOW_TESTS=1 runs them)");
    }
}

/// Sums of the closing lines of all test binaries.
#[derive(Debug, Default, PartialEq, Eq)]
struct Total {
    binaries: u64,
    /// Passed, failed, ignored, measured, filtered out, as in cargo's line.
    counts: [u64; 5],
}

const COUNTED: [&str; 5] = [" passed", " failed", " ignored", " measured", " filtered out"];

impl Total {
    /// Adds a line such as `test result: ok. 3 passed; 0 failed; …`. Other lines add nothing.
    fn add(&mut self, line: &str) {
        let Some(rest) = line.strip_prefix("test result: ") else { return };
        let Some((_, figures)) = rest.split_once(". ") else { return };
        self.binaries += 1;
        for figure in figures.split("; ") {
            for (count, name) in self.counts.iter_mut().zip(COUNTED) {
                let number = figure.strip_suffix(name).and_then(|text| text.parse::<u64>().ok());
                *count += number.unwrap_or(0);
            }
        }
    }

    /// The closing line: cargo's own form, under another head, so that a script that sums cargo's
    /// lines counts no test twice.
    fn summary(&self, passed: bool, seconds: f64) -> String {
        let verdict = if passed { "ok" } else { "FAILED" };
        let counts: Vec<String> =
            self.counts.iter().zip(COUNTED).map(|(count, name)| format!("{count}{name}")).collect();
        let binaries = self.binaries;
        format!("all {binaries} test binaries: {verdict}. {}; finished in {seconds:.2}s", counts.join("; "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tests_that_did_not_run_are_named_once_by_reason() {
        let list =
            "b (../shared is absent)\na (../shared is absent)\nb (../shared is absent)\nc (no b3sum)\n";
        assert_eq!(not_run(list), "3 tests not run: ../shared is absent: a, b; no b3sum: c");
        assert_eq!(not_run(""), "0 tests not run");
    }

    #[test]
    fn totals_add_up_cargos_lines_and_nothing_else() {
        let mut total = Total::default();
        for line in [
            "running 2 tests",
            "test a ... ok",
            "test result: ok. 2 passed; 0 failed; 1 ignored; 0 measured; 0 filtered out; finished in 0.00s",
            "test result: FAILED. 40 passed; 3 failed; 0 ignored; 0 measured; 7 filtered out; finished in 1.20s",
            "",
        ] {
            total.add(line);
        }
        assert_eq!(total, Total { binaries: 2, counts: [42, 3, 1, 0, 7] });
        assert_eq!(
            total.summary(false, 1.5),
            "all 2 test binaries: FAILED. 42 passed; 3 failed; 1 ignored; 0 measured; 7 filtered out; \
             finished in 1.50s"
        );
    }
}
