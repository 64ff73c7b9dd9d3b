//! Share of the picture that shows the scene. A warning; a gate where the recipe sets the limit.
//!
//! A path can lead out of the scene, look away from it, or be written in other units than the scene.
//! The sensor then sees the background only. The share is counted in depth maps at some poses of the
//! path: a pixel shows the scene if its Gaussians cover at least half of it, which is where the
//! renderer defines a depth.

use super::subject::{Judgement, LimitSide, Statements};
use super::{TrajectorySubject, ValidationPass, limits};
use gs2e_image::Image;
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; absent ones have their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Smallest share of a picture that shows the scene. Default: `MIN_SHARE`.
    #[serde(deserialize_with = "limits::parse_share", skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
}

/// Default limit: a view below it shows next to nothing.
const MIN_SHARE: f64 = 0.001;

/// The pass.
pub(crate) struct CoveragePass;

/// The emptiest of some views of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewCoverage {
    /// Number of views.
    pub views: usize,
    /// Number of views in which no pixel shows the scene.
    pub empty: usize,
    /// Smallest share of pixels that show the scene.
    pub least: f64,
    /// Stamp of the view with that share, microseconds.
    pub at_us: i64,
}

impl ViewCoverage {
    /// Counts the pixels with a depth; `None` without depth maps. NaN is no depth.
    pub fn from_depths<'a>(depths: impl Iterator<Item = (i64, &'a Image<f32>)>) -> Option<Self> {
        let mut found: Option<Self> = None;
        for (at_us, depth) in depths {
            let pixels = depth.pixels();
            let covered = pixels.iter().filter(|depth| !depth.is_nan()).count();
            let share = covered as f64 / pixels.len().max(1) as f64;
            let one = Self { views: 1, empty: usize::from(covered == 0), least: share, at_us };
            found = Some(found.map_or(one, |sum| sum.joined(one)));
        }
        found
    }

    fn joined(self, other: Self) -> Self {
        let (views, empty) = (self.views + other.views, self.empty + other.empty);
        let emptier = if other.least < self.least { other } else { self };
        Self { views, empty, ..emptier }
    }
}

impl ValidationPass for CoveragePass {
    fn of_trajectory(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let ViewCoverage { views, empty, least, at_us } =
            subject.coverage.ok_or("there is no depth or flow of any view")?;
        let limit =
            LimitSide::limit_or(subject.limits.coverage.and_then(|l| l.min), LimitSide::warning(MIN_SHARE));
        let because = if empty > 0 {
            format!(
                "{empty} of {views} sampled views show no part of the scene; the first is at time {at_us} us"
            )
        } else {
            format!(
                "in the emptiest of {views} sampled views, the scene covers {:.2} % of the pixels",
                100.0 * least
            )
        };
        Ok(vec![("", Ok(Judgement::at_least(least, limit, "1", because)))])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_image::Size;

    #[test]
    fn the_emptiest_view_is_found_with_its_stamp() {
        let size = Size { width: 4, height: 1 };
        let view = |depths: [f32; 4]| Image::from_vec(size, depths.to_vec());
        let none = f32::NAN;
        let views = [view([1.0; 4]), view([none, none, 2.0, none]), view([none, 1.0, 1.0, 1.0])];
        let found = ViewCoverage::from_depths([0, 10, 20].into_iter().zip(&views));
        assert_eq!(found, Some(ViewCoverage { views: 3, empty: 0, least: 0.25, at_us: 10 }));
        let views = [view([none; 4]), view([none; 4]), view([1.0; 4])];
        let found = ViewCoverage::from_depths([5, 10, 20].into_iter().zip(&views));
        assert_eq!(found, Some(ViewCoverage { views: 3, empty: 2, least: 0.0, at_us: 5 }));
        assert_eq!(ViewCoverage::from_depths(std::iter::empty()), None);
    }
}
