//! The pixels of a tile, stored block by block, and the blending of one layer over a block.
//!
//! A pixel stops when the next layer would leave less transmittance than the rules allow. A stopped
//! pixel keeps its transmittance with the sign set. Every later layer then yields a negative
//! transmittance, fails the same comparison, and adds nothing: one sign bit replaces a mask that
//! would take a register of its own.

#![expect(clippy::cast_precision_loss, reason = "pixel coordinates are small")]

use super::{LANES, PIXELS, SIDE, SplatBatch};
use crate::cpu::exp2::exp2_neg;
use crate::cpu::splat::{Splat, SplatRates};
use crate::shared::{MAX_ALPHA, STOP, TILE, least_alpha};
use crate::{RenderRules, RenderWork};
use fearless_simd::{Bytes as _, Select as _, Simd, SimdBase as _, SimdMask as _, f32x16, i32x16, u32x16};
use gs2e_image::Size;
use std::f32::consts::LN_2;

/// One value for each pixel of a tile, block by block, each block row by row.
type Plane = [f32; PIXELS];

/// Thresholds of the rendering rules.
#[derive(Debug, Clone, Copy)]
struct BlendLimits {
    /// Smallest opacity that is blended.
    least: f32,
    /// Smallest transmittance with which a pixel goes on.
    stop: f32,
}

/// The pixels of one tile while they are blended.
pub(super) struct TilePixels<const N: usize> {
    limits: BlendLimits,
    /// Pixel centres, px.
    x: Plane,
    y: Plane,
    /// Transmittance; negative once the pixel is finished.
    light: Plane,
    /// Sums of weight times feature.
    sums: [Plane; N],
    /// Rate of the transmittance.
    light_rate: Plane,
    /// Rate of the luminance.
    grey_rate: Plane,
    /// Number of entries of the tile's list up to the last one that was blended.
    last: Plane,
    /// Bit `b` is set while block `b` has a pixel that goes on.
    open: u64,
    /// Pixels of the tile that lie outside the image.
    outside: usize,
    blended: u64,
}

/// Column and row within the tile of the `i`-th value of a plane.
#[inline(always)]
pub(in crate::cpu) fn pixel_place(i: usize) -> [usize; 2] {
    let across = TILE / SIDE;
    let (block, lane) = (i / LANES, i % LANES);
    [block % across * SIDE + lane % SIDE, block / across * SIDE + lane / SIDE]
}

impl<const N: usize> TilePixels<N> {
    /// The pixels of the tile at `corner` before the first layer.
    #[inline(always)]
    pub(super) fn new(corner: [usize; 2], size: Size, rules: RenderRules) -> Self {
        let nothing = [0.0; PIXELS];
        let mut pixels = Self {
            limits: BlendLimits {
                least: least_alpha(rules),
                // gsplat stops at `T <= 1e-4`, the official rasteriser at `T < 1e-4`. The next
                // float turns the first comparison into the second.
                stop: if rules == RenderRules::Gsplat { STOP.next_up() } else { STOP },
            },
            x: nothing,
            y: nothing,
            light: [1.0; PIXELS],
            sums: [nothing; N],
            light_rate: nothing,
            grey_rate: nothing,
            last: nothing,
            open: 0,
            outside: 0,
            blended: 0,
        };
        for i in 0..PIXELS {
            let [x, y] = pixel_place(i);
            let [x, y] = [corner[0] + x, corner[1] + y];
            [pixels.x[i], pixels.y[i]] = [x as f32 + 0.5, y as f32 + 0.5];
            if x < size.width as usize && y < size.height as usize {
                pixels.open |= 1 << (i / LANES);
            } else {
                // Pixels outside the image start finished, so no layer counts there.
                pixels.light[i] = -1.0;
                pixels.outside += 1;
            }
        }
        pixels
    }

    /// Returns true if all pixels are finished.
    #[inline(always)]
    pub(super) fn is_finished(&self) -> bool {
        self.open == 0
    }

    /// Returns true if the block has a pixel that goes on.
    #[inline(always)]
    pub(super) fn is_open(&self, block: usize) -> bool {
        self.open >> block & 1 == 1
    }

    /// Blends over a block, front to back, the splats of a batch whose bits are set in `mask`.
    #[inline(always)]
    pub(super) fn blend<S: Simd, const SOFT: bool, const RATE: bool, const TRACE: bool>(
        &mut self,
        simd: S,
        block: usize,
        batch: &SplatBatch,
        mut mask: u64,
    ) {
        let range = block * LANES..(block + 1) * LANES;
        let load = |plane: &Plane| f32x16::from_slice(simd, &plane[range.clone()]);
        let mut sums = [f32x16::splat(simd, 0.0); N];
        for (sums, plane) in sums.iter_mut().zip(&self.sums) {
            *sums = load(plane);
        }
        let mut state = BlockState {
            x: load(&self.x),
            y: load(&self.y),
            light: load(&self.light),
            sums,
            blended: i32x16::splat(simd, 0),
            light_rate: load(&self.light_rate),
            grey_rate: load(&self.grey_rate),
            last: load(&self.last),
        };
        while mask != 0 {
            // Bits are in order of depth, so the lowest one comes first.
            let i = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            // The place in the list, counted from 1: 0 means that nothing was blended.
            let place = if TRACE { (batch.first + i + 1) as f32 } else { 0.0 };
            let layer = BlendLayer { splat: &batch.splats[i], rates: &batch.rates[i], place };
            state.blend::<SOFT, RATE, TRACE>(simd, layer, self.limits);
        }
        let store = |value: f32x16<S>, plane: &mut Plane| value.store_slice(&mut plane[range.clone()]);
        store(state.light, &mut self.light);
        for (sums, plane) in state.sums.into_iter().zip(&mut self.sums) {
            store(sums, plane);
        }
        if RATE {
            store(state.light_rate, &mut self.light_rate);
            store(state.grey_rate, &mut self.grey_rate);
        }
        if TRACE {
            store(state.last, &mut self.last);
        }
        self.blended += state.blended.as_slice().iter().map(|&v| u64::from(v.cast_unsigned())).sum::<u64>();
        let is_open = state.light.simd_gt(0.0).to_bitmask() != 0;
        self.open &= !(u64::from(!is_open) << block);
    }

    /// Writes the planes, row by row.
    #[inline(always)]
    pub(super) fn store<const TRACE: bool>(&self, out: &mut [f32]) {
        let mut light = self.light;
        for light in &mut light {
            *light = light.abs();
        }
        for (n, out) in out.chunks_exact_mut(PIXELS).enumerate() {
            let plane = match n.checked_sub(N) {
                None => &self.sums[n],
                Some(0) => &light,
                Some(1) if TRACE => &self.last,
                Some(1) => &self.grey_rate,
                Some(_) => &self.light_rate,
            };
            for (k, row) in plane.chunks_exact(SIDE).enumerate() {
                let [x, y] = pixel_place(k * SIDE);
                out[y * TILE + x..][..SIDE].copy_from_slice(row);
            }
        }
    }

    /// Adds the blended layers and the pixels that stopped early.
    #[inline(always)]
    pub(super) fn count(&self, work: &mut RenderWork) {
        work.blended += self.blended;
        work.stopped += (self.light.iter().filter(|&&v| v < 0.0).count() - self.outside) as u64;
    }
}

/// A layer that is blended.
struct BlendLayer<'a> {
    splat: &'a Splat,
    rates: &'a SplatRates,
    /// Its place in the tile's list, counted from 1, for a trace.
    place: f32,
}

/// The pixels of one block, in registers.
struct BlockState<S: Simd, const N: usize> {
    x: f32x16<S>,
    y: f32x16<S>,
    light: f32x16<S>,
    sums: [f32x16<S>; N],
    /// Blended layers.
    blended: i32x16<S>,
    light_rate: f32x16<S>,
    grey_rate: f32x16<S>,
    last: f32x16<S>,
}

impl<S: Simd, const N: usize> BlockState<S, N> {
    /// Blends one layer over the block. Rates follow by the product rule from the rates of mean,
    /// conic and opacity.
    #[inline(always)]
    fn blend<const SOFT: bool, const RATE: bool, const TRACE: bool>(
        &mut self,
        simd: S,
        BlendLayer { splat, rates, place }: BlendLayer<'_>,
        limits: BlendLimits,
    ) {
        let (zero, one) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 1.0));
        let [w1, w2, w3] = splat.w;
        let (dx, dy) = (self.x - splat.mean[0], self.y - splat.mean[1]);
        // The exponent as a sum of two squares (a Cholesky factor of the conic) is never negative,
        // even where rounding would make `a dx^2 + 2 b dx dy + c dy^2` of a needle negative and its
        // opacity larger than 1.
        let (e1, e2) = (dx * w1 + dy * w2, dy * w3);
        let free = exp2_neg(simd, e1 * e1 + e2 * e2) * splat.opacity;
        let mut alpha = free.min(MAX_ALPHA);
        let counts = alpha.simd_ge(limits.least);
        alpha = counts.select(alpha, zero);
        let mut rate = zero;
        if RATE {
            let e1_rate = dx * rates.w[0] + (dy * rates.w[1] - w1 * rates.mean[0] - w2 * rates.mean[1]);
            let q2_rate = e2 * (dy * rates.w[2] - w3 * rates.mean[1]);
            let power_rate = (e1 * e1_rate + q2_rate) * (2.0 * LN_2);
            // A clamped opacity is constant, so its rate is 0.
            let moves = counts & free.simd_lt(MAX_ALPHA);
            rate = moves.select(alpha * (f32x16::splat(simd, rates.opacity) - power_rate), zero);
        }
        if SOFT {
            let (ramp, slope) = soft_ramp(simd, alpha);
            rate *= ramp + alpha * slope;
            alpha *= ramp;
        }
        let after = self.light * (one - alpha);
        // False for every finished pixel, whose transmittance is negative. True where alpha is 0
        // and the pixel goes on, since its transmittance passed this comparison before.
        let goes_on = after.simd_ge(limits.stop);
        let weight = goes_on.select(self.light * alpha, zero);
        if RATE {
            let weight_rate = goes_on.select(self.light_rate * alpha + self.light * rate, zero);
            self.grey_rate += weight_rate * rates.grey + weight * rates.grey_rate;
            // `Tdot (1 - alpha) - T alphadot` is `Tdot` minus the rate of the weight.
            self.light_rate -= weight_rate;
        }
        // Not `from_bits`: see `exp2_neg`.
        let bits: u32x16<S> = self.light.bitcast();
        let finished: f32x16<S> = (bits | SIGN).bitcast();
        self.light = goes_on.select(after, finished);
        let is_blended = weight.simd_gt(zero);
        if TRACE {
            self.last = is_blended.select(f32x16::splat(simd, place), self.last);
        }
        // A true lane is -1 as an integer.
        self.blended -= is_blended.to_vector();
        for (sums, feature) in self.sums.iter_mut().zip(splat.features) {
            *sums += weight * feature;
        }
    }
}

/// The ramp of the rules `soft` and its derivative: 0 at an opacity of half a grey step, 1 at one
/// and a half. A layer then fades in where the other rules cut it off, so brightness does not jump
/// as the camera moves.
#[inline(always)]
pub(in crate::cpu) fn soft_ramp<S: Simd>(simd: S, alpha: f32x16<S>) -> (f32x16<S>, f32x16<S>) {
    let u = (alpha * 255.0 - 0.5).max(0.0).min(1.0);
    (u * u * (f32x16::splat(simd, 3.0) - u * 2.0), u * (6.0 * 255.0) * (f32x16::splat(simd, 1.0) - u))
}

/// The bit that makes a number negative.
const SIGN: u32 = 1 << 31;
