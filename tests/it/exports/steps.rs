//! The residual of a log-brightness step along a consumer's rays.

use super::plane::{self, THRESHOLD};
use glam::{DQuat, DVec3};
use std::collections::BTreeMap;

/// Poses of a consumer, interpolated as most of them do: straight lines and slerps.
pub(super) struct Path {
    /// Times, in the consumer's unit.
    pub(super) times: Vec<f64>,
    pub(super) centres: Vec<DVec3>,
    pub(super) turns: Vec<DQuat>,
}

impl Path {
    pub(super) fn at(&self, t: f64) -> (DVec3, DQuat) {
        let k = self.times.partition_point(|time| *time <= t).clamp(1, self.times.len() - 1);
        let share = (t - self.times[k - 1]) / (self.times[k] - self.times[k - 1]);
        // glam's slerp and lerp, which the program does not use.
        let turn = self.turns[k - 1].slerp(self.turns[k], share);
        (self.centres[k - 1].lerp(self.centres[k], share), turn)
    }
}

/// An event as a consumer reads it.
#[derive(Clone, Copy)]
pub(super) struct ReadEvent {
    pub(super) x: u16,
    pub(super) y: u16,
    pub(super) t: f64,
    pub(super) sign: f64,
}

/// RMS of the true change between two events of a pixel, less sign times threshold, in thresholds.
/// `ray` is the direction of a pixel in the camera's axes.
pub(super) fn residual(events: &[ReadEvent], path: &Path, ray: impl Fn(u16, u16) -> DVec3) -> f64 {
    let mut last: BTreeMap<(u16, u16), f64> = BTreeMap::new();
    let (mut squares, mut count) = (0.0, 0u32);
    for event in events {
        let (centre, turn) = path.at(event.t);
        let log = plane::log_brightness(centre, turn * ray(event.x, event.y));
        if let Some(before) = last.insert((event.y, event.x), log) {
            let off = (log - before) / THRESHOLD - event.sign;
            squares += off * off;
            count += 1;
        }
    }
    assert!(count > 10_000, "only {count} pairs");
    (squares / f64::from(count)).sqrt()
}
