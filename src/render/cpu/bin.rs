//! Pass 3: the list of splats that may touch each tile, front to back.

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
use std::sync::atomic::{AtomicUsize, Ordering};

/// Number of splats that one task bins. The list of a tile is the concatenation of its chunks'
/// lists, so threads never write to the same list.
const CHUNK: usize = 1 << 15;
/// Number of entries after which a chunk checks whether the budget is exceeded.
const STEP: usize = 1 << 12;

/// Number of splats that are copied at a time.
const NEAR: usize = 32;

/// The division of an image into tiles, row by row.
#[derive(Debug, Clone, Copy)]
pub(super) struct TileGrid {
    /// Size of the image.
    pub(super) size: Size,
    /// Tiles per row.
    pub(super) columns: usize,
    /// Rows of tiles.
    pub(super) rows: usize,
}

impl TileGrid {
    /// The tiles of an image.
    pub(super) fn new(size: Size) -> Self {
        let count = |edge: u32| (edge as usize).div_ceil(TILE);
        Self { size, columns: count(size.width), rows: count(size.height) }
    }

    /// Number of tiles.
    pub(super) fn len(&self) -> usize {
        self.columns * self.rows
    }
}

/// Maximum number of entries in all lists at once: about 100 MB at 8 bytes per [`TilePair`] plus 4.
pub(super) const BUDGET: usize = 1 << 23;

/// The lists of a band of tiles. The band covers all tiles if they are within the budget.
#[derive(Debug)]
pub(super) struct TileLists {
    budget: usize,
    /// Indices of the band's tiles in the grid.
    band: Range<usize>,
    chunks: Vec<SplatChunk>,
}

/// The lists of one chunk of splats in the frame's order.
#[derive(Debug, Default)]
struct SplatChunk {
    /// Start of each tile's list in `places`, then the end of the last list.
    starts: Vec<u32>,
    places: Vec<u32>,
    pairs: Vec<TilePair>,
}

#[derive(Debug, Clone, Copy)]
struct TilePair {
    /// Index of the tile, counted from the band's first.
    tile: u32,
    place: u32,
}

/// The input of the pass.
#[derive(Debug, Clone, Copy)]
pub(super) struct OrderedSplats<'a> {
    /// The frame's front-to-back order.
    pub(super) order: &'a [u64],
    /// The splats to which the order refers.
    pub(super) splats: &'a [Splat],
    /// The division into tiles.
    pub(super) grid: TileGrid,
}

impl TileLists {
    /// Empty lists. They never hold more than `budget` entries at once, except for a single tile
    /// with more.
    pub(super) fn new(budget: usize) -> Self {
        Self { budget, band: 0..0, chunks: Vec::new() }
    }

    /// Lists the splats of every tile, band by band, and calls `each` with the lists of each band.
    /// Returns the number of entries. There is one band if all tiles are within the budget.
    pub(super) fn run(&mut self, frame: OrderedSplats<'_>, mut each: impl FnMut(&Self)) -> u64 {
        let all = 0..frame.grid.len();
        if let Some(pairs) = self.fill(frame, all, self.budget) {
            each(self);
            return pairs;
        }
        let mut pairs = 0;
        for band in self.bands(frame) {
            pairs += self.fill(frame, band, usize::MAX).expect("there is no bound");
            each(self);
        }
        pairs
    }

    /// The band of tiles that are listed.
    pub(super) fn band(&self) -> Range<usize> {
        self.band.clone()
    }

    /// The splats of a tile of the band, front to back, in one slice per chunk.
    pub(super) fn of(&self, tile: usize) -> impl Iterator<Item = &[u32]> {
        let tile = tile - self.band.start;
        self.chunks.iter().map(move |c| &c.places[c.starts[tile] as usize..c.starts[tile + 1] as usize])
    }

    /// Lists the splats of the band's tiles, and returns the number of entries. Returns `None` if
    /// there are more than `bound`; the lists are then invalid.
    fn fill(&mut self, frame: OrderedSplats<'_>, band: Range<usize>, bound: usize) -> Option<u64> {
        let used = frame.order.len().div_ceil(CHUNK);
        // Each chunk keeps one start per tile. These starts count too, even if the lists are short.
        if used.saturating_mul(band.len()) > bound {
            return None;
        }
        self.chunks.resize_with(used, SplatChunk::default);
        self.band = band.clone();
        let room = ListCapacity { bound, taken: AtomicUsize::new(0) };
        let fill =
            |(chunk, order): (&mut SplatChunk, _)| chunk.run(OrderedSplats { order, ..frame }, &band, &room);
        // If the total exceeds the bound, the chunk that adds last sees it, whatever the order.
        let within = self.chunks.par_iter_mut().zip(frame.order.par_chunks(CHUNK)).all(fill);
        within.then(|| room.taken.into_inner() as u64)
    }

    /// Divides the tiles into bands within the budget.
    fn bands(&self, frame: OrderedSplats<'_>) -> Vec<Range<usize>> {
        // As in `fill`, the starts of all chunks must be within the budget.
        let most = (self.budget / frame.order.len().div_ceil(CHUNK)).max(1);
        let mut bands: Vec<Range<usize>> = Vec::new();
        // Full at first, so that the first tile opens a band.
        let mut listed = usize::MAX;
        for (tile, count) in list_lengths(frame).into_iter().enumerate() {
            listed = listed.saturating_add(count as usize);
            match bands.last_mut() {
                Some(band) if listed <= self.budget && band.len() < most => band.end += 1,
                _ => {
                    bands.push(tile..tile + 1);
                    listed = count as usize;
                }
            }
        }
        bands
    }
}

/// Length of each tile's list.
fn list_lengths(frame: OrderedSplats<'_>) -> Vec<u32> {
    let none = || vec![0_u32; frame.grid.len() + 1];
    // A difference array: plus one where a run of tiles begins, minus one where it ends. Arithmetic
    // is modulo 2^32; no tile has more splats than that.
    let steps = frame.order.par_iter().with_min_len(CHUNK).fold(none, |mut steps, &key| {
        each_run(&frame.splats[sort::key_place(key) as usize], frame.grid, &(0..frame.grid.len()), |run| {
            steps[run.start] = steps[run.start].wrapping_add(1);
            steps[run.end] = steps[run.end].wrapping_sub(1);
        });
        steps
    });
    let mut lengths = steps.reduce(none, |mut a, b| {
        a.iter_mut().zip(b).for_each(|(a, b)| *a = a.wrapping_add(b));
        a
    });
    let mut sum = 0_u32;
    for step in &mut lengths {
        sum = sum.wrapping_add(*step);
        *step = sum;
    }
    lengths.pop();
    lengths
}

/// Number of entries so far, and its limit.
struct ListCapacity {
    bound: usize,
    taken: AtomicUsize,
}

impl ListCapacity {
    /// Adds entries, and returns whether the total is within the bound.
    fn take(&self, entries: usize) -> bool {
        // Relaxed: only the sum matters, and no other memory is published by it.
        self.taken.fetch_add(entries, Ordering::Relaxed) + entries <= self.bound
    }
}

impl SplatChunk {
    /// Lists the chunk's splats for the band. Returns `false`, with nothing listed, if that exceeds
    /// the bound.
    fn run(&mut self, frame: OrderedSplats<'_>, band: &Range<usize>, room: &ListCapacity) -> bool {
        self.pairs.clear();
        self.starts.clear();
        self.starts.resize(band.len() + 1, 0);
        let mut counted = 0;
        let mut near = [Splat::default(); NEAR];
        for keys in frame.order.chunks(NEAR) {
            // Copied first: most of these reads miss the cache, and a plain copy lets them overlap.
            for (near, &key) in near.iter_mut().zip(keys) {
                *near = frame.splats[sort::key_place(key) as usize];
            }
            for (splat, &key) in near.iter().zip(keys) {
                let place = sort::key_place(key);
                each_run(splat, frame.grid, band, |run| {
                    for tile in run {
                        let tile = tile - band.start;
                        self.starts[tile] += 1;
                        self.pairs.push(TilePair { tile: tile as u32, place });
                    }
                });
            }
            // Threads share the counter, so it is not touched for every splat.
            if self.pairs.len() - counted >= STEP {
                if !room.take(self.pairs.len() - counted) {
                    return false;
                }
                counted = self.pairs.len();
            }
        }
        let within = room.take(self.pairs.len() - counted);
        if within {
            self.scatter();
        }
        within
    }

    /// Counting sort of the pairs by tile. It is stable, so each list keeps the frame's order.
    fn scatter(&mut self) {
        // Running sums make each entry the end of its list. Filling from the back moves it to the
        // beginning.
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

/// Calls `each` with every run of tiles, row by row, in the band that the splat's ellipse may
/// touch.
fn each_run(splat: &Splat, grid: TileGrid, band: &Range<usize>, mut each: impl FnMut(Range<usize>)) {
    let rows = tiles(splat.rows);
    let one_row_or_column = rows.len() == 1 || tiles(splat.columns).len() == 1;
    let outline = splat.outline();
    let within = band.start / grid.columns..band.end.div_ceil(grid.columns);
    for row in rows.start.max(within.start)..rows.end.min(within.end) {
        // `columns_in` expects rows within those of the splat.
        let [first, end] = splat.rows;
        let [first, end] = [first.max((row * TILE) as u16), end.min(((row + 1) * TILE) as u16)];
        let columns = tiles(if one_row_or_column { splat.columns } else { outline.columns_in(first, end) });
        let first = (row * grid.columns + columns.start).max(band.start);
        let end = (row * grid.columns + columns.end).min(band.end);
        if first < end {
            each(first..end);
        }
    }
}
