//! Errors that end a verb early, and the exit code that follows.

use super::message::{MessageLevel, UserMessage};
use gs2e_build::plan::assess::PlanError;
use gs2e_build::plan::survey::SurveyError;
use gs2e_build::stage::StageError;
use gs2e_recipe::RecipeFaults;
use gs2e_store::StoreError;
use std::process::ExitCode;

/// The end of the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExitKind {
    /// Done.
    Done,
    /// A step failed.
    Failed,
    /// The command line or a recipe is wrong, and nothing ran.
    Usage,
    /// A check or an audit found a fault.
    Fault,
    /// The run was interrupted, and finished steps are kept.
    Interrupted,
}

impl ExitKind {
    /// The exit code of the process.
    #[must_use]
    pub fn code(self) -> u8 {
        match self {
            Self::Done => 0,
            Self::Failed => 1,
            Self::Usage => 2,
            Self::Fault => 3,
            Self::Interrupted => 130,
        }
    }
}

impl From<ExitKind> for ExitCode {
    fn from(exit: ExitKind) -> Self {
        Self::from(exit.code())
    }
}

/// An error that ends a verb early.
#[derive(Debug)]
pub(super) struct VerbError {
    pub(super) exit: ExitKind,
    said: ProblemText,
}

#[derive(Debug)]
enum ProblemText {
    Message(Box<UserMessage>),
    /// The faults of recipes, with their own positions.
    Faults(Box<RecipeFaults>),
    /// A command line that cannot be parsed, and the parser's own lines for people.
    Misread(Box<UserMessage>, Vec<String>),
}

impl VerbError {
    fn new(exit: ExitKind, code: &'static str, what: String) -> Self {
        Self::from_message(exit, UserMessage::new(MessageLevel::Error, code, what))
    }

    /// Ends a verb with this message.
    pub(super) fn from_message(exit: ExitKind, message: UserMessage) -> Self {
        Self { exit, said: ProblemText::Message(Box::new(message)) }
    }

    /// The command line or the input is wrong, and nothing ran.
    pub(super) fn usage(code: &'static str, what: String) -> Self {
        Self::new(ExitKind::Usage, code, what)
    }

    /// The command line cannot be parsed. `what` is the error, and `lines` is the longer text for
    /// people.
    pub(super) fn misread(what: String, lines: Vec<String>) -> Self {
        let message = UserMessage::new(MessageLevel::Error, "usage", what).help("gs2e --help");
        Self { exit: ExitKind::Usage, said: ProblemText::Misread(Box::new(message), lines) }
    }

    /// An operation failed.
    pub(super) fn failed(code: &'static str, what: String) -> Self {
        Self::new(ExitKind::Failed, code, what)
    }

    /// A check found a fault.
    pub(super) fn fault(code: &'static str, what: String) -> Self {
        Self::new(ExitKind::Fault, code, what)
    }

    /// Adds the remedy.
    pub(super) fn help(self, help: &str) -> Self {
        self.with(|message| message.help(help))
    }

    /// Adds the step that the error is about.
    pub(super) fn step(self, scene: &str, step: &str) -> Self {
        self.with(|message| message.step(scene, step))
    }

    fn with(self, change: impl FnOnce(UserMessage) -> UserMessage) -> Self {
        let said = match self.said {
            ProblemText::Message(message) => ProblemText::Message(Box::new(change(*message))),
            // Faults and parser errors state their own remedies.
            other => other,
        };
        Self { said, ..self }
    }

    /// The lines for people.
    pub(super) fn to_lines(&self) -> Vec<String> {
        match &self.said {
            ProblemText::Message(message) => message.to_lines(),
            ProblemText::Faults(faults) => faults.render_lines(),
            ProblemText::Misread(_, lines) => lines.clone(),
        }
    }

    /// The objects for programs: one per fault, with the exit code of the program in `exit`.
    pub(super) fn to_json(&self) -> Vec<serde_json::Value> {
        let mut objects = match &self.said {
            ProblemText::Message(message) | ProblemText::Misread(message, _) => vec![message.to_json()],
            ProblemText::Faults(faults) => faults.to_json(),
        };
        objects.iter_mut().for_each(|object| object["exit"] = self.exit.code().into());
        objects
    }
}

impl From<RecipeFaults> for VerbError {
    fn from(faults: RecipeFaults) -> Self {
        Self { exit: ExitKind::Usage, said: ProblemText::Faults(Box::new(faults)) }
    }
}

impl From<SurveyError> for VerbError {
    fn from(error: SurveyError) -> Self {
        match error {
            SurveyError::Faults(faults) => (*faults).into(),
            SurveyError::Store(error) => error.into(),
        }
    }
}

impl From<StoreError> for VerbError {
    fn from(error: StoreError) -> Self {
        let message = error.to_string();
        // Any operation may meet a full disk, and the remedy is always the same.
        if error.is_full() {
            return Self::failed("disk-full", format!("no space: failed {message}")).help(FULL);
        }
        match error {
            StoreError::Newer { .. } => {
                Self::usage("store-newer", message).help("use a newer gs2e, or another --store")
            }
            StoreError::Foreign { .. } => Self::usage("not-a-store", message)
                .help("name a new folder or an empty one: a store keeps nothing else in its folder"),
            StoreError::Link { .. } => Self::usage("store-link", message)
                .help("delete the link; to use another disk, name the whole store there with --store"),
            StoreError::NotPermitted { .. } => {
                Self::failed("shared-store-refused", format!("failed {message}"))
                    .help("the users of a shared store need one group, and a umask of 002")
            }
            StoreError::Locked { .. } => {
                Self::failed("locked", message).help("leave out --no-wait to wait for it")
            }
            StoreError::NotShared { .. } => Self::usage("not-shared", message)
                .help("choose an empty folder, or one that an earlier --shared-store filled"),
            StoreError::Clocks { .. } => {
                Self::failed("clock-skew", message).help("set the clocks of the machines, then run it again")
            }
            StoreError::Nondeterministic(_) | StoreError::SharedMismatch(_) => {
                Self::failed("nondeterministic", message)
            }
            StoreError::Unshareable { help, .. } => Self::usage("not-shared", message).help(help),
            StoreError::Bucket { .. } => Self::failed("shared-store", format!("failed {message}")),
            StoreError::Io { .. } | StoreError::State { .. } => {
                Self::failed("store", format!("failed {message}"))
            }
        }
    }
}

/// The remedy for a full disk.
pub(super) const FULL: &str = "gs2e gc --dry-run shows what can be deleted";

impl From<PlanError> for VerbError {
    /// The plan is compared with the store before anything runs, so the exit code says that nothing
    /// ran.
    fn from(error: PlanError) -> Self {
        match error {
            PlanError::Store(error) => error.into(),
            error => Self::from_message(ExitKind::Usage, unplanned_message(&error)),
        }
    }
}

/// The message about a step that cannot be compared with the store.
pub(super) fn unplanned_message(error: &PlanError) -> UserMessage {
    match error {
        PlanError::Missing { scene, step, path, named_at } => UserMessage::new(
            MessageLevel::Error,
            "input-missing",
            format!("{scene}: the source of {step} does not exist"),
        )
        .step(scene, step)
        .path(path)
        .named_at(named_at.clone())
        .help("a path is relative to the recipe's folder"),
        PlanError::Source { scene, step, cause } => {
            stage_failed("input-unreadable", scene, step, cause).help("fix it and run the same command")
        }
        PlanError::Store(error) => UserMessage::new(MessageLevel::Error, "store", format!("failed {error}")),
    }
}

/// The message about a step with an error in its own work.
pub(super) fn stage_failed(code: &'static str, scene: &str, step: &str, error: &StageError) -> UserMessage {
    let (doing, why) = match error {
        StageError::Work { doing, cause } => (doing.clone(), Some(cause.to_string())),
        StageError::Io { path, source } => (format!("use {}", path.display()), Some(source.to_string())),
        other => (other.to_string(), None),
    };
    let message = UserMessage::new(MessageLevel::Error, code, format!("{scene}/{step}: failed to {doing}"));
    why.into_iter().fold(message.step(scene, step), UserMessage::because)
}
