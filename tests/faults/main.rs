//! The fault tests: the engine is killed, cut off, starved and damaged, and must never be wrong.
//!
//! `cargo xtask faults [--long] [--seconds N] [--only NAME]... [--seed N]` runs them in release
//! mode. Each prints a line with its name, seed, number of trials, number of wrong trials, and
//! seconds, and the command that repeats it; a table ends it. Any wrong trial makes the exit code
//! 1.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics, which counts as wrong")]

mod arguments;
mod damage;
mod edits;
mod engine;
mod failing;
mod flips;
mod frozen;
mod full;
mod kill;
mod operations;
mod place;
mod power;
mod program;
mod random;
mod repeat;
mod scenes;
mod shared;
mod state;
mod tally;
mod together;
mod workers;

use arguments::Arguments;
use std::io::Write as _;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::time::{Duration, Instant};
use tally::{Line, Tally};

/// The size of a test, and the seed of its random numbers.
#[derive(Debug, Clone, Copy)]
struct Size {
    long: bool,
    seed: u64,
    /// Time after which no trial of a test begins, seconds.
    seconds: Option<u64>,
}

impl Size {
    /// Picks the value for CI or the value for the long run.
    fn of<T>(self, ci: T, long: T) -> T {
        if self.long { long } else { ci }
    }

    /// The instant after which no trial begins. Called when the trials begin.
    fn end(self) -> Option<Instant> {
        self.seconds.map(|seconds| Instant::now() + Duration::from_secs(seconds))
    }
}

struct Test {
    name: &'static str,
    what: &'static str,
    run: fn(Size) -> Tally,
}

const TESTS: [Test; 10] = [
    Test { name: "kill", what: "kill -9 of the process group at random instants", run: kill::run },
    Test { name: "operations", what: "every file operation fails, in every way", run: operations::run },
    Test { name: "power", what: "unsynced writes dropped, torn or out of order", run: power::run },
    Test { name: "state", what: "the database and the records cut and flipped", run: state::run },
    Test { name: "flips", what: "single bits of release files and blobs flipped", run: flips::run },
    Test { name: "full", what: "a disk that fills and is freed", run: full::run },
    Test {
        name: "together",
        what: "two coordinators on a store, eight writers to a shared one",
        run: together::run,
    },
    Test {
        name: "shared",
        what: "a shared store: kills, flips, a full disk, a hostile member",
        run: shared::run,
    },
    Test { name: "repeat", what: "threads, order, folder and clock", run: repeat::run },
    Test { name: "edits", what: "random edit sequences against clean builds", run: edits::run },
];

fn main() -> ExitCode {
    let names: Vec<&str> = TESTS.iter().map(|test| test.name).collect();
    let arguments = match Arguments::parse(std::env::args().skip(1), &names) {
        Ok(arguments) => arguments,
        Err(why) => {
            say(&format!("error: {why}"));
            return ExitCode::from(2);
        }
    };
    if arguments.has("full") || arguments.has("shared") {
        full::enter_name_space();
    }
    let chosen = TESTS.iter().filter(|test| arguments.has(test.name));
    let lines: Vec<Line> = chosen.map(|test| run(test, arguments.size)).collect();
    say("");
    say(&Line::head());
    lines.iter().for_each(|line| say(&line.row()));
    let wrong: u64 = lines.iter().map(|line| line.tally.wrong()).sum();
    let seconds: f64 = lines.iter().map(|line| line.seconds).sum();
    say(&format!("{} tests, {wrong} wrong, {seconds:.0} s", lines.len()));
    if wrong == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Runs a test and reports its result. A panic counts as a wrong trial.
fn run(test: &Test, size: Size) -> Line {
    let started = Instant::now();
    let ended = catch_unwind(AssertUnwindSafe(|| (test.run)(size)));
    let tally = ended.unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str);
        let text = text.or(panic.downcast_ref::<&str>().copied()).unwrap_or("a panic");
        let mut tally = Tally::default();
        tally.trial(Err(format!("the test itself stopped: {text}")));
        tally
    });
    let line =
        Line { name: test.name, what: test.what, size, tally, seconds: started.elapsed().as_secs_f64() };
    say(&line.to_string());
    line
}

/// Returns true if the test's time is over.
fn is_over(end: Option<Instant>) -> bool {
    end.is_some_and(|end| Instant::now() >= end)
}

/// Prints a line to stdout: the figures are the result.
fn say(line: &str) {
    // A closed pipe is no reason to stop.
    let _ = writeln!(std::io::stdout(), "{line}");
}
