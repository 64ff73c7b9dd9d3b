//! The supervisor of a program: the other end of the socket in [`gs2e_files::programs`].
//!
//! The program runs in a process group of its own. When it ends, when the socket closes, or when a
//! signal arrives, the rest of the group is killed. Descendants that left the group are killed too:
//! the system makes the supervisor the parent of orphans, so it finds them.

use gs2e_files as files;
use gs2e_files::programs::ProgramReport;
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

/// Maximum number of searches for remaining processes. With the pause between them, 5 s.
const LOOKS: u32 = 500;
const PAUSE: Duration = Duration::from_millis(10);

/// Supervises the program that these arguments start.
pub(super) fn run(words: Vec<OsString>) -> ExitCode {
    match supervise(words) {
        Ok(()) => ExitCode::SUCCESS,
        // The parent finds no report on the socket, and this line in the log.
        Err(error) => {
            let _ = writeln!(io::stderr(), "the supervisor failed: {error}");
            ExitCode::FAILURE
        }
    }
}

/// An event that the supervisor waits for.
enum SupervisorEvent {
    /// The program has ended.
    Ended(io::Result<ProgramReport>),
    /// The parent asks the program to end.
    Asked,
    /// The parent process is gone, or a signal asks for the end.
    Gone,
}

fn supervise(words: Vec<OsString>) -> io::Result<()> {
    let mut words = words.into_iter();
    let program = words.next().ok_or(io::ErrorKind::InvalidInput)?;
    let mut line = UnixStream::from(io::stdin().as_fd().try_clone_to_owned()?);
    // Signals and orphans are taken over before the program starts, so that none of them is missed.
    let mut signals = Signals::new([SIGHUP, SIGINT, SIGQUIT, SIGTERM])?;
    adopt_orphans();
    let mut command = Command::new(program);
    command.args(words).stdin(Stdio::null()).process_group(0);
    // The supervisor's own stdout holds the lock of the store, which the program must not inherit.
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
    // The receiver lives as long as the process, so no send fails. The threads end with the process
    // too, and are not joined.
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
                // The program may have ended meanwhile.
                let _ = kill_process_group(group, Signal::TERM);
            }
            Ok(SupervisorEvent::Ended(report)) => {
                // The report comes last: the parent that reads it may rely on the end of all
                // processes.
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

/// Makes the supervisor the parent of every orphan, where the system can do that.
fn adopt_orphans() {
    #[cfg(target_os = "linux")]
    let _ = rustix::process::set_child_subreaper(Some(getpid()));
}

/// Waits for the end of the program, and leaves its process id taken. So the id of its group cannot
/// belong to another group.
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

/// Kills the rest of the program's group, then its remaining descendants.
fn kill_all(group: Pid) {
    let _ = kill_process_group(group, Signal::KILL);
    // Several rounds, because a process may start another one between the search and its death.
    for _ in 0..LOOKS {
        let left = descendants();
        if left.is_empty() {
            return;
        }
        for process in left {
            // The process may have ended meanwhile.
            let _ = kill_process(process, Signal::KILL);
        }
        thread::sleep(PAUSE);
    }
}

/// A process as described by `/proc`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct ChildProcess {
    pid: i32,
    parent: i32,
    has_ended: bool,
}

/// The descendants of the supervisor that have not ended.
fn descendants() -> Vec<Pid> {
    let Ok(entries) = std::fs::read_dir("/proc") else { return Vec::new() };
    let all = entries.filter_map(|entry| {
        let stat = entry.ok()?.path().join("stat");
        // Read as bytes, because the name of a process need not be UTF-8.
        parse_stat(&String::from_utf8_lossy(&files::read(&stat, files::MAX_TEXT).ok()?))
    });
    let below = below(getpid().as_raw_nonzero().get(), &all.collect::<Vec<_>>());
    below.into_iter().filter(|process| !process.has_ended).filter_map(|p| Pid::from_raw(p.pid)).collect()
}

/// Parses `/proc/PID/stat`: the process id, the name in brackets, the state, the id of the parent,
/// and more.
fn parse_stat(stat: &str) -> Option<ChildProcess> {
    let (pid, _) = stat.split_once(' ')?;
    // The name may contain brackets and spaces, so the last bracket ends it.
    let (_, after) = stat.rsplit_once(')')?;
    let mut fields = after.split_whitespace();
    let has_ended = matches!(fields.next()?, "Z" | "X");
    Some(ChildProcess { pid: pid.parse().ok()?, parent: fields.next()?.parse().ok()?, has_ended })
}

/// The processes below `root`.
fn below(root: i32, all: &[ChildProcess]) -> Vec<ChildProcess> {
    let mut found: Vec<ChildProcess> = Vec::new();
    let mut parents = vec![root];
    while let Some(parent) = parents.pop() {
        // A process id that was reused while the list was read could close a circle.
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
