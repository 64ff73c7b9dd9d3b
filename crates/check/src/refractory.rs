//! Events in a pixel's dead time. An exact gate.
//!
//! A sensor with a refractory period makes no event within it after another event of the same
//! pixel. Stamps in files are whole microseconds, rounded down, so two of them may be closer than
//! the period by less than one microsecond. The pass counts events closer than the period in whole
//! microseconds; a sound stream has none.

use super::subject::{Judgement, Statements};
use super::{TrajectorySubject, ValidationPass};

/// The pass.
pub(crate) struct DeadTime;

impl ValidationPass for DeadTime {
    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let tally = subject.events()?;
        let sensor = subject.sensor.ok_or("there are no events")?;
        let period_us = sensor.dead_us();
        if period_us == 0 {
            return Err("the sensor has no refractory period of a microsecond or more".into());
        }
        if sensor.readout().is_some() {
            return Err(
                "not applicable behind a readout of limited rate: events are stamped when they are read"
                    .into(),
            );
        }
        let because = format!(
            "{} of {} events come within the dead time of {period_us} us after another event of their pixel",
            tally.too_soon, tally.events
        );
        Ok(vec![("", Ok(Judgement::none_of(tally.too_soon as f64, "events", because)))])
    }
}
