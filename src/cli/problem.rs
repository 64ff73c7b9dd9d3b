//! Why a verb ends early, told in four parts: what failed, where, why, and what to do.

use crate::plan::assess::PlanError;
use crate::recipe::{Faults, Position};
use crate::run::StepError;
use crate::store::StoreError;
use serde_json::json;
use std::process::ExitCode;

/// How the program ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Exit {
    /// Done.
    Done,
    /// A step failed.
    Failed,
    /// The command line or a recipe is wrong; nothing ran.
    Usage,
    /// A check or an audit found a fault.
    Fault,
    /// Interrupted; what was finished is kept.
    Interrupted,
}

impl Exit {
    /// Help and version end well, everything else that clap says is about the command line.
    pub(super) fn from_clap(error: &clap::Error) -> Self {
        if error.use_stderr() { Self::Usage } else { Self::Done }
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(match exit {
            Exit::Done => 0,
            Exit::Failed => 1,
            Exit::Usage => 2,
            Exit::Fault => 3,
            Exit::Interrupted => 130,
        })
    }
}

/// What to know where a file is not found.
const RELATIVE: &str = "a path is relative to the recipe's folder";

/// Why a verb ends early.
#[derive(Debug)]
pub(super) struct Problem {
    pub(super) exit: Exit,
    code: &'static str,
    message: String,
    help: Option<String>,
    /// Where a recipe names what is wrong.
    at: Option<Position>,
    /// The faults of recipes, which bring their own places.
    faults: Option<Box<Faults>>,
}

impl Problem {
    fn new(exit: Exit, code: &'static str, message: String) -> Self {
        Self { exit, code, message, help: None, at: None, faults: None }
    }

    /// The command line or the input is wrong: nothing ran.
    pub(super) fn usage(code: &'static str, message: String) -> Self {
        Self::new(Exit::Usage, code, message)
    }

    /// Something could not be done.
    pub(super) fn failed(code: &'static str, message: String) -> Self {
        Self::new(Exit::Failed, code, message)
    }

    /// A check found a fault.
    pub(super) fn fault(code: &'static str, message: String) -> Self {
        Self::new(Exit::Fault, code, message)
    }

    /// Adds what to do.
    pub(super) fn help(mut self, help: &str) -> Self {
        self.help = Some(help.to_owned());
        self
    }

    /// A step that failed: `name` is the scene's id and the step's.
    pub(super) fn of_step(name: &str, error: &StepError) -> Self {
        let failed = |code, message: String| Self::failed(code, message);
        match error {
            // The errors of a plan name the scene themselves.
            StepError::Plan(PlanError::Missing { named_at, .. }) => {
                Self { at: named_at.clone(), ..failed("input-missing", error.to_string()).help(RELATIVE) }
            }
            StepError::Plan(_) => failed("input-unreadable", error.to_string()),
            StepError::Moved(_) => {
                failed("input-moved", format!("{name}: {error}")).help("run again when it is at rest")
            }
            StepError::Stage(_) => failed("step-failed", format!("{name}: {error}"))
                .help("mend it and run the same command: what is finished is kept"),
            StepError::Store(StoreError::Nondeterministic { .. }) => {
                failed("nondeterministic", format!("{name}: {error}"))
            }
            StepError::Store(_) => failed("store", format!("{name}: failed {error}")),
        }
    }

    pub(super) fn to_text(&self) -> String {
        if let Some(faults) = &self.faults {
            return faults.render_text();
        }
        let mut text = format!("error: {}", self.message);
        if let Some(help) = &self.help {
            text.push_str("\nhelp: ");
            text.push_str(help);
        }
        text
    }

    pub(super) fn to_json(&self) -> serde_json::Value {
        if let Some(faults) = &self.faults {
            return serde_json::Value::Array(faults.to_json());
        }
        json!({
            "level": "error", "code": self.code, "message": self.message, "help": self.help,
            "path": self.at.as_ref().map(|at| &at.file), "line": self.at.as_ref().map(|at| at.line),
            "column": self.at.as_ref().map(|at| at.column),
        })
    }
}

impl From<Faults> for Problem {
    fn from(faults: Faults) -> Self {
        let faults = Some(Box::new(faults));
        Self { faults, ..Self::usage("recipe-invalid", String::new()) }
    }
}

impl From<StoreError> for Problem {
    fn from(error: StoreError) -> Self {
        let message = error.to_string();
        match error {
            StoreError::Newer { .. } => {
                Self::usage("store-newer", message).help("use a newer gs2e, or another --store")
            }
            StoreError::Locked { .. } => {
                Self::failed("locked", message).help("leave out --no-wait to wait for it")
            }
            StoreError::Nondeterministic { .. } => Self::failed("nondeterministic", message),
            StoreError::Io { .. } | StoreError::State { .. } => {
                Self::failed("store", format!("failed {message}"))
            }
        }
    }
}

impl From<PlanError> for Problem {
    fn from(error: PlanError) -> Self {
        let message = error.to_string();
        match error {
            PlanError::Missing { named_at: at, .. } => {
                Self { at, ..Self::usage("input-missing", message).help(RELATIVE) }
            }
            PlanError::Source { .. } => Self::usage("input-unreadable", message),
            PlanError::Store(error) => error.into(),
        }
    }
}
