//! Stamps of poses are those of the frame rate, or of the law that varies it, and events lie between the first and the last (numerics.md section 9,
//! pass 2, and section 4). Gate, exact.

use super::subject::{Bound, Judged};
use super::{Check, Finding, Subject};
use crate::speed::Meaning;
use crate::trajectory::report::Report;
use crate::trajectory::sample::stamps_us;

/// The pass.
#[derive(Debug, Clone, Copy)]
pub struct Stamps;

const NAME: &str = "stamps";

impl Check for Stamps {
    fn name(&self) -> &'static str {
        NAME
    }

    fn run(&self, subject: &Subject<'_>) -> Vec<Finding> {
        let mut findings = vec![poses(subject)];
        findings.extend(subject.tally.map(|tally| {
            let events = tally.events;
            let span = format!("0 to {} us", subject.trajectory.stamps_us.last().unwrap_or(&0));
            let because = format!("{} of {events} events lie outside {span}", tally.off_time);
            wrong(subject, "events", tally.off_time, because)
        }));
        findings
    }
}

fn poses(subject: &Subject<'_>) -> Finding {
    let stamps = &subject.trajectory.stamps_us;
    let poses = subject.trajectory.world_from_camera.len();
    let (wanted, formula) = asked(subject);
    let off_rate = wanted.iter().zip(stamps).filter(|(wanted, t)| wanted != t).count();
    let unsorted = stamps.windows(2).filter(|w| w[1] <= w[0]).count();
    let unpaired = poses.abs_diff(stamps.len());
    let because = format!(
        "of {} stamps for {poses} poses, {off_rate} are not {formula} and {unsorted} do not grow",
        stamps.len()
    );
    wrong(subject, "poses", (off_rate + unsorted + unpaired) as u64, because)
}

/// The stamps that were asked for, and in words.
fn asked(subject: &Subject<'_>) -> (Vec<i64>, &'static str) {
    match subject.speed {
        Some(Report { meaning: Meaning::FrameRate, u, .. }) => {
            (stamps_us(subject.rate, Meaning::FrameRate, u), "the rounded sums of 1 / (rate u)")
        }
        _ => {
            let count = subject.trajectory.stamps_us.len() as u64;
            ((0..count).map(|j| subject.rate.stamp_us(j)).collect(), "round(j / rate)")
        }
    }
}

fn wrong(subject: &Subject<'_>, part: &str, count: u64, because: String) -> Finding {
    let unit = if part == "poses" { "stamps" } else { "events" };
    let verdict = Bound::gate(0.0).at_most(count as f64);
    let (measured, limit) = (Some(count as f64), Some(0.0));
    subject.finding(NAME, part, Judged { verdict, measured, limit, unit, because })
}
