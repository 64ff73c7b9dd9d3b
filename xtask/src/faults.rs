//! The fault tests of the engine: they kill and damage many builds.

use crate::command::{Outcome, cargo};
use crate::suite::PACKAGES;

/// Runs the tests in release mode; `args` are their own (`--long`, `--seconds N`, `--only NAME`,
/// `--seed N`).
pub(crate) fn run(args: &[String]) -> Outcome {
    cargo(&["test", "--quiet", "--release", "--test", "faults", "--"]).args(args).run()
}

/// Begins trials of each test for 4 s, with the program that the other tests have built: a build in
/// release mode would take longer than the trials.
pub(crate) fn short() -> Outcome {
    cargo(&["test", "--quiet", "--test", "faults"]).args(PACKAGES).args(["--", "--seconds", "4"]).run()
}
