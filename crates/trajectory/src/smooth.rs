//! Smoothing of captured poses over a window of neighbours (the paper's equations 7 and 8).
//!
//! Centres get the arithmetic mean, rotations the Karcher mean, its counterpart for rotations.
//! Equation 8 writes a slerp of a whole window at 1/2, which is undefined for more than two
//! rotations. [`RotationMean::SlerpMidpoint`] is its literal reading: the piecewise slerp through
//! the window, at the middle of its indices.

use super::refine::{EndRule, RefinePath, RotationMean};
use super::{NamedPose, TrajectoryError};
use glam::{DQuat, DVec3};
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::{karcher_mean, slerp};

/// The views with smoothed poses.
///
/// # Errors
/// The rotations of a window have no mean.
pub(super) fn smooth_views<'a>(
    views: &[NamedPose<'a>],
    params: &RefinePath,
) -> Result<Vec<NamedPose<'a>>, TrajectoryError> {
    (0..views.len())
        .map(|i| {
            let (first, last) = window_at(i, views.len(), params);
            let window = &views[first..=last];
            let rotation = match params.rotation {
                RotationMean::Mean => mean_rotation(window)?,
                RotationMean::SlerpMidpoint => middle_rotation(window),
            };
            let world_from_camera = Se3 { rotation, translation: mean_centre(window) };
            Ok(NamedPose { name: views[i].name, world_from_camera })
        })
        .collect()
}

/// First and last index of the window around `i` of `n` views.
fn window_at(i: usize, n: usize, params: &RefinePath) -> (usize, usize) {
    let after = n - 1 - i;
    // It may be `usize::MAX`, so it is cut off below before it is added or subtracted.
    let half = usize::try_from(params.window).unwrap_or(usize::MAX);
    match params.ends {
        EndRule::Truncated => (i - half.min(i), i + half.min(after)),
        EndRule::Pinned => (i - half.min(i).min(after), i + half.min(i).min(after)),
    }
}

/// The mean of the centres of at least one view.
pub(super) fn mean_centre(window: &[NamedPose<'_>]) -> DVec3 {
    window.iter().map(|v| v.world_from_camera.translation).sum::<DVec3>() / window.len() as f64
}

/// The Karcher mean of the rotations of at least one view, with the middle one as the start.
///
/// # Errors
/// They have no mean; the error names the images.
pub(super) fn mean_rotation(window: &[NamedPose<'_>]) -> Result<DQuat, TrajectoryError> {
    let rotations: Vec<DQuat> = window.iter().map(|v| v.world_from_camera.rotation).collect();
    karcher_mean(&rotations, rotations[rotations.len() / 2]).map_err(|source| TrajectoryError::Mean {
        names: window.iter().map(|v| v.name.to_owned()).collect(),
        source,
    })
}

/// The rotation at the middle of the window's indices: its middle element, or halfway between its
/// middle two.
fn middle_rotation(window: &[NamedPose<'_>]) -> DQuat {
    let at = |i: usize| window[i].world_from_camera.rotation;
    let n = window.len();
    if n % 2 == 1 { at(n / 2) } else { slerp(at(n / 2 - 1), at(n / 2), 0.5) }
}
