//! The typical value of a change along a path.
//!
//! A change is typical if it is as large as the median of those before it, or as that of those after it:
//! a motion that begins, or an edge that enters the picture, stays for more than some steps, and a flash
//! does not. Where the camera is faster than on that side, the median grows with its speed.

use gs2e_num::stats::mean_median;

/// Number of values on one side of a change.
const SIDE: usize = 16;
/// Smallest number of values with a typical one.
const LEAST: usize = 8;
/// Number of steps on each side that may belong to the same flash.
const APART: usize = 3;

/// Changes along a path, and the motion of the camera in the same intervals.
#[derive(Debug, Clone)]
pub struct ChangeCourse {
    /// Changes.
    pub changes: Vec<f64>,
    /// Lengths of the path.
    pub motions: Vec<f64>,
}

/// A change next to its typical value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AtypicalChange {
    /// The change.
    pub change: f64,
    /// Its typical value.
    pub typical: f64,
    /// Their quotient.
    pub ratio: f64,
}

impl ChangeCourse {
    /// The change with the largest ratio, and its index. `stride` is the number of steps in an interval;
    /// typical values are `least` or more. `None` if no change has enough others around it.
    #[must_use]
    pub(crate) fn most_atypical(&self, stride: usize, least: f64) -> Option<(usize, AtypicalChange)> {
        let judged = (0..self.changes.len()).filter_map(|at| {
            let (change, typical) = (self.changes[at], self.typical(at, stride)?.max(least));
            Some((at, AtypicalChange { change, typical, ratio: change / typical }))
        });
        judged.max_by(|(_, a), (_, b)| a.ratio.total_cmp(&b.ratio))
    }

    /// The larger of the typical values before and after.
    fn typical(&self, at: usize, stride: usize) -> Option<f64> {
        let apart = |k: usize| (APART + k) * stride;
        let before = (0..SIDE).map_while(|k| at.checked_sub(apart(k))).collect::<Vec<_>>();
        let after = (0..SIDE).map(|k| at + apart(k)).take_while(|other| *other < self.changes.len());
        let sides = [before, after.collect()];
        sides.iter().filter_map(|side| self.typical_change(at, side)).reduce(f64::max)
    }

    /// The median of some changes, at the speed of another one.
    fn typical_change(&self, at: usize, side: &[usize]) -> Option<f64> {
        let median = |of: &[f64]| mean_median(side.iter().map(|other| of[*other]).collect());
        let (change, motion) = (median(&self.changes)?, median(&self.motions)?);
        let typical = match self.motions[at] {
            moved if moved <= motion => change,
            moved if motion > 0.0 => change * moved / motion,
            // A camera that rests says nothing about one that moves.
            _ => f64::INFINITY,
        };
        (side.len() >= LEAST).then_some(typical)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn worst(changes: impl Fn(usize) -> f64, motions: impl Fn(usize) -> f64) -> (usize, f64) {
        let course = ChangeCourse {
            changes: (0..100).map(changes).collect(),
            motions: (0..100).map(motions).collect(),
        };
        let (at, AtypicalChange { ratio, .. }) = course.most_atypical(1, 1.0).unwrap();
        (at, ratio)
    }

    fn is(ratio: f64, wanted: f64) {
        // Quotients of small whole numbers, to their last bit.
        assert!((ratio - wanted).abs() < 1e-12, "{ratio} is not {wanted}");
    }

    #[test]
    fn a_short_change_is_unusual_and_one_that_stays_is_not() {
        assert_eq!(worst(|i| if i == 40 { 30.0 } else { 3.0 }, |_| 1.0), (40, 10.0));
        is(worst(|i| if (40..44).contains(&i) { 30.0 } else { 3.0 }, |_| 1.0).1, 10.0);
        is(worst(|i| if i >= 40 { 30.0 } else { 3.0 }, |_| 1.0).1, 1.0);
        // At the ends, one side is known.
        assert_eq!(worst(|i| if i == 0 { 30.0 } else { 3.0 }, |_| 1.0), (0, 10.0));
    }

    #[test]
    fn a_faster_camera_changes_more() {
        let jolt = |i: usize| if i == 40 { 10.0 } else { 1.0 };
        is(worst(|i| 3.0 * jolt(i), jolt).1, 1.0);
        // A slower one does not change less: noise stays.
        is(worst(|_| 3.0, |i| 1.0 / jolt(i)).1, 1.0);
        // From rest, any change is explained.
        is(worst(|i| 3.0 * jolt(i), |i| jolt(i) - 1.0).1, 1.0);
    }

    #[test]
    fn too_few_changes_have_no_usual_one() {
        let course = ChangeCourse { changes: vec![1.0; 10], motions: vec![1.0; 10] };
        assert_eq!(course.most_atypical(1, 1.0), None);
    }
}
