//! The picture of one Gaussian, in slopes `x/z` and `y/z`.

use crate::RenderRules;
use crate::cpu::eye::slope_bounds;
use crate::shared::{DILATION, NEAR};
use glam::{DMat3, DQuat, DVec2, DVec3};
use gs2e_num::se3::Se3;
use gs2e_scene::Gaussians;
use gs2e_scene::camera::Camera;
use std::f64::consts::TAU;

/// A camera at a pose.
pub(super) struct NearEye<'a> {
    pub(super) camera: &'a Camera,
    pub(super) rules: RenderRules,
    pub(super) world_from_camera: Se3,
}

/// A Gaussian as an ellipse.
pub(super) struct Footprint {
    opacity: f64,
    /// Depth of its mean, scene units.
    pub(super) depth: f64,
    /// The covariance `a b c`.
    covariance: [f64; 3],
    /// Corners of the picture, relative to the mean.
    low: DVec2,
    high: DVec2,
}

impl NearEye<'_> {
    /// The footprint of Gaussian `i`. Nearer than the near plane, it is that of the plane's depth.
    pub(super) fn footprint(&self, scene: &Gaussians, i: usize) -> Footprint {
        let Se3 { rotation, translation } = self.world_from_camera;
        let turn = DMat3::from_quat(rotation.conjugate());
        let in_camera = turn * (scene.position(i) - translation);
        let depth = in_camera.z.max(NEAR.into());
        let slope = in_camera.truncate() / depth;
        let [across, down] = slope_bounds(self.camera, self.rules);
        let clamped = DVec2::new(slope.x.clamp(across[0], across[1]), slope.y.clamp(down[0], down[1]));
        let axes = (turn * scaled_axes(scene, i)).to_cols_array_2d();
        let rows = axes.map(|[x, y, z]| DVec2::new(x - clamped.x * z, y - clamped.y * z) / depth);
        let sum = |of: fn(DVec2) -> f64| rows.into_iter().map(of).sum::<f64>();
        // The dilation is stated in pixels, and a slope is a pixel over the focal length.
        let [wide, high] = [self.camera.fx, self.camera.fy].map(|focal| f64::from(DILATION) / focal.powi(2));
        let covariance = [sum(|r| r.x * r.x) + wide, sum(|r| r.x * r.y), sum(|r| r.y * r.y) + high];
        let [low, high] = self.camera.field().map(|corner| corner - slope);
        let opacity = 1.0 / (1.0 + libm::exp(-f64::from(scene.opacity_logits[i])));
        Footprint { opacity, depth: in_camera.z, covariance, low, high }
    }
}

/// The axes of a Gaussian in the world, scaled by its standard deviations.
fn scaled_axes(scene: &Gaussians, i: usize) -> DMat3 {
    let [w, x, y, z] = scene.rotations[i].map(f64::from);
    let rotation = DQuat::from_xyzw(x, y, z, w);
    let rotation = if rotation.length() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY };
    let scales = scene.log_scales[i].map(|log| libm::exp(log.into()));
    DMat3::from_quat(rotation) * DMat3::from_diagonal(DVec3::from_array(scales))
}

impl Footprint {
    /// The largest opacity within the picture.
    pub(super) fn peak(&self) -> f64 {
        self.opacity * libm::exp(-0.5 * self.least_square())
    }

    /// An estimate of the share of the picture's light that the Gaussian makes or takes.
    pub(super) fn cover(&self) -> f64 {
        let [a, b, c] = self.covariance;
        let sides = self.high - self.low;
        // The volume under a Gaussian with a peak of 1 is `2 pi` times the root of its determinant.
        let area = TAU * (a * c - b * b).max(0.0).sqrt() / (sides.x * sides.y);
        self.peak() * area.min(1.0)
    }

    /// The least squared distance from the mean to the picture, in standard deviations.
    fn least_square(&self) -> f64 {
        let Self { covariance: [a, b, c], low, high, .. } = *self;
        let det = a * c - b * b;
        if DVec2::ZERO.clamp(low, high) == DVec2::ZERO || det.is_nan() || det <= 0.0 {
            return 0.0;
        }
        let square = |x: f64, y: f64| (c * x * x - 2.0 * b * x * y + a * y * y) / det;
        // On a line of one x, the least is at y = b x / a. The mean is outside, so the least is on an edge.
        let on_x = [low.x, high.x].map(|x| square(x, (b * x / a).clamp(low.y, high.y)));
        let on_y = [low.y, high.y].map(|y| square((b * y / c).clamp(low.x, high.x), y));
        on_x.into_iter().chain(on_y).fold(f64::INFINITY, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The least over a fine grid of the picture bounds the result from above, by the width of a cell.
    #[test]
    fn the_nearest_point_of_the_picture_is_no_worse_than_any_of_a_grid() {
        let corners =
            [[0.3, -1.0, 1.4, 0.9], [-0.5, 0.2, 0.4, 0.7], [0.4, 0.3, 1.0, 0.8], [-2.0, -3.0, -1.0, -2.0]];
        for [x0, y0, x1, y1] in corners {
            let (low, high) = (DVec2::new(x0, y0), DVec2::new(x1, y1));
            let covariance = [0.5, -0.3, 0.4];
            let footprint = Footprint { opacity: 1.0, depth: 1.0, covariance, low, high };
            let inverse = glam::DMat2::from_cols_array(&[0.5, -0.3, -0.3, 0.4]).inverse();
            let place =
                |k: usize| low + (high - low) * DVec2::new((k % 201) as f64, (k / 201) as f64) / 200.0;
            let square = |at: DVec2| at.dot(inverse * at);
            let least = (0..201 * 201).map(|k| square(place(k))).fold(f64::INFINITY, f64::min);
            let found = footprint.least_square();
            assert!(found <= least + 1e-12 && least - found < 0.1, "{found} {least}");
        }
    }
}
