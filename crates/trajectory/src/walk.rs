//! Evenness of a capture: distances between successive views, in natural order of their names.
//!
//! Everything is measured in the mixed [`super::metric`] and in median steps, so neither the scale
//! nor the density of a capture matters. A **step** is the distance between neighbours; a long step
//! is a gap, where frames did not register. The **detour** of a view is half the difference between
//! the path through the view and the path past it:
//!
//! ```text
//! detour(i) = (d(i-1, i) + d(i, i+1) - d(i-1, i+1)) / 2
//! ```
//!
//! A view at distance `x` from the line between its neighbours has a detour of about `x`; the
//! detours of its neighbours are at most a step. By the triangle inequality, a detour is at most
//! the shorter of its two steps, so a gap, one long step, makes none.

use super::knots::{CaptureGap, knot_distances, rounding_distance};
use super::metric::{MixedMetric, common_focus};
use super::order::by_name;
use super::refine::{TranslationScale, screen_views};
use super::{NamedPose, TrajectoryError};
use glam::DVec3;
use gs2e_num::stats::mean_median;

/// Steps and detours, divided by the median step.
#[derive(Debug, Clone, PartialEq)]
pub struct CaptureEvenness {
    /// The step from each view to the next.
    pub steps: Vec<CaptureGap>,
    /// The detour of each view except the first and the last.
    pub detours: Vec<ViewDetour>,
    /// Median distance of the cameras from the point that they look at, scene units; the largest
    /// distance between two cameras if they look at no common point.
    pub scale: f64,
    /// True if the cameras look at a common point.
    pub focused: bool,
}

/// Detour of one view.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewDetour {
    /// The view.
    pub name: String,
    /// Its detour divided by the median step.
    pub times_median: f64,
}

impl CaptureEvenness {
    /// Measures views, given in any order; `None` if all of them coincide.
    ///
    /// # Errors
    /// There are no views, or they have values that are not finite, invalid rotations or equal
    /// names.
    pub fn measure_views(views: &[NamedPose<'_>]) -> Result<Option<Self>, TrajectoryError> {
        let (_, views, _) = screen_views(by_name(views)?)?;
        let metric = MixedMetric::new(TranslationScale::Scene, &views)?;
        let poses = views.iter().map(|view| view.world_from_camera);
        let rays: Vec<(DVec3, DVec3)> = poses.map(|p| (p.translation, p.rotation * DVec3::Z)).collect();
        let (steps, still) = (knot_distances(&views, metric), rounding_distance(&views, metric));
        let median = mean_median(steps.iter().copied().filter(|step| *step > still).collect()).unwrap_or(0.0);
        let step = |(pair, step): (&[NamedPose<'_>], &f64)| CaptureGap {
            after: pair[0].name.to_owned(),
            before: pair[1].name.to_owned(),
            times_median: step / median,
        };
        let detour = |i: usize| ViewDetour {
            name: views[i].name.to_owned(),
            times_median: {
                let past = metric.distance(&views[i - 1].world_from_camera, &views[i + 1].world_from_camera);
                0.5 * (steps[i - 1] + steps[i] - past) / median
            },
        };
        // The closures are lazy: nothing is divided by a median of zero.
        Ok((median > 0.0).then(|| Self {
            steps: views.windows(2).zip(&steps).map(step).collect(),
            detours: (1..steps.len()).map(detour).collect(),
            scale: metric.scale,
            focused: common_focus(&rays).is_some(),
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use gs2e_num::se3::Se3;

    /// Views that look along z, so that the scale of the metric is the largest distance between two
    /// of them.
    fn walk(centres: &[[f64; 3]]) -> CaptureEvenness {
        let names: Vec<String> = (0..centres.len()).map(|i| format!("{i}.jpg")).collect();
        let views: Vec<NamedPose<'_>> = names
            .iter()
            .zip(centres)
            .map(|(name, centre)| NamedPose {
                name,
                world_from_camera: Se3 { rotation: DQuat::IDENTITY, translation: DVec3::from_array(*centre) },
            })
            .collect();
        CaptureEvenness::measure_views(&views).unwrap().unwrap()
    }

    fn close(found: f64, wanted: f64) {
        assert!((found - wanted).abs() < 1e-9, "{found}, {wanted}");
    }

    #[test]
    fn a_straight_walk_has_no_detour_and_a_gap_is_a_step() {
        let mut centres: Vec<[f64; 3]> = (0..12u8).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        centres.drain(4..9);
        let walk = walk(&centres);
        assert!(walk.detours.iter().all(|detour| detour.times_median.abs() < 1e-9));
        for (i, step) in walk.steps.iter().enumerate() {
            close(step.times_median, if i == 3 { 6.0 } else { 1.0 });
        }
        assert_eq!((walk.steps[3].after.as_str(), walk.steps[3].before.as_str()), ("3.jpg", "4.jpg"));
    }

    #[test]
    fn a_view_off_the_way_has_a_detour_of_its_distance() {
        let mut centres: Vec<[f64; 3]> = (0..15u8).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        centres[6] = [6.0, 10.0, 0.0];
        let walk = walk(&centres);
        // Both legs are sqrt(101), and the path past the view is 2 steps.
        close(walk.detours[5].times_median, 101f64.sqrt() - 1.0);
        assert_eq!(walk.detours[5].name, "6.jpg");
        assert!(walk.detours.iter().enumerate().all(|(i, d)| i == 5 || d.times_median <= 1.0));
    }

    #[test]
    fn views_at_one_place_are_no_walk() {
        let view = |name| NamedPose {
            name,
            world_from_camera: Se3 { rotation: DQuat::IDENTITY, translation: DVec3::ONE },
        };
        assert_eq!(CaptureEvenness::measure_views(&[view("a"), view("b")]).unwrap(), None);
        assert_eq!(CaptureEvenness::measure_views(&[view("a")]).unwrap(), None);
        assert!(CaptureEvenness::measure_views(&[view("a"), view("a")]).is_err());
    }
}
