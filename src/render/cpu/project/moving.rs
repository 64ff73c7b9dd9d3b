//! Gaussians that change: their rates in the projection of a block.
//!
//! Nothing here is inlined into the copies per instruction set: those of a still scene stay as small as they are. The bits
//! are the same.

use super::{LaneValue, ProjectedBlock};
use crate::render::RenderStyle;
use crate::render::cpu::activate::{BlockMotion, GaussianBlock, LANES};
use crate::render::cpu::eye::ViewTransform;
use crate::scene::dynamic::Rated;

impl<S: LaneValue> ProjectedBlock<S> {
    /// The means again and the covariances, with their rates.
    #[inline(never)]
    pub(super) fn outline_moving(
        &mut self,
        eye: &ViewTransform,
        style: RenderStyle,
        block: &GaussianBlock,
        motion: &BlockMotion,
    ) {
        self.locate_moving(eye, block, motion);
        let turned = |axes: [[f32; 3]; 3], i: usize| moving_axes(eye, axes, motion, i);
        if style.antialiased {
            self.shape::<true>(eye, style.rules, block, turned);
        } else {
            self.shape::<false>(eye, style.rules, block, turned);
        }
        self.fade(block, motion);
    }

    /// The harmonics in the directions of the drawn lanes, with the rates of the directions.
    #[inline(never)]
    pub(super) fn face_moving(
        &mut self,
        eye: &ViewTransform,
        motion: &BlockMotion,
        (degree, count): (u8, usize),
    ) {
        let mut velocities = [[0.0; 3]; LANES];
        for (k, to) in velocities.iter_mut().take(count).enumerate() {
            let i = usize::from(self.drawn[k]);
            *to = [motion.velocity[0][i], motion.velocity[1][i], motion.velocity[2][i]];
        }
        self.face_to(degree, count, |point, k| eye.direction_moving(point, velocities[k]));
    }

    /// The means again, with the rates of Gaussians that move.
    fn locate_moving(&mut self, eye: &ViewTransform, block: &GaussianBlock, motion: &BlockMotion) {
        let ([x, y, z], [u, v, w]) = (&block.positions, &motion.velocity);
        for i in 0..LANES {
            let point = eye.camera_from_world * eye.ray([x[i], y[i], z[i]]);
            let sight = eye.sight_moving::<S>(point, [u[i], v[i], w[i]]);
            sight.depth.put(&mut self.depth, i);
            for k in 0..2 {
                sight.mean[k].put(&mut self.mean[k], i);
                sight.slopes[k].put(&mut self.slopes[k], i);
            }
        }
    }

    /// Adds the rates of opacities that change. They scale as the opacities do.
    fn fade(&mut self, block: &GaussianBlock, motion: &BlockMotion) {
        for i in 0..LANES {
            let opacity = S::at(&self.opacity, i);
            // An opacity of 0 is not drawn.
            let share = if block.opacity[i] > 0.0 { motion.opacity[i] / block.opacity[i] } else { 0.0 };
            S::with_rate(opacity.value(), opacity.rate() + opacity.value() * share).put(&mut self.opacity, i);
        }
    }

    /// As [`Self::colour`], of coefficients that change.
    #[inline(never)]
    pub(super) fn changing_colour(&self, k: usize, coefficients: &[[Rated; 3]]) -> [S; 3] {
        let one = |channel: usize| {
            let mut sum = S::nearest(0.5);
            for (own, basis) in coefficients.iter().zip(&self.basis) {
                let [value, rate] = own[channel].map(|v| v as f32);
                sum = sum + S::with_rate(value, rate) * S::at(basis, k);
            }
            sum.at_least(S::nearest(0.0))
        };
        [one(0), one(1), one(2)]
    }
}

/// Scaled axes of a lane in camera axes, which change.
fn moving_axes<S: LaneValue>(
    eye: &ViewTransform,
    axes: [[f32; 3]; 3],
    motion: &BlockMotion,
    i: usize,
) -> [[S; 3]; 3] {
    let rate = |k: usize| [motion.axes[k][0][i], motion.axes[k][1][i], motion.axes[k][2][i]];
    [
        eye.turned_moving(axes[0], rate(0)),
        eye.turned_moving(axes[1], rate(1)),
        eye.turned_moving(axes[2], rate(2)),
    ]
}
