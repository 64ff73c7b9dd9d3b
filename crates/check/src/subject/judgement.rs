//! A measured value against its limits.

use crate::{DetectableFault, Finding, FindingSubject, Verdict};

/// The statements of a pass by their names. The name is empty if the pass makes only one.
pub(crate) type Statements = Vec<(&'static str, JudgementResult)>;

/// The verdict on one statement, or the reason why nothing could be measured.
pub type JudgementResult = Result<Judgement, String>;

/// The verdict on one statement.
#[derive(Debug, Clone, PartialEq)]
pub struct Judgement {
    /// The verdict.
    pub verdict: Verdict,
    /// The measured value, in `unit`.
    pub measured: Option<f64>,
    /// The limit.
    pub limit: Option<f64>,
    /// Unit of both values; `1` for pure numbers.
    pub unit: &'static str,
    /// One sentence for people with the measured value and the limit.
    pub because: String,
    /// The smallest fault that would have been found, if the pass states one.
    pub detects: Option<DetectableFault>,
}

impl Judgement {
    /// The verdict on a statement that could not be measured.
    #[must_use]
    pub fn not_run(because: impl Into<String>) -> Self {
        Self::without_value(Verdict::NotRun, "1", because.into())
    }

    /// A verdict without a measured value.
    #[must_use]
    pub fn without_value(verdict: Verdict, unit: &'static str, because: String) -> Self {
        Self { verdict, measured: None, limit: None, unit, because, detects: None }
    }

    /// The verdict on a measured value and a limit, if there is one.
    #[must_use]
    pub fn new(
        verdict: Verdict,
        measured: f64,
        limit: impl Into<Option<f64>>,
        unit: &'static str,
        because: String,
    ) -> Self {
        let (measured, limit) = (Some(measured), limit.into());
        Self { verdict, measured, limit, unit, because, detects: None }
    }

    /// The verdict on a value that must not exceed its limit.
    pub(crate) fn at_most(measured: f64, limit: LimitSide, unit: &'static str, because: String) -> Self {
        Self::new(limit.at_most(measured), measured, limit.value, unit, because)
    }

    /// The verdict on a value that must not be below its limit.
    pub(crate) fn at_least(measured: f64, limit: LimitSide, unit: &'static str, because: String) -> Self {
        Self::new(limit.at_least(measured), measured, limit.value, unit, because)
    }

    /// The verdict on a number of faults, where a single one fails.
    pub(crate) fn none_of(faults: f64, unit: &'static str, because: String) -> Self {
        Self::at_most(faults, LimitSide::gate(0.0), unit, because)
    }

    /// This verdict with the smallest fault that it would have shown.
    #[must_use]
    pub fn detecting(self, size: f64, unit: &str) -> Self {
        // Infinity is not a number in JSON, and states nothing.
        Self { detects: size.is_finite().then(|| DetectableFault::new(size, unit)), ..self }
    }

    /// The finding of `name`, with the name of the statement if a pass makes several.
    #[must_use]
    pub fn finding(self, name: &str, check: &str, statement: &str) -> Finding {
        let subject = FindingSubject::new(name, statement);
        let Self { verdict, measured, limit, unit, because, detects } = self;
        let unit = unit.to_owned();
        Finding { check: check.to_owned(), subject, verdict, measured, limit, unit, because, detects }
    }
}

/// The statements of a check as its findings. A check that could not measure anything has one, without a
/// name.
pub(crate) fn findings_of(name: &str, check: &str, made: Result<Statements, String>) -> Vec<Finding> {
    let statements = made.unwrap_or_else(|because| vec![("", Err(because))]);
    let finding = |(statement, judged): (_, JudgementResult)| {
        judged.unwrap_or_else(Judgement::not_run).finding(name, check, statement)
    };
    statements.into_iter().map(finding).collect()
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
