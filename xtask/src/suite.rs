//! All tests through plain `cargo test`, what is left out named before, the total after.

use crate::command::{Outcome, cargo, program, root, say};
use std::ffi::OsStr;
use std::io::Write as _;
use std::time::Instant;

/// Runs `cargo test --workspace` with `args` after it.
pub(crate) fn run(args: &[String]) -> Outcome {
    name_what_is_absent();
    let begin = Instant::now();
    let mut total = Total::default();
    let test = cargo(&["test", "--workspace", "--no-fail-fast"]).args(args);
    let passed = test.each_line(|line| {
        total.add(line);
        // A reader that went away (`| head`) is no failed test.
        let _ = writeln!(std::io::stdout(), "{line}");
    })?;
    let _ = writeln!(std::io::stdout(), "{}", total.summary(passed, begin.elapsed().as_secs_f64()));
    if passed { Ok(()) } else { Err("tests failed, see above".into()) }
}

/// Rewrites the generated parts of the documentation: the tests that compare them do, where they are asked to.
pub(crate) fn rewrite_docs() -> Outcome {
    cargo(&["test", "--quiet", "--test", "it", "--", "docs::the_reference"]).env("WRITE_DOCS", "1").run()
}

fn name_what_is_absent() {
    if !root().join("../shared").is_dir() {
        say("absent: ../shared (golden renders and events, real scenes): the tests over them are left out");
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

/// Sums of the lines with which each test binary ends.
#[derive(Debug, Default, PartialEq, Eq)]
struct Total {
    binaries: u64,
    /// Passed, failed, ignored, measured, filtered out, as in cargo's line.
    counts: [u64; 5],
}

const COUNTED: [&str; 5] = [" passed", " failed", " ignored", " measured", " filtered out"];

impl Total {
    /// Adds a line such as `test result: ok. 3 passed; 0 failed; …`; any other adds nothing.
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

    /// The closing line: cargo's own form, under another head so that a script that sums cargo's lines counts no
    /// test twice.
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
