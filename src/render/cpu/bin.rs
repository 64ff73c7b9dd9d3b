//! Pass 3: for each tile, the splats that may touch it, front to back.

#![expect(
    clippy::cast_possible_truncation,
    reason = "tile coordinates and counts of a chunk fit their types"
)]

use super::sort;
use super::splat::Splat;
use crate::image::Size;
use crate::render::shared::TILE;
use rayon::prelude::*;
use std::ops::Range;

/// Splats that one task bins: the lists of a tile are read chunk by chunk, so threads never share one.
const CHUNK: usize = 1 << 15;

/// The image cut into tiles, row by row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    /// Of the image.
    pub(super) size: Size,
    /// Tiles a row.
    pub(super) columns: usize,
    /// Rows of tiles.
    pub(super) rows: usize,
}

impl Grid {
    /// The tiles of an image.
    pub(super) fn new(size: Size) -> Self {
        let count = |edge: u32| (edge as usize).div_ceil(TILE);
        Self { size, columns: count(size.width), rows: count(size.height) }
    }

    /// How many.
    pub(super) fn len(&self) -> usize {
        self.columns * self.rows
    }
}

/// The tiles' lists.
#[derive(Debug, Default)]
pub(super) struct Lists {
    chunks: Vec<Chunk>,
}

/// The lists of one run of splats in the frame's order.
#[derive(Debug, Default)]
struct Chunk {
    /// Where each tile's list begins in `places`; the end of the last one at the end.
    starts: Vec<u32>,
    places: Vec<u32>,
    pairs: Vec<Pair>,
}

#[derive(Debug, Clone, Copy)]
struct Pair {
    tile: u32,
    place: u32,
}

impl Lists {
    /// Lists the splats of `order` for every tile, and counts the entries.
    pub(super) fn run(&mut self, order: &[u64], splats: &[Splat], grid: Grid) -> u64 {
        let used = order.len().div_ceil(CHUNK);
        self.chunks.resize_with(used, Chunk::default);
        self.chunks
            .par_iter_mut()
            .zip(order.par_chunks(CHUNK))
            .map(|(chunk, order)| chunk.run(order, splats, grid))
            .sum()
    }

    /// The splats of a tile, front to back, in runs.
    pub(super) fn of(&self, tile: usize) -> impl Iterator<Item = &[u32]> {
        self.chunks.iter().map(move |c| &c.places[c.starts[tile] as usize..c.starts[tile + 1] as usize])
    }
}

impl Chunk {
    fn run(&mut self, order: &[u64], splats: &[Splat], grid: Grid) -> u64 {
        self.pairs.clear();
        self.starts.clear();
        self.starts.resize(grid.len() + 1, 0);
        for &key in order {
            let place = sort::place(key);
            each_tile(&splats[place as usize], grid, |tile| {
                self.starts[tile] += 1;
                self.pairs.push(Pair { tile: tile as u32, place });
            });
        }
        self.scatter();
        self.pairs.len() as u64
    }

    /// Counting sort of the pairs by tile, stable, so that each list keeps the frame's order.
    fn scatter(&mut self) {
        // Running sums make each entry the end of its list; filling from the back moves it to the beginning.
        let mut sum = 0;
        for count in &mut self.starts {
            sum += *count;
            *count = sum;
        }
        self.places.clear();
        self.places.resize(self.pairs.len(), 0);
        for pair in self.pairs.iter().rev() {
            let start = &mut self.starts[pair.tile as usize];
            *start -= 1;
            self.places[*start as usize] = pair.place;
        }
    }
}

fn tiles([first, end]: [u16; 2]) -> Range<usize> {
    usize::from(first) / TILE..usize::from(end).div_ceil(TILE)
}

/// Calls `each` with every tile that the splat's ellipse may touch.
fn each_tile(splat: &Splat, grid: Grid, mut each: impl FnMut(usize)) {
    let rows = tiles(splat.rows);
    let one_row_or_column = rows.len() == 1 || tiles(splat.columns).len() == 1;
    for row in rows {
        let columns = if one_row_or_column { splat.columns } else { band(splat, row) };
        for column in tiles(columns) {
            each(row * grid.columns + column);
        }
    }
}

/// The columns that the splat may touch in one row of tiles.
fn band(splat: &Splat, row: usize) -> [u16; 2] {
    let [first, end] = splat.rows;
    splat.columns_in(first.max((row * TILE) as u16), end.min(((row + 1) * TILE) as u16))
}
