//! Events in a pixel's dead time. An exact gate.
//!
//! A sensor with a refractory period makes no event within it after another event of the same
//! pixel. Stamps in files are whole microseconds, rounded down, so two of them may be closer than
//! the period by less than one microsecond. The pass counts events closer than the period in whole
//! microseconds; a sound stream has none.

use super::subject::{Judgement, LimitSide};
use super::{Finding, TrajectorySubject, ValidationPass};

/// The pass.
#[derive(Debug, Clone, Copy)]
pub struct DeadTime;

const NAME: &str = "refractory";

impl ValidationPass for DeadTime {
    fn name(&self) -> &'static str {
        NAME
    }

    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Vec<Finding> {
        let (Some(tally), Some(sensor)) = (subject.tally, subject.sensor) else {
            return vec![subject.not_run(NAME, "", "there are no events")];
        };
        let period_us = sensor.dead_us();
        if period_us == 0 {
            return vec![subject.not_run(
                NAME,
                "",
                "the sensor has no refractory period of a microsecond or more",
            )];
        }
        if sensor.readout().is_some() {
            let because =
                "not applicable behind a readout of limited rate: events are stamped when they are read";
            return vec![subject.not_run(NAME, "", because)];
        }
        let because = format!(
            "{} of {} events come within the dead time of {period_us} us after another event of their pixel",
            tally.too_soon, tally.events
        );
        let (limit, measured) = (LimitSide::gate(0.0), tally.too_soon as f64);
        vec![subject.finding(
            NAME,
            "",
            Judgement::from_value(limit.at_most(measured), measured, limit, "events", because),
        )]
    }
}
