//! Depth images against depth images, by the poses. A gate.
//!
//! As [`photometric`](super::photometric), with the depth of both views in place of the brightness.
//! Depth of soft edges is a mixture that moves by itself: on sound scenes, up to 0.45 of the motion is
//! left. The limit is 0.7 of it. Depth images in another order, of another path, or of a camera that
//! stands still leave at least all of it.
//!
//! `disparity`: disparity images of a stereo pair against depth, see [`disparity`].

pub mod disparity;

use super::photometric::{PairShares, judge_pairs};
use super::subject::Statements;
use super::{TrajectorySubject, ValidationPass};

/// Largest motion that may be left, as a share of the motion.
const SHARE: f64 = 0.7;

/// The pass.
pub(crate) struct DepthConsistency;

impl ValidationPass for DepthConsistency {
    fn of_trajectory(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let shares = PairShares { apart: SHARE, neighbours: SHARE };
        let depths = subject.geometry.map(|g| &g.depths);
        let mut statements = judge_pairs(depths, shares, "depth images");
        statements.extend(disparity::judge_disparities(subject).map(|judged| ("disparity", judged)));
        Ok(statements)
    }
}
