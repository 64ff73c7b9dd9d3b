//! Gaussians that change: their rates in the projection of a block.
//!
//! Nothing here is inlined into the copies per instruction set: those of a still scene stay as small as they
//! are. The bits are the same.

use super::{LaneMotion, LaneValue, ProjectedBlock};
use crate::RenderStyle;
use crate::cpu::activate::{BlockMotion, GaussianBlock, LANES};
use crate::cpu::eye::ViewTransform;
use gs2e_scene::dynamic::Rated;

impl<S: LaneValue> ProjectedBlock<S> {
    /// The means again and the covariances, with their rates.
    #[inline(never)]
    pub(super) fn outline_changing(
        &mut self,
        eye: &ViewTransform,
        style: RenderStyle,
        block: &GaussianBlock,
        motion: &BlockMotion,
    ) {
        self.locate_changing(eye, block, motion);
        let moving = ChangingGaussians { motion, drawn: self.drawn };
        if style.antialiased {
            self.shape::<_, true>(eye, style.rules, block, moving);
        } else {
            self.shape::<_, false>(eye, style.rules, block, moving);
        }
        self.fade(block, motion);
    }

    /// The harmonics in the directions of the drawn lanes, with the rates of the directions.
    #[inline(never)]
    pub(super) fn face_changing(
        &mut self,
        eye: &ViewTransform,
        motion: &BlockMotion,
        degree: u8,
        count: usize,
    ) {
        self.face_to(eye, degree, count, ChangingGaussians { motion, drawn: self.drawn });
    }

    /// The means again, with the rates of Gaussians that move.
    fn locate_changing(&mut self, eye: &ViewTransform, block: &GaussianBlock, motion: &BlockMotion) {
        let ([x, y, z], [u, v, w]) = (&block.positions, &motion.velocity);
        for i in 0..LANES {
            let point = eye.camera_from_world * eye.ray([x[i], y[i], z[i]]);
            let sight = eye.sight_changing::<S>(point, [u[i], v[i], w[i]]);
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

/// The Gaussians of a block that change.
#[derive(Debug, Clone, Copy)]
struct ChangingGaussians<'a> {
    motion: &'a BlockMotion,
    /// The lanes that are drawn.
    drawn: [u8; LANES],
}

impl LaneMotion for ChangingGaussians<'_> {
    fn turned<S: LaneValue>(self, eye: &ViewTransform, axes: [[f32; 3]; 3], i: usize) -> [[S; 3]; 3] {
        let rates = &self.motion.axes;
        let rate = |k: usize| [rates[k][0][i], rates[k][1][i], rates[k][2][i]];
        [
            eye.turned_changing(axes[0], rate(0)),
            eye.turned_changing(axes[1], rate(1)),
            eye.turned_changing(axes[2], rate(2)),
        ]
    }

    fn direction<S: LaneValue>(self, eye: &ViewTransform, point: [f32; 3], k: usize) -> [S; 3] {
        // Places beyond the last drawn lane have that of an earlier block; nothing reads their values.
        let (velocity, i) = (&self.motion.velocity, usize::from(self.drawn[k]));
        eye.direction_changing(point, [velocity[0][i], velocity[1][i], velocity[2][i]])
    }
}
