//! One run of a program.

use super::ForeignError;
use crate::programs::{self, Ended, Failed, How, Invocation};
use crate::reconstruct::Desk;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// What is run, and where.
pub(super) struct Run<'a> {
    /// Its name.
    pub(super) program: &'static str,
    pub(super) arguments: Vec<OsString>,
    /// It is stopped after so many seconds.
    pub(super) seconds: u32,
    pub(super) desk: Desk<'a>,
}

/// Neither a screen nor more than one thread is taken.
const ENVIRONMENT: [(&str, &str); 3] =
    [("QT_QPA_PLATFORM", "offscreen"), ("OMP_NUM_THREADS", "1"), ("OPENBLAS_NUM_THREADS", "1")];

/// A run that ended well, and may turn out to have brought nothing.
pub(super) struct Ran<'a> {
    invocation: Invocation,
    program: &'static str,
    log: &'a Path,
    /// Where in the log what it says begins.
    from: u64,
}

impl<'a> Run<'a> {
    /// Runs it to its end: `Err` within the answer where it ended with an exit code of its own.
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

    /// Runs it to its end, which has to be a good one.
    pub(super) fn end_well(self) -> Result<Ran<'a>, ForeignError> {
        self.end()?.map_err(|ran| ran.failed(How::Code(1)))
    }
}

impl Ran<'_> {
    /// Whether this is among the last that it said.
    pub(super) fn says(&self, text: &str) -> bool {
        programs::last_lines(self.log, self.from).iter().any(|line| line.contains(text))
    }

    /// The error that it did not do what it was for.
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
