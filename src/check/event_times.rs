//! Times of the events against those that the frames predict, and the grid of their stamps. A gate.
//!
//! - `offset`: delay of the events against the frames, from every event, see [`crossing`]. The limit
//!   is 4 us and five standard errors.
//! - `scale`: how much faster the clock of the events runs. The limit is 2e-4 and five standard
//!   errors.
//! - `grid`: the coarsest grid on which nearly all stamps lie, from the stamps alone. The limit is
//!   1 us, the unit of the files.
//!
//! The stated power takes the truncation of residuals into account, see `smallest_fault`.
//!
//! Offset and scale need the frames between which the sensor interpolated, one per pose. A release
//! has them as `sharp/`. The allowances of 4 us and 2e-4 are far above the biases of sound streams,
//! which stay below 1 us and 1e-4, and far below what other passes see.

pub mod crossing;
pub mod grid;

use super::subject::{Judgement, LimitSide};
use super::{Finding, TrajectorySubject, ValidationPass};
use crossing::{CrossingFit, ErrorBar};

/// Largest offset, in addition to five standard errors, us.
const OFFSET_US: f64 = 4.0;
/// Largest difference of the scale from 1, in addition to five standard errors.
const SCALE: f64 = 2e-4;
/// Number of standard errors that a fault must exceed.
const SURE: f64 = 5.0;
/// Standard errors between a fault's size and a limit that it exceeds in 95 % of trials.
const POWER: f64 = 1.645;
/// Largest limit of the offset, as a share of a step between poses: beyond it, the pass says
/// nothing that `time_offset` does not.
const UNSURE: f64 = 0.5;
/// Largest limit of the scale.
const UNSURE_SCALE: f64 = 0.05;
/// Minimum number of events for a grid.
const MIN_STAMPS: u64 = 100;

/// The pass.
#[derive(Debug, Clone, Copy)]
pub struct EventTimes;

const NAME: &str = "event_times";

/// The reason in a build, which keeps only some of the frames.
const NOT_KEPT: &str =
    "it needs the frame at every pose, which a build does not keep: `gs2e check --tree` reads sharp/";

impl ValidationPass for EventTimes {
    fn name(&self) -> &'static str {
        NAME
    }

    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Vec<Finding> {
        if subject.tally.is_none() {
            return vec![subject.not_run(NAME, "", "there are no events")];
        }
        let mut findings = match subject.crossings {
            None => not_run_both(subject, NOT_KEPT),
            Some(Err(because)) => not_run_both(subject, because),
            Some(Ok(fit)) => vec![judge_offset(subject, fit), judge_scale(subject, fit)],
        };
        findings.push(judge_grid(subject));
        findings
    }
}

fn not_run_both(subject: &TrajectorySubject<'_>, because: &str) -> Vec<Finding> {
    ["offset", "scale"].into_iter().map(|part| subject.not_run(NAME, part, because)).collect()
}

fn judge_offset(subject: &TrajectorySubject<'_>, fit: &CrossingFit) -> Finding {
    let ErrorBar { value, deviation } = fit.offset_us;
    let limit = LimitSide::gate(OFFSET_US + SURE * deviation);
    let step = 1e6 / subject.rate.to_f64();
    if limit.value.is_nan() || limit.value > UNSURE * step {
        let because =
            format!("the offset can be measured only to {deviation:.0} us, from {} events", fit.events);
        return subject.not_run(NAME, "offset", because);
    }
    let detects = smallest_fault(OFFSET_US, fit.offset_us, fit.responses[0]);
    let seen = detects.map_or_else(
        || "which would hide a larger one".to_owned(),
        |size| format!("an offset above {size:.1} us would be seen"),
    );
    let side = if value < 0.0 { "earlier" } else { "later" };
    let because = format!(
        "events happen {:.2} us {side} than the frames predict (standard error {deviation:.2} us, {} events); {seen}",
        value.abs(),
        fit.events
    );
    let judged = Judgement::from_value(limit.at_most(value.abs()), value, limit, "us", because);
    subject.finding(NAME, "offset", judged).detecting(detects.unwrap_or(f64::INFINITY), "us")
}

fn judge_scale(subject: &TrajectorySubject<'_>, fit: &CrossingFit) -> Finding {
    let ErrorBar { value, deviation } = fit.scale;
    let limit = LimitSide::gate(SCALE + SURE * deviation);
    if limit.value.is_nan() || limit.value > UNSURE_SCALE {
        let because =
            format!("the time scale can be measured only to {deviation:.4}, from {} events", fit.events);
        return subject.not_run(NAME, "scale", because);
    }
    let detects = smallest_fault(SCALE, fit.scale, fit.responses[1]);
    let seen = detects.map_or_else(
        || "which would hide another".to_owned(),
        |size| format!("a scale beyond 1 +- {size:.4} would be seen"),
    );
    let because = format!(
        "the times of the events are {:.5} times those that the frames predict (standard error {deviation:.5}); {seen}",
        1.0 + value
    );
    // The limit is on the difference from 1; the finding shows the scale.
    let shown = LimitSide { value: 1.0 + limit.value.copysign(value), ..limit };
    let judged = Judgement::from_value(limit.at_most(value.abs()), 1.0 + value, shown, "1", because);
    subject.finding(NAME, "scale", judged).detecting(detects.unwrap_or(f64::INFINITY), "1")
}

/// The smallest fault that exceeds the limit in 95 % of trials; `None` if no size does.
///
/// A fault of size `d` is shown as `g d`, `g` the response with its standard error `s`, and the present
/// value may work against it. Parts of the picture respond differently, so that the standard error of
/// the estimate grows from `e` to `hypot(e, s d)`, and the limit with it. Hence
/// `g d = allowed + |value| + (SURE + POWER) hypot(e, s d)`, a quadratic equation for `d`.
fn smallest_fault(allowed: f64, found: ErrorBar, response: ErrorBar) -> Option<f64> {
    let ErrorBar { value: g, deviation: s } = response;
    let least = allowed + found.value.abs().min(allowed + SURE * found.deviation);
    let sure = SURE + POWER;
    let square = g * g - sure * s * sure * s;
    // Otherwise the limit grows faster than the fault.
    if g.is_nan() || g <= 0.0 || square.is_nan() || square <= 0.0 {
        return None;
    }
    let rest = sure * found.deviation * sure * found.deviation - least * least;
    let root = (g * least * g * least + square * rest).max(0.0).sqrt();
    Some((g * least + root) / square)
}

fn judge_grid(subject: &TrajectorySubject<'_>) -> Finding {
    let Some(grid) = subject.tally.map(|tally| tally.grid).filter(|grid| grid.stamps >= MIN_STAMPS) else {
        let because = format!("fewer than {MIN_STAMPS} distinct times");
        return subject.not_run(NAME, "grid", because);
    };
    let limit = LimitSide::gate(1.0);
    let measured = grid.step_us as f64;
    let because = if grid.step_us > 1 {
        format!(
            "{:.1} % of {} distinct times lie on a grid of {} us; the files have a resolution of 1 us",
            100.0 * grid.share,
            grid.stamps,
            grid.step_us
        )
    } else {
        format!("{} distinct times lie on no grid that is coarser than 1 us", grid.stamps)
    };
    let judged = Judgement::from_value(limit.at_most(measured), measured, limit, "us", because);
    subject.finding(NAME, "grid", judged).detecting(2.0, "us")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_fault_just_exceeds_its_limit() {
        for (value, deviation, g, s) in
            [(0.0, 1.0, 1.0, 0.0), (2.0, 0.5, 0.8, 0.05), (-1.0, 3.0, 0.6, 0.02), (0.3, 0.0, 0.9, 0.0)]
        {
            let bar = |value, deviation| ErrorBar { value, deviation };
            let d = smallest_fault(4.0, bar(value, deviation), bar(g, s)).unwrap();
            let under_fault = deviation.hypot(s * d);
            // The lower end of 95 % of estimates is at the limit.
            let lowest = g * d - f64::abs(value) - POWER * under_fault;
            assert!((lowest - 4.0 - SURE * under_fault).abs() < 1e-9, "{value} {deviation} {g} {s}: {d}");
        }
    }

    #[test]
    fn an_estimate_that_hides_faults_states_none() {
        let bar = |value, deviation| ErrorBar { value, deviation };
        for response in [bar(0.5, 0.1), bar(-0.1, 0.0), bar(0.0, 0.0), bar(f64::NAN, 0.0)] {
            assert_eq!(smallest_fault(4.0, bar(0.0, 1.0), response), None, "{response:?}");
        }
    }
}
