//! Pass 3: the list of splats that may touch each tile, front to back.

#![expect(
    clippy::cast_possible_truncation,
    reason = "tile coordinates and counts of a chunk fit their types"
)]

use super::sort;
use super::splat::Splat;
use crate::shared::TILE;
use gs2e_image::Size;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Number of splats whose lists are read as one: no batch of the raster spans two chunks.
const CHUNK: usize = 1 << 15;
/// Least number of splats that one task bins. The list of a tile is the concatenation of the tasks' lists, so
/// threads never write to the same list.
const MIN_SLICE: usize = 1 << 10;
/// Largest number of slices that a small frame is divided into. Each tile looks into the list of each slice.
const MAX_SLICES: usize = 16;
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
    slices: Vec<SplatSlice>,
    /// Number of slices of a chunk.
    divided: usize,
}

/// The lists of a slice of the splats in the frame's order.
#[derive(Debug, Default)]
struct SplatSlice {
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
        Self { budget, band: 0..0, slices: Vec::new(), divided: 1 }
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

    /// The splats of a tile of the band, front to back, in one list per slice.
    pub(super) fn of(&self, tile: usize) -> impl Iterator<Item = &[u32]> {
        let tile = tile - self.band.start;
        self.slices.iter().map(move |slice| slice.of(tile))
    }

    /// The splats of a tile of the band, front to back, in batches.
    #[inline(always)]
    pub(super) fn batches(&self, tile: usize) -> TileBatches<'_> {
        let tile = tile - self.band.start;
        TileBatches { tile, divided: self.divided, slices: &self.slices, of_chunk: &[], rest: &[] }
    }

    /// Lists the splats of the band's tiles, and returns the number of entries. Returns `None` if
    /// there are more than `bound`; the lists are then invalid.
    fn fill(&mut self, frame: OrderedSplats<'_>, band: Range<usize>, bound: usize) -> Option<u64> {
        let slice = slice_len(frame.order.len());
        let used = frame.order.len().div_ceil(slice);
        // Each slice keeps one start per tile. These starts count too, even if the lists are short.
        if used.saturating_mul(band.len()) > bound {
            return None;
        }
        self.divided = CHUNK / slice;
        self.slices.resize_with(used, SplatSlice::default);
        self.band = band.clone();
        let room = ListCapacity { bound, taken: AtomicUsize::new(0) };
        let fill =
            |(list, order): (&mut SplatSlice, _)| list.run(OrderedSplats { order, ..frame }, &band, &room);
        // If the total exceeds the bound, the slice that adds last sees it, whatever the order.
        let within = self.slices.par_iter_mut().zip(frame.order.par_chunks(slice)).all(fill);
        within.then(|| room.taken.into_inner() as u64)
    }

    /// Divides the tiles into bands within the budget.
    fn bands(&self, frame: OrderedSplats<'_>) -> Vec<Range<usize>> {
        // As in `fill`, the starts of all slices must be within the budget.
        let most = (self.budget / frame.order.len().div_ceil(slice_len(frame.order.len()))).max(1);
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

impl SplatSlice {
    /// The list of a tile, counted from the band's first.
    #[inline(always)]
    fn of(&self, tile: usize) -> &[u32] {
        &self.places[self.starts[tile] as usize..self.starts[tile + 1] as usize]
    }

    /// Lists the slice's splats for the band. Returns `false`, with nothing listed, if that exceeds
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

/// The list of a tile, in batches. A batch is full, or the last one of a chunk: where slices end does not
/// show.
pub(super) struct TileBatches<'a> {
    tile: usize,
    divided: usize,
    /// The slices of later chunks, and of this one.
    slices: &'a [SplatSlice],
    of_chunk: &'a [SplatSlice],
    /// The rest of the present slice.
    rest: &'a [u32],
}

impl<'a> TileBatches<'a> {
    /// The next batch, in `room` if it spans slices. Not empty.
    #[inline(always)]
    pub(super) fn next<'b, const N: usize>(&mut self, room: &'b mut [u32; N]) -> Option<&'b [u32]>
    where
        'a: 'b,
    {
        loop {
            if let Some((batch, rest)) = self.rest.split_at_checked(N) {
                self.rest = rest;
                return Some(batch);
            }
            let mut count = self.rest.len();
            room[..count].copy_from_slice(self.rest);
            self.rest = &[];
            while let Some((slice, others)) = self.of_chunk.split_first().filter(|_| count < N) {
                let list = slice.of(self.tile);
                let taken = list.len().min(N - count);
                room[count..count + taken].copy_from_slice(&list[..taken]);
                (self.of_chunk, self.rest, count) = (others, &list[taken..], count + taken);
            }
            if count > 0 {
                return Some(&room[..count]);
            }
            if self.slices.is_empty() {
                return None;
            }
            (self.of_chunk, self.slices) = self.slices.split_at(self.divided.min(self.slices.len()));
        }
    }
}

/// Number of splats of a slice: a chunk, or a fraction of it so that all threads bin the splats of a small
/// scene.
fn slice_len(splats: usize) -> usize {
    // Twice as many as threads, so that threads end at about the same time.
    let slices = match rayon::current_num_threads() {
        1 => 1,
        threads => (2 * threads).min(MAX_SLICES),
    };
    splats.div_ceil(slices).next_power_of_two().clamp(MIN_SLICE, CHUNK)
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The tile of a dot, without a pattern.
    fn tile_of(dot: u32) -> u16 {
        (dot.wrapping_mul(2_654_435_761) >> 28) as u16
    }

    #[test]
    fn batches_are_those_of_chunks_for_any_number_of_threads() {
        let grid = TileGrid::new(Size { width: 64, height: 64 });
        let dot = |dot: u32| {
            let pixel = |tile: u16| [TILE as u16 * tile, TILE as u16 * tile + 1];
            let (columns, rows) = (pixel(tile_of(dot) % 4), pixel(tile_of(dot) / 4));
            Splat { columns, rows, w: [1.0, 0.0, 1.0], ..Splat::default() }
        };
        // One chunk and a slice of the next.
        let dots = 40_000;
        let splats: Vec<Splat> = (0..dots).map(dot).collect();
        let order: Vec<u64> = (0..dots).map(u64::from).collect();
        let chunks = [0..CHUNK as u32, CHUNK as u32..dots];
        let mut wanted: Vec<(usize, Vec<u32>)> = Vec::new();
        for tile in 0..grid.len() {
            for chunk in chunks.clone() {
                let listed: Vec<u32> = chunk.filter(|dot| usize::from(tile_of(*dot)) == tile).collect();
                wanted.extend(listed.chunks(64).map(|batch| (tile, batch.to_vec())));
            }
        }
        for threads in [1, 2, 8] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut found = Vec::new();
            let mut lists = TileLists::new(BUDGET);
            let frame = OrderedSplats { order: &order, splats: &splats, grid };
            let pairs = pool.install(|| {
                lists.run(frame, |lists| {
                    for tile in 0..grid.len() {
                        let (mut batches, mut room) = (lists.batches(tile), [0; 64]);
                        while let Some(batch) = batches.next(&mut room) {
                            found.push((tile, batch.to_vec()));
                        }
                    }
                })
            });
            assert_eq!(pairs, u64::from(dots));
            assert!(found == wanted, "{threads} threads");
        }
    }
}
