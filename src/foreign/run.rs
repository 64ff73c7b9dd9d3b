//! One run of a program.

use super::ForeignError;
use crate::programs::{self, Ended, Failed, How, Invocation};
use crate::reconstruct::Desk;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// A program with its arguments and folder.
pub(super) struct Run<'a> {
    /// Its name.
    pub(super) program: &'static str,
    pub(super) arguments: Vec<OsString>,
    /// Time limit in seconds.
    pub(super) seconds: u32,
    pub(super) desk: Desk<'a>,
}

/// Neither a screen nor more than one thread is taken.
const ENVIRONMENT: [(&str, &str); 3] =
    [("QT_QPA_PLATFORM", "offscreen"), ("OMP_NUM_THREADS", "1"), ("OPENBLAS_NUM_THREADS", "1")];

/// A run that ended without a signal. Its result may still be missing.
pub(super) struct Ran<'a> {
    invocation: Invocation,
    program: &'static str,
    log: &'a Path,
    /// Offset of its output in the log.
    from: u64,
}

impl<'a> Run<'a> {
    /// Runs the program to its end. The inner `Err` is a run with a non-zero exit code.
    pub(super) fn end(self) -> Result<Result<Ran<'a>, Ran<'a>>, ForeignError> {
        let Self { program, arguments, seconds, desk } = self;
        let environment = ENVIRONMENT.map(|(name, value)| (name.to_owned(), value.to_owned()));
        let environment = BTreeMap::from(environment);
        // The desk lies below the current folder, where version managers look for a file that chooses a
        // program.
        let folder = PathBuf::from("/");
        let invocation = Invocation { program: program.into(), arguments, environment, folder };
        let ran = Ran { invocation, program, log: desk.log, from: programs::length(desk.log) };
        match programs::run_within(seconds, desk.programs, &ran.invocation, desk.log, desk.goes_on) {
            Ok(()) => Ok(Ok(ran)),
            Err(Ended::Stopped) => Err(ForeignError::Stopped),
            Err(Ended::Failed(How::Code(1))) => Ok(Err(ran)),
            Err(Ended::Failed(how)) => Err(ran.failed(how)),
        }
    }

    /// Runs the program to its end, which must be successful.
    pub(super) fn end_well(self) -> Result<Ran<'a>, ForeignError> {
        self.end()?.map_err(|ran| ran.failed(How::Code(1)))
    }
}

impl Ran<'_> {
    /// Returns true if the last output contains this text.
    pub(super) fn says(&self, text: &str) -> bool {
        programs::last_lines(self.log, self.from).iter().any(|line| line.contains(text))
    }

    /// Creates the error of a run without the expected result.
    pub(super) fn failed(&self, how: How) -> ForeignError {
        Box::new(Failed {
            program: self.program.to_owned(),
            command: self.invocation.to_text(),
            how,
            last: programs::last_lines(self.log, self.from),
            log: self.log.to_owned(),
        })
        .into()
    }
}
