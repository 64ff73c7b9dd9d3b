//! The drift identity of the sensor's own account. An exact gate.
//!
//! During the simulation, the sensor compares each pixel's event balance with the drift of its
//! frames: `|A N_on - B N_off - (D(T) - D(0))| <= max(A, B) + 6 sigma sqrt(T)`. The account has the
//! number of pixels that violate it, and the largest difference relative to its bound. Sensors with
//! noise that decouples events from frames make no promise; the pass then reports that.

use super::drift::require_balance;
use super::subject::{Judgement, LimitSide};
use super::{Finding, TrajectorySubject, ValidationPass};

/// The pass.
#[derive(Debug, Clone, Copy)]
pub struct DriftIdentity;

const NAME: &str = "drift_identity";

impl ValidationPass for DriftIdentity {
    fn name(&self) -> &'static str {
        NAME
    }

    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Vec<Finding> {
        let Some(account) = subject.account else {
            return vec![subject.not_run(
                NAME,
                "",
                "the account of the simulation is not available: it stays in the store",
            )];
        };
        let balanced = match subject.sensor.map_or(Ok(()), require_balance) {
            Ok(()) => judge_violations(subject, account.drift_violations, account.drift_worst),
            Err(because) => subject.not_run(NAME, "pixels", because),
        };
        let mut findings = vec![balanced];
        findings.extend(subject.tally.map(|tally| {
            // By polarity, so that an event of the wrong polarity shows although the total agrees.
            let missing = account.on.abs_diff(tally.on) + account.off.abs_diff(tally.off());
            let (made, found) = (account.events, tally.events);
            count_finding(
                subject,
                "events",
                missing,
                format!("the simulation made {made} events; the stream has {found}"),
            )
        }));
        findings
    }
}

fn judge_violations(subject: &TrajectorySubject<'_>, pixels: u64, worst: f64) -> Finding {
    let because = format!(
        "{pixels} pixels have events that contradict their brightness change; the worst reaches {worst:.3} of the allowed difference"
    );
    count_finding(subject, "pixels", pixels, because)
}

fn count_finding(
    subject: &TrajectorySubject<'_>,
    part: &'static str,
    count: u64,
    because: String,
) -> Finding {
    let verdict = LimitSide::gate(0.0).at_most(count as f64);
    let (measured, limit) = (Some(count as f64), Some(0.0));
    subject.finding(NAME, part, Judgement { verdict, measured, limit, unit: part, because })
}
