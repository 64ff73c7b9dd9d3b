//! Times of the events against those that the frames predict, and the grid of their stamps. A gate.
//!
//! - `offset`: delay of the events against the frames, from every event, see [`crossing`]. The limit
//!   is 4 us and five standard errors.
//! - `scale`: how much faster the clock of the events runs. The limit is 2e-4 and five standard
//!   errors.
//! - `grid`: the coarsest grid on which nearly all stamps lie, from the stamps alone. The limit is
//!   1 us, the unit of the files.
//!
//! Noise that returns biases both; the size of the expected bias is added to the limits, see [`crossing`].
//!
//! The stated power takes the truncation of residuals into account, and that the limit varies with its
//! standard error, see `DetectedSize`.
//!
//! Offset and scale need the frames between which the sensor interpolated, one per pose. A release
//! has them as `sharp/`. The allowances of 4 us and 2e-4 are far above the biases of sound streams,
//! which stay below 1 us and 1e-4, and far below what other passes see.

pub mod crossing;
pub mod grid;

use super::subject::{Judgement, JudgementResult, LimitSide, Statements};
use super::{TrajectorySubject, ValidationPass};
use crossing::{CrossingFit, ErrorBar, FAR_US, StreamClock};
use grid::StampGrid;

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
pub(crate) struct EventTimes;

/// The reason in a build, which keeps only some of the frames.
const NOT_KEPT: &str =
    "it needs the frame at every pose, which a build does not keep: `gs2e check --tree` reads sharp/";

impl ValidationPass for EventTimes {
    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let grid = judge_grid(subject.events()?.grid);
        let clock = || Ok::<_, String>(subject.crossings.ok_or(NOT_KEPT)?.as_ref()?);
        Ok(vec![
            ("offset", clock().and_then(|clock| judge_offset(subject, clock))),
            ("scale", clock().and_then(|clock| judge_scale(subject, clock))),
            ("grid", grid),
        ])
    }
}

fn judge_offset(subject: &TrajectorySubject<'_>, clock: &StreamClock) -> JudgementResult {
    let fit = &clock.found;
    let ErrorBar { value, deviation } = fit.offset_us;
    let limit = LimitSide::gate(OFFSET_US + fit.biases[0] + SURE * deviation);
    let step = 1e6 / subject.rate.to_f64();
    if limit.value.is_nan() || limit.value > UNSURE * step {
        return Err(format!(
            "the offset can be measured only to {deviation:.0} us, from {} events",
            fit.events
        ));
    }
    let detects = smallest_offset(clock, clock.reach * step);
    let seen = detects.map_or_else(
        || "the smallest that would be seen is not known".to_owned(),
        |size| format!("an offset above {size:.1} us would be seen"),
    );
    let side = if value < 0.0 { "earlier" } else { "later" };
    let because = format!(
        "events happen {:.2} us {side} than the frames predict (standard error {deviation:.2} us, {} events); {seen}",
        value.abs(),
        fit.events
    );
    let judged = Judgement::new(limit.at_most(value.abs()), value, limit.value, "us", because);
    Ok(judged.detecting(detects.unwrap_or(f64::INFINITY), "us"))
}

fn judge_scale(subject: &TrajectorySubject<'_>, clock: &StreamClock) -> JudgementResult {
    let fit = &clock.found;
    let ErrorBar { value, deviation } = fit.scale;
    let limit = LimitSide::gate(SCALE + fit.biases[1] + SURE * deviation);
    if limit.value.is_nan() || limit.value > UNSURE_SCALE {
        return Err(format!(
            "the time scale can be measured only to {deviation:.4}, from {} events",
            fit.events
        ));
    }
    let step = 1e6 / subject.rate.to_f64();
    let detects = smallest_scale(clock, clock.reach * step);
    let seen = detects.map_or_else(
        || "the smallest that would be seen is not known".to_owned(),
        |size| format!("a scale beyond 1 +- {size:.4} would be seen"),
    );
    let because = format!(
        "the times of the events are {:.5} times those that the frames predict (standard error {deviation:.5}); {seen}",
        1.0 + value
    );
    // The limit is on the difference from 1; the finding shows the scale.
    let shown = 1.0 + limit.value.copysign(value);
    let judged = Judgement::new(limit.at_most(value.abs()), 1.0 + value, shown, "1", because);
    Ok(judged.detecting(detects.unwrap_or(f64::INFINITY), "1"))
}

/// The smallest offset that is found in 95 % of trials, us; `None` if it is not known. The response is that
/// to small faults: events that are off by more than `most` meet the rates of other intervals, and show less.
fn smallest_offset(clock: &StreamClock, most: f64) -> Option<f64> {
    let near = FaultPower::of_offset(&clock.found, OFFSET_US).smallest_fault();
    let far = clock.far.and_then(|fit| FaultPower::of_offset(&fit, FAR_US).smallest_fault());
    near.into_iter().chain(far).filter(|size| *size <= most).min_by(f64::total_cmp)
}

/// The smallest difference of the scale from 1 that is found in 95 % of trials, of a clock that starts with
/// the clip; `None` if it is not known. No event may be off by more than `most` us, as in
/// [`smallest_offset`].
fn smallest_scale(clock: &StreamClock, most: f64) -> Option<f64> {
    let near = FaultPower::of_scale(&clock.found).smallest_fault();
    let far = clock.far.and_then(|fit| FaultPower::of_scale(&fit).smallest_fault());
    // The middle of the clip is off by half as much as its end. If that is more than `FAR_US`, the far
    // fit may be the one that is judged.
    let found = match near {
        Some(near) if near * clock.half_us < FAR_US || clock.far.is_none() => Some(near),
        Some(near) => far.map(|far| far.max(near)),
        None => {
            let shown = clock.far.and_then(|fit| FaultPower::of_offset(&fit, FAR_US).smallest_fault());
            far.zip(shown).map(|(far, shown)| far.max(shown / clock.half_us))
        }
    };
    found.filter(|size| 2.0 * clock.half_us * size <= most)
}

/// The quantities on which the size of the smallest found fault depends.
#[derive(Debug, Clone, Copy)]
struct FaultPower {
    /// The part of the limit that no standard error adds to.
    allowed: f64,
    found: ErrorBar,
    /// Share of the fault that the estimate shows.
    response: ErrorBar,
    /// Degrees of freedom of the standard errors.
    freedom: f64,
}

impl FaultPower {
    fn of_offset(fit: &CrossingFit, allowed: f64) -> Self {
        let CrossingFit { offset_us, responses, freedom, biases, .. } = fit;
        let allowed = allowed + biases[0];
        Self { allowed, found: *offset_us, response: responses[0], freedom: freedom[0] }
    }

    fn of_scale(fit: &CrossingFit) -> Self {
        let CrossingFit { scale, responses, freedom, biases, .. } = fit;
        Self { allowed: SCALE + biases[1], found: *scale, response: responses[1], freedom: freedom[1] }
    }

    /// The smallest fault that exceeds the limit in 95 % of trials; `None` if no size does.
    ///
    /// A fault of size `d` is shown as `g d`, `g` the response with its standard error `s`, and the present
    /// value may work against it. Parts of the picture respond differently, so that the standard error of
    /// the estimate grows from `e` to `hypot(e, s d)`, and the limit with it. In another trial, it is up to
    /// `r` times as large, see [`excess_of_errors`]. Hence
    /// `g d = allowed + |value| + (SURE + POWER) r hypot(e, s d)`, a quadratic equation for `d`. The sum of
    /// the 95 % quantiles of the limit and of the noise is above that of their sum.
    fn smallest_fault(&self) -> Option<f64> {
        let Self { allowed, found, response: ErrorBar { value: g, deviation: s }, freedom } = *self;
        // A value beyond its limit fails already, so it counts for no more than the limit.
        let least = allowed + found.value.abs().min(allowed + SURE * found.deviation);
        let sure = (SURE + POWER) * excess_of_errors(freedom);
        let square = g * g - sure * s * sure * s;
        // Otherwise the limit grows faster than the fault.
        if g.is_nan() || g <= 0.0 || square.is_nan() || square <= 0.0 {
            return None;
        }
        let rest = sure * found.deviation * sure * found.deviation - least * least;
        let root = (g * least * g * least + square * rest).max(0.0).sqrt();
        Some((g * least + root) / square)
    }
}

/// The factor by which a standard error exceeds another of the same distribution in 5 % of trials.
///
/// The square of the factor is the 95 % quantile of the F distribution with `freedom` degrees of freedom
/// twice. Half of the logarithm of F is close to normal, with a variance of `1 / (freedom - 1)`
/// (Fisher, Proc. Int. Math. Congress, Toronto, 1924). The factor is within 2 % from 5 degrees of freedom
/// on, and too large by 5 % at 3 and by a fifth at 2. It is infinite at 1.
fn excess_of_errors(freedom: f64) -> f64 {
    libm::exp(POWER / (freedom - 1.0).max(0.0).sqrt())
}

fn judge_grid(grid: StampGrid) -> JudgementResult {
    if grid.stamps < MIN_STAMPS {
        return Err(format!("fewer than {MIN_STAMPS} distinct times"));
    }
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
    Ok(Judgement::at_most(measured, limit, "us", because).detecting(2.0, "us"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planted::SplitMixDraws;

    fn power(value: f64, deviation: f64, [g, s]: [f64; 2], freedom: f64) -> FaultPower {
        let bar = |value, deviation| ErrorBar { value, deviation };
        FaultPower { allowed: 4.0, found: bar(value, deviation), response: bar(g, s), freedom }
    }

    #[test]
    fn the_smallest_fault_just_exceeds_its_limit() {
        for (value, deviation, response) in [
            (0.0, 1.0, [1.0, 0.0]),
            (2.0, 0.5, [0.8, 0.05]),
            (-1.0, 3.0, [0.6, 0.02]),
            (0.3, 0.0, [0.9, 0.0]),
        ] {
            let [g, s] = response;
            // Without uncertainty of the standard error.
            let d = power(value, deviation, response, f64::INFINITY).smallest_fault().unwrap();
            let under_fault = deviation.hypot(s * d);
            // The lower end of 95 % of estimates is at the limit.
            let lowest = g * d - f64::abs(value) - POWER * under_fault;
            assert!((lowest - 4.0 - SURE * under_fault).abs() < 1e-9, "{value} {deviation} {g} {s}: {d}");
        }
    }

    #[test]
    fn an_estimate_that_hides_faults_states_none() {
        for response in [[0.5, 0.1], [-0.1, 0.0], [0.0, 0.0], [f64::NAN, 0.0]] {
            assert_eq!(power(0.0, 1.0, response, 60.0).smallest_fault(), None, "{response:?}");
        }
        // A single block of the picture.
        assert_eq!(power(0.0, 1.0, [1.0, 0.0], 1.0).smallest_fault(), None);
    }

    #[test]
    fn the_excess_of_errors_is_that_of_tables() {
        // 95 % quantiles of the F distribution with equal degrees of freedom.
        for (freedom, quantile, within) in [
            (3.0, 9.277, 0.06),
            (5.0, 5.050, 0.02),
            (10.0, 2.978, 0.005),
            (30.0, 1.841, 0.002),
            (60.0, 1.534, 0.001),
        ] {
            let excess = excess_of_errors(freedom);
            assert!((excess / f64::sqrt(quantile) - 1.0).abs() < within, "{freedom}: {excess}");
        }
    }

    /// Trials by random numbers: estimates and limits of normal errors in blocks of unequal shares.
    #[test]
    fn faults_of_the_stated_size_are_found_in_95_percent_of_trials() {
        let mut draws = SplitMixDraws(5);
        // The sum of twelve even numbers has a variance of 1, and a mean of 6.
        let mut normal =
            || (0..12).map(|_| draws.below(1 << 20) as f64 / f64::from(1 << 20)).sum::<f64>() - 6.0;
        for shares in [vec![1.0; 40], vec![20.0, 8.0, 8.0, 4.0, 1.0, 1.0, 1.0, 1.0], vec![9.0, 3.0, 3.0, 3.0]]
        {
            let total: f64 = shares.iter().sum();
            let freedom = 1.0 / shares.iter().map(|share| share / total * (share / total)).sum::<f64>();
            // The estimate is the sum of the blocks' errors, of variances in proportion to their shares, and
            // its standard error the root of the sum of their squares.
            let mut trial = || {
                let errors: Vec<f64> =
                    shares.iter().map(|share| normal() * f64::sqrt(share / total)).collect();
                let squares: f64 = errors.iter().map(|error| error * error).sum();
                ErrorBar { value: errors.iter().sum(), deviation: squares.sqrt() }
            };
            let found = (0..2000).filter(|_| {
                let before = trial();
                let d = power(before.value, before.deviation, [1.0, 0.0], freedom).smallest_fault().unwrap();
                let after = trial();
                d + after.value > 4.0 + SURE * after.deviation
            });
            let found = found.count();
            println!("{found} of 2000 with {freedom:.1} degrees of freedom");
            // 1900, less five standard deviations of a binomial number.
            assert!(found > 1851, "{found} of 2000 with {freedom:.1} degrees of freedom");
        }
    }
}
