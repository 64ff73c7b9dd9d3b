//! Execution of a program to its end: in its own process group, without standard input, with all
//! output in a file.
//!
//! A group can be stopped as a whole, including processes that the program started. No process of
//! the group outlives its leader.

use super::argument::quoted;
use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, WaitIdStatus, kill_process_group, waitid};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::Duration;

/// The program to start.
#[derive(Debug, Clone)]
pub(crate) struct Invocation {
    /// The system searches for it, unless it is a path.
    pub(crate) program: PathBuf,
    pub(crate) arguments: Vec<OsString>,
    /// Variables in addition to the inherited environment.
    pub(crate) environment: BTreeMap<String, String>,
    /// Working folder.
    pub(crate) folder: PathBuf,
}

impl Invocation {
    /// Returns the command as a person could type it.
    pub(crate) fn to_text(&self) -> String {
        let assigned = self.environment.iter().map(|(name, value)| PathBuf::from(format!("{name}={value}")));
        let words: Vec<PathBuf> =
            assigned.chain([self.program.clone()]).chain(self.arguments.iter().map(PathBuf::from)).collect();
        quoted(words.iter().map(PathBuf::as_path))
    }
}

/// A program that failed.
#[derive(Debug, thiserror::Error)]
#[error("run {program}: {how}")]
pub struct Failed {
    /// Name of the program.
    pub program: String,
    /// The executed command.
    pub command: String,
    /// The kind of failure.
    pub how: How,
    /// Last lines of its output.
    pub last: Vec<String>,
    /// Path of the complete output.
    pub log: PathBuf,
}

/// The kinds of failure of a program.
#[derive(Debug, thiserror::Error)]
pub enum How {
    /// It did not start.
    #[error("it cannot be started: {0}")]
    NotStarted(io::Error),
    /// The system no longer reports its state.
    #[error("it was lost sight of: {0}")]
    Lost(io::Error),
    /// It ended with an exit code other than 0.
    #[error("it ended with exit code {0}")]
    Code(i32),
    /// A signal ended it.
    #[error("signal {0} ended it")]
    Signal(i32),
    /// It is another version than the recipe states.
    #[error("it does not say that it is version {0}")]
    Version(String),
    /// It took too long, and was stopped.
    #[error("it had not ended after {0} s and was stopped")]
    TooLong(u32),
    /// Its result cannot be used.
    #[error("{0}")]
    Product(String),
}

/// The reason why a program did not run to its end.
#[derive(Debug)]
pub(crate) enum Ended {
    /// It was asked to stop, and stopped.
    Stopped,
    /// It failed.
    Failed(How),
}

/// Interval between polls.
const LOOK: Duration = Duration::from_millis(20);
/// Number of polls before a program is killed: 5 s.
const LOOKS_TO_END: u32 = 250;
/// Number of output lines in the error message.
const LAST_LINES: usize = 20;
/// Maximum number of bytes read for these lines.
const LAST_BYTES: u64 = 1 << 14;
/// Maximum number of bytes searched for a version.
const MOST_VERSION_BYTES: u64 = 1 << 20;

/// Runs a program to its end, or until `goes_on` returns false or the time limit in seconds is
/// over. The output is appended to the file `log`.
pub(crate) fn run_within(
    seconds: u32,
    invocation: &Invocation,
    log: &Path,
    goes_on: &dyn Fn() -> bool,
) -> Result<(), Ended> {
    // The time is counted in polls instead of a clock, so that time while the machine sleeps does
    // not count.
    let most = u64::from(seconds) * 1000 / u64::from(LOOK.subsec_millis());
    let looks = Cell::new(0);
    let ended = run(invocation, log, &|| {
        looks.set(looks.get() + 1);
        looks.get() <= most && goes_on()
    });
    match ended {
        Err(Ended::Stopped) if looks.get() > most => Err(Ended::Failed(How::TooLong(seconds))),
        ended => ended,
    }
}

/// Runs a program to its end, or until `goes_on` returns false. The output is appended to the file
/// `log`.
pub(crate) fn run(invocation: &Invocation, log: &Path, goes_on: &dyn Fn() -> bool) -> Result<(), Ended> {
    let mut child = start(invocation, log).map_err(|e| Ended::Failed(How::NotStarted(e)))?;
    let group = Pid::from_child(&child);
    let ended = loop {
        match look(group) {
            Ok(None) if goes_on() => std::thread::sleep(LOOK),
            Ok(None) => {
                ask_to_end(group);
                break Err(Ended::Stopped);
            }
            Ok(Some(status)) => break outcome(&status).map_err(Ended::Failed),
            Err(cause) => break Err(Ended::Failed(How::Lost(cause))),
        }
    };
    // The rest of the group ends in every case.
    end(group, &mut child);
    ended
}

/// Asks a group to end, and waits for a while.
fn ask_to_end(group: Pid) {
    // The group may have ended already, so an error means nothing.
    let _ = kill_process_group(group, Signal::TERM);
    for _ in 0..LOOKS_TO_END {
        if !matches!(look(group), Ok(None)) {
            break;
        }
        std::thread::sleep(LOOK);
    }
}

fn start(invocation: &Invocation, log: &Path) -> io::Result<Child> {
    let mut log = File::options().create(true).append(true).open(log)?;
    writeln!(log, "$ {}", invocation.to_text())?;
    std::process::Command::new(&invocation.program)
        .args(&invocation.arguments)
        .envs(&invocation.environment)
        .current_dir(&invocation.folder)
        .stdin(Stdio::null())
        .stdout(log.try_clone()?)
        .stderr(log)
        .process_group(0)
        .spawn()
}

/// Returns the status of an ended process. The process is not reaped, so its id stays taken and the
/// group id stays valid.
fn look(process: Pid) -> io::Result<Option<WaitIdStatus>> {
    let options = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
    Ok(waitid(WaitId::Pid(process), options)?)
}

/// Kills the rest of a group.
fn end(group: Pid, child: &mut Child) {
    // An error means that no process is left.
    let _ = kill_process_group(group, Signal::KILL);
    let _ = child.wait();
}

fn outcome(status: &WaitIdStatus) -> Result<(), How> {
    match (status.exit_status(), status.terminating_signal()) {
        (Some(0), _) => Ok(()),
        (Some(code), _) => Err(How::Code(code)),
        (None, signal) => Err(How::Signal(signal.unwrap_or_default())),
    }
}

/// Returns the length of the log in bytes.
pub(crate) fn length(log: &Path) -> u64 {
    std::fs::metadata(log).map_or(0, |about| about.len())
}

/// Reads the log from byte `from`, at most `most` bytes.
fn said(log: &Path, from: u64, most: u64) -> String {
    let read = || {
        let mut file = File::open(log)?;
        file.seek(SeekFrom::Start(from))?;
        let mut bytes = Vec::new();
        file.take(most).read_to_end(&mut bytes)?;
        io::Result::Ok(String::from_utf8_lossy(&bytes).into_owned())
    };
    read().unwrap_or_default()
}

/// Returns true if the output from byte `from` contains this version as a whole.
pub(crate) fn says(log: &Path, from: u64, version: &str) -> bool {
    let text = said(log, from, MOST_VERSION_BYTES);
    // The first line is the command, which can contain any text.
    text.split_once('\n').is_some_and(|(_, said)| holds(said, version))
}

fn holds(said: &str, version: &str) -> bool {
    let digit = |c: Option<char>| c.is_some_and(|c| c.is_ascii_digit());
    said.match_indices(version).any(|(at, _)| {
        let (before, after) = (&said[..at], &said[at + version.len()..]);
        let mut before = before.chars().rev();
        let goes_before = match before.next() {
            Some('.') => digit(before.next()),
            c => digit(c),
        };
        let mut after = after.chars();
        let goes_after = match after.next() {
            Some('.') => digit(after.next()),
            c => digit(c),
        };
        !goes_before && !goes_after
    })
}

/// Returns the last lines of the log from byte `from`. For a line that was overwritten by carriage
/// returns, as progress bars do, only the last text counts.
pub(crate) fn last_lines(log: &Path, from: u64) -> Vec<String> {
    let from = from.max(length(log).saturating_sub(LAST_BYTES));
    let text = said(log, from, LAST_BYTES);
    let shown = |line: &str| {
        let line = line.trim_end().rsplit('\r').next().unwrap_or_default();
        line.chars().filter(|c| *c == '\t' || !c.is_control()).collect::<String>()
    };
    let mut lines: Vec<String> =
        text.lines().rev().map(shown).filter(|line| !line.trim().is_empty()).take(LAST_LINES).collect();
    lines.reverse();
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shell(script: &str, folder: &Path) -> Invocation {
        Invocation {
            program: "/bin/sh".into(),
            arguments: ["-c", script].map(OsString::from).to_vec(),
            environment: BTreeMap::from([("WORD".to_owned(), "a $b".to_owned())]),
            folder: folder.to_owned(),
        }
    }

    #[test]
    fn what_a_program_says_is_kept_and_how_it_ends_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("log");
        let t = |script: &str, wanted: &str, said: &str| {
            let from = length(&log);
            let ended = run(&shell(script, folder.path()), &log, &|| true);
            let told = match ended {
                Ok(()) => "fine".to_owned(),
                Err(Ended::Failed(how)) => how.to_string(),
                Err(Ended::Stopped) => "stopped".to_owned(),
            };
            assert_eq!(told, wanted, "{script}");
            assert_eq!(last_lines(&log, from)[1..].join("|"), said, "{script}");
        };
        t("echo out; echo err >&2", "fine", "out|err");
        t("echo $WORD; pwd | grep -c .; cat", "fine", "a $b|1");
        t("printf '1%%\\r2%%\\n\\n\\033[1mbold'; exit 3", "it ended with exit code 3", "2%|[1mbold");
        t("kill -9 $$", "signal 9 ended it", "");
        t("seq 100", "fine", &(82..=100).map(|n| n.to_string()).collect::<Vec<_>>().join("|"));
    }

    #[test]
    fn a_version_is_told_from_a_longer_one() {
        let t = |said: &str, version: &str, wanted: bool| assert_eq!(holds(said, version), wanted, "{said}");
        t("1.1.4", "1.1.4", true);
        t("opensplat v1.1.4 (git commit 1a2b3c)\n", "1.1.4", true);
        t("gsplat-1.1.4.", "1.1.4", true);
        t("1.1.45", "1.1.4", false);
        t("1.1.4.2", "1.1.4", false);
        t("11.1.4", "1.1.4", false);
        t("0.1.1.4", "1.1.4", false);
        t("1.1.45, not 1.1.4", "1.1.4", true);
        t("", "1.1.4", false);
    }

    /// A version in the command line itself proves nothing about the program.
    #[test]
    fn the_command_itself_says_no_version() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("log");
        run(&shell(": 1.1.4", folder.path()), &log, &|| true).unwrap();
        assert!(!says(&log, 0, "1.1.4"), "{}", said(&log, 0, LAST_BYTES));
        run(&shell("echo 1.1.4", folder.path()), &log, &|| true).unwrap();
        assert!(says(&log, 0, "1.1.4"));
    }

    #[test]
    fn a_program_that_is_not_there_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let missing = Invocation { program: "/no/such/program".into(), ..shell("", folder.path()) };
        let ended = run(&missing, &folder.path().join("log"), &|| true);
        let Err(Ended::Failed(how)) = ended else { panic!("{ended:?}") };
        assert!(how.to_string().starts_with("it cannot be started: "), "{how}");
    }

    /// Runs a script that holds the pipe `held` open, and returns when no process holds it any
    /// more.
    fn run_holding(script: &str, folder: &Path, goes_on: &dyn Fn() -> bool) -> Result<(), Ended> {
        let pipe = folder.join("held");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status().unwrap();
        assert!(made.success());
        std::thread::scope(|scope| {
            let reader = scope.spawn(|| std::fs::read(&pipe).unwrap());
            let script = format!("exec 9> held; {script}");
            let ended = run(&shell(&script, folder), &folder.join("log"), goes_on);
            reader.join().unwrap();
            ended
        })
    }

    #[test]
    fn nothing_outlives_a_program() {
        let folder = tempfile::tempdir().unwrap();
        assert!(run_holding("sleep 600 & echo started", folder.path(), &|| true).is_ok());
    }

    #[test]
    fn what_takes_too_long_is_stopped_and_told() {
        let folder = tempfile::tempdir().unwrap();
        let run = |seconds, script: &str| {
            run_within(seconds, &shell(script, folder.path()), &folder.path().join("log"), &|| true)
        };
        let ended = run(0, "sleep 600");
        assert!(matches!(ended, Err(Ended::Failed(How::TooLong(0)))), "{ended:?}");
        assert!(run(60, ":").is_ok());
    }

    #[test]
    fn what_is_asked_to_stop_stops_with_all_that_it_started() {
        let folder = tempfile::tempdir().unwrap();
        let at_work = folder.path().join("at work");
        let script = "trap 'echo stopping; exit 0' TERM; sleep 600 & : > 'at work'; wait";
        let ended = run_holding(script, folder.path(), &|| !at_work.exists());
        assert!(matches!(ended, Err(Ended::Stopped)), "{ended:?}");
        assert!(
            said(&folder.path().join("log"), 0, LAST_BYTES).contains("stopping"),
            "it was asked before it was made to"
        );
    }
}
