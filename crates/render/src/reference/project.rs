//! Projection of every Gaussian onto the image plane, with rates for a moving camera.

use super::D;
use super::parameters::RatedGaussian;
use crate::dual::{RealNumber, cross_product, dot_product};
use crate::shared::{
    AFFINE_DOUBTFUL, AFFINE_INVALID, COMPENSATION_FLOOR, DILATION, EXTENT_ROOT_FLOOR, EXTENT_SIGMAS,
    FRUSTUM_SLACK, GSPLAT_FAR, GSPLAT_NEAR, GSPLAT_SIGMAS, GSPLAT_SLACK, NEAR, TILE,
};
use crate::{RenderRules, RenderStyle};
use glam::{DMat3, DVec3};
use gs2e_scene::Gaussians;
use gs2e_scene::camera::view::CameraView;
use std::array::from_fn;
use std::ops::Range;

/// A Gaussian on the image plane.
#[derive(Debug, Clone)]
pub(super) struct ReferenceLayer {
    /// Sort key: the bits of the depth in 32 bits, then the index in the scene.
    pub(super) order: (u32, usize),
    pub(super) mean: [D; 2],
    /// `w1, w2, w3` of the Cholesky form.
    pub(super) w: [D; 3],
    pub(super) opacity: D,
    pub(super) colour: [D; 3],
    pub(super) depth: D,
    /// Velocity of the mean by itself, camera axes.
    pub(super) drift: DVec3,
    /// True if the Gaussian is too deep for its distance.
    pub(super) doubtful: bool,
    /// True if the Gaussian is far too deep for its distance.
    pub(super) invalid: bool,
    /// Pixels that it may touch under the rules.
    pub(super) columns: Range<usize>,
    pub(super) rows: Range<usize>,
}

/// The reason why a Gaussian makes no layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CullReason {
    Behind,
    Degenerate,
    Outside,
}

/// A view, prepared for the projection of many Gaussians.
pub(super) struct ReferenceView<'a> {
    view: &'a CameraView,
    camera_from_world: DMat3,
    origin: DVec3,
    style: RenderStyle,
}

impl<'a> ReferenceView<'a> {
    pub(super) fn new(view: &'a CameraView, style: RenderStyle, scene_origin: DVec3) -> Self {
        let camera_from_world = view.world_from_camera.rotation_matrix().transpose();
        Self { view, camera_from_world, origin: scene_origin - view.world_from_camera.translation, style }
    }

    /// The layer of Gaussian `i`, or the reason why it makes none.
    pub(super) fn layer(
        &self,
        scene: &Gaussians,
        i: usize,
        gaussian: &RatedGaussian,
    ) -> Result<ReferenceLayer, CullReason> {
        // Camera and scene origin are subtracted before anything is rotated. Far from the world's
        // origin, a difference of rotated positions would cancel.
        let from_camera: [D; 3] = from_fn(|k| D::constant(self.origin[k]) + gaussian.position[k]);
        let [x, y, z] = self.in_camera(from_camera, self.view.velocity.linear);
        // A depth that is NaN is in no range, so it counts as behind.
        if !self.in_depth(z.value) {
            return Err(CullReason::Behind);
        }
        let (u, v) = (x / z, y / z);
        let camera = self.view.camera;
        let mean = [
            D::constant(camera.fx) * u + D::constant(camera.cx),
            D::constant(camera.fy) * v + D::constant(camera.cy),
        ];
        let axes = gaussian.axes().map(|axis| self.in_camera(axis, DVec3::ZERO));
        let shape = self.shape(axes, [u, v], z);
        let opacity = self.opacity(gaussian.opacity(), &shape);
        // All back ends leave out what overflows in f32.
        let in_range = (shape.det.value as f32).is_finite() && shape.det.value > 0.0;
        if !(is_finite(scene, i) && in_range && mean.iter().all(|m| m.value.is_finite())) {
            return Err(CullReason::Degenerate);
        }
        // Under the published rules too, no pixel of it would be blended.
        if opacity.value < least_alpha(self.style.rules) {
            return Err(CullReason::Outside);
        }
        let [columns, rows] = self.extent(mean.map(|m| m.value), &shape, opacity.value);
        if columns.is_empty() || rows.is_empty() {
            return Err(CullReason::Outside);
        }
        let deep = axes.map(|axis| axis[2].value.powi(2)).iter().sum::<f64>().sqrt() / z.value;
        Ok(ReferenceLayer {
            // Rounded to 32 bits, so that depths tie here exactly where they tie in the other back
            // ends.
            order: ((z.value as f32).to_bits(), i),
            mean,
            w: shape.weights(),
            opacity,
            colour: gaussian.colour(scene.sh_degree, self.direction(from_camera)),
            depth: z,
            drift: self.camera_from_world * DVec3::from_array(gaussian.position.map(|x| x.rate)),
            doubtful: deep > f64::from(AFFINE_DOUBTFUL),
            invalid: deep > f64::from(AFFINE_INVALID),
            columns,
            rows,
        })
    }

    /// A vector in camera axes with its rate: that of the vector, and `-v - w x vector`. For a direction,
    /// `v` is 0.
    fn in_camera(&self, vector: [D; 3], linear: DVec3) -> [D; 3] {
        // A rotation is linear, so values and rates turn separately, and the values keep their bits.
        let turned = |part: fn(D) -> f64| self.camera_from_world * DVec3::from_array(vector.map(part));
        let value = turned(|v| v.value);
        let rate = turned(|v| v.rate) - linear - self.view.velocity.angular.cross(value);
        from_fn(|k| D { value: value[k], rate: rate[k] })
    }

    fn in_depth(&self, z: f64) -> bool {
        match self.style.rules {
            RenderRules::Gsplat => (f64::from(GSPLAT_NEAR)..=f64::from(GSPLAT_FAR)).contains(&z),
            RenderRules::Official | RenderRules::Exact | RenderRules::Soft => z > f64::from(NEAR),
        }
    }

    fn shape(&self, axes: [[D; 3]; 3], [u, v]: [D; 2], z: D) -> ImageCovariance {
        let camera = self.view.camera;
        let [uc, vc] = self.clamped([u, v]);
        let row = |focal: f64, clamped: D, k: usize| {
            axes.map(|axis| D::constant(focal) / z * (axis[k] - clamped * axis[2]))
        };
        let (a0, a1) = (row(camera.fx, uc, 0), row(camera.fy, vc, 1));
        let n = cross_product(a0, a1);
        let (aa, cc, det0) = (dot_product(a0, a0), dot_product(a1, a1), dot_product(n, n));
        let d = D::constant(f64::from(DILATION));
        let (a, b, c) = (aa + d, dot_product(a0, a1), cc + d);
        // `det` equals `a c - b^2` without its cancellation.
        ImageCovariance { a, b, c, det0, det: det0 + d * (aa + cc) + d * d }
    }

    /// The direction at which the projection's derivative is taken.
    fn clamped(&self, [u, v]: [D; 2]) -> [D; 2] {
        let camera = self.view.camera;
        let side = |slope: D, edge: u32, focal: f64, centre: f64| {
            let edge = f64::from(edge);
            let slack = FRUSTUM_SLACK * edge / (2.0 * focal);
            match self.style.rules {
                RenderRules::Gsplat => {
                    let more = GSPLAT_SLACK * edge / focal;
                    slope.clamp(-(centre / focal + more), (edge - centre) / focal + more)
                }
                RenderRules::Official | RenderRules::Exact | RenderRules::Soft => slope.clamp(-slack, slack),
            }
        };
        let size = camera.size;
        [side(u, size.width, camera.fx, camera.cx), side(v, size.height, camera.fy, camera.cy)]
    }

    fn opacity(&self, opacity: D, shape: &ImageCovariance) -> D {
        if !self.style.antialiased {
            return opacity;
        }
        opacity * (shape.det0 / shape.det).clamp(f64::from(COMPENSATION_FLOOR), f64::INFINITY).sqrt()
    }

    /// The unit direction from the camera, in world axes.
    fn direction(&self, from_camera: [D; 3]) -> [D; 3] {
        // A fixed point moves against the camera. In world axes, the camera's rotation has no part
        // in it.
        let rate = -(self.view.world_from_camera.rotation * self.view.velocity.linear);
        let ray: [D; 3] = from_fn(|k| from_camera[k] + D { value: 0.0, rate: rate[k] });
        let length = dot_product(ray, ray).sqrt();
        ray.map(|r| r / length)
    }

    /// Columns and rows that a Gaussian may touch under the rules, without those where it is below
    /// the smallest opacity.
    fn extent(&self, mean: [f64; 2], shape: &ImageCovariance, opacity: f64) -> [Range<usize>; 2] {
        let size = [self.view.camera.size.width, self.view.camera.size.height].map(f64::from);
        let (a, c) = (shape.a.value, shape.c.value);
        let least = least_alpha(self.style.rules);
        let reach = (2.0 * libm::log((opacity / least).max(1.0))).sqrt();
        let tile = TILE as f64;
        let side = |k: usize, variance: f64| {
            // The bounding box of the ellipse, with a margin for rounding.
            let half = reach * variance.sqrt() * (1.0 + 1e-9) + 1e-9;
            let [low, high] = [(mean[k] - half - 0.5).ceil(), (mean[k] + half + 0.5).floor()];
            let [first, end] = match self.style.rules {
                RenderRules::Official => {
                    let mid = 0.5 * (a + c);
                    let root = (mid * mid - shape.det.value).max(f64::from(EXTENT_ROOT_FLOOR)).sqrt();
                    let radius = (f64::from(EXTENT_SIGMAS) * (mid + root).sqrt()).ceil();
                    // The published program counts pixels by their index: the centre of pixel 0 is
                    // at 0.
                    let index = mean[k] - 0.5;
                    [(index - radius) / tile, (index + radius + tile - 1.0) / tile].map(|t| t.trunc() * tile)
                }
                RenderRules::Gsplat => {
                    let radius = (reach.min(f64::from(GSPLAT_SIGMAS)) * variance.sqrt()).ceil();
                    [((mean[k] - radius) / tile).floor() * tile, ((mean[k] + radius) / tile).ceil() * tile]
                }
                RenderRules::Exact | RenderRules::Soft => [low, high],
            };
            touched_range(first.max(low), end.min(high), size[k])
        };
        [side(0, a), side(1, c)]
    }
}

/// A dilated covariance on the image, px^2.
struct ImageCovariance {
    a: D,
    b: D,
    c: D,
    det0: D,
    det: D,
}

impl ImageCovariance {
    fn weights(&self) -> [D; 3] {
        let root = self.c.sqrt();
        // `w2` has two quotients, because the product `c det` could overflow.
        [(self.c / self.det).sqrt(), -(self.b / root / self.det.sqrt()), D::constant(1.0) / root]
    }
}

/// Opacity below which a layer is skipped, in f64.
pub(super) fn least_alpha(rules: RenderRules) -> f64 {
    match rules {
        RenderRules::Official | RenderRules::Exact | RenderRules::Gsplat => 1.0 / 255.0,
        RenderRules::Soft => 0.5 / 255.0,
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to the image, whose edges fit"
)]
fn touched_range(first: f64, end: f64, edge: f64) -> Range<usize> {
    first.clamp(0.0, edge) as usize..end.clamp(0.0, edge) as usize
}

fn is_finite(scene: &Gaussians, i: usize) -> bool {
    let all = |values: &[f32]| values.iter().all(|v| v.is_finite());
    all(&scene.positions[i])
        && all(&scene.log_scales[i])
        && all(&scene.rotations[i])
        && scene.opacity_logits[i].is_finite()
        && all(scene.sh_of(i).as_flattened())
}
