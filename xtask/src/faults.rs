//! The fault tests of the engine, in release mode: they kill and damage many builds.

use crate::command::{Outcome, cargo};

/// Runs them; `args` are theirs (`--long`, `--minutes N`, `--only NAME`, `--seed N`).
pub(crate) fn run(args: &[String]) -> Outcome {
    cargo(&["test", "--quiet", "--release", "--test", "faults", "--"]).args(args).run()
}
