//! The view transform: projection of a point and of an ellipsoid. Positions are `f64` up to camera
//! coordinates, so that scenes far from the world's origin lose no precision; from there on, stable
//! forms in `f32`.
//!
//! # Examples
//!
//! ```
//! # use gs2e_image::Size;
//! use gs2e_render::{RenderRules, cpu::eye::slope_bounds};
//! use gs2e_scene::camera::Camera;
//!
//! let camera = Camera::pinhole(Size { width: 64, height: 48 }, [100.0, 100.0, 32.0, 24.0]);
//! let [[left, right], [top, bottom]] = slope_bounds(&camera, RenderRules::Exact);
//! // 1.3 times the slopes at the edges of the picture, which are 0.32 and 0.24.
//! assert!((right - 1.3 * 0.32).abs() < 1e-12 && (bottom - 1.3 * 0.24).abs() < 1e-12);
//! assert_eq!([left, top], [-right, -bottom]);
//! ```

#![expect(clippy::cast_possible_truncation, reason = "positions become f32 once they are camera coordinates")]

use crate::RenderRules;
use crate::dual::{RealNumber, cross_product, dot_product};
use crate::shared::{DILATION, FRUSTUM_SLACK, GSPLAT_SLACK};
use glam::{DMat3, DVec3};
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::{CameraVelocity, CameraView};

/// `sqrt(log2(e) / 2)`. Scaling by it turns `exp(-x^2 / 2)` into `2^-x^2`.
const TO_BINARY: f32 = 0.849_321_8;

/// A view, prepared for the projection of many Gaussians.
#[derive(Debug, Clone, Copy)]
pub(super) struct ViewTransform {
    pub(super) camera_from_world: DMat3,
    /// `camera_from_world`, rounded to `f32`, by rows.
    pub(super) rows: [[f32; 3]; 3],
    /// The scene's local origin minus the camera's centre, in world axes.
    origin: DVec3,
    pub(super) focal: [f64; 2],
    centre: [f64; 2],
    /// [`slope_bounds`] of the camera.
    pub(super) slack: [[f64; 2]; 2],
    /// Size of the image, px.
    pub(super) size: [f32; 2],
    /// Velocity of the camera, in its own axes.
    velocity: CameraVelocity,
    /// Angular velocity, rounded to `f32`.
    turning: [f32; 3],
    /// Rate of the ray from the camera to any fixed point: world axes, units per second.
    ray_rate: DVec3,
}

/// Bounds of `x / z`, then of `y / z`, at which the derivative of the projection is taken.
pub fn slope_bounds(camera: &Camera, rules: RenderRules) -> [[f64; 2]; 2] {
    let along = |focal: f64, centre: f64, edge: u32| match rules {
        RenderRules::Official | RenderRules::Exact | RenderRules::Soft => {
            // The published bounds are symmetric about the optical axis: they know no principal
            // point.
            let most = FRUSTUM_SLACK * f64::from(edge) / (2.0 * focal);
            [-most, most]
        }
        RenderRules::Gsplat => {
            let size = f64::from(edge);
            let more = GSPLAT_SLACK * size / focal;
            [-(centre / focal + more), (size - centre) / focal + more]
        }
    };
    [along(camera.fx, camera.cx, camera.size.width), along(camera.fy, camera.cy, camera.size.height)]
}

impl ViewTransform {
    /// Prepares the view of a scene with positions relative to `origin`.
    pub(super) fn new(view: &CameraView, origin: DVec3, rules: RenderRules) -> Self {
        let camera = view.camera;
        let camera_from_world = view.world_from_camera.rotation_matrix().transpose();
        let size = [camera.size.width, camera.size.height].map(f64::from);
        let (focal, centre) = ([camera.fx, camera.fy], [camera.cx, camera.cy]);
        Self {
            camera_from_world,
            rows: [0, 1, 2].map(|k| camera_from_world.row(k).as_vec3().to_array()),
            origin: origin - view.world_from_camera.translation,
            focal,
            centre,
            slack: slope_bounds(&camera, rules),
            size: size.map(|v| v as f32),
            velocity: view.velocity,
            turning: view.velocity.angular.as_vec3().to_array(),
            ray_rate: -(view.world_from_camera.rotation * view.velocity.linear),
        }
    }
}

/// The dilated covariance `[[a, b], [b, c]]` of a Gaussian on the image, px^2, and related values.
#[derive(Debug, Clone, Copy)]
pub(super) struct SplatCovariance<S> {
    /// Variance along x.
    pub(super) a: S,
    /// Covariance.
    pub(super) b: S,
    /// Variance along y.
    pub(super) c: S,
    /// Determinant of the dilated covariance.
    pub(super) det: S,
    /// Determinant before dilation.
    pub(super) det0: S,
    /// Standard deviation of depth, scene units.
    pub(super) depth_deviation: f32,
}

impl<S: RealNumber<Plain = f32>> SplatCovariance<S> {
    /// `w1, w2, w3` of a splat. `w2` is computed as `-(b / c) w1`, because the product `c det` of
    /// `-b / sqrt(c det)` could overflow.
    #[inline(always)]
    pub(super) fn weights(&self) -> [S; 3] {
        let to_binary = S::with_rate(TO_BINARY, 0.0);
        let w1 = (self.c / self.det).sqrt() * to_binary;
        [w1, -(self.b / self.c) * w1, to_binary / self.c.sqrt()]
    }
}

/// The projection of a Gaussian's mean.
pub(super) struct ProjectedMean<S> {
    pub(super) depth: S,
    /// Position on the image, px.
    pub(super) mean: [S; 2],
    /// `x / z` and `y / z`, clamped, at which the derivative of the projection is taken.
    pub(super) slopes: [S; 2],
}

impl ViewTransform {
    /// The vector from the camera's centre to a point relative to the scene's origin, in world
    /// axes.
    #[inline(always)]
    pub(super) fn ray(&self, [x, y, z]: [f32; 3]) -> DVec3 {
        self.origin + DVec3::new(x.into(), y.into(), z.into())
    }

    /// The projection of a point in camera axes. While the camera moves, `qdot = -v - w x q`.
    #[inline(always)]
    pub(super) fn sight<S: RealNumber<Plain = f32>>(&self, point: DVec3) -> ProjectedMean<S> {
        self.sight_at_rate(point, -self.velocity.linear - self.velocity.angular.cross(point))
    }

    /// As [`Self::sight`], of a point with a velocity of its own in world axes.
    #[inline(always)]
    pub(super) fn sight_changing<S: RealNumber<Plain = f32>>(
        &self,
        point: DVec3,
        velocity: [f32; 3],
    ) -> ProjectedMean<S> {
        let still = -self.velocity.linear - self.velocity.angular.cross(point);
        self.sight_at_rate(point, still + self.camera_from_world * wide(velocity))
    }

    #[inline(always)]
    fn sight_at_rate<S: RealNumber<Plain = f32>>(&self, point: DVec3, rate: DVec3) -> ProjectedMean<S> {
        let (u, v) = (point.x / point.z, point.y / point.z);
        let (u_rate, v_rate) = ((rate.x - u * rate.z) / point.z, (rate.y - v * rate.z) / point.z);
        ProjectedMean {
            depth: S::with_rate(point.z as f32, rate.z as f32),
            mean: [self.mean(0, u, u_rate), self.mean(1, v, v_rate)],
            slopes: [self.clamped(0, u, u_rate), self.clamped(1, v, v_rate)],
        }
    }

    #[inline(always)]
    fn mean<S: RealNumber<Plain = f32>>(&self, k: usize, slope: f64, rate: f64) -> S {
        S::with_rate((self.focal[k] * slope + self.centre[k]) as f32, (self.focal[k] * rate) as f32)
    }

    #[inline(always)]
    fn clamped<S: RealNumber<Plain = f32>>(&self, k: usize, slope: f64, rate: f64) -> S {
        let [low, high] = self.slack[k];
        // `&` and selections instead of `&&` and branches keep the loop over lanes vector code.
        let inside = (low < slope) & (slope < high);
        // `f64::clamp` without its check of the bounds.
        let slope = if slope < low { low } else { slope };
        let slope = if slope > high { high } else { slope };
        S::with_rate(slope as f32, if inside { rate as f32 } else { 0.0 })
    }

    /// The covariance on the image of a Gaussian with these scaled axes, in camera axes.
    #[inline(always)]
    pub(super) fn footprint<S: RealNumber<Plain = f32>>(
        &self,
        slopes: [S; 2],
        depth: S,
        [m0, m1, m2]: [[S; 3]; 3],
    ) -> SplatCovariance<S> {
        let along = [m0[2], m1[2], m2[2]];
        // Rows of the projection's derivative times the axes. In the Gaussian's own axes, the cross
        // product that gives the determinant does not cancel, which matters for needles.
        let scale = |k: usize| S::with_rate(self.focal[k] as f32, 0.0) / depth;
        let (s0, s1) = (scale(0), scale(1));
        let a0 = [
            derivative_entry(s0, slopes[0], m0, 0),
            derivative_entry(s0, slopes[0], m1, 0),
            derivative_entry(s0, slopes[0], m2, 0),
        ];
        let a1 = [
            derivative_entry(s1, slopes[1], m0, 1),
            derivative_entry(s1, slopes[1], m1, 1),
            derivative_entry(s1, slopes[1], m2, 1),
        ];
        let n = cross_product(a0, a1);
        let (aa, cc, det0) = (dot_product(a0, a0), dot_product(a1, a1), dot_product(n, n));
        let d = S::with_rate(DILATION, 0.0);
        let depth_deviation = dot_product(along, along).value().sqrt();
        SplatCovariance {
            a: aa + d,
            b: dot_product(a0, a1),
            c: cc + d,
            // `a c - b^2` as a sum of positive terms: the difference would cancel for a needle.
            det: det0 + d * (aa + cc) + d * d,
            det0,
            depth_deviation,
        }
    }

    /// A world direction in camera axes. It turns against the camera.
    #[inline(always)]
    pub(super) fn turned<S: RealNumber<Plain = f32>>(&self, axis: [f32; 3]) -> [S; 3] {
        let in_camera = [
            dot_product(self.rows[0], axis),
            dot_product(self.rows[1], axis),
            dot_product(self.rows[2], axis),
        ];
        // `seen x w` is `-w x seen`.
        let rate = cross_product(in_camera, self.turning);
        [
            S::with_rate(in_camera[0], rate[0]),
            S::with_rate(in_camera[1], rate[1]),
            S::with_rate(in_camera[2], rate[2]),
        ]
    }

    /// As [`Self::turned`], of a vector that changes at a rate in world axes.
    #[inline(always)]
    pub(super) fn turned_changing<S: RealNumber<Plain = f32>>(
        &self,
        axis: [f32; 3],
        rate: [f32; 3],
    ) -> [S; 3] {
        let still: [S; 3] = self.turned(axis);
        let own = |k: usize| dot_product(self.rows[k], rate);
        let with = |k: usize| S::with_rate(still[k].value(), still[k].rate() + own(k));
        [with(0), with(1), with(2)]
    }

    /// The direction from the camera to a point. Only the component of the rate across the ray
    /// turns it.
    #[inline(always)]
    pub(super) fn direction<S: RealNumber<Plain = f32>>(&self, point: [f32; 3]) -> [S; 3] {
        self.direction_at_rate(point, self.ray_rate)
    }

    /// As [`Self::direction`], to a point with a velocity of its own.
    #[inline(always)]
    pub(super) fn direction_changing<S: RealNumber<Plain = f32>>(
        &self,
        point: [f32; 3],
        velocity: [f32; 3],
    ) -> [S; 3] {
        self.direction_at_rate(point, self.ray_rate + wide(velocity))
    }

    #[inline(always)]
    fn direction_at_rate<S: RealNumber<Plain = f32>>(&self, point: [f32; 3], rate: DVec3) -> [S; 3] {
        let ray = self.ray(point);
        let direction = ray.normalize();
        let turning = (rate - direction * direction.dot(rate)) / ray.length();
        [
            S::with_rate(direction.x as f32, turning.x as f32),
            S::with_rate(direction.y as f32, turning.y as f32),
            S::with_rate(direction.z as f32, turning.z as f32),
        ]
    }
}

#[inline(always)]
fn wide([x, y, z]: [f32; 3]) -> DVec3 {
    DVec3::new(x.into(), y.into(), z.into())
}

/// An entry of a row of the projection's derivative times one axis.
#[inline(always)]
fn derivative_entry<S: RealNumber<Plain = f32>>(scale: S, slope: S, axis: [S; 3], k: usize) -> S {
    scale * (axis[k] - slope * axis[2])
}
