//! What an export lacks: needs of a loader, and losses of a layout.

use serde::Serialize;

/// A requirement of a loader that the release does not meet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnmetNeed {
    /// The value found and the value wanted.
    pub what: String,
    /// The option or the recipe key that would meet it.
    pub remedy: String,
}

impl UnmetNeed {
    /// A need with its remedy.
    #[must_use]
    pub(super) fn new(what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { what: what.into(), remedy: remedy.into() }
    }
}

/// A property of the release that an export does not hold exactly.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ExportLoss {
    /// The property.
    pub field: &'static str,
    /// How it is lost.
    pub kind: LossKind,
    /// The size of the loss in the unit that `what` names, if it has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub figure: Option<f64>,
    /// Description.
    pub what: String,
}

/// How a property is lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum LossKind {
    /// The layout has no place for it. What the layout holds is still exact.
    Lost,
    /// The release does not state it; it follows from other data.
    Derived,
    /// The consumer's assumption differs from the release. `--lossy` accepts this.
    Approximate,
}

impl ExportLoss {
    /// A property without a place in the layout.
    #[must_use]
    pub(super) fn lost(field: &'static str, what: impl Into<String>) -> Self {
        Self { field, kind: LossKind::Lost, figure: None, what: what.into() }
    }

    /// A value that follows from other data.
    #[must_use]
    pub(super) fn derived(field: &'static str, what: impl Into<String>) -> Self {
        Self { field, kind: LossKind::Derived, figure: None, what: what.into() }
    }

    /// An assumption that differs from the release by `figure`.
    #[must_use]
    pub(super) fn approximate(field: &'static str, figure: f64, what: impl Into<String>) -> Self {
        Self { field, kind: LossKind::Approximate, figure: Some(figure), what: what.into() }
    }
}
