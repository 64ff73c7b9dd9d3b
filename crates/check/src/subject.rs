//! The input of passes over a trajectory, and the construction of findings.

mod judgement;

pub use judgement::{Judgement, JudgementResult};
pub(super) use judgement::{LimitSide, Statements, between_bounds, findings_of};

use super::coverage::ViewCoverage;
use super::depth_consistency::disparity::DisparityDifference;
use super::drift::DriftLaw;
use super::event_times::crossing::StreamClock;
use super::flash::blocks::FrameBlocks;
use super::geometry::{GeometryMeasures, Measurement};
use super::sampling::ResampledIntervals;
use super::{Limits, StreamTally};
use gs2e_num::units::Hertz;
use gs2e_sensor::{SensorChoice, SimulationAccount};
use gs2e_source::foreign::ExternalReport;
use gs2e_trajectory::Trajectory;
use gs2e_trajectory::flow::FlowQuantiles;
use gs2e_trajectory::report::SpeedReport;

/// The reason why a release tree may not allow a comparison with frames.
pub(super) const NO_FRAMES: &str =
    "there are fewer than two frames to compare with: the recipe asks for no sharp frames, or for too few";

/// One trajectory and its products. Values that were not requested or not kept are `None`; the
/// passes that need them say so.
#[derive(Debug, Clone, Copy)]
pub struct TrajectorySubject<'a> {
    /// `scene/trajectory`.
    pub name: &'a str,
    /// Frame rate.
    pub rate: Hertz,
    /// The poses and their stamps.
    pub trajectory: &'a Trajectory,
    /// The trajectory's own report.
    pub speed: Option<&'a SpeedReport>,
    /// The sensor, if there are events.
    pub sensor: Option<&'a SensorChoice>,
    /// The sensor's account of its run.
    pub account: Option<&'a SimulationAccount>,
    /// The counts of the event stream.
    pub tally: Option<&'a StreamTally>,
    /// Image motion between neighbouring frames of the sensor, px; in a release, between poses.
    pub flow: Option<FlowQuantiles>,
    /// Image motion from the first pose to the last, px: the median over pixels, summed over time.
    pub moved_px: Option<f64>,
    /// The stream with twice the frames, if that was simulated.
    pub resampled: Option<&'a ResampledIntervals>,
    /// The recipe's tolerance of the error between frames, thresholds, if it has one.
    pub tolerance: Option<f64>,
    /// The emptiest view, if depth maps were kept.
    pub coverage: Option<ViewCoverage>,
    /// The share of the image from Gaussians too deep for their distance.
    pub doubtful_share: Option<f64>,
    /// Number of views or key poses that the path follows, if known.
    pub views: Option<usize>,
    /// Released pictures compared by the poses, if they were read.
    pub geometry: Option<&'a GeometryMeasures>,
    /// Brightness of the blocks of the sharp frames, if they were read.
    pub blocks: Option<&'a [FrameBlocks]>,
    /// Disparity images compared with depth images, if the trajectory has some.
    pub disparities: Option<&'a Measurement<Vec<DisparityDifference>>>,
    /// Times of the events compared with those that the released frames predict, if they were
    /// read. An error is the reason why they cannot be compared.
    pub crossings: Option<&'a Result<StreamClock, String>>,
    /// Reports of other programs, if the recipe requests them.
    pub foreign: Option<&'a ExternalReport>,
    /// True if the light of the scene changes.
    pub light_changes: bool,
    /// True if things move on paths of their own, or the scene changes with time.
    pub moves_by_itself: bool,
    /// True if the files of a release are all that is known.
    pub is_release: bool,
    /// The recipe's limits.
    pub limits: &'a Limits,
}

impl<'a> TrajectorySubject<'a> {
    /// A trajectory without any other product.
    #[must_use]
    pub fn new(name: &'a str, rate: Hertz, trajectory: &'a Trajectory, limits: &'a Limits) -> Self {
        Self {
            name,
            rate,
            trajectory,
            speed: None,
            sensor: None,
            account: None,
            tally: None,
            flow: None,
            moved_px: None,
            resampled: None,
            tolerance: None,
            coverage: None,
            doubtful_share: None,
            views: None,
            geometry: None,
            blocks: None,
            disparities: None,
            crossings: None,
            foreign: None,
            light_changes: false,
            moves_by_itself: false,
            is_release: false,
            limits,
        }
    }

    /// Time from the first stamp to the last, seconds.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        let stamps = &self.trajectory.stamps_us;
        match (stamps.first(), stamps.last()) {
            (Some(first), Some(last)) => (last - first) as f64 * 1e-6,
            _ => 0.0,
        }
    }

    /// The counts of the event stream, or the reason for their absence.
    pub(super) fn events(&self) -> Result<&'a StreamTally, &'static str> {
        self.tally.ok_or("there are no events")
    }

    /// The law of the sensor's drift, or the reason for its absence.
    pub(super) fn drift_law(&self) -> Result<DriftLaw, &'static str> {
        self.sensor.map(DriftLaw::for_sensor).ok_or("there is no sensor")
    }

    /// The sensor of the pixels that are compared with frames: known hot pixels are not among them.
    pub(super) fn compared_sensor(&self) -> Option<SensorChoice> {
        let without = self.tally.is_some_and(|tally| tally.hot_left_out);
        self.sensor.map(|sensor| if without { sensor.without_hot_pixels() } else { sensor.clone() })
    }

    /// The law of the drift of these pixels, or the reason for its absence.
    pub(super) fn compared_law(&self) -> Result<DriftLaw, &'static str> {
        self.compared_sensor().as_ref().map(DriftLaw::for_sensor).ok_or("there is no sensor")
    }

    /// The stream's comparison with the frames, or the reason for its absence. Signs and places of
    /// events can be compared for every law, and exact numbers only for one that is not loose.
    pub(super) fn compared(&self) -> Result<&'a StreamTally, &'static str> {
        let tally = self.events()?;
        self.drift_law()?;
        match (tally.compared.fits.is_empty(), self.trajectory.stamps_us.len() < 2) {
            (false, _) => Ok(tally),
            (true, true) => Err("there is only one frame, so nothing changes"),
            (true, false) => Err(NO_FRAMES),
        }
    }

    /// As [`TrajectorySubject::compared`], for a law whose events follow the frames at once.
    pub(super) fn compared_at_once(&self) -> Result<(&'a StreamTally, DriftLaw), &'static str> {
        let (tally, law) = (self.compared()?, self.compared_law()?);
        match law.loose.filter(|_| law.delay_us > 0.0) {
            Some(because) => Err(because),
            None => Ok((tally, law)),
        }
    }

    /// Requires that pixels change one by one.
    pub(super) fn changes_one_by_one(&self) -> Result<(), &'static str> {
        let because = "the light of the scene changes, which moves all pixels alike";
        if self.light_changes { Err(because) } else { Ok(()) }
    }

    /// Requires that pixels change steadily.
    pub(super) fn changes_steadily(&self) -> Result<(), &'static str> {
        let because =
            "things move on paths of their own, and pixels that they pass may brighten and darken in turn";
        if self.moves_by_itself { Err(because) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Verdict;

    #[test]
    fn a_value_is_held_against_the_bound_it_violates_or_the_nearer() {
        let t = |measured, verdict, limit| {
            let found = between_bounds(measured, LimitSide::warning(1.0), LimitSide::gate(2.0));
            assert_eq!(found, (verdict, limit), "{measured}");
        };
        t(0.9, Verdict::Warn, 1.0);
        t(1.0, Verdict::Pass, 1.0);
        t(1.1, Verdict::Pass, 1.0);
        t(1.9, Verdict::Pass, 2.0);
        t(2.1, Verdict::Fail, 2.0);
    }

    #[test]
    fn what_is_not_a_number_is_outside() {
        assert_eq!(LimitSide::gate(1.0).at_most(f64::NAN), Verdict::Fail);
        assert_eq!(LimitSide::gate(1.0).at_least(f64::NAN), Verdict::Fail);
    }
}
