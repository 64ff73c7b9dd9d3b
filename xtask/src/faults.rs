//! The fault tests of the engine, in release mode: they kill and damage many builds.

use crate::command::{Outcome, cargo};

/// Runs the tests; `args` are their own (`--long`, `--minutes N`, `--only NAME`, `--seed N`).
pub(crate) fn run(args: &[String]) -> Outcome {
    cargo(&["test", "--quiet", "--release", "--test", "faults", "--"]).args(args).run()
}
