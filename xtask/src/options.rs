//! Options of the tasks that measure the program: `--name VALUE`.

use crate::command::{Outcome, cargo, root};
use std::path::PathBuf;
use std::str::FromStr;

/// The words after the name of a task.
#[derive(Clone, Copy)]
pub(crate) struct Options<'a>(pub(crate) &'a [String]);

impl<'a> Options<'a> {
    /// The word after `name`.
    pub(crate) fn value(self, name: &str) -> Option<&'a str> {
        let at = self.0.iter().position(|arg| arg == name)?;
        self.0.get(at + 1).map(String::as_str)
    }

    /// The number after `name`.
    pub(crate) fn number<T: FromStr>(self, name: &str, default: T) -> Outcome<T> {
        let parse = |text: &str| text.parse().map_err(|_| format!("{name} takes a number"));
        self.value(name).map_or(Ok(default), parse)
    }

    /// The path after `name`. Commands run in the repository's root, so it is made absolute.
    pub(crate) fn path(self, name: &str) -> Outcome<Option<PathBuf>> {
        let absolute = |path: &str| std::path::absolute(path).map_err(|e| format!("{path}: {e}"));
        self.value(name).map(absolute).transpose()
    }

    /// The program: `--program FILE`, or one that is built in release mode with these words for cargo.
    pub(crate) fn program(self, how: &[&str]) -> Outcome<PathBuf> {
        if let Some(path) = self.path("--program")? {
            return Ok(path);
        }
        cargo(&[&["build", "--release", "--quiet"], how].concat()).run()?;
        Ok(root().join("target/release/gs2e"))
    }
}
