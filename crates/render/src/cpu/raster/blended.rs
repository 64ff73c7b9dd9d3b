//! Pass 4 with blended depth order: layers of nearly the same depth cover each other in part.
//!
//! The plain order jumps when two layers swap: the front one takes all the light. Here layer `i` is
//! lit by the product over all other layers of `1 - alpha_j cover(z_j, z_i)`, where `cover` rises
//! smoothly from 0 to 1 as `z_j` passes from behind `z_i` to the front.
//!
//! ```text
//!  depth  ->   laid down   |  wait in the queue      |  not yet read
//!              cover = 1   |  0 < cover < 1 possible |  cover = 0
//! ```
//!
//! A layer can be blended once every layer that covers it is known. Those are the layers that
//! follow it by less than [`BLENDED_DEPTHS`], so it waits in a queue until the next layer lies
//! beyond that. The set of layers at a pixel, and the layer at which the pixel stops, are those of
//! the plain order. This code makes references: it is written to be read, and it is generic over
//! plain numbers and numbers with a rate.

#![expect(clippy::cast_precision_loss, reason = "tile coordinates are small")]

use super::{PIXELS, RasterInput};
use crate::RenderWork;
use crate::cpu::exp2::exp2_neg;
use crate::cpu::splat::{Splat, SplatRates};
use crate::dual::RealNumber;
use crate::shared::{BLENDED_DEPTHS, MAX_ALPHA, SOFT_MIN_ALPHA, STOP, TILE};
use fearless_simd::{Simd, SimdBase as _, f32x16};
use std::collections::VecDeque;
use std::f32::consts::LN_2;

/// Blends one tile with `N` features per splat into its part of the planes (see
/// [`super::raster_tiles`]).
#[inline(always)]
pub(super) fn blend_tile_smoothly<V: Simd, S: RealNumber<Plain = f32>, const N: usize>(
    simd: V,
    frame: RasterInput<'_>,
    index: usize,
    out: &mut [f32],
) -> RenderWork {
    // Without rates, the array may be empty or that of an earlier frame. Plain numbers drop the
    // rates.
    let moving = |place: u32| frame.rates.get(place as usize).copied().unwrap_or_default();
    let places = frame.lists.of(index).flatten();
    let layers: Vec<(Splat, SplatRates)> =
        places.map(|&place| (frame.splats[place as usize], moving(place))).collect();
    let [row, column] = [index / frame.grid.columns, index % frame.grid.columns].map(|tile| tile * TILE);
    let [width, height] = [frame.grid.size.width, frame.grid.size.height].map(|edge| edge as usize);
    let mut work = RenderWork::default();
    for y in 0..TILE {
        // Tiles at the border reach beyond the image.
        let inside = if row + y < height { width.saturating_sub(column) } else { 0 };
        let mut pixels = TileRow::<S, N>::new([column, row + y], inside);
        // A loop: a closure given to `for_each` is compiled without the instruction set in use.
        for (splat, rates) in &layers {
            pixels.take(simd, splat, rates);
        }
        pixels.finish();
        pixels.store(y, out);
        work.blended += pixels.blended;
        // Pixels outside the image were never open, and do not count as stopped.
        work.stopped += pixels.open.iter().take(inside).filter(|open| !**open).count() as u64;
    }
    work
}

/// A splat on one row of pixels.
struct RowLayer<S, const N: usize> {
    depth: S,
    alpha: [S; TILE],
    features: [f32; N],
    grey: S,
}

/// One row of a tile, with the layers that are waiting or may still cover others.
struct TileRow<S, const N: usize> {
    /// Centre of the first pixel, px.
    first: [f32; 2],
    /// True if each pixel goes on.
    open: [bool; TILE],
    /// Transmittance of all layers so far, in plain order: decides where a pixel stops.
    rest: [S; TILE],
    sums: [[f32; TILE]; N],
    grey_rate: [f32; TILE],
    blended: u64,
    /// Front to back.
    queue: VecDeque<RowLayer<S, N>>,
    /// Number of layers at the front of the queue that are laid down.
    laid: usize,
    /// Transmittance of the layers that have left the queue.
    before: [S; TILE],
}

impl<S: RealNumber<Plain = f32>, const N: usize> TileRow<S, N> {
    fn new([x, y]: [usize; 2], inside: usize) -> Self {
        Self {
            first: [x as f32 + 0.5, y as f32 + 0.5],
            open: std::array::from_fn(|x| x < inside),
            rest: [S::constant(1.0); TILE],
            sums: [[0.0; TILE]; N],
            grey_rate: [0.0; TILE],
            blended: 0,
            queue: VecDeque::new(),
            laid: 0,
            before: [S::constant(1.0); TILE],
        }
    }

    /// Takes the next splat in order of depth.
    #[inline(always)]
    fn take<V: Simd>(&mut self, simd: V, splat: &Splat, rates: &SplatRates) {
        let [first, end] = splat.rows.map(f32::from);
        if self.first[1] < first || self.first[1] > end {
            return;
        }
        // Columns need no test. Outside its extent, a splat's opacity is below the least one.
        let alpha = self.alphas(simd, splat, rates);
        let hits = alpha.iter().filter(|alpha| alpha.value() > 0.0).count();
        if hits == 0 {
            return;
        }
        self.blended += hits as u64;
        let depth = S::with_rate(splat.depth, rates.depth);
        // The new layer and all later ones are too deep to cover these, so these are complete.
        while self.queue.get(self.laid).is_some_and(|next| depth_cover(depth, next.depth).value() <= 0.0) {
            self.lay();
        }
        let mut features = [0.0; N];
        features.copy_from_slice(&splat.features[..N]);
        let grey = S::with_rate(rates.grey, rates.grey_rate);
        self.queue.push_back(RowLayer { depth, alpha, features, grey });
    }

    /// The splat's opacity at each pixel: 0 where it is too small to count or the pixel stops.
    #[inline(always)]
    fn alphas<V: Simd>(&mut self, simd: V, splat: &Splat, rates: &SplatRates) -> [S; TILE] {
        let [mx, my] = [0, 1].map(|k| S::with_rate(splat.mean[k], rates.mean[k]));
        let [w1, w2, w3] = [0, 1, 2].map(|k| S::with_rate(splat.w[k], rates.w[k]));
        let dy = S::with_rate(self.first[1], 0.0) - my;
        let e2 = w3 * dy;
        let mut q = [S::constant(0.0); TILE];
        let mut values = [0.0; TILE];
        for x in 0..TILE {
            let e1 = w1 * (S::with_rate(self.first[0] + x as f32, 0.0) - mx) + w2 * dy;
            q[x] = e1 * e1 + e2 * e2;
            values[x] = q[x].value();
        }
        // The power of the plain pass, so that the opacities have the same bits.
        let powers = opacity_powers(simd, values);
        // `check_style` admits this order under the rules `soft` only, so their constants are used.
        let mut alphas = [S::constant(0.0); TILE];
        for x in 0..TILE {
            let free = splat.opacity * powers[x];
            if !self.open[x] || free < SOFT_MIN_ALPHA {
                continue;
            }
            let clamped = free >= MAX_ALPHA;
            let rate = free * (rates.opacity - LN_2 * q[x].rate());
            let alpha = if clamped { S::with_rate(MAX_ALPHA, 0.0) } else { S::with_rate(free, rate) };
            let alpha = alpha * smooth_step(S::constant(255.0) * alpha - S::constant(0.5));
            // The pixel stops before the layer that would take too much of its light.
            let after = self.rest[x] * (S::constant(1.0) - alpha);
            self.open[x] = after.value() >= STOP;
            if self.open[x] {
                self.rest[x] = after;
                alphas[x] = alpha;
            }
        }
        alphas
    }

    /// Adds the next layer of the queue to the sums.
    #[inline(always)]
    fn lay(&mut self) {
        let depth = self.queue[self.laid].depth;
        // A layer that covers this one fully covers all later ones fully: its factor moves into
        // `before` for good.
        while self.laid > 0 && depth_cover(self.queue[0].depth, depth).value() >= 1.0 {
            let gone = self.queue.pop_front().expect("those laid down are in the queue");
            for (light, alpha) in self.before.iter_mut().zip(gone.alpha) {
                *light = *light * (S::constant(1.0) - alpha);
            }
            // `laid` counts from the front of the queue, which has moved.
            self.laid -= 1;
        }
        let mut light = self.before;
        for (_, other) in self.queue.iter().enumerate().filter(|(j, _)| *j != self.laid) {
            let cover = depth_cover(other.depth, depth);
            for (light, alpha) in light.iter_mut().zip(other.alpha) {
                *light = *light * (S::constant(1.0) - cover * alpha);
            }
        }
        let layer = &self.queue[self.laid];
        for x in 0..TILE {
            let weight = layer.alpha[x] * light[x];
            for (sums, feature) in self.sums.iter_mut().zip(layer.features) {
                sums[x] += weight.value() * feature;
            }
            self.grey_rate[x] += (weight * layer.grey).rate();
        }
        self.laid += 1;
    }

    /// Adds the layers that still wait.
    #[inline(always)]
    fn finish(&mut self) {
        while self.laid < self.queue.len() {
            self.lay();
        }
    }

    /// Writes row `y` of the tile's planes.
    fn store(&self, y: usize, out: &mut [f32]) {
        for (n, plane) in out.chunks_exact_mut(PIXELS).enumerate() {
            let row = &mut plane[y * TILE..][..TILE];
            match n.checked_sub(N) {
                None => row.copy_from_slice(&self.sums[n]),
                // The light left for the background does not depend on the order of the layers.
                Some(0) => row.copy_from_slice(&self.rest.map(S::value)),
                Some(1) => row.copy_from_slice(&self.grey_rate),
                Some(_) => row.copy_from_slice(&self.rest.map(S::rate)),
            }
        }
    }
}

/// `2^-q` for each value.
#[inline(always)]
fn opacity_powers<V: Simd>(simd: V, mut q: [f32; TILE]) -> [f32; TILE] {
    exp2_neg(simd, f32x16::from_slice(simd, &q)).store_slice(&mut q);
    q
}

/// The share of its opacity with which a layer at depth `of` dims a layer at depth `at`: 1 far in
/// front, 0 far behind.
#[inline(always)]
fn depth_cover<S: RealNumber>(of: S, at: S) -> S {
    smooth_step((at - of) / (S::constant(2.0 * BLENDED_DEPTHS) * at) + S::constant(0.5))
}

/// `3u^2 - 2u^3` with `u` clamped to 0..1: rises from 0 to 1 with slope 0 at both ends.
#[inline(always)]
fn smooth_step<S: RealNumber>(x: S) -> S {
    let (low, high) = (S::constant(0.0), S::constant(1.0));
    let u = if x > low { x } else { low };
    let u = if u < high { u } else { high };
    u * u * (S::constant(3.0) - S::constant(2.0) * u)
}
