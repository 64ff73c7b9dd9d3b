//! A measured value against its limits.

use crate::{Finding, FindingSubject, Verdict};

/// The verdict on one statement.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Judgement {
    pub(crate) verdict: Verdict,
    pub(crate) measured: Option<f64>,
    pub(crate) limit: Option<f64>,
    pub(crate) unit: &'static str,
    pub(crate) because: String,
}

impl Judgement {
    /// The verdict on a statement that could not be measured.
    pub(crate) fn not_run(because: impl Into<String>) -> Self {
        let verdict = Verdict::NotRun;
        Self { verdict, measured: None, limit: None, unit: "1", because: because.into() }
    }

    /// The verdict on a measured value and a limit.
    pub(crate) fn from_value(
        verdict: Verdict,
        measured: f64,
        limit: LimitSide,
        unit: &'static str,
        because: String,
    ) -> Self {
        Self { verdict, measured: Some(measured), limit: Some(limit.value), unit, because }
    }

    /// The finding of `name`; `part` names the statement if a pass makes several.
    pub(crate) fn finding(self, name: &str, check: &str, part: &str) -> Finding {
        let subject = FindingSubject::new(name, part);
        let Self { verdict, measured, limit, unit, because } = self;
        let unit = unit.to_owned();
        let detects = None;
        Finding { check: check.to_owned(), subject, verdict, measured, limit, unit, because, detects }
    }
}

/// One end of an allowed range, and the verdict beyond it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LimitSide {
    pub(crate) value: f64,
    pub(crate) beyond: Verdict,
}

impl LimitSide {
    /// A limit that stops a release.
    pub(crate) fn gate(value: f64) -> Self {
        Self { value, beyond: Verdict::Fail }
    }

    /// A limit that causes a warning.
    pub(crate) fn warning(value: f64) -> Self {
        Self { value, beyond: Verdict::Warn }
    }

    /// The recipe's limit, which is a gate, or else the default.
    pub(crate) fn limit_or(recipe: Option<f64>, default: Self) -> Self {
        recipe.map_or(default, Self::gate)
    }

    /// The verdict on a value that must not exceed this.
    pub(crate) fn at_most(self, measured: f64) -> Verdict {
        // NaN is outside.
        if measured <= self.value { Verdict::Pass } else { self.beyond }
    }

    /// The verdict on a value that must not be below this.
    pub(crate) fn at_least(self, measured: f64) -> Verdict {
        if measured >= self.value { Verdict::Pass } else { self.beyond }
    }
}

/// The verdict on a value between two bounds, and the relevant bound: the violated one, or else the
/// nearer.
pub(crate) fn between_bounds(measured: f64, least: LimitSide, most: LimitSide) -> (Verdict, f64) {
    match (least.at_least(measured), most.at_most(measured)) {
        (Verdict::Pass, Verdict::Pass) if measured - least.value < most.value - measured => {
            (Verdict::Pass, least.value)
        }
        (Verdict::Pass, verdict) => (verdict, most.value),
        (verdict, _) => (verdict, least.value),
    }
}
