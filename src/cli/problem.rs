//! Errors that end a verb early, and the exit code that follows.

use super::UserMessage;
use gs2e_build::plan::assess::PlanError;
use gs2e_build::plan::survey::SurveyError;
use gs2e_build::stage::StageError;
use gs2e_recipe::RecipeFaults;
use gs2e_store::StoreError;
use std::fmt::Display;
use std::path::Path;
use std::process::ExitCode;

/// The end of the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum ExitKind {
    /// Done.
    Done = 0,
    /// A step failed.
    Failed = 1,
    /// The command line or a recipe is wrong, and nothing ran.
    Usage = 2,
    /// A check or an audit found a fault.
    Fault = 3,
    // 128 and the number of SIGINT, which is 2: shells report a program that an interrupt ended in this way.
    /// The run was interrupted, and finished steps are kept.
    Interrupted = 130,
}

impl ExitKind {
    /// The exit code of the process.
    #[must_use]
    pub fn code(self) -> u8 {
        self as u8
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
    /// Ends a verb with this message.
    pub(super) fn new(exit: ExitKind, message: UserMessage) -> Self {
        Self { exit, said: ProblemText::Message(Box::new(message)) }
    }

    /// The command line or the input is wrong, and nothing ran.
    pub(super) fn usage(code: &'static str, what: impl Into<String>) -> Self {
        Self::new(ExitKind::Usage, UserMessage::error(code, what))
    }

    /// The command line cannot be parsed. `what` is the error, and `lines` is the longer text for
    /// people.
    pub(super) fn misread(what: String, lines: Vec<String>) -> Self {
        let message = UserMessage::error("usage", what).help("gs2e --help");
        Self { exit: ExitKind::Usage, said: ProblemText::Misread(Box::new(message), lines) }
    }

    /// An operation failed.
    pub(super) fn failed(code: &'static str, what: impl Into<String>) -> Self {
        Self::new(ExitKind::Failed, UserMessage::error(code, what))
    }

    /// A check found a fault.
    pub(super) fn fault(code: &'static str, what: impl Into<String>) -> Self {
        Self::new(ExitKind::Fault, UserMessage::error(code, what))
    }

    /// The user interrupted the program.
    pub(super) fn interrupted(what: impl Into<String>) -> Self {
        Self::new(ExitKind::Interrupted, UserMessage::error("interrupted", what))
    }

    /// Adds the remedy.
    pub(super) fn help(self, help: impl Into<String>) -> Self {
        self.with(|message| message.help(help))
    }

    /// Adds a cause.
    pub(super) fn because(self, why: impl Display) -> Self {
        self.with(|message| message.because(why))
    }

    /// Adds lines about the error.
    pub(super) fn details(self, lines: impl IntoIterator<Item = String>) -> Self {
        self.with(|message| message.details(lines))
    }

    /// Adds the file that the error is about.
    pub(super) fn path(self, path: &Path) -> Self {
        self.with(|message| message.path(path))
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
            error => Self::new(ExitKind::Usage, unplanned_message(&error)),
        }
    }
}

/// The error for a step without outputs in the store.
pub(super) fn not_built(scene: &str, step: &str) -> VerbError {
    VerbError::failed("not-built", format!("{scene}/{step} is not built, or no longer up to date"))
        .step(scene, step)
        .help("gs2e build")
}

/// The message about a step that cannot be compared with the store.
pub(super) fn unplanned_message(error: &PlanError) -> UserMessage {
    match error {
        PlanError::Missing { scene, step, path, named_at } => {
            let what = format!("{scene}: the source of {step} does not exist");
            let message = UserMessage::error("input-missing", what).step(scene, step).path(path);
            message.named_at(named_at.clone()).help("a path is relative to the recipe's folder")
        }
        PlanError::Source { scene, step, cause } => {
            stage_failed("input-unreadable", scene, step, cause).help("fix it and run the same command")
        }
        PlanError::Store(error) => UserMessage::error("store", format!("failed {error}")),
    }
}

/// The message about a step with an error in its own work.
pub(super) fn stage_failed(code: &'static str, scene: &str, step: &str, error: &StageError) -> UserMessage {
    let failed = |doing: &dyn Display| {
        UserMessage::error(code, format!("{scene}/{step}: failed to {doing}")).step(scene, step)
    };
    match error {
        StageError::Work { doing, cause } => failed(doing).because(cause),
        StageError::Io(error) => failed(&format!("use {}", error.path.display())).because(&error.source),
        other => failed(other),
    }
}
