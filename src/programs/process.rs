//! A program run to its end: supervised, without input, and with all that it prints in a file.

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

/// What is started.
#[derive(Debug, Clone)]
pub struct ProgramCall {
    /// A name, or an absolute path.
    pub program: PathBuf,
    /// What it is started with.
    pub arguments: Vec<OsString>,
    /// Variables added to those that this program was started with.
    pub environment: BTreeMap<String, String>,
    /// Absolute path of the folder in which it works.
    pub folder: PathBuf,
}

impl ProgramCall {
    /// The command as a person may type it.
    #[must_use]
    pub fn to_text(&self) -> String {
        let assigned = self.environment.iter().map(|(name, value)| PathBuf::from(format!("{name}={value}")));
        let words: Vec<PathBuf> =
            assigned.chain([self.program.clone()]).chain(self.arguments.iter().map(PathBuf::from)).collect();
        quoted(words.iter().map(PathBuf::as_path))
    }
}

/// A program that did not do what it was for.
#[derive(Debug, thiserror::Error)]
#[error("run {program}: {how}")]
pub struct ProgramFailure {
    /// Its name.
    pub program: String,
    /// The command as it was run.
    pub command: String,
    /// What happened.
    pub how: EndKind,
    /// The last lines that it printed.
    pub last: Vec<String>,
    /// The file with all that it printed.
    pub log: PathBuf,
}

/// What happened to a program.
#[derive(Debug, thiserror::Error)]
pub enum EndKind {
    /// It did not start.
    #[error("it cannot be started: {0}")]
    NotStarted(io::Error),
    /// The end of the program was not reported.
    #[error("it was lost sight of: {0}")]
    Lost(io::Error),
    /// It ended with an exit code other than 0.
    #[error("it ended with exit code {0}")]
    Code(i32),
    /// A signal ended it.
    #[error("signal {0} ended it")]
    Signal(i32),
    /// It has another version than the recipe says.
    #[error("it does not say that it is version {0}")]
    Version(String),
    /// It took too long, and was stopped.
    #[error("it had not ended after {0} s and was stopped")]
    TooLong(u32),
    /// The product cannot be used.
    #[error("{0}")]
    Product(String),
}

/// Why a program did not come to a good end.
#[derive(Debug)]
pub enum ProgramEnd {
    /// The caller asked it to stop, and it has.
    Stopped,
    /// It failed.
    Failed(EndKind),
}

/// Time between two looks at a program.
const LOOK: Duration = Duration::from_millis(20);
/// Looks until a program that was asked to end is killed: 5 s.
const LOOKS_TO_END: u32 = 250;

/// Runs a program to its end, or until `goes_on` says no or `seconds` have passed. What it prints is
/// appended to the file `log`.
///
/// # Errors
/// When it fails or is stopped.
pub fn run_within(
    seconds: u32,
    programs: &ProgramFinder,
    invocation: &ProgramCall,
    log: &Path,
    goes_on: &dyn Fn() -> bool,
) -> Result<(), ProgramEnd> {
    within(seconds, goes_on, |goes_on| run(programs, invocation, log, goes_on))
}

/// Has `run` stop after `seconds`.
pub(super) fn within(
    seconds: u32,
    goes_on: &dyn Fn() -> bool,
    run: impl FnOnce(&dyn Fn() -> bool) -> Result<(), ProgramEnd>,
) -> Result<(), ProgramEnd> {
    // Counted in looks, so that no clock is read: a machine that was asleep has not spent them.
    let most = u64::from(seconds) * 1000 / u64::from(LOOK.subsec_millis());
    let looks = Cell::new(0);
    let ended = run(&|| {
        looks.set(looks.get() + 1);
        looks.get() <= most && goes_on()
    });
    match ended {
        Err(ProgramEnd::Stopped) if looks.get() > most => Err(ProgramEnd::Failed(EndKind::TooLong(seconds))),
        ended => ended,
    }
}

/// Runs a program to its end, or until `goes_on` says no. What it prints is appended to the file `log`.
///
/// # Errors
/// When it fails or is stopped.
pub fn run(
    programs: &ProgramFinder,
    invocation: &ProgramCall,
    log: &Path,
    goes_on: &dyn Fn() -> bool,
) -> Result<(), ProgramEnd> {
    let open = || {
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

/// A program with its supervisor. Dropping it kills the program with all that it started.
struct SupervisedChild {
    supervisor: Child,
    /// `None` once it is closed.
    line: Option<UnixStream>,
}

impl SupervisedChild {
    fn start(programs: &ProgramFinder, invocation: &ProgramCall, output: Stdio) -> io::Result<Self> {
        let program = programs.find(&invocation.program)?;
        let (ours, theirs) = UnixStream::pair()?;
        let held = programs.held.as_ref().map(|file| file.try_clone()).transpose()?;
        let mut command = Command::new(&programs.supervisor);
        command.arg(SUPERVISE).arg(program).args(&invocation.arguments);
        match programs.path() {
            Some(path) => command.env("PATH", path),
            None => command.env_remove("PATH"),
        };
        // Shells trust PWD where it names the folder that they are in, and version managers trust it
        // always.
        command.env("PWD", &invocation.folder).envs(&invocation.environment);
        command
            .current_dir(&invocation.folder)
            .stdin(OwnedFd::from(theirs))
            .stdout(held.map_or_else(Stdio::null, Stdio::from))
            .stderr(output)
            // A signal that the terminal sends to our group is ours to handle.
            .process_group(0);
        Ok(Self { supervisor: command.spawn()?, line: Some(ours) })
    }

    /// Lets the program end by itself, for a while.
    fn ask_to_end(&mut self) {
        let asked = self.line.as_mut().is_some_and(|line| line.write_all(b"t").is_ok());
        for _ in 0..if asked { LOOKS_TO_END } else { 0 } {
            if !matches!(self.supervisor.try_wait(), Ok(None)) {
                break;
            }
            std::thread::sleep(LOOK);
        }
    }

    /// How the program ended, after its supervisor has.
    fn outcome(&mut self) -> Result<(), EndKind> {
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
        self.line = None;
        // Its folder may be deleted next, so its end is waited for. One that cannot be waited for has
        // ended.
        let _ = self.supervisor.wait();
    }
}
