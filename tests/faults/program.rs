//! The program under test, run to its end or killed before it.

use rustix::process::{Pid, Signal, kill_process_group};
use serde_json::Value;
use std::fmt;
use std::io::Read;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Outcome of a run.
#[derive(Debug)]
pub(crate) struct RunOutcome {
    /// The exit code; `None` if a signal ended the program.
    pub(crate) code: Option<i32>,
    pub(crate) signal: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl RunOutcome {
    fn of(output: Output) -> Self {
        let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
        Self {
            code: output.status.code(),
            signal: output.status.signal(),
            stdout: text(output.stdout),
            stderr: text(output.stderr),
        }
    }

    /// The steps that `build --json` reports as made. The last line may be truncated.
    pub(crate) fn made(&self) -> Vec<String> {
        let found = self.stdout.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
        let made = found.filter(|line| line["state"] == "made");
        made.filter_map(|line| line["step"].as_str().map(str::to_owned)).collect()
    }

    /// Checks that there was no panic and no fatal signal: on any input the program ends by itself
    /// and gives a reason.
    pub(crate) fn is_orderly(&self) -> Result<(), String> {
        let panicked = self.code == Some(101) || self.stderr.contains("panicked at");
        // Exit code 3 is a verdict, with its own messages.
        let says_why = ["error", "interrupted"].iter().any(|word| self.stderr.contains(word));
        let unsaid = !matches!(self.code, Some(0 | 3)) && !says_why;
        if panicked || self.signal.is_some() || unsaid { Err(self.to_string()) } else { Ok(()) }
    }
}

impl fmt::Display for RunOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines: Vec<&str> = self.stderr.lines().collect();
        let tail = lines[lines.len().saturating_sub(12)..].join("\n");
        write!(f, "exit code {:?}, signal {:?}\n{tail}", self.code, self.signal)
    }
}

fn command(folder: &Path, args: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gs2e"));
    command.args(args.split_whitespace()).current_dir(folder).stdin(Stdio::null());
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).process_group(0);
    command
}

/// Starts the program in a process group of its own.
pub(crate) fn start(folder: &Path, args: &str) -> Child {
    command(folder, args).spawn().unwrap()
}

/// Waits for the program's end.
pub(crate) fn end(child: Child) -> RunOutcome {
    RunOutcome::of(child.wait_with_output().unwrap())
}

/// Runs the program to its end, which must be orderly.
pub(crate) fn run(folder: &Path, args: &str) -> Result<RunOutcome, String> {
    let ended = end(start(folder, args));
    ended.is_orderly().map_err(|why| format!("`gs2e {args}` ended out of order: {why}"))?;
    Ok(ended)
}

/// Runs the program, and sends its process group a signal after a time, unless it ended before. The
/// second value is true if the signal was sent.
pub(crate) fn run_until(folder: &Path, args: &str, after: Duration, signal: Signal) -> (RunOutcome, bool) {
    let started = Instant::now();
    let mut child = start(folder, args);
    let pid = Pid::from_child(&child);
    let (mut stdout, mut stderr) = (child.stdout.take().unwrap(), child.stderr.take().unwrap());
    let (message, errors) = std::thread::scope(|scope| {
        // The pipes are read all the time: a program with a full pipe would wait, and every kill
        // would hit that wait.
        let message = scope.spawn(|| read(&mut stdout));
        let errors = scope.spawn(|| read(&mut stderr));
        std::thread::sleep(after.saturating_sub(started.elapsed()));
        // An unreaped child keeps its number, so the signal can reach no other group.
        kill_process_group(pid, signal).unwrap();
        (message.join().unwrap(), errors.join().unwrap())
    });
    let status = child.wait().unwrap();
    let ended = RunOutcome::of(Output { status, stdout: message, stderr: errors });
    let was_hit = ended.code.is_none() || ended.code == Some(130);
    (ended, was_hit)
}

fn read(pipe: &mut impl Read) -> Vec<u8> {
    let mut bytes = Vec::new();
    pipe.read_to_end(&mut bytes).unwrap();
    bytes
}
