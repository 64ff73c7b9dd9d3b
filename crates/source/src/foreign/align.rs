//! Comparison of poses in two worlds that differ by a similarity.
//!
//! The rotation between the worlds is estimated from the rotations of the poses, and only scale and
//! shift from the centres (Umeyama, PAMI 1991, with the rotation given). Centres on a straight line
//! would leave the rotation about this line undetermined, and a difference of axis conventions
//! would be removed by the alignment. The rotation minimises the sum of angles, not of their
//! squares (Weiszfeld's iteration, Hartley et al., IJCV 2013). One wrong pose then moves it little
//! and keeps its full error.

use glam::{DQuat, DVec3};
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::{exp_vector, log_vector, relative_angle};

/// One camera in both worlds, camera to world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraPair {
    /// The stated pose.
    pub stated: Se3,
    /// The recovered pose, in the other world.
    pub found: Se3,
}

/// Distance of a camera from its recovered pose after the alignment of the worlds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseDistance {
    /// Angle between the rotations, rad.
    pub rotation: f64,
    /// Distance of the centres, units of the stated world.
    pub translation: f64,
}

const ROUNDS: usize = 100;
/// Minimum angle in the weights, rad. Without it, a pose that agrees up to rounding would outweigh
/// all others.
const NEAR: f64 = 1e-9;

/// Returns the distances of all pairs after the best similarity.
#[must_use]
pub fn pose_distances(pairs: &[CameraPair]) -> Vec<PoseDistance> {
    // If only the worlds differ, this rotation is equal for all poses.
    let turns: Vec<DQuat> =
        pairs.iter().map(|p| (p.stated.rotation * p.found.rotation.conjugate()).normalize()).collect();
    let Some(turn) = median_rotation(&turns) else { return Vec::new() };
    let count = pairs.len() as f64;
    let stated = pairs.iter().map(|p| p.stated.translation).sum::<DVec3>() / count;
    let found = pairs.iter().map(|p| turn * p.found.translation).sum::<DVec3>() / count;
    let arms = pairs.iter().map(|p| (p.stated.translation - stated, turn * p.found.translation - found));
    let (product, square) = arms
        .clone()
        .fold((0.0, 0.0), |(p, s), (stated, found)| (p + stated.dot(found), s + found.dot(found)));
    // Centres in one place have no scale.
    let scale = if square > 0.0 { product / square } else { 0.0 };
    turns
        .iter()
        .zip(arms)
        .map(|(own, (stated, found))| PoseDistance {
            rotation: relative_angle(*own, turn),
            translation: (stated - scale * found).length(),
        })
        .collect()
}

/// Returns the rotation with the minimum sum of angles to these; `None` for an empty list.
fn median_rotation(rotations: &[DQuat]) -> Option<DQuat> {
    let sum = |from: DQuat| rotations.iter().map(|r| relative_angle(from, *r)).sum::<f64>();
    // The start is the best of the given rotations, and only better ones follow.
    let start = rotations.iter().min_by(|a, b| sum(**a).total_cmp(&sum(**b)))?;
    let mut best = *start;
    for _ in 0..ROUNDS {
        let (mut pull, mut weight) = (DVec3::ZERO, 0.0);
        for r in rotations {
            let to = log_vector(best.conjugate() * *r);
            let w = 1.0 / to.length().max(NEAR);
            pull += to * w;
            weight += w;
        }
        let next = (best * exp_vector(pull / weight)).normalize();
        // A step without improvement ends the iteration: it has converged up to rounding.
        if sum(next) >= sum(best) {
            break;
        }
        best = next;
    }
    Some(best)
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEGREE: f64 = std::f64::consts::PI / 180.0;

    /// An arc of cameras, and the same arc in a rotated, scaled and shifted world.
    fn arc(count: usize) -> Vec<CameraPair> {
        let turn = exp_vector(DVec3::new(0.4, -1.1, 0.7));
        let pair = |i: usize| {
            let a = 0.05 * i as f64;
            let rotation = exp_vector(DVec3::Y * a);
            let stated = Se3 { rotation, translation: rotation * DVec3::new(0.1 * a, 0.2 * a * a, -3.0) };
            let found = Se3 {
                rotation: turn * stated.rotation,
                translation: turn * stated.translation * 0.37 + DVec3::new(5.0, 6.0, -7.0),
            };
            CameraPair { stated, found }
        };
        (0..count).map(pair).collect()
    }

    #[test]
    fn a_similarity_is_no_difference() {
        for found in pose_distances(&arc(20)) {
            assert!(found.rotation < 1e-14 && found.translation < 1e-13, "{found:?}");
        }
    }

    #[test]
    fn one_wrong_pose_shows_in_full_and_leaves_the_others_alone() {
        let mut pairs = arc(20);
        pairs[7].stated.rotation *= exp_vector(DVec3::X * DEGREE);
        pairs[12].stated.translation += DVec3::Z * 0.1;
        let found = pose_distances(&pairs);
        assert!((found[7].rotation / DEGREE - 1.0).abs() < 1e-6, "{:?}", found[7]);
        let others = found.iter().enumerate().filter(|(i, _)| *i != 7);
        for (i, apart) in others {
            assert!(apart.rotation < 1e-8, "{i}: {apart:?}");
        }
        let farthest = (0..20).max_by(|a, b| found[*a].translation.total_cmp(&found[*b].translation));
        assert_eq!(farthest, Some(12));
        assert!((found[12].translation - 0.1).abs() < 0.01, "{:?}", found[12]);
    }

    #[test]
    fn other_camera_axes_are_no_similarity() {
        let mut pairs = arc(20);
        for pair in &mut pairs {
            // The OpenGL convention: a half turn about the camera's own x.
            pair.stated.rotation *= exp_vector(DVec3::X * std::f64::consts::PI);
        }
        let found = pose_distances(&pairs);
        let worst = found.iter().map(|a| a.rotation).fold(0.0, f64::max);
        assert!(worst > 20.0 * DEGREE, "{worst}");
        let mut pairs = arc(20);
        for pair in &mut pairs {
            pair.stated = pair.stated.inverse();
        }
        assert!(pose_distances(&pairs).iter().any(|a| a.rotation > 20.0 * DEGREE));
    }

    #[test]
    fn a_straight_line_settles_the_turn_too() {
        let mut pairs = arc(9);
        for (i, pair) in pairs.iter_mut().enumerate() {
            pair.stated.translation = DVec3::X * i as f64;
            pair.found.translation = exp_vector(DVec3::new(0.4, -1.1, 0.7)) * pair.stated.translation;
        }
        assert!(pose_distances(&pairs).iter().all(|a| a.rotation < 1e-14 && a.translation < 1e-13));
        assert!(pose_distances(&[]).is_empty());
    }
}
