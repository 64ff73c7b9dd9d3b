//! Which of the ready steps comes first: the one with the longest chain of work behind it, then the plan's order.

use crate::plan::Plan;
use crate::plan::past::Past;
use crate::stage::StepId;
use std::cmp::Reverse;
use std::time::Duration;

/// A step's place in the order: the smallest comes first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Rank(Reverse<u64>, pub(super) StepId);

/// The rank of each step. A step of which nothing is known counts as nothing: the result depends on no rank.
pub(super) fn ranks(plan: &Plan, past: &[Option<Past>]) -> Vec<Rank> {
    // Milliseconds, so that ranks are compared exactly; what a damaged record may say is no reason to stop.
    let own = |step: usize| {
        let seconds = past[step].map_or(0.0, |past| past.core_seconds);
        Duration::try_from_secs_f64(seconds).map_or(0, |d| u64::try_from(d.as_millis()).unwrap_or(u64::MAX))
    };
    let mut chains: Vec<u64> = (0..plan.steps().len()).map(own).collect();
    // Inputs stand before those that need them, so backwards every follower is done.
    for (step, planned) in plan.steps().iter().enumerate().rev() {
        for (_, input) in planned.step.inputs() {
            chains[input.0] = chains[input.0].max(own(input.0).saturating_add(chains[step]));
        }
    }
    chains.into_iter().enumerate().map(|(step, chain)| Rank(Reverse(chain), StepId(step))).collect()
}
