//! Stamps of poses equal those of the frame rate, and events lie between the first and the last. An
//! exact gate.

use super::subject::{Judgement, Statements};
use super::{TrajectorySubject, ValidationPass};
use gs2e_trajectory::sample::stamps_us;
use gs2e_trajectory::speed::SpeedMeaning;

/// The pass.
pub(crate) struct StampsPass;

impl ValidationPass for StampsPass {
    fn of_trajectory(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        Ok(vec![("poses", Ok(judge_poses(subject)))])
    }

    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let Some(tally) = subject.tally else { return Ok(Vec::new()) };
        let events = tally.events;
        let span = format!("0 to {} us", subject.trajectory.stamps_us.last().unwrap_or(&0));
        let because = format!("{} of {events} events have times outside {span}", tally.off_time);
        Ok(vec![("events", Ok(judge_count(tally.off_time, "events", because)))])
    }
}

fn judge_poses(subject: &TrajectorySubject<'_>) -> Judgement {
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
    judge_count((off_rate + unsorted + unpaired) as u64, "stamps", because)
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

fn judge_count(count: u64, unit: &'static str, because: String) -> Judgement {
    Judgement::none_of(count as f64, unit, because).detecting(1.0, unit)
}

#[cfg(test)]
mod tests {
    use crate::planted::{PlantedWorld, check};
    use gs2e_num::units::Timestamp;

    #[test]
    fn shifted_time_is_found() {
        let shift = |w: &mut PlantedWorld| {
            for event in &mut w.events {
                event.t = Timestamp(event.t.0 + 1_000_000);
            }
        };
        let mut world = PlantedWorld::default_world();
        shift(&mut world);
        let faults = world.faults();
        assert!(faults.contains(&"stamps#events".to_owned()), "{faults:?}");
    }

    #[test]
    fn a_wrong_stamp_is_found() {
        check(|w| w.trajectory.stamps_us[20] += 1, &["stamps#poses"]);
    }
}
