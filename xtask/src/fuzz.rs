//! The readers under mutated files. Not in release mode: arithmetic that overflows shall be told.

use crate::command::{Outcome, cargo};

/// Runs the harness; `args` are its own (`--seconds N`, `--only READER`, `--seed N`, `--first N`, `--runs N`).
pub(crate) fn run(args: &[String]) -> Outcome {
    cargo(&["test", "--quiet", "--test", "fuzz", "--"]).args(args).run()
}
