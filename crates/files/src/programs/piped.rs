//! Programs whose output is read while they run.

use super::process::{LOOK, SupervisedChild};
use super::{EndKind, ProgramCall, ProgramFinder};
use rustix::fs::OFlags;
use std::io::{self, BufRead, BufReader, PipeReader, Read};
use std::process::Stdio;
use std::thread;

/// A program that runs, and its output: all that it prints, to stdout and to stderr. Dropping it kills the
/// program.
pub struct PipedProgram {
    child: SupervisedChild,
    output: BufReader<PipeReader>,
}

impl std::fmt::Debug for PipedProgram {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PipedProgram").finish_non_exhaustive()
    }
}

impl PipedProgram {
    /// Starts a program.
    ///
    /// # Errors
    /// It cannot be started. A missing program may also show as an empty output, and as the error of
    /// [`PipedProgram::finish`].
    pub fn start(programs: &ProgramFinder, call: &ProgramCall) -> Result<Self, EndKind> {
        let start = || {
            let (reader, writer) = io::pipe()?;
            let child = SupervisedChild::start(programs, call, Stdio::from(writer))?;
            Ok(Self { child, output: BufReader::with_capacity(1 << 16, reader) })
        };
        start().map_err(EndKind::NotStarted)
    }

    /// The output, whose reads end with an error once `goes_on` returns false, also while the program
    /// prints nothing.
    ///
    /// # Errors
    /// The pipe cannot be made non-blocking.
    pub fn watched(mut self, goes_on: &dyn Fn() -> bool) -> io::Result<WatchedProgram<'_>> {
        let pipe = self.output.get_mut();
        let flags = rustix::fs::fcntl_getfl(&*pipe)?;
        rustix::fs::fcntl_setfl(&*pipe, flags | OFlags::NONBLOCK)?;
        Ok(WatchedProgram { program: self, goes_on })
    }

    /// Waits for the end of a program whose output was read to its end.
    ///
    /// # Errors
    /// The program failed.
    pub fn finish(mut self) -> Result<(), EndKind> {
        self.child.wait()
    }
}

impl Read for PipedProgram {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        self.output.read(into)
    }
}

impl BufRead for PipedProgram {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        self.output.fill_buf()
    }

    fn consume(&mut self, amount: usize) {
        self.output.consume(amount);
    }
}

/// A program that runs while a condition holds. Dropping it kills the program.
pub struct WatchedProgram<'a> {
    program: PipedProgram,
    goes_on: &'a dyn Fn() -> bool,
}

impl std::fmt::Debug for WatchedProgram<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("WatchedProgram").finish_non_exhaustive()
    }
}

impl WatchedProgram<'_> {
    /// Waits for the end of a program whose output was read to its end.
    ///
    /// # Errors
    /// The program failed.
    pub fn finish(self) -> Result<(), EndKind> {
        self.program.finish()
    }
}

impl Read for WatchedProgram<'_> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        loop {
            if !(self.goes_on)() {
                return Err(io::Error::other("it was asked to stop"));
            }
            match self.program.read(into) {
                // A read that blocks could not see `goes_on` change while the program prints nothing.
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => thread::sleep(LOOK),
                read => return read,
            }
        }
    }
}
