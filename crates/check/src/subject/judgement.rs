//! A measured value against its limits.

use crate::check::{Finding, FindingSubject, Verdict};

/// The verdict on one statement.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::check) struct Judgement {
    pub(in crate::check) verdict: Verdict,
    pub(in crate::check) measured: Option<f64>,
    pub(in crate::check) limit: Option<f64>,
    pub(in crate::check) unit: &'static str,
    pub(in crate::check) because: String,
}

impl Judgement {
    /// The verdict on a statement that could not be measured.
    pub(in crate::check) fn not_run(because: impl Into<String>) -> Self {
        let verdict = Verdict::NotRun;
        Self { verdict, measured: None, limit: None, unit: "1", because: because.into() }
    }

    /// The verdict on a measured value and a limit.
    pub(in crate::check) fn from_value(
        verdict: Verdict,
        measured: f64,
        limit: LimitSide,
        unit: &'static str,
        because: String,
    ) -> Self {
        Self { verdict, measured: Some(measured), limit: Some(limit.value), unit, because }
    }

    /// The finding of `name`; `part` names the statement if a pass makes several.
    pub(in crate::check) fn finding(self, name: &str, check: &str, part: &str) -> Finding {
        let subject = FindingSubject::new(name, part);
        let Self { verdict, measured, limit, unit, because } = self;
        let unit = unit.to_owned();
        let detects = None;
        Finding { check: check.to_owned(), subject, verdict, measured, limit, unit, because, detects }
    }
}

/// One end of an allowed range, and the verdict beyond it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::check) struct LimitSide {
    pub(in crate::check) value: f64,
    pub(in crate::check) beyond: Verdict,
}

impl LimitSide {
    /// A limit that stops a release.
    pub(in crate::check) fn gate(value: f64) -> Self {
        Self { value, beyond: Verdict::Fail }
    }

    /// A limit that causes a warning.
    pub(in crate::check) fn warning(value: f64) -> Self {
        Self { value, beyond: Verdict::Warn }
    }

    /// The recipe's limit, which is a gate, or else the default.
    pub(in crate::check) fn limit_or(recipe: Option<f64>, default: Self) -> Self {
        recipe.map_or(default, Self::gate)
    }

    /// The verdict on a value that must not exceed this.
    pub(in crate::check) fn at_most(self, measured: f64) -> Verdict {
        // NaN is outside.
        if measured <= self.value { Verdict::Pass } else { self.beyond }
    }

    /// The verdict on a value that must not be below this.
    pub(in crate::check) fn at_least(self, measured: f64) -> Verdict {
        if measured >= self.value { Verdict::Pass } else { self.beyond }
    }
}

/// The verdict on a value between two bounds, and the relevant bound: the violated one, or else the
/// nearer.
pub(in crate::check) fn between_bounds(measured: f64, least: LimitSide, most: LimitSide) -> (Verdict, f64) {
    match (least.at_least(measured), most.at_most(measured)) {
        (Verdict::Pass, Verdict::Pass) if measured - least.value < most.value - measured => {
            (Verdict::Pass, least.value)
        }
        (Verdict::Pass, verdict) => (verdict, most.value),
        (verdict, _) => (verdict, least.value),
    }
}
