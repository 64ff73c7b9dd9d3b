//! Events come from structure and not from anywhere. A warning; a gate where the recipe sets a
//! limit.
//!
//! In each of a hundred windows of the stream, `sum n (n - 1)` over cells of 4x4 pixels counts the
//! pairs of events that share a cell. For uniformly distributed events it is `N (N - 1) / cells`.
//! The measured value is the root of the ratio over all windows: the event structural ratio (Ding
//! et al., E-MLB, 2023) relative to that of a uniform stream. Dense texture comes close to 1, so
//! this is not a gate.

use super::subject::{Judgement, LimitSide, Statements};
use super::{TrajectorySubject, ValidationPass, limits};
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; absent ones have their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Smallest event structural ratio. Default: `MIN_RATIO`.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
}

const MIN_RATIO: f64 = 1.03;

/// The pass.
pub(crate) struct StructurePass;

impl ValidationPass for StructurePass {
    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let tally = subject.events()?;
        let crowding = &tally.crowding;
        let (measured, noise) = (crowding.ratio(), crowding.noise());
        let limit =
            LimitSide::limit_or(subject.limits.structure.and_then(|l| l.min), LimitSide::warning(MIN_RATIO));
        // Five standard deviations of a stream without structure must lie below the limit.
        if noise.is_nan() || 5.0 * noise >= limit.value - 1.0 {
            return Err(format!("{} events are too few to tell structure from chance", tally.events));
        }
        let because = format!(
            "events cluster {measured:.3} times as strongly as randomly placed ones; 1 means pure noise"
        );
        Ok(vec![("", Ok(Judgement::at_least(measured, limit, "1", because)))])
    }
}

#[cfg(test)]
mod tests {
    use crate::Verdict;
    use crate::planted::{PlantedWorld, SplitMixDraws};
    use gs2e_event::Event;

    #[test]
    fn events_without_structure_are_found() {
        let mut world = PlantedWorld::default_world();
        let mut draws = SplitMixDraws(1);
        for event in &mut world.events {
            (event.x, event.y) = (draws.at(96), draws.at(72));
        }
        world.events.sort_by_cached_key(Event::file_order);
        assert_eq!(world.finding("structure").verdict, Verdict::Warn);
    }
}
