//! The supervisor of a program: see [`crate::programs`], whose side of the socket asks this one.
//!
//! The program runs in a group of its own. When it ends, when the socket closes or when a signal
//! arrives, whatever is left of the group is killed. So are the processes that left the group and
//! descend from the program: the system hands orphans to the supervisor, where they are found.

use crate::files;
use crate::programs::ProgramReport;
use rustix::process::{
    Pid, Signal, WaitId, WaitIdOptions, WaitIdStatus, getpid, kill_process, kill_process_group, waitid,
};
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};
use signal_hook::iterator::Signals;
use std::ffi::OsString;
use std::io::{self, Read, Write};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::process::{Command, ExitCode, Stdio};
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

/// Looks for processes that are left before they are given up: with the pause between them, 5 s.
const LOOKS: u32 = 500;
const PAUSE: Duration = Duration::from_millis(10);

/// Supervises the program that these words start.
pub(super) fn run(words: Vec<OsString>) -> ExitCode {
    match supervise(words) {
        Ok(()) => ExitCode::SUCCESS,
        // The parent finds no report, and this in the log.
        Err(error) => {
            let _ = writeln!(io::stderr(), "the supervisor failed: {error}");
            ExitCode::FAILURE
        }
    }
}

/// What the supervisor waits for.
enum SupervisorEvent {
    /// The program has ended.
    Ended(io::Result<ProgramReport>),
    /// The program is asked to end.
    Asked,
    /// The process that started the supervisor is gone, or a signal asks for the end.
    Gone,
}

fn supervise(words: Vec<OsString>) -> io::Result<()> {
    let mut words = words.into_iter();
    let program = words.next().ok_or(io::ErrorKind::InvalidInput)?;
    let mut line = UnixStream::from(io::stdin().as_fd().try_clone_to_owned()?);
    let mut signals = Signals::new([SIGHUP, SIGINT, SIGQUIT, SIGTERM])?;
    adopt_orphans();
    let mut command = Command::new(program);
    command.args(words).stdin(Stdio::null()).process_group(0);
    // Its own stdout holds a lock that the program must not have.
    command.stdout(io::stderr().as_fd().try_clone_to_owned()?);
    let group = match command.spawn() {
        Ok(child) => Pid::from_child(&child),
        Err(error) => {
            let number = error.raw_os_error().ok_or(error)?;
            return write!(line, "{}", ProgramReport::NotStarted(number));
        }
    };
    let (sender, events) = mpsc::channel();
    let [ended, signalled, asked] = [(); 3].map(|()| sender.clone());
    // The receiver lives as long as the process does.
    thread::spawn(move || drop(ended.send(SupervisorEvent::Ended(wait(group)))));
    thread::spawn(move || signals.forever().all(|_| signalled.send(SupervisorEvent::Gone).is_ok()));
    let mut reader = line.try_clone()?;
    thread::spawn(move || {
        while matches!(reader.read(&mut [0]), Ok(1)) {
            let _ = asked.send(SupervisorEvent::Asked);
        }
        drop(asked.send(SupervisorEvent::Gone));
    });
    loop {
        match events.recv() {
            Ok(SupervisorEvent::Asked) => {
                // It may have ended meanwhile.
                let _ = kill_process_group(group, Signal::TERM);
            }
            Ok(SupervisorEvent::Ended(report)) => {
                kill_all(group);
                return write!(line, "{}", report?);
            }
            Ok(SupervisorEvent::Gone) | Err(_) => {
                kill_all(group);
                return Ok(());
            }
        }
    }
}

/// Has the system hand every process whose parent ends to the supervisor, where the system can do that.
fn adopt_orphans() {
    #[cfg(target_os = "linux")]
    let _ = rustix::process::set_child_subreaper(Some(getpid()));
}

/// Waits for the end of the program. Its number stays taken, so that its group is not another one's.
fn wait(program: Pid) -> io::Result<ProgramReport> {
    loop {
        match waitid(WaitId::Pid(program), WaitIdOptions::EXITED | WaitIdOptions::NOWAIT) {
            Ok(Some(status)) => return Ok(report(&status)),
            Ok(None) | Err(rustix::io::Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
    }
}

fn report(status: &WaitIdStatus) -> ProgramReport {
    match status.exit_status() {
        Some(code) => ProgramReport::Code(code),
        None => ProgramReport::Signal(status.terminating_signal().unwrap_or_default()),
    }
}

/// Kills what is left of the program's group, then what is left of its descendants.
fn kill_all(group: Pid) {
    let _ = kill_process_group(group, Signal::KILL);
    for _ in 0..LOOKS {
        let left = descendants();
        if left.is_empty() {
            return;
        }
        for process in left {
            // It may have ended meanwhile.
            let _ = kill_process(process, Signal::KILL);
        }
        thread::sleep(PAUSE);
    }
}

/// A process, as `/proc` tells of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct ChildProcess {
    pid: i32,
    parent: i32,
    has_ended: bool,
}

/// The processes that descend from the supervisor and have not ended.
fn descendants() -> Vec<Pid> {
    let Ok(entries) = std::fs::read_dir("/proc") else { return Vec::new() };
    let all = entries.filter_map(|entry| {
        let stat = entry.ok()?.path().join("stat");
        // Bytes, because a process may call itself anything.
        parse_stat(&String::from_utf8_lossy(&files::read(&stat, files::MAX_TEXT).ok()?))
    });
    let below = below(getpid().as_raw_nonzero().get(), &all.collect::<Vec<_>>());
    below.into_iter().filter(|process| !process.has_ended).filter_map(|p| Pid::from_raw(p.pid)).collect()
}

/// `/proc/PID/stat`: the number, the name in brackets, the state, the parent's number, and more.
fn parse_stat(stat: &str) -> Option<ChildProcess> {
    let (pid, _) = stat.split_once(' ')?;
    let (_, after) = stat.rsplit_once(')')?;
    let mut fields = after.split_whitespace();
    let has_ended = matches!(fields.next()?, "Z" | "X");
    Some(ChildProcess { pid: pid.parse().ok()?, parent: fields.next()?.parse().ok()?, has_ended })
}

/// The processes below one.
fn below(root: i32, all: &[ChildProcess]) -> Vec<ChildProcess> {
    let mut found: Vec<ChildProcess> = Vec::new();
    let mut parents = vec![root];
    while let Some(parent) = parents.pop() {
        // A number that was given again while the list was read could close a circle.
        let is_new = |process: &&ChildProcess| process.parent == parent && !found.contains(*process);
        let children: Vec<ChildProcess> = all.iter().filter(is_new).copied().collect();
        parents.extend(children.iter().map(|process| process.pid));
        found.extend(children);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_of_a_process_is_read_whatever_its_name() {
        let t = |stat: &str, wanted: Option<(i32, i32, bool)>| {
            let found = parse_stat(stat).map(|p| (p.pid, p.parent, p.has_ended));
            assert_eq!(found, wanted, "{stat}");
        };
        t("17 (sh) S 3 17 17 0 -1", Some((17, 3, false)));
        t("18 (a) Z 1 (b) R 4 18", Some((18, 4, false)));
        t("19 (python3) Z 17 17", Some((19, 17, true)));
        t("", None);
        t("20 (cut", None);
    }

    #[test]
    fn all_below_a_process_are_found() {
        let process = |(pid, parent)| ChildProcess { pid, parent, has_ended: false };
        let all = [(2, 1), (3, 2), (4, 3), (5, 1), (6, 2), (1, 0)].map(process);
        let mut found: Vec<i32> = below(2, &all).iter().map(|process| process.pid).collect();
        found.sort_unstable();
        assert_eq!(found, [3, 4, 6]);
        assert!(below(4, &all).is_empty());
    }
}
