//! Stamps of poses equal those of the frame rate, and events lie between the first and the last. An
//! exact gate.

use super::subject::{Judgement, LimitSide};
use super::{Finding, TrajectorySubject, ValidationPass};
use gs2e_trajectory::sample::stamps_us;
use gs2e_trajectory::speed::SpeedMeaning;

/// The pass.
#[derive(Debug, Clone, Copy)]
pub struct StampsPass;

const NAME: &str = "stamps";

impl ValidationPass for StampsPass {
    fn name(&self) -> &'static str {
        NAME
    }

    fn of_trajectory(&self, subject: &TrajectorySubject<'_>) -> Vec<Finding> {
        vec![judge_poses(subject)]
    }

    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Vec<Finding> {
        let Some(tally) = subject.tally else { return Vec::new() };
        let events = tally.events;
        let span = format!("0 to {} us", subject.trajectory.stamps_us.last().unwrap_or(&0));
        let because = format!("{} of {events} events have times outside {span}", tally.off_time);
        vec![wrong_count(subject, "events", tally.off_time, because)]
    }
}

fn judge_poses(subject: &TrajectorySubject<'_>) -> Finding {
    let stamps = &subject.trajectory.stamps_us;
    let poses = subject.trajectory.world_from_camera.len();
    let wanted = expected_stamps(subject);
    let off_rate = stamps.iter().enumerate().filter(|(j, t)| wanted.get(*j) != Some(t)).count();
    let unsorted = stamps.windows(2).filter(|w| w[1] <= w[0]).count();
    let unpaired = poses.abs_diff(stamps.len());
    let law = match subject.speed.map(|report| report.meaning) {
        Some(SpeedMeaning::FrameRate) => "those of the requested frame rates",
        _ => "round(j / rate)",
    };
    let because = format!(
        "of {} time stamps for {poses} poses, {off_rate} differ from {law} and {unsorted} do not increase",
        stamps.len()
    );
    wrong_count(subject, "poses", (off_rate + unsorted + unpaired) as u64, because)
}

/// The expected stamps: those of the frame rate, or those of the frame rates that the speed law
/// requests.
fn expected_stamps(subject: &TrajectorySubject<'_>) -> Vec<i64> {
    match subject.speed {
        Some(report) if report.meaning == SpeedMeaning::FrameRate => {
            stamps_us(subject.rate, report.meaning, &report.u)
        }
        _ => (0..subject.trajectory.stamps_us.len() as u64).map(|j| subject.rate.stamp_us(j)).collect(),
    }
}

fn wrong_count(subject: &TrajectorySubject<'_>, part: &str, count: u64, because: String) -> Finding {
    let unit = if part == "poses" { "stamps" } else { "events" };
    let verdict = LimitSide::gate(0.0).at_most(count as f64);
    let (measured, limit) = (Some(count as f64), Some(0.0));
    subject.finding(NAME, part, Judgement { verdict, measured, limit, unit, because }).detecting(1.0, unit)
}
