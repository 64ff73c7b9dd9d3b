//! Pass 4: blends each tile's splats, front to back.

#![expect(clippy::cast_precision_loss, reason = "tile coordinates are small")]

use super::bin::{Grid, Lists};
use super::exp2::exp2_neg;
use super::splat::Splat;
use crate::render::shared::{MAX_ALPHA, STOP, TILE, least_alpha};
use crate::render::{Rules, Work};
use rayon::prelude::*;

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

/// Blends every tile with `N` features a splat; `SOFT` where layers fade in. A tile's part of `out` is `N + 1` planes of [`PIXELS`] values: the
/// sums of weight times feature, then what is left of the light behind.
pub(super) fn run<const N: usize, const SOFT: bool>(
    splats: &[Splat],
    lists: &Lists,
    grid: Grid,
    rules: Rules,
    out: &mut Vec<f32>,
) -> Work {
    let stride = (N + 1) * PIXELS;
    out.resize(grid.len() * stride, 0.0);
    out.par_chunks_mut(stride)
        .enumerate()
        .map(|(index, out)| {
            let mut tile = Tile::<N>::new(grid, index, rules);
            tile.blend_all::<SOFT>(splats, lists.of(index));
            tile.store(out)
        })
        .reduce(Work::default, |mut a, b| {
            a += b;
            a
        })
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

impl<const N: usize> Tile<N> {
    fn new(grid: Grid, index: usize, rules: Rules) -> Self {
        let stop = if rules == Rules::Gsplat { STOP.next_up() } else { STOP };
        let first_row = index / grid.columns * TILE;
        let first_column = index % grid.columns * TILE;
        let row = |y: usize| {
            let inside = |x: usize| {
                first_row + y < grid.size.height as usize && first_column + x < grid.size.width as usize
            };
            let least = std::array::from_fn(|x| if inside(x) { least_alpha(rules) } else { OUTSIDE });
            Row { rest: [1.0; TILE], least, sums: [[0.0; TILE]; N] }
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

    fn blend_all<'a, const SOFT: bool>(&mut self, splats: &[Splat], runs: impl Iterator<Item = &'a [u32]>) {
        let mut batch = [Splat::default(); PATIENCE];
        for run in runs {
            for places in run.chunks(PATIENCE) {
                // Copied first: reads that do not wait for one another overlap, and most of them miss the cache.
                for (near, &place) in batch.iter_mut().zip(places) {
                    *near = splats[place as usize];
                }
                batch[..places.len()].iter().for_each(|splat| self.blend::<SOFT>(splat));
                if !self.look() {
                    return;
                }
            }
        }
    }

    /// Notes which rows have a pixel left to blend, and whether any has.
    fn look(&mut self) -> bool {
        for (open, row) in self.open.iter_mut().zip(&self.rows) {
            *open = *open && row.least.iter().any(|&v| v < FINISHED);
        }
        self.open.contains(&true)
    }

    fn blend<const SOFT: bool>(&mut self, splat: &Splat) {
        let [first, end] = splat.rows.map(|y| usize::from(y).saturating_sub(self.first_row).min(TILE));
        for y in first..end {
            if self.open[y] {
                self.blend_row::<SOFT>(splat, y);
            }
        }
    }

    fn blend_row<const SOFT: bool>(&mut self, splat: &Splat, y: usize) {
        let dy = (self.first_row + y) as f32 + 0.5 - splat.mean[1];
        let Some([low, high]) = splat.chord(dy) else { return };
        if high < self.centres[0] || low > self.centres[TILE - 1] {
            return;
        }
        let [w1, w2, w3] = splat.w;
        let e2 = w3 * dy;
        let mut features = [0.0; N];
        features.copy_from_slice(&splat.features[..N]);
        let (mean_x, opacity) = (splat.mean[0], splat.opacity);
        let line = Line { mean_x, w1, e1: w2 * dy, q2: e2 * e2, opacity, stop: self.stop, features };
        self.rows[y].blend::<SOFT>(&line, &self.centres, &mut self.blended);
    }

    /// Writes the planes and counts.
    fn store(&self, out: &mut [f32]) -> Work {
        for (n, plane) in out.chunks_exact_mut(PIXELS).enumerate() {
            for (to, row) in plane.chunks_exact_mut(TILE).zip(&self.rows) {
                to.copy_from_slice(if n < N { &row.sums[n] } else { &row.rest });
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
    #[inline]
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

/// The centred ramp of the rules `soft`: 0 at half a grey step, 1 at one and a half (`numerics.md` 3.3).
#[inline]
fn ramp(alpha: f32) -> f32 {
    let u = (255.0 * alpha - 0.5).clamp(0.0, 1.0);
    u * u * (3.0 - 2.0 * u)
}
