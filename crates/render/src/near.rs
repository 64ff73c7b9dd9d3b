//! Gaussians that the near plane would cut within the picture, hidden along a whole path.
//!
//! A renderer draws a Gaussian until its mean passes the near plane, and its affine projection divides the
//! size by the depth. So a large one covers the whole picture at that moment, also where its mean is far to
//! the side, and vanishes with the next frame. The published renderers differ in the plane alone (0.2 scene
//! units in graphdeco-inria/diff-gaussian-rasterization, 0.01 in nerfstudio-project/gsplat); a plane at
//! another depth moves the moment. A fade over depth is slower, but no motion makes its change of brightness
//! either. A Gaussian that is hidden along the whole path changes nothing at any moment, in frames, events,
//! depth and flow alike.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_image::Size;
//! # use gs2e_num::se3::Se3;
//! # use gs2e_scene::collector::{Gaussian, GaussianCollector};
//! use gs2e_render::RenderRules;
//! use gs2e_render::near::{NearPath, hide_near};
//! use gs2e_scene::camera::Camera;
//!
//! # let mut collector = GaussianCollector::new(0, 1)?;
//! # let (log_scale, rotation, sh) = ([-1.0; 3], [1.0, 0.0, 0.0, 0.0], &[[0.0; 3]]);
//! # collector.push(&Gaussian { position: [0.0, 0.0, 2.0], log_scale, rotation, opacity_logit: 0.0, sh });
//! # let mut scene = collector.finish(DVec3::ZERO, None)?;
//! # let camera = Camera::pinhole(Size { width: 9, height: 9 }, [9.0, 9.0, 4.5, 4.5]);
//! // The camera goes along its axis, through the only Gaussian of `scene`, at depth 2.
//! let poses: Vec<Se3> =
//!     (0..12).map(|k| Se3 { translation: DVec3::Z * (0.25 * f64::from(k)), ..Se3::IDENTITY }).collect();
//! let path = NearPath { camera: &camera, rules: RenderRules::Exact, poses: &poses, plane: 0.2 };
//! assert_eq!(hide_near(&mut scene, &path), [0]);
//! // What is hidden passes the plane in no picture.
//! assert!(hide_near(&mut scene, &path).is_empty());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod cause;
mod footprint;

use super::RenderRules;
use super::shared::{GSPLAT_NEAR, NEAR};
use footprint::NearEye;
use glam::DVec3;
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::relative_angle;
use gs2e_scene::Gaussians;
use gs2e_scene::camera::Camera;
use rayon::prelude::*;

/// Smallest opacity in the picture at which a Gaussian is hidden: about four greys of a white one.
const VISIBLE: f64 = 1.0 / 64.0;
/// Largest depth of a Gaussian before it passes the plane, in depths of the plane. Further away, it passed
/// between two poses of a coarse path, and perhaps out of the picture.
const PASSING: f64 = 2.0;
/// Number of neighbouring poses that are bounded at once.
const BLOCK: usize = 32;
/// Logit of a hidden Gaussian. Its opacity is far below the smallest one that is drawn.
const HIDDEN_LOGIT: f32 = -30.0;

/// The poses of a path, with the camera and the near plane.
#[derive(Debug, Clone, Copy)]
pub struct NearPath<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// The rules of the rendering.
    pub rules: RenderRules,
    /// Poses, camera to world.
    pub poses: &'a [Se3],
    /// Depth of the plane, scene units. The renderer's own plane counts where it is deeper.
    pub plane: f64,
}

/// Some neighbouring poses, and bounds of their distances from the one in the middle.
struct PoseBlock {
    first: usize,
    end: usize,
    middle: Se3,
    moved: f64,
    turned: f64,
}

/// Hides the Gaussians that pass the near plane within the picture along a path. Returns their numbers.
/// Objects, and scenes that change with time, stay as they are.
pub fn hide_near(scene: &mut Gaussians, path: &NearPath<'_>) -> Vec<usize> {
    if scene.dynamics().is_some() {
        return Vec::new();
    }
    let hidden = path.passing(scene);
    for i in &hidden {
        scene.opacity_logits[*i] = HIDDEN_LOGIT;
    }
    hidden
}

/// Depth of the renderer's own near plane.
fn renderer_plane(rules: RenderRules) -> f64 {
    f64::from(if rules == RenderRules::Gsplat { GSPLAT_NEAR } else { NEAR })
}

impl NearPath<'_> {
    /// Numbers of the Gaussians at rest that pass the near plane within the picture.
    #[must_use]
    pub fn passing(&self, scene: &Gaussians) -> Vec<usize> {
        let blocks = self.blocks();
        let passes = |i: &usize| {
            let mean = scene.position(*i);
            let mut near = blocks.iter().filter(|block| block.may_reach(mean, PASSING * self.plane()));
            scene.object_of(*i) == 0 && near.any(|block| self.passes_in(scene, *i, block))
        };
        (0..scene.len()).into_par_iter().filter(passes).collect()
    }

    fn eye(&self, pose: usize) -> NearEye<'_> {
        NearEye { camera: self.camera, rules: self.rules, world_from_camera: self.poses[pose] }
    }

    fn plane(&self) -> f64 {
        self.plane.max(renderer_plane(self.rules))
    }

    fn blocks(&self) -> Vec<PoseBlock> {
        let starts = (0..self.poses.len()).step_by(BLOCK);
        starts.map(|first| PoseBlock::new(self.poses, first)).collect()
    }

    /// Returns true if Gaussian `i` is visible at one of these poses, and at the plane at it or a neighbour.
    fn passes_in(&self, scene: &Gaussians, i: usize, block: &PoseBlock) -> bool {
        let (mean, plane) = (scene.position(i), self.plane());
        let depth = |pose: usize| {
            let Se3 { rotation, translation } = self.poses[pose];
            (rotation * DVec3::Z).dot(mean - translation)
        };
        let last = self.poses.len() - 1;
        (block.first..block.end).any(|pose| {
            let own = depth(pose);
            let is_at_plane =
                || [pose.saturating_sub(1), (pose + 1).min(last)].iter().any(|at| depth(*at) <= plane);
            // The footprint costs most by far, so it comes last.
            own > 0.0
                && own <= PASSING * plane
                && (own <= plane || is_at_plane())
                && self.eye(pose).footprint(scene, i).peak() >= VISIBLE
        })
    }
}

impl PoseBlock {
    fn new(poses: &[Se3], first: usize) -> Self {
        let end = (first + BLOCK).min(poses.len());
        let middle = poses[first.midpoint(end)];
        let most = |of: &dyn Fn(&Se3) -> f64| poses[first..end].iter().map(of).fold(0.0, f64::max);
        let moved = most(&|pose| (pose.translation - middle.translation).length());
        let turned = most(&|pose| relative_angle(pose.rotation, middle.rotation));
        Self { first, end, middle, moved, turned }
    }

    /// Returns false if a point has a depth outside of 0 to `most` at all poses.
    fn may_reach(&self, mean: DVec3, most: f64) -> bool {
        let ray = mean - self.middle.translation;
        let depth = (self.middle.rotation * DVec3::Z).dot(ray);
        // Turning the axis by an angle moves the depth by at most that angle times the distance.
        let slack = self.moved + (ray.length() + self.moved) * self.turned;
        depth - slack <= most && depth + slack > 0.0
    }
}
