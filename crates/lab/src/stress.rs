//! Stress table: the arithmetic at its extremes. Each case compares a result with an independent
//! answer, and states the allowed error (`gs2e stress`).
//!
//! An answer is a closed form that the program does not use, a series in 64 bits, a number computed
//! with 120 digits (`stress/answers.txt`, written by `answers.py`), the same input in a form
//! without extremes, or the input from which a result was made. Results based on event counts have
//! a fixed seed and a stated number of standard errors.
//!
//! A case takes the function under test as an argument, so that a test can pass a naive one and
//! verify that it exceeds the limit.

mod answers;
pub mod clips;
pub mod clock;
pub mod sensor;
pub mod splat;
pub mod trajectory;

use serde::Serialize;
use std::fmt;

/// The subject of a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum StressArea {
    /// The law of the event sensor.
    Sensor,
    /// Paths and speeds.
    Trajectory,
    /// The renderers.
    Splat,
    /// Time, order, and everything that must not affect a stream.
    Clock,
}

impl StressArea {
    /// All areas, in the order of the table.
    pub const ALL: [Self; 4] = [Self::Sensor, Self::Trajectory, Self::Splat, Self::Clock];

    /// Name of the area.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Sensor => "sensor",
            Self::Trajectory => "trajectory",
            Self::Splat => "splat",
            Self::Clock => "clock",
        }
    }
}

/// One computed value and its correct value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StressPoint {
    /// The computed value.
    pub computed: f64,
    /// The independent answer.
    pub answer: f64,
    /// The error, in the unit of the case.
    pub error: f64,
    /// The allowed error.
    pub limit: f64,
}

impl StressPoint {
    /// An absolute error.
    #[must_use]
    pub(crate) fn absolute_error(computed: f64, answer: f64, limit: f64) -> Self {
        Self { computed, answer, error: (computed - answer).abs(), limit }
    }

    /// An error relative to the answer.
    #[must_use]
    pub fn relative_error(computed: f64, answer: f64, limit: f64) -> Self {
        Self { computed, answer, error: ((computed - answer) / answer).abs(), limit }
    }

    /// An error in a unit of its own: units in the last place, standard errors, or nanoseconds.
    #[must_use]
    pub(crate) fn scaled_error(computed: f64, answer: f64, unit: f64, limit: f64) -> Self {
        Self { computed, answer, error: ((computed - answer) / unit).abs(), limit }
    }

    /// A count that must be exact.
    #[must_use]
    pub(crate) fn exact_count(computed: u64, answer: u64) -> Self {
        Self::absolute_error(computed as f64, answer as f64, 0.0)
    }

    /// Returns true if the error is within its limit. NaN is not.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.error <= self.limit
    }

    /// The error relative to its limit.
    fn strain(&self) -> f64 {
        // An exact value under a limit of 0 would be 0/0.
        if self.error == 0.0 && self.limit >= 0.0 {
            return 0.0;
        }
        let strain = self.error / self.limit;
        // NaN is beyond every limit.
        if strain.is_nan() { f64::INFINITY } else { strain }
    }
}

/// The result of a case: the worst of its points.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CaseResult {
    /// The point nearest to its limit, or farthest beyond it.
    #[serde(flatten)]
    pub worst: StressPoint,
    /// The place of that point.
    pub at: String,
    /// Number of points.
    pub points: u64,
}

impl CaseResult {
    /// Returns true if every point is within its limit.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.worst.holds()
    }
}

/// Collects points.
#[derive(Debug, Default)]
pub(crate) struct WorstPoint(Option<CaseResult>);

impl WorstPoint {
    /// Adds a point; `at` describes its place.
    pub(crate) fn see(&mut self, point: StressPoint, at: impl FnOnce() -> String) {
        match &mut self.0 {
            Some(found) => {
                found.points += 1;
                if point.strain() > found.worst.strain() {
                    (found.worst, found.at) = (point, at());
                }
            }
            none => *none = Some(CaseResult { worst: point, at: at(), points: 1 }),
        }
    }

    /// Adds a comparison of bits: `differing` of `all` values differ.
    pub(crate) fn see_same(&mut self, differing: usize, all: usize, at: impl FnOnce() -> String) {
        assert!(all > 0, "there is something to compare");
        self.see(StressPoint::exact_count(differing as u64, 0), at);
    }

    /// The worst point.
    ///
    /// # Panics
    /// There was no point: a case without points would pass for any program.
    #[must_use]
    pub(crate) fn found(self) -> CaseResult {
        self.0.expect("a case has points")
    }
}

/// The result of a case, or the reason for not running it.
pub type Outcome = Result<CaseResult, NotRun>;

/// The reason for not running a case.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct NotRun(pub String);

/// A case that can be run.
pub struct StressCase<'a> {
    /// Area of the case.
    pub area: StressArea,
    /// Name, of words and hyphens; unique together with the area and the back end.
    pub name: &'static str,
    /// The stiff or extreme property.
    pub regime: &'static str,
    /// The unit of error and limit.
    pub unit: &'static str,
    /// The back end, if the case renders.
    pub backend: Option<&'static str>,
    run: Box<dyn Fn() -> Outcome + 'a>,
}

impl<'a> StressCase<'a> {
    fn new(
        area: StressArea,
        [name, regime, unit]: [&'static str; 3],
        run: impl Fn() -> CaseResult + 'a,
    ) -> Self {
        Self { area, name, regime, unit, backend: None, run: Box::new(move || Ok(run())) }
    }

    /// Runs the case.
    ///
    /// # Errors
    /// It cannot be run on this machine.
    pub fn run(&self) -> Outcome {
        (self.run)()
    }

    /// `area/name`, and the back end.
    #[must_use]
    pub fn id(&self) -> String {
        let by = self.backend.map(|backend| format!("@{backend}")).unwrap_or_default();
        format!("{}/{}{by}", self.area.name(), self.name)
    }
}

impl fmt::Debug for StressCase<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("StressCase").field("id", &self.id()).finish_non_exhaustive()
    }
}

/// All cases of an area, in the order of the table. The cases of [`StressArea::Splat`] run with
/// each renderer of the bench.
#[must_use]
pub fn area_cases<'a>(area: StressArea, stage: &'a splat::SplatBench) -> Vec<StressCase<'a>> {
    match area {
        StressArea::Sensor => sensor::sensor_cases(),
        StressArea::Trajectory => trajectory::trajectory_cases(),
        StressArea::Splat => splat::splat_cases(stage),
        StressArea::Clock => clock::clock_cases(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_point_is_kept_and_what_is_no_number_is_worst() {
        let mut worst = WorstPoint::default();
        worst.see(StressPoint::absolute_error(1.0, 1.5, 1.0), || "half".to_owned());
        worst.see(StressPoint::relative_error(1.1, 1.0, 0.2), || "less than half, or just".to_owned());
        worst.see(StressPoint::exact_count(3, 3), || "nothing".to_owned());
        let found = worst.found();
        assert!(found.holds() && found.points == 3 && found.at != "nothing");
        for (bad, limit) in [(f64::NAN, 1.0), (f64::INFINITY, 1.0), (1e-300, 0.0)] {
            let mut worst = WorstPoint::default();
            worst.see(StressPoint::absolute_error(1.0, 1.5, 1.0), || "half".to_owned());
            worst.see(StressPoint { error: bad, ..StressPoint::absolute_error(0.0, 0.0, limit) }, || {
                "bad".to_owned()
            });
            worst.see(StressPoint::absolute_error(0.0, 3.0, 1.0), || "far".to_owned());
            let found = worst.found();
            assert!(!found.holds() && found.at == "bad", "{bad}: {found:?}");
        }
    }
}
