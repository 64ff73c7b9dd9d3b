//! A sample of an image's tiles, for measurements that do not need whole frames.
//!
//! # Examples
//!
//! ```
//! use gs2e_image::Size;
//! use gs2e_render::sample::TileSample;
//!
//! // Tiles have 16 px along each edge: there are three in a row.
//! let size = Size { width: 48, height: 16 };
//! assert_eq!(TileSample::whole(size).pixels().len(), 48 * 16);
//! // A square of 4x4 pixels whose upper left corner is the pixel (14, 3) is in the first two tiles.
//! let sample = TileSample::under(size, [[14, 3]].into_iter(), 4);
//! assert_eq!([0, 1, 2].map(|tile| sample.has(tile)), [true, true, false]);
//! ```

use super::shared::TILE;
use gs2e_image::Size;

/// Some tiles of an image, spread over all of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TileSample {
    size: Size,
    columns: usize,
    has: Vec<bool>,
    /// Number of tiles of the sample above and to the left of each corner of the grid, row by row. Four of
    /// them give the number within a rectangle.
    sums: Vec<u32>,
}

/// Number of tiles below which a sample is not made smaller, and the largest edge of a square with one tile.
const ENOUGH: usize = 48;
const EDGES: std::ops::RangeInclusive<usize> = 1..=8;

impl TileSample {
    /// One tile from each square of tiles, drawn by numbers in 0..1. The squares are as large as leaves about
    /// 48 tiles, so a small image is sampled as a whole. Every tile is drawn with the same probability:
    /// where a square reaches beyond the image, it may yield none.
    pub fn spread(size: Size, mut draw: impl FnMut() -> f64) -> Self {
        let [columns, rows] = [size.width, size.height].map(|edge| (edge as usize).div_ceil(TILE));
        let edge = EDGES.rev().find(|edge| columns * rows >= ENOUGH * edge * edge).unwrap_or(1);
        let mut has = vec![false; columns * rows];
        for row in (0..rows).step_by(edge) {
            for column in (0..columns).step_by(edge) {
                #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below edge^2")]
                let drawn = (draw() * (edge * edge) as f64) as usize;
                let (x, y) = (column + drawn % edge, row + drawn / edge);
                if x < columns && y < rows {
                    has[y * columns + x] = true;
                }
            }
        }
        Self::from_tiles(size, has)
    }

    /// All tiles of an image.
    #[must_use]
    pub fn whole(size: Size) -> Self {
        let [columns, rows] = [size.width, size.height].map(|edge| (edge as usize).div_ceil(TILE));
        Self::from_tiles(size, vec![true; columns * rows])
    }

    /// The tiles of an image that hold squares of pixels, by their first pixels and the length of their
    /// edges. The squares are within the image.
    pub fn under(size: Size, squares: impl Iterator<Item = [usize; 2]>, edge: usize) -> Self {
        let [columns, rows] = [size.width, size.height].map(|edge| (edge as usize).div_ceil(TILE));
        let mut has = vec![false; columns * rows];
        for [left, top] in squares {
            for y in top / TILE..=(top + edge - 1) / TILE {
                has[y * columns..][left / TILE..=(left + edge - 1) / TILE].fill(true);
            }
        }
        Self::from_tiles(size, has)
    }

    fn from_tiles(size: Size, has: Vec<bool>) -> Self {
        let columns = (size.width as usize).div_ceil(TILE);
        let stride = columns + 1;
        let mut sums = vec![0; stride];
        for row in has.chunks(columns) {
            let above = sums.len() - stride;
            let mut sum = 0;
            sums.push(0);
            for (x, has) in row.iter().enumerate() {
                sum += u32::from(*has);
                sums.push(sums[above + x + 1] + sum);
            }
        }
        Self { size, columns, has, sums }
    }

    /// Size of the image.
    #[must_use]
    pub fn size(&self) -> Size {
        self.size
    }

    /// Returns true if the tile with this index is in the sample. Tiles are counted row by row.
    #[must_use]
    pub fn has(&self, tile: usize) -> bool {
        self.has[tile]
    }

    /// Returns true if these ranges of pixels, none of them empty, overlap a tile of the sample.
    #[inline]
    #[must_use]
    pub fn touches(&self, columns: [u16; 2], rows: [u16; 2]) -> bool {
        let tiles = |[first, end]: [u16; 2]| [usize::from(first) / TILE, usize::from(end).div_ceil(TILE)];
        let ([left, right], [top, bottom]) = (tiles(columns), tiles(rows));
        let sum = |x: usize, y: usize| self.sums[y * (self.columns + 1) + x];
        // Sums on both sides, because a difference of unsigned numbers could pass below 0 on the way.
        sum(right, bottom) + sum(left, top) > sum(left, bottom) + sum(right, top)
    }

    /// Indices of the pixels of the sample in the image, ascending.
    #[must_use]
    pub fn pixels(&self) -> Vec<usize> {
        let [width, height] = [self.size.width, self.size.height].map(|edge| edge as usize);
        let row = |y: usize| {
            let tiles = (0..self.columns).filter(move |x| self.has[y / TILE * self.columns + x]);
            tiles.flat_map(move |x| (x * TILE..width.min((x + 1) * TILE)).map(move |x| y * width + x))
        };
        (0..height).flat_map(row).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_num::seed::{DrawSpace, Seed, SeedCell};

    fn spread(size: Size, seed: u64) -> TileSample {
        let mut draws = Seed(seed).draws(SeedCell { x: 0, y: 0, level: 0, index: 0 }, DrawSpace::Choice);
        TileSample::spread(size, || draws.uniform())
    }

    #[test]
    fn every_tile_is_drawn_as_often_as_the_others() {
        // 40 x 23 tiles in squares of 4 x 4; the last row of squares has 3 rows of tiles.
        let size = Size { width: 640, height: 360 };
        let mut drawn = [0_u32; 40 * 23];
        for seed in 0..3200 {
            let sample = spread(size, seed);
            drawn.iter_mut().enumerate().for_each(|(tile, n)| *n += u32::from(sample.has(tile)));
        }
        // 200 of 3200, with a deviation of 13.7; six of them for any of 920 tiles.
        assert!(drawn.iter().all(|n| n.abs_diff(200) < 82), "{drawn:?}");
        let mean = f64::from(drawn.iter().sum::<u32>()) / 920.0;
        // The mean of 920 has a deviation of 0.45, less what the squares have in common.
        assert!((mean - 200.0).abs() < 3.0, "{mean}");
    }

    #[test]
    fn a_small_image_is_sampled_as_a_whole() {
        let size = Size { width: 100, height: 50 };
        let sample = spread(size, 1);
        assert_eq!(sample.pixels(), (0..5000).collect::<Vec<_>>());
        assert!(sample.touches([99, 100], [49, 50]));
    }

    #[test]
    fn rectangles_touch_what_they_overlap() {
        let size = Size { width: 330, height: 250 };
        let sample = spread(size, 5);
        let pixels = sample.pixels();
        assert!(pixels.windows(2).all(|pair| pair[0] < pair[1]) && pixels.len() < 330 * 250 / 3);
        let has = |x: u16, y: u16| pixels.binary_search(&(usize::from(y) * 330 + usize::from(x))).is_ok();
        // A rectangle touches every tile that it shares a pixel with, so whole tiles are compared.
        for (left, right) in [(0, 1_u16), (15, 17), (100, 130), (320, 330), (0, 330)] {
            for (top, bottom) in [(0, 1_u16), (31, 33), (60, 90), (249, 250), (0, 250)] {
                let mut any = false;
                for x in left / 16 * 16..right.next_multiple_of(16).min(330) {
                    for y in top / 16 * 16..bottom.next_multiple_of(16).min(250) {
                        any |= has(x, y);
                    }
                }
                assert_eq!(
                    sample.touches([left, right], [top, bottom]),
                    any,
                    "{left} {right} {top} {bottom}"
                );
            }
        }
    }
}
