//! Frames against frames, by depth and poses. A gate.
//!
//! A frame is warped into another by its depth and the relative pose, and the motion that is left
//! between both is measured, see [`align`]. With the right geometry it is a few percent of the
//! motion between the frames: depth at soft edges is a mixture, and colours depend on the view.
//!
//! - `motion`: the median over pairs about a pixel apart. The limit is a tenth of the motion, three
//!   standard errors and 0.01 px. It finds poses, depths or axes of another convention or scale, and
//!   another order.
//! - `frames`: the worst pair of neighbours. The limit is a quarter of the motion, three standard
//!   errors and 0.02 px. It finds single frames and poses in another place.
//! - `order`: the order of the frames, which needs no depth, see [`order`].
//!
//! The standard error of a pair is that of a jackknife over 16 blocks of the picture. In small
//! pictures of few Gaussians it is as large as the motion; the limit and the stated power follow it.

pub mod align;
pub mod order;

use super::geometry::{AlignedPairs, Measurement};
use super::subject::{Judgement, JudgementResult, LimitSide, Statements};
use super::{TrajectorySubject, ValidationPass};
use align::PairAlignment;
use gs2e_num::stats::mean_median;

/// Largest motion that may be left, as a share of the motion.
pub(super) const SHARE: f64 = 0.1;
/// Limit for a single pair of neighbours.
const NEIGHBOUR_SHARE: f64 = 0.25;
/// Motion below which nothing is judged, px: rounding of colours to 8 bits leaves about as much
/// between two frames.
const FLOOR_PX: f64 = 0.01;
/// Limit for a single pair of neighbours: the worst of many counts.
const NEIGHBOUR_FLOOR_PX: f64 = 0.02;
/// Smallest motion of pairs apart that says something, px.
const MIN_MOTION_PX: f64 = 0.05;
/// Number of standard errors in a limit.
const SURE: f64 = 3.0;
/// Standard errors between a fault's size and a limit that it exceeds in 95 % of trials.
const POWER: f64 = 1.645;

/// The pass.
pub(crate) struct PhotometricPass;

impl ValidationPass for PhotometricPass {
    fn of_trajectory(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let shares = PairShares { apart: SHARE, neighbours: NEIGHBOUR_SHARE };
        let mut statements = judge_pairs(subject.geometry.map(|g| &g.pictures), shares, "pictures");
        statements.extend(subject.geometry.map(|g| ("order", order::judge_order(subject, &g.order))));
        Ok(statements)
    }
}

/// Shares of the motion that may be left.
#[derive(Clone, Copy)]
pub(super) struct PairShares {
    pub(super) apart: f64,
    pub(super) neighbours: f64,
}

impl PairShares {
    /// Largest motion that may be left between the pictures of a pair apart, px.
    fn limit_px(self, pair: &PairAlignment) -> f64 {
        self.apart * pair.motion_px + SURE * pair.deviation_px + FLOOR_PX
    }
}

/// Returns true if the typical pair is left with more than the pass allows.
#[must_use]
pub fn disagrees(pairs: &[PairAlignment], share: f64) -> bool {
    typical(pairs)
        .is_some_and(|pair| pair.left_px > PairShares { apart: share, neighbours: share }.limit_px(&pair))
}

/// The share that the pass over frames allows for pairs apart.
pub(crate) const FRAME_SHARE: f64 = SHARE;

/// The statements on the pairs of one kind of picture.
pub(super) fn judge_pairs(
    measured: Option<&Measurement<AlignedPairs>>,
    shares: PairShares,
    what: &str,
) -> Statements {
    match measured {
        None => vec![("", Err(NO_PICTURES.to_owned()))],
        Some(Err(because)) => vec![("", Err(because.clone()))],
        Some(Ok(pairs)) => {
            vec![("motion", judge_motion(pairs, shares, what)), ("frames", judge_frames(pairs, shares, what))]
        }
    }
}

/// The reason why a build does not compare pictures.
pub(super) const NO_PICTURES: &str = "it needs the released pictures: `gs2e check --tree` reads them";

fn judge_motion(pairs: &AlignedPairs, shares: PairShares, what: &str) -> JudgementResult {
    let Some(pair) = typical(&pairs.apart) else {
        return Err(format!("no two {what} share enough of the scene"));
    };
    let PairAlignment { left_px, motion_px, deviation_px, poses: [from, to], .. } = pair;
    let limit = LimitSide::gate(shares.limit_px(&pair));
    if left_px <= limit.value && motion_px < MIN_MOTION_PX {
        return Err(format!("the picture moves by {motion_px:.3} px over {} poses, too little", to - from));
    }
    // Both may point in opposite directions.
    let detects = limit.value + left_px.min(limit.value) + POWER * deviation_px;
    let hint = pairs.agrees_with.as_ref().map_or_else(String::new, |of| format!("; they agree with {of}"));
    let because = format!(
        "{what} {} poses apart move by {motion_px:.2} px by depth and poses, and by {left_px:.3} px otherwise (median of {} pairs, standard error {deviation_px:.3} px){hint}",
        to - from,
        pairs.apart.len()
    );
    Ok(Judgement::at_most(left_px, limit, "px", because).detecting(detects, "px"))
}

fn judge_frames(pairs: &AlignedPairs, shares: PairShares, what: &str) -> JudgementResult {
    let Some(usual) = typical(&pairs.neighbours) else {
        return Err(format!("no two neighbouring {what} share enough of the scene"));
    };
    let limit_px = |pair: &PairAlignment| {
        // Where the camera rests for a moment, its usual motion counts.
        shares.neighbours * pair.motion_px.max(usual.motion_px)
            + SURE * pair.deviation_px
            + NEIGHBOUR_FLOOR_PX
    };
    let excess = |pair: &PairAlignment| pair.left_px / limit_px(pair);
    let worst = pairs.neighbours.iter().max_by(|a, b| excess(a).total_cmp(&excess(b)));
    let worst = worst.expect("a typical pair is one of them");
    let limit = LimitSide::gate(limit_px(worst));
    let detects = limit_px(&usual) + usual.left_px + POWER * usual.deviation_px;
    let because = format!(
        "between poses {} and {}, the {what} move by {:.2} px by depth and poses, and by {:.3} px otherwise: the worst of {} pairs",
        worst.poses[0],
        worst.poses[1],
        worst.motion_px,
        worst.left_px,
        pairs.neighbours.len()
    );
    Ok(Judgement::at_most(worst.left_px, limit, "px", because).detecting(detects, "px"))
}

/// The medians of all pairs, with the poses of the first.
fn typical(pairs: &[PairAlignment]) -> Option<PairAlignment> {
    let first = pairs.first()?;
    let median = |of: fn(&PairAlignment) -> f64| mean_median(pairs.iter().map(of).collect()).unwrap_or(0.0);
    Some(PairAlignment {
        motion_px: median(|p| p.motion_px),
        left_px: median(|p| p.left_px),
        deviation_px: median(|p| p.deviation_px),
        ..*first
    })
}
