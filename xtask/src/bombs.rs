//! Small files that ask for much memory, and the program's memory on them.

use crate::command::{Outcome, cargo};
use crate::suite::PACKAGES;

/// Runs the harness; `args` are its own (`--program FILE`, names of bombs).
pub(crate) fn run(args: &[String]) -> Outcome {
    cargo(&["test", "--quiet", "--test", "bombs"]).args(PACKAGES).args(["--"]).args(args).run()
}
