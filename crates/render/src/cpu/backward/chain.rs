//! From the moments of a splat to the gradients of its Gaussian: the projection backwards.
//!
//! With `W` the Cholesky form of the splat, `ln alpha = ln o - ln 2 |W d|^2` and
//! `Sigma^-1 = 2 ln 2 W^T W`, so with the moments of `e = W d`
//!
//! ```text
//! dL/dmean  = 2 ln 2 W^T (sum a e)
//! dL/dSigma = 2 (ln 2)^2 W^T (sum a e e^T) W
//! ```
//!
//! The covariance goes back through the rows `a0, a1` of the projection's derivative times the
//! scaled axes, as the forward pass computes it (`eye.rs`): no entry of the covariance is divided by
//! its determinant. The clamp of the derivative's slopes, the floor of the antialiased rule, the cap
//! of the opacity and the clamp of a colour at 0 are constant where they hold.
//!
//! Written over [`RealNumber`]: in 64 bits, the tests hold the formulas against dual numbers without the
//! rounding of 32 bits.

use super::GaussianGradient;
use super::raster::SplatMoments;
use crate::cpu::activate;
use crate::cpu::activate::ActivatedGaussian;
use crate::cpu::eye::ViewTransform;
use crate::cpu::splat::Splat;
use crate::dual::{RealNumber, cross_product, dot_product};
use crate::shared::{COMPENSATION_FLOOR, DILATION};
use gs2e_scene::{Gaussians, sh};
use std::f64::consts::LN_2;

/// The Gaussians of a view, as the forward pass projected them.
#[derive(Debug, Clone, Copy)]
pub(super) struct ProjectionChain<'a> {
    pub(super) scene: &'a Gaussians,
    pub(super) eye: ViewTransform,
    pub(super) sh_degree: u8,
    pub(super) antialiased: bool,
}

/// A drawn Gaussian, as the forward pass activated and projected it.
#[derive(Debug, Clone, Copy)]
pub(super) struct DrawnGaussian<S> {
    /// World directions of its axes, scaled by the standard deviations.
    pub(super) axes: [[S; 3]; 3],
    /// Opacity at the mean, without the factor of the antialiased rule.
    pub(super) opacity: S,
    /// `w1, w2, w3` of the splat, 1/px.
    pub(super) w: [S; 3],
    /// True for each colour above 0.
    pub(super) lit: [bool; 3],
}

impl DrawnGaussian<f32> {
    /// Takes what the gradients need.
    pub(super) fn new(active: &ActivatedGaussian, splat: &Splat) -> Self {
        let lit = [0, 1, 2].map(|c| splat.features[c] > 0.0);
        Self { axes: active.axes, opacity: active.opacity, w: splat.w, lit }
    }
}

/// An array of three values. The array functions of the standard library may stay calls.
#[inline(always)]
fn three<S>(value: impl Fn(usize) -> S) -> [S; 3] {
    [value(0), value(1), value(2)]
}

/// `dL` by the entries of the covariance: `dL = xx dSxx + 2 xy dSxy + yy dSyy`.
struct CovarianceGradient<S> {
    xx: S,
    xy: S,
    yy: S,
}

impl<S: RealNumber<Plain = S>> CovarianceGradient<S> {
    fn new([w1, w2, w3]: [S; 3], [m11, m12, m22]: [S; 3]) -> Self {
        let two = S::nearest(2.0);
        let k = two * S::nearest(LN_2) * S::nearest(LN_2);
        Self {
            xx: k * w1 * w1 * m11,
            xy: k * w1 * (w2 * m11 + w3 * m12),
            yy: k * (w2 * w2 * m11 + two * w2 * w3 * m12 + w3 * w3 * m22),
        }
    }
}

impl ProjectionChain<'_> {
    /// The gradients of Gaussian `i`.
    pub(super) fn gradient<S: RealNumber<Plain = S>>(
        &self,
        i: usize,
        drawn: &DrawnGaussian<S>,
        moments: &SplatMoments<S>,
    ) -> GaussianGradient<S> {
        let eye = &self.eye;
        // In 64 bits until the slopes are known, as in the forward pass: far from the origin, the
        // difference of a position and the camera's centre loses most digits of 32.
        let ray = eye.ray(self.scene.positions[i]);
        let point = eye.camera_from_world * ray;
        let slopes = [point.x / point.z, point.y / point.z];
        let depth = S::nearest(point.z);
        let on_image = self.image_gradient(slopes, depth, drawn, moments);
        // Moving the point by d changes u = x/z by (dx - u dz) / z.
        let [du, dv] = on_image.slopes;
        let [u, v] = slopes.map(S::nearest);
        let in_camera = [du / depth, dv / depth, on_image.depth - (du * u + dv * v) / depth];
        let direction = ray.normalize().to_array().map(S::nearest);
        // A colour that the clamp holds at 0 does not follow a small change.
        let colour = moments.colour();
        let colour = three(|c| if drawn.lit[c] { colour[c] } else { S::nearest(0.0) });
        let turned = self.direction_gradient(i, direction, colour);
        let length = S::nearest(ray.length());
        // Only the component across the ray turns it.
        let along = dot_product(direction, turned);
        let position = self.world_gradient(in_camera);
        let [a, b, c] = on_image.axes;
        let axes = [self.world_gradient(a), self.world_gradient(b), self.world_gradient(c)];
        GaussianGradient {
            position: three(|k| position[k] + (turned[k] - direction[k] * along) / length),
            // A scaled axis is a column of the rotation times `exp(log scale)`, and so its own
            // derivative.
            log_scale: three(|k| dot_product(axes[k], drawn.axes[k])),
            rotation: activate::rotation_gradient(self.scene.rotations[i], drawn.axes, axes),
            // `d ln o / d logit = 1 - o` for `o = 1 / (1 + exp(-logit))`: exact where `o` nearly
            // vanishes, unlike a quotient of small numbers.
            logit: moments.total() * (S::nearest(1.0) - drawn.opacity),
            colour,
            direction,
            score: moments.score(),
        }
    }

    /// The rows of the view's rotation: they turn world axes into camera axes.
    fn rows<S: RealNumber<Plain = S>>(&self) -> [[S; 3]; 3] {
        three(|k| self.eye.camera_from_world.row(k).to_array().map(S::nearest))
    }

    /// A gradient by camera axes as one by world axes.
    fn world_gradient<S: RealNumber<Plain = S>>(&self, g: [S; 3]) -> [S; 3] {
        // Gradients go back by the transpose: the rows of the view weigh its columns.
        let rows = self.rows::<S>();
        three(|k| rows[0][k] * g[0] + rows[1][k] * g[1] + rows[2][k] * g[2])
    }

    /// From the image plane to slopes, depth and scaled axes, in camera axes.
    fn image_gradient<S: RealNumber<Plain = S>>(
        &self,
        slopes: [f64; 2],
        depth: S,
        drawn: &DrawnGaussian<S>,
        moments: &SplatMoments<S>,
    ) -> ImageGradient<S> {
        let eye = &self.eye;
        let [w1, w2, w3] = drawn.w;
        let [v1, v2] = moments.first();
        let binary = S::nearest(2.0 * LN_2);
        let mean = [binary * w1 * v1, binary * (w2 * v1 + w3 * v2)];
        let focal = eye.focal.map(S::nearest);
        // The forward pass clamps the slopes in the derivative of the projection only. The position
        // of the splat keeps the slopes as they are.
        let clamp = |k: usize| S::nearest(slopes[k].clamp(eye.slack[k][0], eye.slack[k][1]));
        let clamped = [clamp(0), clamp(1)];
        let scale = [focal[0] / depth, focal[1] / depth];
        let view_rows = self.rows::<S>();
        let turned = |n: usize| three(|k| dot_product(view_rows[k], drawn.axes[n]));
        let axes = [turned(0), turned(1), turned(2)];
        let row = |k: usize| three(|n| scale[k] * (axes[n][k] - clamped[k] * axes[n][2]));
        let rows = [row(0), row(1)];
        let mut by_rows = CovarianceGradient::new(drawn.w, moments.second()).by_rows(rows);
        if self.antialiased {
            let more = compensation_gradient(rows, moments.total());
            by_rows = [three(|k| by_rows[0][k] + more[0][k]), three(|k| by_rows[1][k] + more[1][k])];
        }
        let along = three(|n| axes[n][2]);
        let by_slope = |k: usize| {
            // At its bound, the slope of the derivative is constant.
            let free = eye.slack[k][0] < slopes[k] && slopes[k] < eye.slack[k][1];
            let clamped = if free { -scale[k] * dot_product(by_rows[k], along) } else { S::nearest(0.0) };
            focal[k] * mean[k] + clamped
        };
        // Both rows are proportional to 1 / depth, so the derivative by depth is minus their share
        // over it.
        let shrink = dot_product(by_rows[0], rows[0]) + dot_product(by_rows[1], rows[1]);
        let axis = |k: usize| {
            let [x, y] = [scale[0] * by_rows[0][k], scale[1] * by_rows[1][k]];
            [x, y, -(clamped[0] * x + clamped[1] * y)]
        };
        ImageGradient {
            slopes: [by_slope(0), by_slope(1)],
            depth: -shrink / depth,
            axes: [axis(0), axis(1), axis(2)],
        }
    }

    /// `dL` by the direction of view. `colour` is `dL` by the colour before its clamp at 0.
    fn direction_gradient<S: RealNumber<Plain = S>>(
        &self,
        i: usize,
        direction: [S; 3],
        colour: [S; 3],
    ) -> [S; 3] {
        let mut weights = [S::nearest(0.0); sh::MAX_LEN];
        let coefficients = &self.scene.sh_of(i)[..sh::function_count(self.sh_degree)];
        for (weight, coefficients) in weights.iter_mut().zip(coefficients) {
            *weight = dot_product(three(|c| S::nearest(coefficients[c].into())), colour);
        }
        sh::direction_gradient(self.sh_degree, direction, &weights)
    }
}

impl<S: RealNumber<Plain = S>> CovarianceGradient<S> {
    /// `dL` by the rows `a0, a1`: the covariance is `a0.a0, a0.a1, a1.a1` and the dilation.
    fn by_rows(&self, [a0, a1]: [[S; 3]; 2]) -> [[S; 3]; 2] {
        // The factor is that of a square on the diagonal, and that of the two equal entries off it.
        let two = S::nearest(2.0);
        [
            three(|k| two * (self.xx * a0[k] + self.xy * a1[k])),
            three(|k| two * (self.xy * a0[k] + self.yy * a1[k])),
        ]
    }
}

/// `dL` by slopes, depth and scaled axes.
struct ImageGradient<S> {
    slopes: [S; 2],
    depth: S,
    axes: [[S; 3]; 3],
}

/// `dL` by the rows through the factor of the antialiased rule, `sqrt(det0 / det)`, with `total` =
/// `dL/d ln opacity`. With `n = a0 x a1`: `det0 = |n|^2`, `det = det0 + 0.3 (|a0|^2 + |a1|^2) +
/// 0.09`, so nothing cancels where the undilated determinant nearly vanishes.
fn compensation_gradient<S: RealNumber<Plain = S>>([a0, a1]: [[S; 3]; 2], total: S) -> [[S; 3]; 2] {
    let [half, one, two, d] = [0.5, 1.0, 2.0, f64::from(DILATION)].map(S::nearest);
    let n = cross_product(a0, a1);
    let det0 = dot_product(n, n);
    let det = det0 + d * (dot_product(a0, a0) + dot_product(a1, a1)) + d * d;
    // At its floor the factor is constant.
    if det0 / det <= S::nearest(COMPENSATION_FLOOR.into()) {
        return [[S::nearest(0.0); 3]; 2];
    }
    // Half of `d ln det0 - d ln det`, by `det0` and by the sum of squares. In logarithms, because a
    // needle's `det0` is the square of a small number, whose own derivative would lose its digits.
    let by_det0 = half * total * (one / det0 - one / det);
    let by_squares = -half * total * d / det;
    // `det0 = |a0 x a1|^2` changes by `2 (a1 x n)` along `a0` and by `2 (n x a0)` along `a1`.
    let (n0, n1) = (cross_product(a1, n), cross_product(n, a0));
    [
        three(|k| two * (by_det0 * n0[k] + by_squares * a0[k])),
        three(|k| two * (by_det0 * n1[k] + by_squares * a1[k])),
    ]
}
