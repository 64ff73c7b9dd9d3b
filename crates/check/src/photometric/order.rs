//! Order of the frames against that of the poses, without depth.
//!
//! Of three poses in a row along a path, the outer two are the furthest apart, and so are their
//! frames. Frames in another order break this: where two neighbours are swapped, the middle frame
//! of a triple lies beyond an outer one. A camera that stands still sees one picture.

use super::super::geometry::Measurement;
use super::super::subject::{Judgement, JudgementResult, LimitSide};
use super::super::{TrajectorySubject, Verdict};
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::relative_angle;
use gs2e_num::stats::mean_median;

/// Smallest ratio of the outer difference to the larger inner one. Where the motion exceeds the
/// structure of the picture, all differences are equal.
const LEAST_RATIO: f64 = 0.8;
/// Smallest such ratio of the poses for a triple that is judged: the path goes on.
const ONWARD: f64 = 1.5;
/// Smallest difference that is compared, greys: rounding to 8 bits leaves a tenth of it after
/// smoothing.
const LEAST_GREY: f64 = 0.5;
/// Difference of neighbouring frames that a still camera cannot see, greys.
const MOST_STILL_GREY: f64 = 0.2;
/// Distance of poses that are the same but for rounding, in the mixed metric.
const SAME: f64 = 1e-9;
/// Minimum number of triples.
const LEAST_TRIPLES: usize = 3;

/// Differences within three frames in a row, root mean square of the smoothed greys.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameTriple {
    /// Numbers of the poses.
    pub poses: [usize; 3],
    /// Of the first and the second, and of the second and the third.
    pub inner: [f64; 2],
    /// Of the first and the third.
    pub outer: f64,
}

/// The statement on the order of the frames.
pub(super) fn judge_order(
    subject: &TrajectorySubject<'_>,
    triples: &Measurement<Vec<FrameTriple>>,
) -> JudgementResult {
    let triples = triples.as_ref()?;
    let poses = &subject.trajectory.world_from_camera;
    let scale = subject.speed.map_or(1.0, |report| report.scale_distance);
    let apart = |a: usize, b: usize| mixed_distance(&poses[a], &poses[b], scale);
    let difference = mean_median(triples.iter().map(|t| t.inner[0]).collect()).unwrap_or(0.0);
    if poses.iter().all(|pose| mixed_distance(pose, &poses[0], scale) <= SAME) && !triples.is_empty() {
        return Ok(judge_still(difference));
    }
    let judged: Vec<&FrameTriple> = triples
        .iter()
        .filter(|t| {
            let [a, b, c] = t.poses;
            apart(a, c) > ONWARD * apart(a, b).max(apart(b, c)) && t.inner[0].max(t.inner[1]) > LEAST_GREY
        })
        .collect();
    let ratio = |t: &FrameTriple| t.outer / t.inner[0].max(t.inner[1]);
    let worst = judged.iter().min_by(|a, b| ratio(a).total_cmp(&ratio(b)));
    let Some(worst) = worst.filter(|_| judged.len() >= LEAST_TRIPLES) else {
        return Err("too few frames in a row differ".into());
    };
    let limit = LimitSide::gate(LEAST_RATIO);
    let because = format!(
        "frames {} and {} differ {:.2} times as much as either from frame {} between them: the least of {} triples of a path that goes on",
        worst.poses[0],
        worst.poses[2],
        ratio(worst),
        worst.poses[1],
        judged.len()
    );
    Ok(Judgement::at_least(ratio(worst), limit, "1", because))
}

fn judge_still(difference: f64) -> Judgement {
    let limit = LimitSide::gate(MOST_STILL_GREY);
    let verdict = limit.at_most(difference);
    let because = match verdict {
        Verdict::Pass => {
            format!("the camera stands still, and neighbouring frames differ by {difference:.2} grey")
        }
        _ => format!("the poses stand still, but neighbouring frames differ by {difference:.2} grey"),
    };
    Judgement::new(verdict, difference, limit.value, "grey", because)
}

fn mixed_distance(a: &Se3, b: &Se3, scale: f64) -> f64 {
    (a.translation - b.translation).length() / scale + relative_angle(a.rotation, b.rotation)
}
