//! Where text goes: people read stderr, programs read stdout.

use super::message::Message;
use super::problem::Problem;
use std::io::{IsTerminal, Write};

/// The two streams, and what the user wants on them.
#[derive(Debug)]
pub(super) struct Console {
    pub(super) json: bool,
    pub(super) quiet: bool,
}

impl Console {
    pub(super) fn new(json: bool, quiet: bool) -> Self {
        Self { json, quiet }
    }

    /// Whether a person watches.
    pub(super) fn is_live(&self) -> bool {
        !self.quiet && std::io::stderr().is_terminal()
    }

    /// The same for people only, where what programs get has its own form.
    pub(super) fn for_people(&self) -> Self {
        Self { json: false, quiet: self.quiet }
    }

    /// A line for people, unless they want none.
    pub(super) fn say(&self, text: &str) {
        if !self.quiet {
            self.insist(text);
        }
    }

    /// A line for people, whatever they want.
    #[expect(clippy::unused_self, reason = "everything printed goes through the console")]
    pub(super) fn insist(&self, text: &str) {
        // Where stderr is gone there is nobody left to tell.
        let _ = writeln!(std::io::stderr().lock(), "{text}");
    }

    /// A result for programs: one JSON value on a line of stdout.
    pub(super) fn result(&self, value: &serde_json::Value) {
        self.print(&value.to_string());
    }

    /// A result of many parts, without a value of the whole.
    pub(super) fn large_result(&self, value: &impl serde::Serialize) {
        self.print(&serde_json::to_string(value).expect("results are plain data"));
    }

    /// A line of stdout, or several.
    #[expect(clippy::unused_self, reason = "everything printed goes through the console")]
    pub(super) fn print(&self, text: &str) {
        // A reader that closed the pipe has read all it wants.
        let _ = writeln!(std::io::stdout().lock(), "{text}");
    }

    /// A message for people, whatever they want, and for programs.
    pub(super) fn tell(&self, message: &Message) {
        if self.json {
            self.result(&message.to_json());
        }
        self.insist(&message.to_text());
    }

    /// Why the verb ends early.
    pub(super) fn problem(&self, problem: &Problem) {
        if self.json {
            problem.to_json().iter().for_each(|fault| self.result(fault));
        }
        self.insist(&problem.to_text());
    }
}
