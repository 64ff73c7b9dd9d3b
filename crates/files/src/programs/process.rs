//! Execution of a program to its end: supervised, without input, and with all output in a file.

use super::quoted::quoted;
use super::report::ProgramReport;
use super::{ProgramFinder, SUPERVISE};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::File;
use std::io::{self, Read, Write};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// A command to run.
#[derive(Debug, Clone)]
pub struct ProgramCall {
    /// A name, or an absolute path.
    pub program: PathBuf,
    /// Its arguments.
    pub arguments: Vec<OsString>,
    /// Variables added to the environment of this program.
    pub environment: BTreeMap<String, String>,
    /// Absolute path of its working folder.
    pub folder: PathBuf,
}

impl ProgramCall {
    /// The command as a user may type it.
    #[must_use]
    pub fn to_text(&self) -> String {
        let assigned = self.environment.iter().map(|(name, value)| PathBuf::from(format!("{name}={value}")));
        let words: Vec<PathBuf> =
            assigned.chain([self.program.clone()]).chain(self.arguments.iter().map(PathBuf::from)).collect();
        quoted(words.iter().map(PathBuf::as_path))
    }
}

/// Failure of a program.
#[derive(Debug, thiserror::Error)]
#[error("run {program}: {how}")]
pub struct ProgramFailure {
    /// Its name.
    pub program: String,
    /// The command that was run.
    pub command: String,
    /// Kind of failure.
    pub how: EndKind,
    /// The last lines that it printed.
    pub last: Vec<String>,
    /// The file with all its output.
    pub log: PathBuf,
}

/// Reason why a program failed.
#[derive(Debug, thiserror::Error)]
pub enum EndKind {
    /// It did not start.
    #[error("it cannot be started: {0}")]
    NotStarted(io::Error),
    /// The end of the program was not reported.
    #[error("its end was not reported: {0}")]
    Lost(io::Error),
    /// It ended with an exit code other than 0.
    #[error("it ended with exit code {0}")]
    Code(i32),
    /// A signal ended it.
    #[error("signal {0} ended it")]
    Signal(i32),
    /// Its version is not the one in the recipe.
    #[error("it does not report version {0}")]
    Version(String),
    /// It took too long, and was stopped.
    #[error("it was stopped because it had not ended after {0} s")]
    TooLong(u32),
    /// The product cannot be used.
    #[error("{0}")]
    Product(String),
}

/// Reason why a program did not complete.
#[derive(Debug)]
pub enum ProgramEnd {
    /// The caller asked it to stop, and it stopped.
    Stopped,
    /// It failed.
    Failed(EndKind),
}

/// Time between two checks on a program.
pub(super) const LOOK: Duration = Duration::from_millis(20);
/// Number of checks before a program that was asked to end is killed: 5 s.
const LOOKS_TO_END: u32 = 250;

/// Runs a program to its end, or until `goes_on` returns false or `seconds` have passed. Its output
/// is appended to the file `log`.
///
/// # Errors
/// The program fails or is stopped.
pub fn run_within(
    seconds: u32,
    programs: &ProgramFinder,
    invocation: &ProgramCall,
    log: &Path,
    goes_on: &dyn Fn() -> bool,
) -> Result<(), ProgramEnd> {
    within(seconds, goes_on, |goes_on| run(programs, invocation, log, goes_on))
}

/// Calls `run` with a condition that also ends after `seconds`.
pub(super) fn within(
    seconds: u32,
    goes_on: &dyn Fn() -> bool,
    run: impl FnOnce(&dyn Fn() -> bool) -> Result<(), ProgramEnd>,
) -> Result<(), ProgramEnd> {
    // Counted in checks instead of clock time: time in which the machine sleeps does not count.
    let most = u64::from(seconds) * 1000 / u64::from(LOOK.subsec_millis());
    let looks = Cell::new(0);
    let ended = run(&|| {
        looks.set(looks.get() + 1);
        looks.get() <= most && goes_on()
    });
    match ended {
        // The count tells a timeout from a stop that the caller asked for.
        Err(ProgramEnd::Stopped) if looks.get() > most => Err(ProgramEnd::Failed(EndKind::TooLong(seconds))),
        ended => ended,
    }
}

/// Runs a program to its end, or until `goes_on` returns false. Its output is appended to the file
/// `log`.
///
/// # Errors
/// The program fails or is stopped.
pub fn run(
    programs: &ProgramFinder,
    invocation: &ProgramCall,
    log: &Path,
    goes_on: &dyn Fn() -> bool,
) -> Result<(), ProgramEnd> {
    let open = || {
        // Appended: several commands of one step share a log.
        let mut log = File::options().create(true).append(true).open(log)?;
        writeln!(log, "$ {}", invocation.to_text())?;
        Ok(log)
    };
    let log = open().map_err(|error| ProgramEnd::Failed(EndKind::NotStarted(error)))?;
    run_into(programs, invocation, Stdio::from(log), goes_on)
}

/// Runs a program that prints to `output`.
pub(super) fn run_into(
    programs: &ProgramFinder,
    invocation: &ProgramCall,
    output: Stdio,
    goes_on: &dyn Fn() -> bool,
) -> Result<(), ProgramEnd> {
    let started = SupervisedChild::start(programs, invocation, output);
    let mut supervised = started.map_err(|error| ProgramEnd::Failed(EndKind::NotStarted(error)))?;
    loop {
        match supervised.supervisor.try_wait() {
            Ok(None) if goes_on() => std::thread::sleep(LOOK),
            Ok(None) => {
                supervised.ask_to_end();
                return Err(ProgramEnd::Stopped);
            }
            Ok(Some(_)) => return supervised.outcome().map_err(ProgramEnd::Failed),
            Err(cause) => return Err(ProgramEnd::Failed(EndKind::Lost(cause))),
        }
    }
}

/// A program with its supervisor. Dropping it kills the program and all processes that it started.
pub(super) struct SupervisedChild {
    supervisor: Child,
    /// `None` once the socket is closed.
    line: Option<UnixStream>,
}

impl SupervisedChild {
    pub(super) fn start(
        programs: &ProgramFinder,
        invocation: &ProgramCall,
        output: Stdio,
    ) -> io::Result<Self> {
        let program = programs.find(&invocation.program)?;
        let (ours, theirs) = UnixStream::pair()?;
        let held = programs.held.as_ref().map(|file| file.try_clone()).transpose()?;
        let mut command = Command::new(&programs.supervisor);
        command.arg(SUPERVISE).arg(program).args(&invocation.arguments);
        // Programs that this one starts are looked for in the same folders.
        match programs.path() {
            Some(path) => command.env("PATH", path),
            None => command.env_remove("PATH"),
        };
        // Shells trust PWD if it names their current folder, and version managers always trust it.
        command.env("PWD", &invocation.folder).envs(&invocation.environment);
        command
            .current_dir(&invocation.folder)
            .stdin(OwnedFd::from(theirs))
            .stdout(held.map_or_else(Stdio::null, Stdio::from))
            .stderr(output)
            // The terminal sends signals to the whole group. This program handles them alone.
            .process_group(0);
        Ok(Self { supervisor: command.spawn()?, line: Some(ours) })
    }

    /// Asks the program to end, and waits a limited time for it.
    fn ask_to_end(&mut self) {
        let asked = self.line.as_mut().is_some_and(|line| line.write_all(b"t").is_ok());
        // A failed write means that the supervisor has ended.
        for _ in 0..if asked { LOOKS_TO_END } else { 0 } {
            if !matches!(self.supervisor.try_wait(), Ok(None)) {
                break;
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Waits for the end of the program, however long it takes.
    pub(super) fn wait(&mut self) -> Result<(), EndKind> {
        self.supervisor.wait().map_err(EndKind::Lost)?;
        self.outcome()
    }

    /// The result of the program, after its supervisor has ended.
    fn outcome(&mut self) -> Result<(), EndKind> {
        // The supervisor has ended, so this reads to the end of the socket without waiting.
        let mut text = String::new();
        if let Some(line) = &mut self.line {
            line.read_to_string(&mut text).map_err(EndKind::Lost)?;
        }
        match text.parse() {
            Ok(ProgramReport::Code(0)) => Ok(()),
            Ok(ProgramReport::Code(code)) => Err(EndKind::Code(code)),
            Ok(ProgramReport::Signal(signal)) => Err(EndKind::Signal(signal)),
            Ok(ProgramReport::NotStarted(error)) => {
                Err(EndKind::NotStarted(io::Error::from_raw_os_error(error)))
            }
            Err(error) => Err(EndKind::Lost(io::Error::other(error))),
        }
    }
}

impl Drop for SupervisedChild {
    fn drop(&mut self) {
        // Closing the socket makes the supervisor kill the program.
        self.line = None;
        // The next action may delete the program's folder, so the end is awaited. If waiting fails,
        // the supervisor has ended already.
        let _ = self.supervisor.wait();
    }
}
