//! Remaining time of a run, from earlier durations of its steps and from its own progress.
//!
//! Time is counted in core-seconds. A waiting step is expected to take what it took before, scaled
//! by the ratio of this run to earlier ones; otherwise the mean of its stage in this run. If
//! neither is known, there is no estimate. A step that an early cut-off may spare counts until it
//! is settled, so the estimate is rather too long than too short.

use crate::stage::StepId;
use std::collections::BTreeMap;

/// The estimate of a run. Its clock counts seconds since the start.
#[derive(Debug)]
pub struct RunEstimate {
    steps: Vec<EstimatedStep>,
    /// Cores for all steps together.
    cores: f64,
    /// By stage: core-seconds and number of the steps made in this run.
    stages: BTreeMap<&'static str, (f64, f64)>,
    /// Core-seconds of the made steps, earlier and now, if both are known.
    before_and_now: [f64; 2],
}

#[derive(Debug)]
struct EstimatedStep {
    stage: &'static str,
    expected: Option<f64>,
    state: StepState,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum StepState {
    Waiting,
    Running { since: f64, cores: f64 },
    Ended,
}

/// A step that exceeds its expected time is expected to need this share of its time more.
const OVERTIME: f64 = 0.1;

impl RunEstimate {
    /// A run of `steps`, each with its stage and its earlier core-seconds, on `cores`.
    pub fn new(steps: impl IntoIterator<Item = (&'static str, Option<f64>)>, cores: usize) -> Self {
        let step = |(stage, expected)| EstimatedStep { stage, expected, state: StepState::Waiting };
        let steps = steps.into_iter().map(step).collect();
        Self { steps, cores: cores.max(1) as f64, stages: BTreeMap::new(), before_and_now: [0.0; 2] }
    }

    /// A step starts at `now` on `cores`: a fraction of them if others are made on the same cores.
    pub fn started(&mut self, step: StepId, now: f64, cores: f64) {
        self.steps[step.0].state = StepState::Running { since: now, cores };
    }

    /// A step was made in this many core-seconds.
    pub fn made(&mut self, step: StepId, core_seconds: f64) {
        let step = &mut self.steps[step.0];
        step.state = StepState::Ended;
        let (sum, count) = self.stages.entry(step.stage).or_default();
        *sum += core_seconds;
        *count += 1.0;
        // A step without an earlier time tells nothing about the speed of this run.
        if let Some(expected) = step.expected {
            let [before, now] = &mut self.before_and_now;
            *before += expected;
            *now += core_seconds;
        }
    }

    /// A step is up to date, or failed, or can no longer be reached.
    pub fn ended(&mut self, step: StepId) {
        self.steps[step.0].state = StepState::Ended;
    }

    /// Seconds from `now` to the end of the run; `None` if nothing is known about a remaining step.
    #[must_use]
    pub fn remaining(&self, now: f64) -> Option<f64> {
        let (mut all, mut longest) = (0.0, 0.0_f64);
        for step in self.steps.iter().filter(|step| step.state != StepState::Ended) {
            let whole = self.core_seconds(step)?;
            all += match step.state {
                StepState::Running { since, cores } => {
                    let used = (now - since) * cores;
                    let left = (whole - used).max(OVERTIME * used);
                    longest = longest.max(left / cores);
                    left
                }
                StepState::Waiting | StepState::Ended => whole,
            };
        }
        // Free cores do not shorten the step that runs longest.
        Some(longest.max(all / self.cores))
    }

    fn core_seconds(&self, step: &EstimatedStep) -> Option<f64> {
        let [before, now] = self.before_and_now;
        let scale = if before > 0.0 { now / before } else { 1.0 };
        let mean = || self.stages.get(step.stage).map(|(sum, count)| sum / count);
        step.expected.map(|expected| scale * expected).or_else(mean)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(found: Option<f64>, wanted: f64) {
        let found = found.expect("all is known");
        assert!((found - wanted).abs() < 1e-9, "{found} where {wanted} is due");
    }

    #[test]
    fn nothing_is_told_of_what_nobody_knows() {
        let mut estimate = RunEstimate::new([("events", None), ("events", None), ("sharp", Some(4.0))], 2);
        assert_eq!(estimate.remaining(0.0), None);
        estimate.started(StepId(0), 0.0, 2.0);
        estimate.made(StepId(0), 6.0);
        // The other step of its stage is expected to take as long: 6 and 4 core-seconds on two
        // cores.
        close(estimate.remaining(3.0), 5.0);
    }

    #[test]
    fn what_a_step_took_before_counts_as_this_run_compares() {
        let mut estimate = RunEstimate::new([("a", Some(10.0)), ("a", Some(20.0)), ("b", Some(30.0))], 1);
        close(estimate.remaining(0.0), 60.0);
        // Twice as slow as before, so the rest is expected to be.
        estimate.made(StepId(0), 20.0);
        close(estimate.remaining(20.0), 100.0);
        estimate.ended(StepId(1));
        close(estimate.remaining(20.0), 60.0);
        estimate.ended(StepId(2));
        close(estimate.remaining(20.0), 0.0);
    }

    #[test]
    fn a_running_step_counts_less_the_longer_it_runs_and_never_nothing() {
        let mut estimate = RunEstimate::new([("a", Some(10.0))], 4);
        estimate.started(StepId(0), 100.0, 1.0);
        // It has one core only, however many are free.
        close(estimate.remaining(100.0), 10.0);
        close(estimate.remaining(106.0), 4.0);
        close(estimate.remaining(130.0), 3.0);
    }

    /// Two steps of 6 and 2 core-seconds on the same two cores end after 4 s, together.
    #[test]
    fn steps_on_the_same_cores_share_them() {
        let mut estimate = RunEstimate::new([("a", Some(6.0)), ("b", Some(2.0))], 2);
        estimate.started(StepId(0), 0.0, 1.0);
        estimate.started(StepId(1), 0.0, 1.0);
        // The longer one has a core of its own at most, so the rest is rather too long: 5 s of 3.
        close(estimate.remaining(1.0), 5.0);
        estimate.made(StepId(0), 6.0);
        estimate.made(StepId(1), 2.0);
        close(estimate.remaining(4.0), 0.0);
    }

    #[test]
    fn nothing_left_takes_no_time() {
        close(RunEstimate::new([], 1).remaining(7.0), 0.0);
    }
}
