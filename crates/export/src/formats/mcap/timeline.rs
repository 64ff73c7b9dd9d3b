//! Everything but events, in the order of time.

use super::recording::Recording;
use crate::{ExportError, ExportFolder, ExportPlan};
use glam::DVec3;
use std::collections::VecDeque;

/// A message that is due.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct DueMessage {
    /// Time from the start of the interval, ns.
    pub(super) t_ns: i64,
    pub(super) kind: DueKind,
    /// Number of the pose, or of the inertial sample.
    pub(super) number: usize,
}

/// The kinds of messages. Those of one time are written in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum DueKind {
    Pose,
    Inertial,
    Sharp,
    Blurred,
    Depth,
}

/// The messages that are not written yet.
#[derive(Debug)]
pub(super) struct Timeline {
    due: VecDeque<DueMessage>,
}

impl Timeline {
    /// The messages of a plan, whose trajectory has these inertial samples.
    pub(super) fn new(plan: &ExportPlan<'_>, inertial: &[(i64, [DVec3; 2])]) -> Self {
        let [start_us, end_us] = plan.window_us();
        let stamps = &plan.subject.poses.stamps_us;
        let inside = |pose: &usize| (start_us..=end_us).contains(&stamps[*pose]);
        let at_pose =
            |kind| move |number: usize| DueMessage { t_ns: (stamps[number] - start_us) * 1000, kind, number };
        let count = stamps.len();
        let mut due: Vec<DueMessage> = (0..count).filter(inside).map(at_pose(DueKind::Pose)).collect();
        due.extend(plan.frames.iter().copied().map(at_pose(DueKind::Sharp)));
        due.extend(plan.subject.depth.iter().copied().filter(inside).map(at_pose(DueKind::Depth)));
        for exposure in &plan.subject.exposures {
            let [open, close] = exposure.open_us;
            if open >= start_us && close <= end_us {
                // The middle of two whole microseconds may be half a one.
                let t_ns = (open - start_us) * 1000 + (close - open) * 500;
                due.push(DueMessage { t_ns, kind: DueKind::Blurred, number: exposure.pose });
            }
        }
        for (number, (stamp_ns, _)) in inertial.iter().enumerate() {
            let t_ns = stamp_ns - start_us * 1000;
            if (0..=(end_us - start_us) * 1000).contains(&t_ns) {
                due.push(DueMessage { t_ns, kind: DueKind::Inertial, number });
            }
        }
        due.sort_unstable();
        Self { due: due.into() }
    }

    /// Returns true if a message of this kind is due.
    pub(super) fn has(&self, kind: DueKind) -> bool {
        self.due.iter().any(|message| message.kind == kind)
    }

    /// Writes the messages up to a time, us.
    ///
    /// # Errors
    /// A picture cannot be read, the recording cannot be written, or the export is to stop.
    pub(super) fn write_before(
        &mut self,
        t_us: i64,
        recording: &mut Recording<'_>,
        out: &mut ExportFolder<'_>,
    ) -> Result<(), ExportError> {
        while let Some(message) = self.due.pop_front_if(|message| message.t_ns <= t_us * 1000) {
            recording.due(message)?;
            if !matches!(message.kind, DueKind::Pose | DueKind::Inertial) {
                out.report()?;
            }
        }
        Ok(())
    }

    /// Writes the other messages.
    ///
    /// # Errors
    /// See [`write_before`](Self::write_before).
    pub(super) fn write_rest(
        &mut self,
        recording: &mut Recording<'_>,
        out: &mut ExportFolder<'_>,
    ) -> Result<(), ExportError> {
        self.write_before(super::END_US, recording, out)
    }
}
