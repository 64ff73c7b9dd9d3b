//! Pass 4: blends each tile's splats, front to back.

#![expect(clippy::cast_precision_loss, reason = "tile coordinates are small")]

mod blended;

use super::bin::{Grid, Lists};
use super::exp2::exp2_neg;
use super::splat::{Rates, Splat};
use crate::render::dual::Dual;
use crate::render::shared::{MAX_ALPHA, STOP, TILE, least_alpha};
use crate::render::{Layering, Rules, Work};
use fearless_simd::{Level, dispatch};
use rayon::prelude::*;
use std::f32::consts::LN_2;

/// Pixels of a tile.
pub(super) const PIXELS: usize = TILE * TILE;
/// Splats between two looks at whether a tile is finished.
const PATIENCE: usize = 32;
/// No layer is as opaque as this: the least opacity that a finished pixel blends.
const FINISHED: f32 = 2.0;
/// The same for the places of a tile that lie outside the image.
const OUTSIDE: f32 = 3.0;

/// One value for each pixel of a tile's row.
type Lane = [f32; TILE];

/// What the pass reads.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame<'a> {
    /// Projected Gaussians.
    pub(super) splats: &'a [Splat],
    /// Their rates, where they are asked for.
    pub(super) rates: &'a [Rates],
    /// The lists of the tiles.
    pub(super) lists: &'a Lists,
    /// The tiles.
    pub(super) grid: Grid,
    /// The rules.
    pub(super) rules: Rules,
    /// How layers lie.
    pub(super) order: Layering,
    /// The instruction set.
    pub(super) level: Level,
}

/// Planes of a tile with so many features, and the rates of luminance and of the light behind, or without.
pub(super) fn planes(features: usize, rate: bool) -> usize {
    features + 1 + 2 * usize::from(rate)
}

/// Blends every tile with `N` features a splat; `SOFT` where layers fade in, `RATE` where luminance's rate is wanted. A
/// tile's part of `out` is [`planes`] of [`PIXELS`] values: the sums of weight times feature, what is left of the light
/// behind, then the rates of luminance and of that.
pub(super) fn run<const N: usize, const SOFT: bool, const RATE: bool>(
    frame: Frame<'_>,
    out: &mut Vec<f32>,
) -> Work {
    let stride = planes(N, RATE) * PIXELS;
    out.resize(frame.grid.len() * stride, 0.0);
    let band = frame.lists.band();
    out.par_chunks_mut(stride)
        .enumerate()
        .skip(band.start)
        .take(band.len())
        .map(|(index, out)| match (frame.order, RATE) {
            (Layering::Depth, _) => {
                dispatch!(frame.level, _simd => one::<N, SOFT, RATE>(frame, index, out))
            }
            (Layering::Blended, false) => blended::one::<f32, N>(frame, index, out),
            (Layering::Blended, true) => blended::one::<Dual<f32>, N>(frame, index, out),
        })
        .reduce(Work::default, |mut a, b| {
            a += b;
            a
        })
}

/// One tile. Inlined, as is all below, into a function for each instruction set.
#[inline(always)]
fn one<const N: usize, const SOFT: bool, const RATE: bool>(
    frame: Frame<'_>,
    index: usize,
    out: &mut [f32],
) -> Work {
    let mut tile = Tile::<N>::new(frame.grid, index, frame.rules);
    tile.blend_all::<SOFT, RATE>(frame, frame.lists.of(index));
    tile.store::<RATE>(out)
}

/// The pixels of one tile while they are blended.
struct Tile<const N: usize> {
    first_row: usize,
    /// Least rest of light that a pixel goes on with.
    stop: f32,
    /// Centres of the columns, px.
    centres: Lane,
    rows: [Row<N>; TILE],
    /// Whether each row still has a pixel to blend.
    open: [bool; TILE],
    blended: [u32; TILE],
}

#[derive(Clone, Copy)]
struct Row<const N: usize> {
    /// What is left of the light behind.
    rest: Lane,
    /// Least opacity that the pixel blends; [`FINISHED`] once it is finished.
    least: Lane,
    sums: [Lane; N],
    /// Rate of `rest`.
    rest_rate: Lane,
    /// Rate of the luminance.
    grey_rate: Lane,
}

/// One splat on one row of pixels.
struct Line<const N: usize> {
    mean_x: f32,
    w1: f32,
    /// `w2 dy`.
    e1: f32,
    /// `(w3 dy)^2`.
    q2: f32,
    opacity: f32,
    /// See [`Tile`].
    stop: f32,
    features: [f32; N],
}

/// The rates of one splat on one row of pixels.
struct LineRates {
    /// Of `w1`.
    w1: f32,
    /// Of `w1 dx + w2 dy`, but for the rate of `w1`.
    e1: f32,
    /// Half the rate of `q2`.
    q2: f32,
    /// Of the opacity at the mean, over it.
    opacity: f32,
    grey: f32,
    grey_rate: f32,
}

impl<const N: usize> Tile<N> {
    #[inline(always)]
    fn new(grid: Grid, index: usize, rules: Rules) -> Self {
        let stop = if rules == Rules::Gsplat { STOP.next_up() } else { STOP };
        let first_row = index / grid.columns * TILE;
        let first_column = index % grid.columns * TILE;
        let row = |y: usize| {
            let inside = |x: usize| {
                first_row + y < grid.size.height as usize && first_column + x < grid.size.width as usize
            };
            let least = std::array::from_fn(|x| if inside(x) { least_alpha(rules) } else { OUTSIDE });
            let nothing = [0.0; TILE];
            Row { rest: [1.0; TILE], least, sums: [nothing; N], rest_rate: nothing, grey_rate: nothing }
        };
        Self {
            first_row,
            stop,
            centres: std::array::from_fn(|x| (first_column + x) as f32 + 0.5),
            rows: std::array::from_fn(row),
            open: [true; TILE],
            blended: [0; TILE],
        }
    }

    #[inline(always)]
    fn blend_all<'a, const SOFT: bool, const RATE: bool>(
        &mut self,
        frame: Frame<'_>,
        runs: impl Iterator<Item = &'a [u32]>,
    ) {
        let mut batch = [Splat::default(); PATIENCE];
        let mut rates = [Rates::default(); PATIENCE];
        for run in runs {
            for places in run.chunks(PATIENCE) {
                // Copied first: reads that do not wait for one another overlap, and most of them miss the cache.
                for (near, &place) in batch.iter_mut().zip(places) {
                    *near = frame.splats[place as usize];
                }
                if RATE {
                    for (near, &place) in rates.iter_mut().zip(places) {
                        *near = frame.rates[place as usize];
                    }
                }
                for (splat, rates) in batch.iter().zip(&rates).take(places.len()) {
                    self.blend::<SOFT, RATE>(splat, rates);
                }
                if !self.look() {
                    return;
                }
            }
        }
    }

    /// Notes which rows have a pixel left to blend, and whether any has.
    #[inline(always)]
    fn look(&mut self) -> bool {
        for (open, row) in self.open.iter_mut().zip(&self.rows) {
            *open = *open && row.least.iter().any(|&v| v < FINISHED);
        }
        self.open.contains(&true)
    }

    #[inline(always)]
    fn blend<const SOFT: bool, const RATE: bool>(&mut self, splat: &Splat, rates: &Rates) {
        let [first, end] = splat.rows.map(|y| usize::from(y).saturating_sub(self.first_row).min(TILE));
        for y in first..end {
            if self.open[y] {
                self.blend_row::<SOFT, RATE>(splat, rates, y);
            }
        }
    }

    #[inline(always)]
    fn blend_row<const SOFT: bool, const RATE: bool>(&mut self, splat: &Splat, rates: &Rates, y: usize) {
        let dy = (self.first_row + y) as f32 + 0.5 - splat.mean[1];
        if splat.misses(dy, [self.centres[0], self.centres[TILE - 1]]) {
            return;
        }
        let [w1, w2, w3] = splat.w;
        let e2 = w3 * dy;
        let mut features = [0.0; N];
        features.copy_from_slice(&splat.features[..N]);
        let (mean_x, opacity) = (splat.mean[0], splat.opacity);
        let line = Line { mean_x, w1, e1: w2 * dy, q2: e2 * e2, opacity, stop: self.stop, features };
        if RATE {
            let [mx, my] = rates.mean;
            let moving = LineRates {
                w1: rates.w[0],
                e1: rates.w[1] * dy - w1 * mx - w2 * my,
                q2: e2 * (rates.w[2] * dy - w3 * my),
                opacity: rates.opacity,
                grey: rates.grey,
                grey_rate: rates.grey_rate,
            };
            self.rows[y].blend_rate::<SOFT>(&line, &moving, &self.centres);
        }
        self.rows[y].blend::<SOFT>(&line, &self.centres, &mut self.blended);
    }

    /// Writes the planes and counts.
    #[inline(always)]
    fn store<const RATE: bool>(&self, out: &mut [f32]) -> Work {
        for (n, plane) in out.chunks_exact_mut(PIXELS).enumerate() {
            for (to, row) in plane.chunks_exact_mut(TILE).zip(&self.rows) {
                to.copy_from_slice(match n.checked_sub(N) {
                    None => &row.sums[n],
                    Some(0) => &row.rest,
                    Some(1) => &row.grey_rate,
                    Some(_) => &row.rest_rate,
                });
            }
        }
        let least = self.rows.iter().flat_map(|row| row.least);
        let finished = least.filter(|v| (FINISHED..OUTSIDE).contains(v)).count();
        let blended = self.blended.iter().map(|&v| u64::from(v)).sum();
        Work { blended, stopped: finished as u64, ..Work::default() }
    }
}

impl<const N: usize> Row<N> {
    /// One layer over the row. Written on copies and without a branch, so that the compiler does several pixels at
    /// once.
    #[inline(always)]
    fn blend<const SOFT: bool>(&mut self, line: &Line<N>, centres: &Lane, blended: &mut [u32; TILE]) {
        let (rest, least) = (self.rest, self.least);
        let mut weights = [0.0; TILE];
        let mut hits = [0; TILE];
        for i in 0..TILE {
            let e1 = line.w1 * (centres[i] - line.mean_x) + line.e1;
            let alpha = line.opacity * exp2_neg(e1 * e1 + line.q2);
            let alpha = if alpha < MAX_ALPHA { alpha } else { MAX_ALPHA };
            let alpha = if alpha >= least[i] { alpha } else { 0.0 };
            let alpha = if SOFT { alpha * ramp(alpha) } else { alpha };
            let after = rest[i] * (1.0 - alpha);
            // always where alpha is 0: what is left of a pixel that went on is at least the stop
            let goes_on = after >= line.stop;
            let alpha = if goes_on { alpha } else { 0.0 };
            weights[i] = alpha * rest[i];
            hits[i] = u32::from(alpha > 0.0);
            self.rest[i] = if goes_on { after } else { rest[i] };
            self.least[i] = if goes_on { least[i] } else { FINISHED };
        }
        for i in 0..TILE {
            blended[i] += hits[i];
        }
        for (sums, &feature) in self.sums.iter_mut().zip(&line.features) {
            for i in 0..TILE {
                sums[i] += weights[i] * feature;
            }
        }
    }
}

impl<const N: usize> Row<N> {
    /// The rates of one layer over the row, before [`Self::blend`] takes the layer in; the same skips and the same
    /// stop (`numerics.md` 7.5).
    #[inline(always)]
    fn blend_rate<const SOFT: bool>(&mut self, line: &Line<N>, moving: &LineRates, centres: &Lane) {
        let (rest, least, rest_rate) = (self.rest, self.least, self.rest_rate);
        for i in 0..TILE {
            let dx = centres[i] - line.mean_x;
            let e1 = line.w1 * dx + line.e1;
            let free = line.opacity * exp2_neg(e1 * e1 + line.q2);
            let e1_rate = moving.w1 * dx + moving.e1;
            let power_rate = (2.0 * LN_2) * (e1 * e1_rate + moving.q2);
            let clamped = free >= MAX_ALPHA;
            let alpha = if clamped { MAX_ALPHA } else { free };
            let rate = if clamped { 0.0 } else { alpha * (moving.opacity - power_rate) };
            let counts = alpha >= least[i];
            let (alpha, rate) = if counts { (alpha, rate) } else { (0.0, 0.0) };
            let rate = if SOFT { rate * (ramp(alpha) + alpha * ramp_slope(alpha)) } else { rate };
            let alpha = if SOFT { alpha * ramp(alpha) } else { alpha };
            let goes_on = rest[i] * (1.0 - alpha) >= line.stop;
            let (alpha, rate) = if goes_on { (alpha, rate) } else { (0.0, 0.0) };
            let weight_rate = rest_rate[i] * alpha + rest[i] * rate;
            self.grey_rate[i] += weight_rate * moving.grey + rest[i] * alpha * moving.grey_rate;
            self.rest_rate[i] = rest_rate[i] - weight_rate;
        }
    }
}

/// The derivative of [`ramp`].
#[inline(always)]
fn ramp_slope(alpha: f32) -> f32 {
    let u = (255.0 * alpha - 0.5).clamp(0.0, 1.0);
    (6.0 * 255.0) * u * (1.0 - u)
}

/// The centred ramp of the rules `soft`: 0 at half a grey step, 1 at one and a half (`numerics.md` 3.3).
#[inline(always)]
fn ramp(alpha: f32) -> f32 {
    let u = (255.0 * alpha - 0.5).clamp(0.0, 1.0);
    u * u * (3.0 - 2.0 * u)
}
