//! The order of ready steps: the longest chain of later work first, then the order of the plan.

use crate::plan::Plan;
use crate::plan::past::PastCosts;
use crate::stage::StepId;
use std::cmp::Reverse;
use std::time::Duration;

/// Position of a step in the order. The smallest one comes first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct StepRank(Reverse<u64>, pub(super) StepId);

/// The rank of each step. A step without a known duration counts as zero. Results do not depend on
/// ranks.
pub(super) fn step_ranks(plan: &Plan, past: &[Option<PastCosts>]) -> Vec<StepRank> {
    // Milliseconds, so that ranks compare exactly. Invalid durations in a damaged record are
    // ignored.
    let own = |step: usize| {
        let seconds = past[step].map_or(0.0, |past| past.core_seconds);
        Duration::try_from_secs_f64(seconds).map_or(0, |d| u64::try_from(d.as_millis()).unwrap_or(u64::MAX))
    };
    let mut chains: Vec<u64> = (0..plan.steps().len()).map(own).collect();
    // Inputs precede their consumers, so in reverse order every consumer is done.
    for (step, planned) in plan.steps().iter().enumerate().rev() {
        for (_, input) in planned.step.inputs() {
            chains[input.0] = chains[input.0].max(own(input.0).saturating_add(chains[step]));
        }
    }
    chains.into_iter().enumerate().map(|(step, chain)| StepRank(Reverse(chain), StepId(step))).collect()
}
