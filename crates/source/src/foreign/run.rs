//! One run of a program.

use super::ForeignError;
use crate::reconstruct::ProgramWorkspace;
use gs2e_files::programs;
use gs2e_files::programs::{EndKind, ProgramCall, ProgramEnd, ProgramFailure};
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// A program with its arguments and folder.
pub(super) struct ExternalRun<'a> {
    /// Its name.
    pub(super) program: &'static str,
    pub(super) arguments: Vec<OsString>,
    /// Time limit in seconds.
    pub(super) seconds: u32,
    pub(super) workspace: ProgramWorkspace<'a>,
}

/// Environment of every run: without a screen, and with one thread.
const ENVIRONMENT: [(&str, &str); 3] =
    [("QT_QPA_PLATFORM", "offscreen"), ("OMP_NUM_THREADS", "1"), ("OPENBLAS_NUM_THREADS", "1")];

/// A run that ended without a signal. Its result may still be missing.
pub(super) struct FinishedRun<'a> {
    invocation: ProgramCall,
    program: &'static str,
    log: &'a Path,
    /// Offset of its output in the log.
    from: u64,
}

impl<'a> ExternalRun<'a> {
    /// Runs the program to its end. The inner `Err` is a run that ended with exit code 1.
    pub(super) fn end(self) -> Result<Result<FinishedRun<'a>, FinishedRun<'a>>, ForeignError> {
        let Self { program, arguments, seconds, workspace } = self;
        let environment = ENVIRONMENT.map(|(name, value)| (name.to_owned(), value.to_owned()));
        let environment = BTreeMap::from(environment);
        // The workspace lies below the current folder, where version managers look for a file that
        // chooses a program.
        let folder = PathBuf::from("/");
        let invocation = ProgramCall { program: program.into(), arguments, environment, folder };
        // The log may already hold the output of earlier runs.
        let ran =
            FinishedRun { invocation, program, log: workspace.log, from: programs::length(workspace.log) };
        match programs::run_within(
            seconds,
            workspace.programs,
            &ran.invocation,
            workspace.log,
            workspace.goes_on,
        ) {
            Ok(()) => Ok(Ok(ran)),
            Err(ProgramEnd::Stopped) => Err(ForeignError::Stopped),
            // COLMAP also ends with code 1 if it finds no model, so the caller decides.
            Err(ProgramEnd::Failed(EndKind::Code(1))) => Ok(Err(ran)),
            Err(ProgramEnd::Failed(how)) => Err(ran.failed(how)),
        }
    }

    /// Runs the program to its end, which must be successful.
    pub(super) fn end_well(self) -> Result<FinishedRun<'a>, ForeignError> {
        self.end()?.map_err(|ran| ran.failed(EndKind::Code(1)))
    }
}

impl FinishedRun<'_> {
    /// Returns true if the last output contains this text.
    pub(super) fn says(&self, text: &str) -> bool {
        programs::last_lines(self.log, self.from).iter().any(|line| line.contains(text))
    }

    /// Creates the error of a run without the expected result.
    pub(super) fn failed(&self, how: EndKind) -> ForeignError {
        Box::new(ProgramFailure {
            program: self.program.to_owned(),
            command: self.invocation.to_text(),
            how,
            last: programs::last_lines(self.log, self.from),
            log: self.log.to_owned(),
        })
        .into()
    }
}
