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

#[cfg(test)]
mod tests {
    use crate::Verdict;
    use crate::planted::PlantedWorld;

    #[test]
    fn events_in_the_dead_time_are_found() {
        use gs2e_sensor::SensorChoice;
        use gs2e_sensor::esim::EsimModel;
        let mut world = PlantedWorld::default_world();
        let mut last = std::collections::BTreeMap::new();
        let mut gap_us = i64::MAX;
        for event in &world.events {
            let t_us = event.t.floor_micros();
            if let Some(before) = last.insert((event.x, event.y), t_us) {
                gap_us = gap_us.min(t_us - before);
            }
        }
        let mut verdict = |period_us: i64| {
            let mut sensor = EsimModel::default();
            sensor.settings.refractory.period_us = period_us as f64;
            world.stated = Some(SensorChoice::Esim(sensor));
            world.finding("refractory").verdict
        };
        assert_eq!([verdict(gap_us), verdict(gap_us + 1)], [Verdict::Pass, Verdict::Fail]);
        assert_eq!(verdict(0), Verdict::NotRun);
    }
}
