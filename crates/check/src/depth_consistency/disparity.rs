//! Disparity images against depth images and the pair of cameras.
//!
//! The disparity of a pixel is `-baseline * focal / z`, `z` its depth in the rectified camera. Both images
//! state it to the 6e-8 of 32 bits, and the limit of 1e-4 leaves room for other programs. The statement finds
//! another sign, scale, baseline, pose or unit, and images without values.

use crate::TrajectorySubject;
use crate::flow_projection::rank;
use crate::subject::{Judgement, JudgementResult, LimitSide};
use gs2e_image::Image;

/// Largest difference of a disparity, as a share of it.
const SHARE: f64 = 1e-4;
/// Largest share of pixels where only one of both has a value.
const MOST_UNPAIRED: f64 = 1e-3;
/// Share of the pixels that the difference of an image must not exceed, in percent.
const PERCENT: usize = 99;

/// A disparity image against the disparity of its depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DisparityDifference {
    /// The pose.
    pub pose: usize,
    /// The difference that 99 % of the pixels do not exceed, as a share of the disparity.
    pub off: f64,
    /// Share of the pixels where only one of both has a value.
    pub unpaired: f64,
}

impl DisparityDifference {
    /// Compares two images of one size.
    #[must_use]
    pub fn new(pose: usize, stated: &Image<f32>, expected: &Image<f32>) -> Self {
        let pairs = || stated.pixels().iter().zip(expected.pixels());
        let both = pairs().filter(|(a, b)| a.is_finite() && b.is_finite());
        let off = both.map(|(a, b)| (f64::from(*a) - f64::from(*b)).abs() / f64::from(*b).abs());
        let off = rank(off.collect(), PERCENT).unwrap_or(0.0);
        let unpaired = pairs().filter(|(a, b)| a.is_finite() != b.is_finite()).count();
        Self { pose, off, unpaired: unpaired as f64 / stated.pixels().len().max(1) as f64 }
    }

    /// The larger of both faults, in their limits.
    fn fault(&self) -> f64 {
        (self.off / SHARE).max(self.unpaired / MOST_UNPAIRED)
    }
}

/// The statement on the disparity images; `None` if the trajectory has none.
pub(super) fn judge_disparities(subject: &TrajectorySubject<'_>) -> Option<JudgementResult> {
    let differences = match subject.disparities? {
        Ok(differences) => differences,
        Err(because) => return Some(Err(because.clone())),
    };
    let worst = differences.iter().max_by(|a, b| a.fault().total_cmp(&b.fault()))?;
    let limit = LimitSide::gate(SHARE);
    let because = format!(
        "at pose {}, 99 % of the disparities differ from those of depth and baseline by at most {:.2e}, and {:.2} % of \
         the pixels have only one of both: the worst of {} images",
        worst.pose,
        worst.off,
        100.0 * worst.unpaired,
        differences.len()
    );
    let verdict = limit.at_most(worst.fault() * SHARE);
    Some(Ok(Judgement::new(verdict, worst.off, SHARE, "1", because).detecting(SHARE, "1")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_image::Size;

    const SIZE: Size = Size { width: 20, height: 10 };

    #[test]
    fn differences_are_shares_of_the_disparity() {
        let expected = Image::filled(SIZE, 4.0);
        let of = |change: &dyn Fn(&mut [f32])| {
            let mut stated = expected.clone();
            change(stated.pixels_mut());
            let DisparityDifference { off, unpaired, .. } = DisparityDifference::new(3, &stated, &expected);
            (off, unpaired)
        };
        assert_eq!(of(&|_| {}), (0.0, 0.0));
        assert_eq!(of(&|all| all.fill(5.0)), (0.25, 0.0));
        assert_eq!(of(&|all| all.fill(-4.0)), (2.0, 0.0));
        assert_eq!(of(&|all| all.fill(0.0)), (1.0, 0.0));
        // Two pixels in two hundred may differ.
        assert_eq!(of(&|all| all[..2].fill(9.0)), (0.0, 0.0));
        assert_eq!(of(&|all| all[..3].fill(9.0)), (1.25, 0.0));
        // An image without values has no difference, and is a fault all the same.
        assert_eq!(of(&|all| all.fill(f32::NAN)), (0.0, 1.0));
    }
}
