//! Small files that ask for much memory, and the program's memory on them.

use crate::command::{Outcome, cargo};

/// Runs the harness; `args` are its own (`--program FILE`, names of bombs).
pub(crate) fn run(args: &[String]) -> Outcome {
    cargo(&["test", "--quiet", "--test", "bombs", "--"]).args(args).run()
}
