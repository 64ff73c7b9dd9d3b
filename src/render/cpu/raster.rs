//! Pass 4: blends each tile's splats, front to back.

#![expect(clippy::cast_precision_loss, reason = "tile coordinates are small")]

use super::bin::{Grid, Lists};
use super::exp2::exp2_neg;
use super::splat::{Splat, pixels_within};
use crate::render::Work;
use crate::render::shared::{MAX_ALPHA, MIN_ALPHA, STOP, TILE};
use rayon::prelude::*;

/// Pixels that are blended together.
const LANES: usize = 8;
/// Groups of them in a tile's row.
const GROUPS: usize = TILE / LANES;
/// Pixels of a tile.
pub(super) const PIXELS: usize = TILE * TILE;
/// Splats between two looks at whether a tile is finished.
const PATIENCE: usize = 32;
/// No layer is as opaque as this: the least opacity that a finished pixel blends.
const FINISHED: f32 = 2.0;
/// The same for the places of a tile that lie outside the image.
const OUTSIDE: f32 = 3.0;

type Lane = [f32; LANES];

/// Blends every tile with `N` features a splat. A tile's part of `out` is `N + 1` planes of [`PIXELS`] values: the
/// sums of weight times feature, then what is left of the light behind.
pub(super) fn run<const N: usize>(splats: &[Splat], lists: &Lists, grid: Grid, out: &mut Vec<f32>) -> Work {
    let stride = (N + 1) * PIXELS;
    out.resize(grid.len() * stride, 0.0);
    out.par_chunks_mut(stride)
        .enumerate()
        .map(|(index, out)| {
            let mut tile = Tile::<N>::new(grid, index);
            tile.blend_all(splats, lists.of(index));
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
    first_column: usize,
    /// Centres of the columns, px.
    centres: [Lane; GROUPS],
    rows: [Row<N>; TILE],
    /// Whether each row still has a pixel to blend.
    open: [bool; TILE],
    blended: [u32; LANES],
}

#[derive(Clone, Copy)]
struct Row<const N: usize> {
    groups: [Group<N>; GROUPS],
}

#[derive(Clone, Copy)]
struct Group<const N: usize> {
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
    features: [f32; N],
}

impl<const N: usize> Tile<N> {
    fn new(grid: Grid, index: usize) -> Self {
        let first_row = index / grid.columns * TILE;
        let first_column = index % grid.columns * TILE;
        let group = |row: usize, g: usize| {
            let outside = |i: usize| {
                first_row + row >= grid.size.height as usize
                    || first_column + g * LANES + i >= grid.size.width as usize
            };
            let least = std::array::from_fn(|i| if outside(i) { OUTSIDE } else { MIN_ALPHA });
            Group { rest: [1.0; LANES], least, sums: [[0.0; LANES]; N] }
        };
        let centre = |x: usize| (first_column + x) as f32 + 0.5;
        Self {
            first_row,
            first_column,
            centres: std::array::from_fn(|g| std::array::from_fn(|i| centre(g * LANES + i))),
            rows: std::array::from_fn(|row| Row { groups: std::array::from_fn(|g| group(row, g)) }),
            open: [true; TILE],
            blended: [0; LANES],
        }
    }

    fn blend_all<'a>(&mut self, splats: &[Splat], runs: impl Iterator<Item = &'a [u32]>) {
        for run in runs {
            for places in run.chunks(PATIENCE) {
                for &place in places {
                    self.blend(&splats[place as usize]);
                }
                if !self.look() {
                    return;
                }
            }
        }
    }

    /// Notes which rows have a pixel left to blend, and whether any has.
    fn look(&mut self) -> bool {
        for (open, row) in self.open.iter_mut().zip(&self.rows) {
            *open = *open && row.groups.iter().any(|g| g.least.iter().any(|&v| v < FINISHED));
        }
        self.open.contains(&true)
    }

    fn blend(&mut self, splat: &Splat) {
        let [first, end] = splat.rows.map(|y| usize::from(y).saturating_sub(self.first_row).min(TILE));
        for row in first..end {
            if self.open[row] {
                self.blend_row(splat, row);
            }
        }
    }

    fn blend_row(&mut self, splat: &Splat, row: usize) {
        let dy = (self.first_row + row) as f32 + 0.5 - splat.mean[1];
        let Some([low, high]) = splat.chord(dy) else { return };
        let left = self.first_column as f32;
        let [first, end] = pixels_within(low - left, high - left, TILE as f32).map(usize::from);
        let [w1, w2, w3] = splat.w;
        let e2 = w3 * dy;
        let mut features = [0.0; N];
        features.copy_from_slice(&splat.features[..N]);
        let line =
            Line { mean_x: splat.mean[0], w1, e1: w2 * dy, q2: e2 * e2, opacity: splat.opacity, features };
        for g in first / LANES..end.div_ceil(LANES) {
            self.rows[row].groups[g].blend(&line, &self.centres[g], &mut self.blended);
        }
    }

    /// Writes the planes and counts.
    fn store(&self, out: &mut [f32]) -> Work {
        let groups = || self.rows.iter().flat_map(|row| &row.groups);
        for (n, plane) in out.chunks_exact_mut(PIXELS).enumerate() {
            for (to, group) in plane.chunks_exact_mut(LANES).zip(groups()) {
                to.copy_from_slice(if n < N { &group.sums[n] } else { &group.rest });
            }
        }
        let finished =
            groups().flat_map(|g| g.least).filter(|v| (FINISHED..OUTSIDE).contains(v)).count() as u64;
        Work {
            blended: self.blended.iter().map(|&v| u64::from(v)).sum(),
            stopped: finished,
            ..Work::default()
        }
    }
}

impl<const N: usize> Group<N> {
    /// One layer over [`LANES`] pixels. Written without a branch, so that the compiler does all of them at once.
    #[inline]
    fn blend(&mut self, line: &Line<N>, centres: &Lane, blended: &mut [u32; LANES]) {
        let mut weights = [0.0; LANES];
        for i in 0..LANES {
            let e1 = line.w1 * (centres[i] - line.mean_x) + line.e1;
            let alpha = line.opacity * exp2_neg(e1 * e1 + line.q2);
            let alpha = if alpha < MAX_ALPHA { alpha } else { MAX_ALPHA };
            let alpha = if alpha >= self.least[i] { alpha } else { 0.0 };
            let rest = self.rest[i] * (1.0 - alpha);
            // never where alpha is 0: what is left of a pixel that goes on is at least STOP
            let stops = rest < STOP;
            weights[i] = if stops { 0.0 } else { alpha * self.rest[i] };
            blended[i] += u32::from(weights[i] > 0.0);
            self.rest[i] = if stops { self.rest[i] } else { rest };
            self.least[i] = if stops { FINISHED } else { self.least[i] };
        }
        for (sums, &feature) in self.sums.iter_mut().zip(&line.features) {
            for i in 0..LANES {
                sums[i] += weights[i] * feature;
            }
        }
    }
}
