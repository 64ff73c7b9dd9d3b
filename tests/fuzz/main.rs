//! Fuzzing of the readers with mutated files of a committed corpus, for a given time. No reader may
//! panic, die, exceed its memory limit, or take more than a second per file. The command line is
//! one of the readers (`command-lines`), and so is the terminal that shows the output (`consoles`).
//!
//! `cargo xtask fuzz [--seconds N] [--only READER]... [--seed N] [--first N] [--runs N] [--jobs
//! N]` runs it. Every reader has a process of its own; `--jobs` processes run at a time. A run is
//! defined by its reader, its seed and its number, so the printed line is enough to repeat a
//! failure. A table ends the output: runs, files read as sound, failures. Any failure makes the
//! exit code 1.
#![expect(clippy::unwrap_used, reason = "a harness that cannot go on panics")]

mod arguments;
mod child;
mod command_lines;
mod consoles;
mod corpus;
mod forging;
mod inert;
mod mutate;
#[path = "../faults/random.rs"]
#[expect(dead_code, reason = "the fault tests draw more kinds of numbers")]
mod random;
mod readers;

use arguments::Arguments;
use child::Tally;
use readers::READERS;
use std::io::Write as _;
use std::process::{Child, Command, ExitCode, ExitStatus, Stdio};
use std::sync::Mutex;
use std::time::{Duration, Instant};

fn main() -> ExitCode {
    let mut args = std::env::args().skip(1).peekable();
    let is_child = args.next_if(|arg| arg == child::MARK).is_some();
    let names: Vec<&str> = READERS.iter().map(|reader| reader.name).collect();
    let arguments = match Arguments::parse(args, &names) {
        Ok(arguments) => arguments,
        Err(why) => {
            say(&format!("error: {why}"));
            return ExitCode::from(2);
        }
    };
    if is_child {
        return child::run(&arguments);
    }
    let chosen: Vec<&str> = names.into_iter().filter(|name| arguments.has(name)).collect();
    let lines = fuzz_all(&chosen, &arguments);
    say(&format!("\n{:16} {:>10} {:>10} {:>9} {:>8}", "reader", "runs", "read", "failures", "seconds"));
    for (name, Tally { runs, sound, failures, seconds }) in &lines {
        say(&format!("{name:16} {runs:>10} {sound:>10} {failures:>9} {seconds:>8.1}"));
    }
    let failures: u64 = lines.iter().map(|(_, tally)| tally.failures).sum();
    say(&format!("{} readers, {failures} failures", lines.len()));
    if failures == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Runs all readers, `--jobs` of them at a time.
fn fuzz_all<'a>(names: &[&'a str], arguments: &Arguments) -> Vec<(&'a str, Tally)> {
    let waiting = Mutex::new(names.iter().enumerate());
    let done = Mutex::new(vec![Tally::default(); names.len()]);
    std::thread::scope(|scope| {
        for _ in 0..arguments.jobs.min(names.len() as u64) {
            scope.spawn(|| {
                loop {
                    let next = waiting.lock().unwrap().next();
                    let Some((k, name)) = next else { return };
                    let tally = fuzz(name, arguments);
                    done.lock().unwrap()[k] = tally;
                }
            });
        }
    });
    names.iter().copied().zip(done.into_inner().unwrap()).collect()
}

/// Runs a reader in a child process. If a run kills the child, the next child continues with the
/// remaining runs.
fn fuzz(name: &str, arguments: &Arguments) -> Tally {
    let progress = tempfile::NamedTempFile::new().unwrap();
    // Memory where the system offers it, so that no disk slows down the readers of files.
    let folder = tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).unwrap();
    let mut all = Tally::default();
    let mut first = arguments.first;
    while all.failures < MAX_FAILURES {
        let left = arguments.seconds as f64 - all.seconds;
        let runs_left = arguments.runs.map(|runs| (arguments.first + runs).saturating_sub(first));
        if left <= 0.0 || runs_left == Some(0) {
            break;
        }
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args([child::MARK, "--only", name, "--seed", &arguments.seed.to_string()]);
        command.args(["--first", &first.to_string(), "--seconds", &format!("{:.0}", left.ceil())]);
        // No GPU is opened: this would take longer than a run may.
        command.env("VK_DRIVER_FILES", "/nonexistent").env("VK_ICD_FILENAMES", "/nonexistent");
        command.env("RUST_BACKTRACE", "0").current_dir(folder.path());
        if let Some(runs) = runs_left {
            command.args(["--runs", &runs.to_string()]);
        }
        let begin = Instant::now();
        let mut child = command.arg("--progress").arg(progress.path()).stdin(Stdio::null()).spawn().unwrap();
        let status = ended(&mut child, Duration::from_secs_f64(left) + PATIENCE);
        let mut tally = child::progress(progress.path());
        tally.seconds = begin.elapsed().as_secs_f64();
        first += tally.runs;
        if !status.success() {
            tally.failures += 1;
            say(&failed(
                name,
                arguments.seed,
                first.saturating_sub(1),
                &format!("the process ended with {status}"),
            ));
        }
        all = all + tally;
        if tally.runs == 0 {
            break;
        }
    }
    all
}

/// Time that a child may take beyond its limit. After that it hangs in its current run and is
/// killed.
const PATIENCE: Duration = Duration::from_secs(10);

fn ended(child: &mut Child, within: Duration) -> ExitStatus {
    let end = Instant::now() + within;
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            return status;
        }
        if Instant::now() >= end {
            child.kill().unwrap();
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Number of failures after which a reader is skipped.
const MAX_FAILURES: u64 = 20;

/// The message for a failure, with the command that repeats it.
fn failed(reader: &str, seed: u64, run: u64, what: &str) -> String {
    format!(
        "{reader}: {what}\n  again: cargo xtask fuzz --only {reader} --seed {seed} --first {run} --runs 1"
    )
}

/// Prints a line to stdout: the figures are the result.
fn say(line: &str) {
    // A closed pipe is no reason to stop.
    let _ = writeln!(std::io::stdout(), "{line}");
}
