//! Flow images against the flow of depth and poses. A gate.
//!
//! The flow of a static point follows from its depth and from the velocity of the camera, which is
//! the derivative of the poses. A release writes all three, so they agree to the rounding of 32
//! bits: 1e-6 of the flow, and as much of the parts that cancel in it. The limit is 0.1 %, for
//! programs that take the derivative in another way. The pass finds poses, depth or flow of another
//! scale, time, order or convention, and noise of single poses.
//!
//! `objects`: the flow of objects that move, see [`objects`].

pub mod objects;

use super::photometric::NO_PICTURES;
use super::subject::{Judgement, JudgementResult, LimitSide, Statements};
use super::{TrajectorySubject, ValidationPass};
use gs2e_image::Image;

/// Largest difference of a flow image, as a share of its median flow.
const SHARE: f64 = 1e-3;
/// Largest share of pixels where only one of both has a flow.
const MOST_UNPAIRED: f64 = 1e-3;
/// Share of the pixels that the difference of an image must not exceed, in percent.
const PERCENT: usize = 99;

/// The pass.
pub(crate) struct FlowProjection;

/// A flow image against the flow of depth and poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlowDifference {
    /// The pose.
    pub pose: usize,
    /// Median size of the expected flow, px/s.
    pub median_px_s: f64,
    /// The difference that 99 % of the pixels do not exceed, px/s.
    pub off_px_s: f64,
    /// Share of the pixels where only one of both has a value.
    pub unpaired: f64,
}

impl FlowDifference {
    /// Compares two images of one size. `None` if no pixel has a value in either.
    #[must_use]
    pub fn new(pose: usize, stated: &Image<[f32; 2]>, expected: &Image<[f32; 2]>) -> Option<Self> {
        let size = |[u, v]: [f64; 2]| (u * u + v * v).sqrt();
        let pairs = || stated.pixels().iter().zip(expected.pixels());
        let is_known = |flow: &[f32; 2]| flow.iter().all(|v| v.is_finite());
        let both = || pairs().filter(|(a, b)| is_known(a) && is_known(b));
        let sizes = both().map(|(_, b)| size(b.map(f64::from))).collect();
        let off = both().map(|(a, b)| size([0, 1].map(|i| f64::from(a[i]) - f64::from(b[i])))).collect();
        let unpaired = pairs().filter(|(a, b)| is_known(a) != is_known(b)).count();
        // An image without values says nothing of the flow, and yet lacks some.
        let of = |values| rank(values, 50).or((unpaired > 0).then_some(0.0));
        Some(Self {
            pose,
            median_px_s: of(sizes)?,
            off_px_s: rank(off, PERCENT).unwrap_or(0.0),
            unpaired: unpaired as f64 / stated.pixels().len().max(1) as f64,
        })
    }

    /// Difference as a share of the flow; a still image is compared with `typical_px` px/s.
    fn share(&self, typical_px: f64) -> f64 {
        // Without a difference, there is no share of a flow that may be 0.
        if self.off_px_s > 0.0 { self.off_px_s / self.median_px_s.max(typical_px) } else { 0.0 }
    }
}

/// The value that this percentage of all values does not exceed.
pub(super) fn rank(mut values: Vec<f64>, percent: usize) -> Option<f64> {
    let at = (values.len() * percent).div_ceil(100).checked_sub(1)?;
    Some(*values.select_nth_unstable_by(at, f64::total_cmp).1)
}

impl ValidationPass for FlowProjection {
    fn of_trajectory(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let mut statements = vec![("", judge_flows(subject))];
        statements.extend(objects::judge_objects(subject).map(|judged| ("objects", judged)));
        Ok(statements)
    }
}

fn judge_flows(subject: &TrajectorySubject<'_>) -> JudgementResult {
    const NONE: &str = "no flow image has a pixel with flow and depth";
    let flows = subject.geometry.map(|g| &g.flows).ok_or(NO_PICTURES)?.as_ref()?;
    // A camera that slows down to rest has images without flow, whose rounding is no fault.
    let typical_px = 0.01 * rank(flows.iter().map(|f| f.median_px_s).collect(), 50).ok_or(NONE)?;
    let fault = |f: &FlowDifference| (f.share(typical_px) / SHARE).max(f.unpaired / MOST_UNPAIRED);
    let worst = flows.iter().max_by(|a, b| fault(a).total_cmp(&fault(b))).ok_or(NONE)?;
    if typical_px <= 0.0 && fault(worst) <= 0.0 {
        return Err("the camera does not move".into());
    }
    let verdict = LimitSide::gate(SHARE).at_most(fault(worst) * SHARE);
    let because = format!(
        "at pose {}, 99 % of the pixels differ from the flow of depth and poses by at most {:.2e} of {:.1} px/s, and {:.2} % have only one of both: the worst of {} images",
        worst.pose,
        worst.share(typical_px),
        worst.median_px_s,
        100.0 * worst.unpaired,
        flows.len()
    );
    Ok(Judgement::new(verdict, worst.share(typical_px), SHARE, "1", because).detecting(SHARE, "1"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_image::Size;

    const SIZE: Size = Size { width: 20, height: 10 };

    #[test]
    fn differences_are_those_of_the_pixels_with_both() {
        let expected = Image::filled(SIZE, [3.0, 4.0]);
        let mut stated = expected.clone();
        stated.pixels_mut()[..3].fill([3.0, 4.5]);
        stated.pixels_mut()[7] = [f32::NAN; 2];
        let found = FlowDifference::new(5, &stated, &expected).unwrap();
        assert_eq!((found.pose, found.median_px_s, found.off_px_s), (5, 5.0, 0.5));
        assert!((found.unpaired - 1.0 / 200.0).abs() < 1e-12);
        // One pixel in a hundred may differ.
        stated.pixels_mut()[..3].copy_from_slice(&[[3.0, 4.5], [3.0, 4.0], [3.0, 4.0]]);
        assert!(FlowDifference::new(5, &stated, &expected).unwrap().off_px_s < 1e-12);
        let empty = Image::filled(SIZE, [f32::NAN; 2]);
        let found = FlowDifference::new(5, &empty, &expected).unwrap();
        assert_eq!((found.off_px_s, found.unpaired), (0.0, 1.0));
        assert_eq!(FlowDifference::new(5, &empty, &empty), None);
    }
}
