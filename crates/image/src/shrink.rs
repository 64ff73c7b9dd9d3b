//! Downscaling: each pixel is the mean of the area that it covers.
//!
//! # Examples
//!
//! ```
//! use gs2e_image::{Image, Size, shrink};
//!
//! let row = [10_u8, 30, 200, 100].map(|grey| [grey; 3]);
//! let image = Image::from_vec(Size { width: 4, height: 2 }, [row, row].concat());
//! let small = shrink::to_width(&image, 2);
//! assert_eq!(small.size(), Size { width: 2, height: 1 });
//! // Each new pixel is the mean of two columns.
//! assert_eq!(small.pixels(), [[20; 3], [150; 3]]);
//! ```

use super::{Image, Size};
use std::ops::Range;

/// Scales an image to a width of `width` columns, with its aspect ratio kept. An image that is not
/// wider stays unchanged.
///
/// Each channel is the mean of the encoded values under the new pixel, weighted by the covered
/// share, in integers: the same on every machine.
#[must_use]
pub fn to_width(image: &Image<[u8; 3]>, width: u32) -> Image<[u8; 3]> {
    let from = image.size();
    if width == 0 || width >= from.width {
        return image.clone();
    }
    // Rounded up, so that at least one row remains.
    let height = (u64::from(from.height) * u64::from(width)).div_ceil(u64::from(from.width));
    let size = Size { width, height: u32::try_from(height).expect("it is lower than the image") };
    let columns: Vec<_> = (0..width).map(|x| covered_range(x, width, from.width)).collect();
    let mut pixels = Vec::with_capacity(size.pixels());
    for y in 0..size.height {
        let rows = covered_range(y, size.height, from.height);
        pixels.extend(columns.iter().map(|columns| covered_mean(image, columns, &rows)));
    }
    Image::from_vec(size, pixels)
}

/// The range of `from` pixels that pixel `at` of `to` covers, and the covered parts of the first
/// and the last, in units of `1 / to`.
struct PixelCover {
    range: Range<u32>,
    first: u64,
    last: u64,
    whole: u64,
}

impl PixelCover {
    fn weight(&self, at: u32) -> u64 {
        match at {
            // A single old pixel is cut by both ends of the new one.
            at if self.range.len() == 1 && at == self.range.start => self.first + self.last - self.whole,
            at if at == self.range.start => self.first,
            at if at + 1 == self.range.end => self.last,
            _ => self.whole,
        }
    }
}

fn covered_range(at: u32, to: u32, from: u32) -> PixelCover {
    let [at, to, from] = [at, to, from].map(u64::from);
    // In units of `1 / to`, an old pixel is `to` wide and a new one `from`: all ends are whole numbers.
    let (begin, end) = (at * from, (at + 1) * from);
    let index = |n: u64| u32::try_from(n).expect("it lies in the image");
    let range = index(begin / to)..index(end.div_ceil(to));
    let first = to - begin % to;
    let last = if end.is_multiple_of(to) { to } else { end % to };
    PixelCover { range, first, last, whole: to }
}

fn covered_mean(image: &Image<[u8; 3]>, columns: &PixelCover, rows: &PixelCover) -> [u8; 3] {
    let width = image.size().width as usize;
    let (mut sums, mut weights) = ([0u64; 3], 0);
    for y in rows.range.clone() {
        for x in columns.range.clone() {
            let weight = columns.weight(x) * rows.weight(y);
            let pixel = image.pixels()[y as usize * width + x as usize];
            for (sum, channel) in sums.iter_mut().zip(pixel) {
                *sum += weight * u64::from(channel);
            }
            weights += weight;
        }
    }
    // Half of the weights makes the division round to the nearest.
    sums.map(|sum| u8::try_from((sum + weights / 2) / weights).expect("a mean of bytes is a byte"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(width: u32, values: &[u8]) -> Image<[u8; 3]> {
        let height = u32::try_from(values.len()).unwrap() / width;
        Image::from_vec(Size { width, height }, values.iter().map(|v| [*v; 3]).collect())
    }

    fn t(width: u32, values: &[u8], to: u32, wanted: &[u8]) {
        let found = to_width(&grey(width, values), to);
        assert_eq!(found.pixels().iter().map(|p| p[0]).collect::<Vec<_>>(), wanted, "{values:?} to {to}");
        assert_eq!(found.size().width, to.min(width));
    }

    #[test]
    fn pixels_are_means_of_what_they_cover() {
        t(4, &[0, 10, 20, 30, 2, 12, 22, 32], 2, &[6, 26]);
        // 3 to 2: each pixel covers one whole pixel and half of the middle one.
        t(3, &[0, 90, 240], 2, &[30, 190]);
        // 5 to 3: 1 and 2/3; 1/3, 1 and 1/3; 2/3 and 1
        t(5, &[50, 100, 30, 60, 10], 3, &[70, 50, 30]);
        t(2, &[7, 9], 2, &[7, 9]);
        t(2, &[7, 9], 5, &[7, 9]);
        t(3, &[1, 2, 3, 4, 5, 6, 7, 8, 9], 1, &[5]);
    }

    #[test]
    fn even_colours_stay_and_shapes_are_kept() {
        for (size, to, wanted) in [([640, 360], 160, [160, 90]), ([31, 17], 10, [10, 6]), ([9, 1], 2, [2, 1])]
        {
            let [width, height] = size;
            let found = to_width(&Image::filled(Size { width, height }, [9, 200, 31]), to);
            assert_eq!([found.size().width, found.size().height], wanted);
            assert!(found.pixels().iter().all(|p| *p == [9, 200, 31]));
        }
    }
}
