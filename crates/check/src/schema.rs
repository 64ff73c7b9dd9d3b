//! Events lie on the sensor and are in order. An exact gate.
//!
//! The reader rejects wrong types, lengths and index tables, and polarities other than 0 and 1: a
//! file with one of these cannot be read.

use super::subject::{Judgement, Statements};
use super::{TrajectorySubject, ValidationPass};

/// The pass.
pub(crate) struct SchemaPass;

impl ValidationPass for SchemaPass {
    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let tally = subject.events()?;
        let (events, size) = (tally.events, tally.size);
        let place = format!("{} of {events} events lie outside the {size} sensor", tally.off_sensor);
        let order = format!("{} of {events} events are out of order", tally.disordered);
        let wrong = |count: u64, because| Ok(Judgement::none_of(count as f64, "events", because));
        Ok(vec![("place", wrong(tally.off_sensor, place)), ("order", wrong(tally.disordered, order))])
    }
}

#[cfg(test)]
mod tests {
    use crate::planted::check;

    #[test]
    fn disorder_and_strange_pixels_are_found() {
        check(|w| w.events.swap(10, 5000), &["schema#order"]);
        check(|w| w.events[7].x = 96, &["schema#place"]);
    }
}
