//! The drift identity of the sensor's own account. An exact gate.
//!
//! During the simulation, the sensor compares each pixel's event balance with the drift of its
//! frames: `|A N_on - B N_off - (D(T) - D(0))| <= max(A, B) + 6 sigma sqrt(T)`. The account has the
//! number of pixels that violate it, and the largest difference relative to its bound. Sensors with
//! noise that decouples events from frames make no promise; the pass then reports that.

use super::drift::require_balance;
use super::subject::{Judgement, Statements};
use super::{TrajectorySubject, ValidationPass};

/// The pass.
pub(crate) struct DriftIdentity;

impl ValidationPass for DriftIdentity {
    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let account =
            subject.account.ok_or("the account of the simulation is not available: it stays in the store")?;
        let balance = subject.sensor.map_or(Ok(()), require_balance);
        let violations = balance.map(|()| judge_violations(account.drift_violations, account.drift_worst));
        let mut statements = vec![("pixels", violations.map_err(String::from))];
        statements.extend(subject.tally.map(|tally| {
            // By polarity, so that an event of the wrong polarity shows although the total agrees.
            let missing = account.on.abs_diff(tally.on) + account.off.abs_diff(tally.off());
            let (made, found) = (account.events, tally.events);
            let because = format!("the simulation made {made} events; the stream has {found}");
            ("events", Ok(Judgement::none_of(missing as f64, "events", because)))
        }));
        Ok(statements)
    }
}

fn judge_violations(pixels: u64, worst: f64) -> Judgement {
    let because = format!(
        "{pixels} pixels have events that contradict their brightness change; the worst reaches {worst:.3} of the allowed difference"
    );
    Judgement::none_of(pixels as f64, "pixels", because)
}

#[cfg(test)]
mod tests {
    use crate::planted::{PlantedWorld, check};

    #[test]
    fn a_dropped_chunk_is_found() {
        let drop = |w: &mut PlantedWorld| {
            let tenth = w.events.len() / 10;
            w.events.drain(3 * tenth..4 * tenth);
        };
        let mut world = PlantedWorld::default_world();
        drop(&mut world);
        let faults = world.faults();
        for wanted in ["event_frame#residual", "drift_identity#events"] {
            assert!(faults.contains(&wanted.to_owned()), "{faults:?}");
        }
    }

    #[test]
    fn an_account_of_broken_pixels_is_a_fault() {
        let breaks = |w: &mut PlantedWorld| {
            w.account.drift_violations = 1;
            w.account.drift_worst = 1.5;
        };
        check(breaks, &["drift_identity#pixels"]);
    }
}
