//! Gaussians that no view of a path can see. The bound is conservative: what is left out touches no
//! pixel of any view.
//!
//! **One view.** Let `q` be the mean of a Gaussian in camera axes, `s` its largest standard
//! deviation and `o` its opacity. It is drawn only if `q.z` is above the near plane. Along x, it
//! touches no pixel farther from its mean `fx u + cx`, `u = q.x / q.z`, than `k sqrt(a)`: under all
//! rules, extents lie within the box of `opacity >= least`, with `k = sqrt(2 ln(o / least))`;
//! antialiasing only lowers `o`. The dilated variance is `a = |a0|^2 + 0.3`, where `a0` is the row
//! `fx/z (1, 0, -uc)` of the projection's derivative times `M`, a matrix of norm `s`. The slope
//! `uc` at which the derivative is taken is clamped to `|uc| <= U`. So `sqrt(a) <= fx/z s V +
//! sqrt(0.3)` with `V = sqrt(1 + U^2)`, and a pixel at or right of the image's left edge is touched
//! only if
//!
//! ```text
//! fx u + cx + k (fx/z s V + sqrt(0.3)) >= 0,    that is, as z > 0,
//! q.x + L q.z >= -k s V,    L = (cx + m) / fx
//! ```
//!
//! with `m >= k sqrt(0.3)` for every opacity. That is a plane through the camera's centre, widened
//! by `k s V`. The other three edges are alike. With the unit normal `n = (1, 0, L) / h` the
//! condition reads `n.q >= -k s V / h`. The near plane is `n = (0, 0, 1)` with `n.q >= near`.
//!
//! **A run of views** has centres `C_j` and normals `N_j = R_j n` in the world. For any point `c`
//! and any `N`
//!
//! ```text
//! N_j.(p - C_j) = N.(p - c) + (N_j - N).(p - c) + N_j.(c - C_j)
//! <= N.(p - c) + turn |p - c| + shift
//! ```
//!
//! with `turn` the largest `|N_j - N|` and `shift` the largest `N_j.(c - C_j)` of the run. If the
//! right side is below the plane's bound, no view of the run sees the Gaussian. Runs are obtained
//! by halving the path, so a few runs decide most Gaussians. A Gaussian that the shortest run
//! cannot exclude is kept.
//!
//! **Rounding.** The 32-bit projection has errors of some units of 2^-24 of each term, and its
//! extents add 0.02 px and a millionth. [`SPREAD`] on `k s V` and [`GRACE_PX`] on `m` are far above
//! both. 64-bit positions have errors of some units of 2^-53 of the largest coordinate, below
//! [`ROUNDING`] of it.

#![expect(clippy::cast_possible_truncation, reason = "a scene has fewer than 2^32 Gaussians")]

use super::eye::slope_bounds;
use super::{activate, extent};
use crate::RenderRules;
use crate::shared::{DILATION, GSPLAT_NEAR, NEAR, least_alpha};
use glam::DVec3;
use gs2e_num::se3::Se3;
use gs2e_scene::Gaussians;
use gs2e_scene::camera::Camera;
use rayon::prelude::*;
use std::f64::consts::LN_2;

/// Maximum number of shortest runs of a path.
const RUNS: usize = 64;
/// Factor on a spread that exceeds any rounding of it.
const SPREAD: f64 = 1.0 + 1e-4;
/// Bound on what the projection adds to an extent or rounds it by, px: 0.02 and a few units of
/// 2^-8.
const GRACE_PX: f64 = 0.1;
/// Bound on the error of 64-bit sums of coordinates, relative to the largest.
const ROUNDING: f64 = 1e-14;
/// Largest focal length or principal point, px, with which anything is left out. Beyond, extents
/// could overflow.
const MAX_PX: f64 = 1e6;
/// Largest standard deviation, scene units, with which a Gaussian is left out.
const MAX_DEVIATION: f64 = 1e9;

/// The indices of all Gaussians.
pub(super) fn all_indices(scene: &Gaussians) -> Vec<u32> {
    (0..scene.len()).map(|i| i as u32).collect()
}

/// The indices of the Gaussians that some pose may see, in order; all of them if there is no pose.
pub(super) fn visible_indices(
    scene: &Gaussians,
    rules: RenderRules,
    camera: &Camera,
    poses: &[Se3],
) -> Vec<u32> {
    let px = [camera.fx, camera.fy, camera.cx, camera.cy];
    // Nor do the poses say when a Gaussian that changes is where.
    if poses.is_empty() || scene.dynamics().is_some() || !px.iter().all(|v| v.abs() <= MAX_PX) {
        return all_indices(scene);
    }
    let hull = PathHull::new(scene.origin, rules, camera, poses);
    // The poses say nothing of when an object is where, so all Gaussians of objects are kept.
    let still = scene.object_end(0);
    let is_visible = |i: &u32| *i as usize >= still || !hull.excludes(scene, *i as usize);
    all_indices(scene).into_par_iter().filter(is_visible).collect()
}

/// The indices of two ascending lists, ascending and each once.
pub(super) fn merged_indices(a: &[u32], b: &[u32]) -> Vec<u32> {
    let mut all = [a, b].concat();
    // The sort of runs that are sorted already only merges them.
    all.sort();
    all.dedup();
    all
}

/// A plane in camera axes. Visible points lie in front of it.
struct CullPlane {
    /// Unit normal, pointing inwards.
    normal: DVec3,
    /// Smallest distance in front of the plane, scene units.
    least: f64,
    /// Reduction of that distance per `k s`.
    spread: f64,
}

/// The near plane and the edges of the image.
fn frustum_planes(rules: RenderRules, camera: &Camera) -> [CullPlane; 5] {
    let near = if rules == RenderRules::Gsplat { GSPLAT_NEAR } else { NEAR };
    let widest = extent_sigmas(extent::opacity_reach(rules, 1.0));
    let margin = widest * f64::from(DILATION).sqrt() + GRACE_PX;
    let edge = |k: usize, sign: f64| {
        let (focal, centre, size) =
            [(camera.fx, camera.cx, camera.size.width), (camera.fy, camera.cy, camera.size.height)][k];
        let room = if sign > 0.0 { centre } else { f64::from(size) - centre };
        let mut normal = DVec3::new(0.0, 0.0, (room + margin) / focal);
        normal[k] = sign;
        let [low, high] = slope_bounds(camera, rules)[k];
        let steepest = low.abs().max(high.abs());
        let spread = SPREAD * (steepest * steepest + 1.0).sqrt() / normal.length();
        CullPlane { normal: normal.normalize(), least: 0.0, spread }
    };
    // Slightly nearer than the plane, because depths are rounded to 32 bits before the comparison.
    let near = CullPlane { normal: DVec3::Z, least: f64::from(near) * (1.0 - 1e-6), spread: 0.0 };
    [near, edge(0, 1.0), edge(0, -1.0), edge(1, 1.0), edge(1, -1.0)]
}

/// Width of an extent of this reach, in standard deviations.
fn extent_sigmas(reach: f32) -> f64 {
    (2.0 * LN_2 * f64::from(reach)).sqrt()
}

/// The bounding planes of a path's runs.
struct PathHull {
    planes: [CullPlane; 5],
    rules: RenderRules,
    /// Runs as a tree in preorder: each run before its halves.
    runs: Vec<PathRun>,
}

struct PathRun {
    /// Centre of the run, relative to the scene's origin.
    centre: DVec3,
    faces: [RunPlane; 5],
    /// True if the run has no halves.
    shortest: bool,
    /// Index after the last of its parts.
    end: usize,
}

/// A plane over a run: see the head of the module.
struct RunPlane {
    normal: DVec3,
    turn: f64,
    shift: f64,
}

impl PathHull {
    fn new(origin: DVec3, rules: RenderRules, camera: &Camera, poses: &[Se3]) -> Self {
        let mut hull = Self { planes: frustum_planes(rules, camera), rules, runs: Vec::new() };
        hull.cut(origin, poses, poses.len().div_ceil(RUNS));
        hull
    }

    /// Adds the run of these poses, and its halves while they are longer than `shortest`.
    fn cut(&mut self, origin: DVec3, poses: &[Se3], shortest: usize) {
        let place = self.runs.len();
        self.runs.push(PathRun::new(&self.planes, origin, poses));
        if poses.len() > shortest {
            let (first, second) = poses.split_at(poses.len() / 2);
            self.cut(origin, first, shortest);
            self.cut(origin, second, shortest);
        }
        // In preorder, the parts of a run are the entries between it and its `end`.
        let end = self.runs.len();
        self.runs[place].shortest = end == place + 1;
        self.runs[place].end = end;
    }

    /// Returns true if no pose sees the Gaussian.
    fn excludes(&self, scene: &Gaussians, i: usize) -> bool {
        let opacity = activate::logistic_opacity(scene.opacity_logits[i]);
        // Slightly below the exact bound, because the antialiased rule may round a factor of 1 up.
        if opacity < 0.999 * least_alpha(self.rules) {
            return true;
        }
        // `f32::max` ignores NaN, so each scale is tested by itself below.
        let log_deviation = scene.log_scales[i].iter().fold(f32::NEG_INFINITY, |most, &v| most.max(v));
        let deviation = libm::exp(f64::from(log_deviation));
        if !(deviation <= MAX_DEVIATION && scene.log_scales[i].iter().all(|v| v.is_finite())) {
            return false;
        }
        let wide = deviation * extent_sigmas(extent::opacity_reach(self.rules, opacity));
        let position = DVec3::from_array(scene.positions[i].map(f64::from));
        let mut place = 0;
        while let Some(run) = self.runs.get(place) {
            if run.excludes(&self.planes, position, wide) {
                // The parts of a run see no more than the run itself.
                place = run.end;
            } else if run.shortest {
                return false;
            } else {
                place += 1;
            }
        }
        true
    }
}

impl PathRun {
    fn new(planes: &[CullPlane; 5], origin: DVec3, poses: &[Se3]) -> Self {
        let share = 1.0 / poses.len() as f64;
        let centre = poses.iter().map(|pose| pose.translation * share).sum::<DVec3>();
        let farthest = poses.iter().fold(origin.length(), |most, pose| most.max(pose.translation.length()));
        let face = |plane: &CullPlane| {
            let normals = || poses.iter().map(|pose| pose.rotation_matrix() * plane.normal);
            let normal = normals().map(|n| n * share).sum::<DVec3>();
            let turn = normals().map(|n| (n - normal).length()).fold(0.0, larger_or_nan);
            let shifts = normals().zip(poses).map(|(n, pose)| n.dot(centre - pose.translation));
            let shift = shifts.fold(f64::NEG_INFINITY, larger_or_nan);
            RunPlane { normal, turn: turn + ROUNDING, shift: shift + ROUNDING * farthest }
        };
        let [a, b, c, d, e] = planes;
        let faces = [face(a), face(b), face(c), face(d), face(e)];
        Self { centre: centre - origin, faces, shortest: true, end: 0 }
    }

    /// Returns true if none of the run's poses sees a Gaussian with this mean; `wide` is `k s`.
    fn excludes(&self, planes: &[CullPlane; 5], position: DVec3, wide: f64) -> bool {
        let from_centre = position - self.centre;
        let distance = from_centre.length();
        self.faces.iter().zip(planes).any(|(face, plane)| {
            let most = face.normal.dot(from_centre) + face.turn * distance + face.shift;
            most < plane.least - plane.spread * wide
        })
    }
}

/// The larger of the two; NaN if one is NaN, so that a pose that is not finite excludes nothing.
fn larger_or_nan(a: f64, b: f64) -> f64 {
    if a > b || a.is_nan() { a } else { b }
}
