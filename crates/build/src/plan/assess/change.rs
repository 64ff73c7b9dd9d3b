//! Changes between two descriptions of a step.

use super::verdict::StepReason;
use gs2e_store::description::ExplanationLine;
use serde::Serialize;

/// A line that differs between two descriptions.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct DescriptionChange {
    /// Path of the line.
    pub path: String,
    /// Previous text; empty if it was absent.
    pub old: String,
    /// Present text; empty if it is absent.
    pub new: String,
}

impl DescriptionChange {
    pub(super) fn reason(self) -> StepReason {
        let Self { path, old, new } = self;
        let below = |prefix: &str| path.strip_prefix(prefix).map(str::to_owned);
        match path.as_str() {
            "revision" => StepReason::Revision { old, new },
            "class" => StepReason::Class { old, new },
            _ => match (below("inputs."), below("params.")) {
                (Some(name), _) => StepReason::InputChanged { name, old, new },
                (None, Some(name)) => StepReason::ParamChanged { name, old, new },
                (None, None) => StepReason::ParamChanged { name: path, old, new },
            },
        }
    }
}

/// The lines that differ, the most important first: revision and class, then parameters, then
/// inputs.
#[must_use]
pub(crate) fn changed_lines(old: &[ExplanationLine], new: &[ExplanationLine]) -> Vec<DescriptionChange> {
    let text = |lines: &[ExplanationLine], path: &str| {
        lines.iter().find(|l| l.path == path).map(|l| l.text.clone()).unwrap_or_default()
    };
    let mut paths: Vec<&str> = old.iter().chain(new).map(|l| l.path.as_str()).collect();
    let rank = |path: &str| match path {
        "revision" | "class" => 0,
        p if p.starts_with("params.") => 1,
        _ => 2,
    };
    paths.sort_by_key(|path| (rank(path), *path));
    paths.dedup();
    let change =
        |path: &str| DescriptionChange { path: path.to_owned(), old: text(old, path), new: text(new, path) };
    paths.into_iter().map(change).filter(|c| c.old != c.new).collect()
}
