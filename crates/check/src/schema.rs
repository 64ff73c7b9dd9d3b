//! Events lie on the sensor and are in order. An exact gate.
//!
//! The reader rejects wrong types, lengths and index tables, and polarities other than 0 and 1: a
//! file with one of these cannot be read.

use super::subject::{Judgement, LimitSide};
use super::{Finding, TrajectorySubject, ValidationPass};

/// The pass.
#[derive(Debug, Clone, Copy)]
pub struct SchemaPass;

const NAME: &str = "schema";

impl ValidationPass for SchemaPass {
    fn name(&self) -> &'static str {
        NAME
    }

    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Vec<Finding> {
        let Some(tally) = subject.tally else {
            return vec![subject.not_run(NAME, "", "there are no events")];
        };
        let (events, size) = (tally.events, tally.size);
        let place = format!("{} of {events} events lie outside the {size} sensor", tally.off_sensor);
        let order = format!("{} of {events} events are out of order", tally.disordered);
        let wrong = |part, count: u64, because| {
            let (measured, limit) = (Some(count as f64), Some(0.0));
            let verdict = LimitSide::gate(0.0).at_most(count as f64);
            subject.finding(NAME, part, Judgement { verdict, measured, limit, unit: "events", because })
        };
        vec![wrong("place", tally.off_sensor, place), wrong("order", tally.disordered, order)]
    }
}
