//! The readers under mutated files, and the command line under mutated words and names. Not in
//! release mode, so that overflowing arithmetic is detected.

use crate::command::{Outcome, cargo};
use crate::suite::PACKAGES;

/// Runs the harness; `args` are its own (`--seconds N`, `--only READER`, `--seed N`, `--first N`,
/// `--runs N`, `--jobs N`).
pub(crate) fn run(args: &[String]) -> Outcome {
    cargo(&["test", "--quiet", "--test", "fuzz"]).args(PACKAGES).args(["--"]).args(args).run()
}

/// Runs every reader for 4 s over the committed corpus, two at a time. The seed is always the same, so
/// that a change is not blamed for a fault that only another draw would have found.
pub(crate) fn short() -> Outcome {
    run(&["--seconds", "4", "--jobs", "2"].map(str::to_owned))
}
