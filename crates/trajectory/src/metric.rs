//! The mixed metric of poses, in which paths are measured (the paper's equation 9).
//!
//! `distance = alpha * angle + beta / D * |dC|`. The paper gives neither alpha nor beta; both are 1
//! here. Translation is divided by the scene's scale distance `D`, because the scale of a capture
//! is arbitrary.

use super::{NamedPose, TrajectoryError, refine::TranslationScale};
use glam::{DMat3, DVec3};
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::relative_angle;
use gs2e_num::se3::sum::NeumaierSum;
use gs2e_num::stats::mean_median;

/// Weight of rotation, per radian.
pub const ALPHA: f64 = 1.0;
/// Weight of translation, per scale distance.
pub(crate) const BETA: f64 = 1.0;
/// Smallest eigenvalue of `mean(I - d d^T)` over the optical axes `d` for which a point nearest to
/// the axes is computed. Below it they are nearly parallel.
const MIN_SPREAD: f64 = 1e-3;

/// Maximum number of centres among which the largest distance is searched, spread evenly over a
/// longer capture. For all pairs of a long capture it would take hours.
const MAX_COMPARED: usize = 4096;

/// The mixed metric.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MixedMetric {
    /// The scale distance `D` by which translation is divided, in scene units.
    pub scale: f64,
}

impl MixedMetric {
    /// The metric of a capture with centres relative to one of them.
    ///
    /// `D` comes from the captured poses before smoothing, so it belongs to the capture and not to
    /// the parameters of one path.
    ///
    /// # Errors
    /// The given scale is not positive and finite.
    pub fn new(scale: TranslationScale, views: &[NamedPose<'_>]) -> Result<Self, TrajectoryError> {
        let scale = match scale {
            TranslationScale::Scene => scene_distance(views),
            TranslationScale::None => 1.0,
            TranslationScale::Fixed(scale) => scale,
        };
        if scale > 0.0 && scale.is_finite() {
            return Ok(Self { scale });
        }
        Err(TrajectoryError::Parameter {
            field: "metric.scale",
            found: scale.to_string(),
            wanted: "`none` or a positive number",
        })
    }

    /// The distance between two poses.
    #[must_use]
    pub fn distance(self, a: &Se3, b: &Se3) -> f64 {
        self.mix(relative_angle(a.rotation, b.rotation), (b.translation - a.translation).length())
    }

    /// `alpha * angular + beta / D * linear`, for angles and lengths or for their rates.
    #[must_use]
    pub fn mix(self, angular: f64, linear: f64) -> f64 {
        ALPHA * angular + BETA * (linear / self.scale)
    }
}

/// Median distance of the centres to the point nearest all optical axes. If the axes do not meet in
/// front of most cameras, the largest distance between two centres; if that is 0, 1.
fn scene_distance(views: &[NamedPose<'_>]) -> f64 {
    let poses = views.iter().map(|v| v.world_from_camera);
    let rays: Vec<(DVec3, DVec3)> = poses.map(|p| (p.translation, p.rotation * DVec3::Z)).collect();
    let focused =
        common_focus(&rays).and_then(|p| mean_median(rays.iter().map(|(c, _)| (*c - p).length()).collect()));
    // A scale of 0 cannot divide. It happens if most centres lie in the focus, or if all are equal.
    focused.filter(|d| *d > 0.0).or_else(|| largest_distance(&rays).filter(|d| *d > 0.0)).unwrap_or(1.0)
}

/// The largest distance between two centres.
fn largest_distance(rays: &[(DVec3, DVec3)]) -> Option<f64> {
    let spread = rays.len().div_ceil(MAX_COMPARED).max(1);
    let some: Vec<DVec3> = rays.iter().step_by(spread).map(|(centre, _)| *centre).collect();
    let pairs = some.iter().enumerate().flat_map(|(i, a)| some[..i].iter().map(|b| (*a - *b).length()));
    pairs.reduce(f64::max)
}

/// The point with the least sum of squared distances to the rays' lines. `None` if the lines are
/// nearly parallel, or the point lies behind more than half of the cameras.
pub(super) fn common_focus(rays: &[(DVec3, DVec3)]) -> Option<DVec3> {
    // The projection across the axis: `|across(d) (p - c)|` is the distance of `p` from the line.
    let across = |d: DVec3| DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
    let n = rays.len() as f64;
    let (mut a, mut b) = (DMat3::ZERO, DVec3::ZERO);
    for (centre, direction) in rays {
        a += across(*direction);
        b += across(*direction) * *centre;
    }
    // The mean, so that the limit on the spread does not depend on the number of views.
    let (a, b) = (a * (1.0 / n), b / n);
    if !eigenvalues_exceed(&a, MIN_SPREAD) {
        return None;
    }
    // The eigenvalues lie between `MIN_SPREAD` and 1, so the inverse loses at most three digits.
    let point = a.inverse() * b;
    let behind = rays.iter().filter(|(c, d)| (point - *c).dot(*d) < 0.0).count();
    (point.is_finite() && 2 * behind <= rays.len()).then_some(point)
}

/// Returns true if every eigenvalue of the symmetric `a` exceeds `limit`, by Sylvester's criterion
/// on `a - limit I`, without computing eigenvalues.
fn eigenvalues_exceed(a: &DMat3, limit: f64) -> bool {
    let m = *a - DMat3::from_diagonal(DVec3::splat(limit));
    m.x_axis.x > 0.0 && m.x_axis.x * m.y_axis.y - m.y_axis.x * m.x_axis.y > 0.0 && m.determinant() > 0.0
}

/// Compensated running sums `0, a, a+b, ...`: one more value than there are terms.
pub(super) fn running_sums(terms: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut sum = NeumaierSum::default();
    let mut sums = Vec::with_capacity(terms.size_hint().0 + 1);
    sums.push(0.0);
    for term in terms {
        sum.add(term);
        sums.push(sum.value());
    }
    sums
}
