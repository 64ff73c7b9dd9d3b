//! Colours: harmonics in the directions of the drawn lanes, and their sums.

use super::{LaneMotion, LaneValue, ProjectedBlock, StillGaussians};
use crate::cpu::activate::GaussianBlock;
use crate::cpu::eye::ViewTransform;
use fearless_simd::{Simd, SimdBase as _, f32x4};
use gs2e_scene::sh;

impl<S: LaneValue> ProjectedBlock<S> {
    /// The harmonics in the directions of the drawn lanes.
    #[inline(always)]
    pub(super) fn face(&mut self, eye: &ViewTransform, block: &GaussianBlock, degree: u8, count: usize) {
        for k in 0..count {
            let i = usize::from(self.drawn[k]);
            for (to, from) in self.positions.iter_mut().zip(&block.positions) {
                to[k] = from[i];
            }
        }
        if let Some(motion) = block.motion.as_deref().filter(|_| S::HAS_RATES) {
            return self.face_changing(eye, motion, degree, count);
        }
        // With a constant degree, the compiler drops the functions above it.
        match degree {
            0 => self.face_to(eye, 0, count, StillGaussians),
            1 => self.face_to(eye, 1, count, StillGaussians),
            2 => self.face_to(eye, 2, count, StillGaussians),
            _ => self.face_to(eye, 3, count, StillGaussians),
        }
    }

    #[inline(always)]
    pub(super) fn face_to<M: LaneMotion>(
        &mut self,
        eye: &ViewTransform,
        degree: u8,
        count: usize,
        motion: M,
    ) {
        // Whole vectors of the widest set. Lanes beyond `count` hold values of an earlier block,
        // which nothing reads.
        for k in 0..count.next_multiple_of(16) {
            let [x, y, z] = &self.positions;
            let basis = sh::basis_values(degree, motion.direction::<S>(eye, [x[k], y[k], z[k]], k));
            for (value, to) in basis[..sh::function_count(degree)].iter().zip(&mut self.basis) {
                value.put(to, k);
            }
        }
    }

    /// The colour of the `k`-th drawn Gaussian, each channel at least 0: [`sh::sum_colour`] for
    /// three channels at once.
    #[inline(always)]
    pub(super) fn colour<V: Simd>(&self, simd: V, k: usize, coefficients: &[f32]) -> [S; 3] {
        // With a constant number, the loop is unrolled.
        let last = coefficients.len() / 3 - 1;
        let [sum, rate] = match last {
            0 => [[0.0; 4]; 2],
            3 => self.partial_colour::<V, 3>(simd, k, coefficients),
            8 => self.partial_colour::<V, 8>(simd, k, coefficients),
            _ => self.partial_colour::<V, 15>(simd, k, coefficients),
        };
        let b = S::at(&self.basis[last], k);
        let one = |j: usize| {
            let c = coefficients[3 * last + j];
            let v = S::with_rate(sum[j] + c * b.value(), rate[j] + c * b.rate()) + S::nearest(0.5);
            v.at_least(S::nearest(0.0))
        };
        [one(0), one(1), one(2)]
    }

    /// The sums of the first `N` functions and their rates; the fourth values mean nothing.
    #[inline(always)]
    fn partial_colour<V: Simd, const N: usize>(
        &self,
        simd: V,
        k: usize,
        coefficients: &[f32],
    ) -> [[f32; 4]; 2] {
        // The fourth value of a vector belongs to the next function. So the last function, which no other
        // follows, is added by itself. As a vector of four by name, because the compiler would make three
        // numbers of it.
        let mut sums = [f32x4::splat(simd, 0.0); 2];
        for n in 0..N {
            let b = S::at(&self.basis[n], k);
            let c = f32x4::from_slice(simd, &coefficients[3 * n..3 * n + 4]);
            sums[0] += c * b.value();
            if S::HAS_RATES {
                sums[1] += c * b.rate();
            }
        }
        sums.map(Into::into)
    }
}
