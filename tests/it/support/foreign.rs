//! The other programs of this machine.

use super::absent::absent;
use gs2e_files::programs::ProgramFinder;
use gs2e_source::foreign::versions;
use std::process::{Command, Output};

/// The programs of this machine.
pub(crate) fn programs() -> ProgramFinder {
    ProgramFinder::new(std::env::var_os("PATH").as_deref(), env!("CARGO_BIN_EXE_gs2e").into())
}

/// Returns true if COLMAP is there. If not, the test is reported as not run; with `REQUIRE_COLMAP=1`
/// that is a failure.
pub(crate) fn colmap_is_there() -> bool {
    versions::colmap(&programs()).map_err(|because| absent("REQUIRE_COLMAP", &because)).is_ok()
}

/// Runs Python with these arguments; `None` without Python.
pub(crate) fn python(args: &[&str]) -> Option<Output> {
    Command::new("python3").args(args).output().ok()
}
