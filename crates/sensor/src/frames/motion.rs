//! An estimate of the picture's motion from frame to frame, by block matching on some pairs of frames, and
//! a count of frames that repeat the one before.
//!
//! The blocks are those that change most. Each is looked for in the next frame: first in a small picture,
//! over an eighth of its width in each direction, then around the place found at full resolution, and
//! between pixels by a parabola through three costs. A block counts if it is found again with a correlation
//! of 0.8. Of places that fit equally well, as along an edge or in a repeated texture, the nearest counts:
//! the estimate is then a lower bound.
//!
//! # Examples
//!
//! ```
//! # use gs2e_image::{Image, Size};
//! use gs2e_num::seed::philox::philox_block;
//! use gs2e_sensor::frames::motion::FrameMotion;
//!
//! // A random texture that moves by 3 px.
//! let grey = |x: u32, y: u32| (philox_block([x, y, 0, 0], [1, 0])[0] % 256) as f32;
//! let size = Size { width: 64, height: 48 };
//! let mut motion = FrameMotion::new(2);
//! for shift in [3, 0] {
//!     let pixels = (0..64 * 48).map(|i| grey(i % 64 + shift, i / 64)).collect();
//!     motion.see(&Image::from_vec(size, pixels));
//! }
//! let found = motion.median_px().ok_or("nothing changes")?;
//! assert!((found - 3.0).abs() < 0.5, "{found}");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use gs2e_image::{Image, Size};

/// Number of pairs that are measured, at most.
const PAIRS: usize = 12;
/// Longest side of the small picture, px.
const SMALL: usize = 192;
/// Side of a block in the small picture, px.
const BLOCK: usize = 16;
/// Number of blocks of a pair.
const BLOCKS: usize = 16;
/// The search reaches this part of the width of the picture.
const REACH: usize = 8;
/// Smallest standard deviation of a block, grey: several times the noise of 8-bit video.
const TEXTURE: f32 = 4.0;
/// Smallest correlation of a block with its place in the next frame.
const FOUND: f32 = 0.8;
/// Cost of a displacement of the whole reach, variances. It decides between equal places.
const FAR: f32 = 0.02;
/// Change of a pixel that rounding and compression do not make, grey.
const CHANGE: f32 = 2.0;
/// Share of pixels of two frames that may change although the second repeats the first.
const REPEATED: f64 = 0.001;
/// Share of pixels that changes between frames of a clip that moves.
const MOVED: f64 = 0.02;

/// The motion between the frames of a sequence so far.
#[derive(Debug)]
pub struct FrameMotion {
    last: Option<Image<f32>>,
    frames: usize,
    /// Pairs between two measured ones.
    apart: usize,
    /// First frame of the next pair that is measured.
    next: usize,
    /// Median motion of the blocks of each measured pair, px; infinite where no block was found again.
    medians: Vec<f32>,
    repeated: usize,
    /// Number of runs of repeated frames.
    runs: usize,
    is_repeat: bool,
    /// Share of changed pixels of each pair without a repeat.
    changed: Vec<f64>,
}

impl FrameMotion {
    /// Starts before the first of `frames` frames.
    #[must_use]
    pub fn new(frames: usize) -> Self {
        Self {
            last: None,
            frames: 0,
            apart: frames / PAIRS,
            next: 0,
            medians: Vec::new(),
            repeated: 0,
            runs: 0,
            is_repeat: false,
            changed: Vec::new(),
        }
    }

    /// Takes the next frame.
    pub fn see(&mut self, luminance: &Image<f32>) {
        if let Some(last) = self.last.take() {
            let changed = changed_share(&last, luminance);
            let is_repeat = changed <= REPEATED;
            self.repeated += usize::from(is_repeat);
            self.runs += usize::from(is_repeat && !self.is_repeat);
            self.is_repeat = is_repeat;
            if !is_repeat {
                self.changed.push(changed);
                if self.frames >= self.next {
                    self.next = self.frames + self.apart;
                    self.medians.extend(block_motion(&last, luminance));
                }
            }
        }
        self.frames += 1;
        self.last = Some(luminance.clone());
    }

    /// The median motion over measured pairs, px: infinite if the blocks of most pairs are not found again;
    /// `None` if too little changes.
    #[must_use]
    pub fn median_px(&self) -> Option<f32> {
        median(self.medians.clone())
    }

    /// Number of frames that repeat the one before, and the number of all but the first, if repeated frames
    /// alternate with others that move.
    #[must_use]
    pub fn repeated(&self) -> Option<[usize; 2]> {
        let pairs = self.frames.saturating_sub(1);
        let changed: Vec<f64> = self.changed.clone();
        let moves = median(changed).is_some_and(|share| share >= MOVED);
        // A camera that rests now and then repeats frames in one or two runs.
        let is_regular = self.runs >= 3 && 10 * self.repeated >= pairs;
        (moves && is_regular).then_some([self.repeated, pairs])
    }
}

fn median<T: PartialOrd + Copy>(mut values: Vec<T>) -> Option<T> {
    values.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    values.get(values.len() / 2).copied()
}

/// Share of the pixels that change by more than rounding.
fn changed_share(a: &Image<f32>, b: &Image<f32>) -> f64 {
    let changed = a.pixels().iter().zip(b.pixels()).filter(|(a, b)| (**a - **b).abs() > CHANGE).count();
    changed as f64 / a.size().pixels().max(1) as f64
}

/// A block by its corner in the small picture.
#[derive(Debug, Clone, Copy)]
struct Block {
    x: usize,
    y: usize,
    variance: f32,
    change: f32,
}

/// The median length of the motion of blocks, px; infinite if most are not found again, `None` if too few
/// change.
fn block_motion(a: &Image<f32>, b: &Image<f32>) -> Option<f32> {
    let size = a.size();
    let longest = size.width.max(size.height) as usize;
    let scale = longest.div_ceil(SMALL).max(1);
    let [small_a, small_b] = [a, b].map(|image| shrink(image, scale));
    let mut blocks = find_blocks(&small_a, &small_b);
    blocks.sort_by(|p, q| q.change.total_cmp(&p.change));
    blocks.truncate(BLOCKS);
    let reach = (size.width as usize / scale / REACH).max(2);
    let lengths = blocks.iter().map(|block| {
        let coarse = Search { a: &small_a, b: &small_b, corner: [block.x, block.y], stride: 1 };
        let [dx, dy] = coarse.best([0, 0], reach as isize, reach, block.variance)?.whole;
        // The place is known to a pixel of the small picture, so the full one is searched within that.
        let fine = Search { a, b, corner: [block.x * scale, block.y * scale], stride: scale };
        let start = [dx * scale as isize, dy * scale as isize];
        let [dx, dy] = fine.best(start, scale as isize, reach * scale, block.variance)?.exact;
        Some(libm::hypotf(dx, dy))
    });
    let lengths: Vec<f32> = lengths.map(|length| length.unwrap_or(f32::INFINITY)).collect();
    if lengths.len() < 3 { None } else { median(lengths) }
}

/// The mean of each `scale` x `scale` pixels.
fn shrink(image: &Image<f32>, scale: usize) -> Image<f32> {
    let (width, height) = (image.size().width as usize, image.size().height as usize);
    let (columns, rows) = (width / scale, height / scale);
    let mean = |at: usize| {
        let (x, y) = (at % columns * scale, at / columns * scale);
        let sum: f32 = (y..y + scale)
            .map(|y| image.pixels()[y * width + x..y * width + x + scale].iter().sum::<f32>())
            .sum();
        sum / (scale * scale) as f32
    };
    #[expect(clippy::cast_possible_truncation, reason = "at most the sides of the image")]
    let size = Size { width: columns as u32, height: rows as u32 };
    Image::from_vec(size, (0..columns * rows).map(mean).collect())
}

/// The blocks with texture that change.
fn find_blocks(a: &Image<f32>, b: &Image<f32>) -> Vec<Block> {
    let (width, height) = (a.size().width as usize, a.size().height as usize);
    let corners = |end: usize| (0..(end + 1).saturating_sub(BLOCK)).step_by(BLOCK / 2);
    let block = |x: usize, y: usize| {
        let rows = || (y..y + BLOCK).map(|y| y * width + x..y * width + x + BLOCK);
        let count = (BLOCK * BLOCK) as f32;
        let mean = rows().map(|row| a.pixels()[row].iter().sum::<f32>()).sum::<f32>() / count;
        let (mut variance, mut change) = (0.0, 0.0);
        for (p, q) in rows().flat_map(|row| a.pixels()[row.clone()].iter().zip(&b.pixels()[row])) {
            variance += (p - mean) * (p - mean) / count;
            change += (p - q) * (p - q) / count;
        }
        (variance > TEXTURE * TEXTURE).then_some(Block { x, y, variance, change })
    };
    corners(height).flat_map(|y| corners(width).filter_map(move |x| block(x, y))).collect()
}

/// A block in one frame that is looked for in the next. Its pixels are `stride` apart.
struct Search<'a> {
    a: &'a Image<f32>,
    b: &'a Image<f32>,
    corner: [usize; 2],
    stride: usize,
}

/// A displacement in whole pixels, and between them.
struct Displacement {
    whole: [isize; 2],
    exact: [f32; 2],
}

impl Search<'_> {
    /// The best place within `radius` pixels of a start; `None` if the block is not found there.
    fn best(&self, start: [isize; 2], radius: isize, reach: usize, variance: f32) -> Option<Displacement> {
        let mut best: Option<(f32, f32, [isize; 2])> = None;
        for dy in -radius..=radius {
            for dx in -radius..=radius {
                let place = [start[0] + dx, start[1] + dy];
                let Some(cost) = self.cost(place) else { continue };
                let [x, y] = place.map(|side| side as f32 / reach as f32);
                let all = cost + FAR * variance * (x * x + y * y);
                if best.as_ref().is_none_or(|(least, ..)| all < *least) {
                    best = Some((all, cost, place));
                }
            }
        }
        let (_, cost, whole) = best?;
        // Of two alike blocks with a correlation r, the mean square of the difference is 2 (1 - r) variances.
        (cost <= 2.0 * (1.0 - FOUND) * variance)
            .then(|| Displacement { whole, exact: self.refine(whole, cost) })
    }

    /// Mean square of the difference, less that of the means; `None` outside of the picture.
    fn cost(&self, [dx, dy]: [isize; 2]) -> Option<f32> {
        let (width, height) = (self.a.size().width as usize, self.a.size().height as usize);
        let last = (BLOCK - 1) * self.stride;
        let moved = [self.corner[0].checked_add_signed(dx)?, self.corner[1].checked_add_signed(dy)?];
        if moved[0] + last >= width || moved[1] + last >= height {
            return None;
        }
        let (mut sum, mut squares) = (0.0, 0.0);
        for row in 0..BLOCK {
            let line = |corner: [usize; 2]| (corner[1] + row * self.stride) * width + corner[0];
            let (from, to) = (line(self.corner), line(moved));
            for column in (0..=last).step_by(self.stride) {
                let difference = self.b.pixels()[to + column] - self.a.pixels()[from + column];
                sum += difference;
                squares += difference * difference;
            }
        }
        let count = (BLOCK * BLOCK) as f32;
        // A common change of brightness is no motion, so the mean difference does not count.
        Some(squares / count - (sum / count) * (sum / count))
    }

    /// The lowest point of a parabola through the costs of three neighbours, in each direction.
    fn refine(&self, whole: [isize; 2], cost: f32) -> [f32; 2] {
        let along = |axis: usize| {
            let at = |by: isize| {
                let mut place = whole;
                place[axis] += by;
                self.cost(place)
            };
            let (Some(before), Some(after)) = (at(-1), at(1)) else { return 0.0 };
            let curve = before - 2.0 * cost + after;
            // No whole place tried is lower, so the lowest point lies within half a pixel of this one.
            if curve > 0.0 { (0.5 * (before - after) / curve).clamp(-0.5, 0.5) } else { 0.0 }
        };
        [whole[0] as f32 + along(0), whole[1] as f32 + along(1)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { width: 160, height: 120 };

    /// Waves of no common period, moved by `px` to the right and half as far down.
    fn picture(px: f64) -> Image<f32> {
        #[expect(clippy::cast_possible_truncation, reason = "greys")]
        let grey = |i: usize| {
            let (x, y) = ((i % 160) as f64 - px, (i / 160) as f64 - 0.5 * px);
            let waves = [(0.31, 0.17, 0.3), (0.11, -0.29, 1.7), (-0.23, 0.07, 4.1), (0.05, 0.41, 2.2)];
            (128.0 + 30.0 * waves.iter().map(|(a, b, c)| (a * x + b * y + c).sin()).sum::<f64>()) as f32
        };
        Image::from_vec(SIZE, (0..SIZE.pixels()).map(grey).collect())
    }

    fn watch(frames: impl IntoIterator<Item = Image<f32>>) -> FrameMotion {
        let frames: Vec<Image<f32>> = frames.into_iter().collect();
        let mut motion = FrameMotion::new(frames.len());
        frames.iter().for_each(|frame| motion.see(frame));
        motion
    }

    #[test]
    fn motion_is_found_far_beyond_the_width_of_an_edge() {
        for px in [0.5, 1.8, 3.7, 7.4, 14.8] {
            let found = f64::from(watch((0..4).map(|i| picture(px * f64::from(i)))).median_px().unwrap());
            let wanted = px * 1.25f64.sqrt();
            // The parabola is exact to a tenth of a pixel in each direction.
            assert!((found - wanted).abs() < 0.2, "{wanted}: {found}");
        }
    }

    #[test]
    fn pictures_without_texture_say_nothing() {
        assert_eq!(watch((0..3u8).map(|i| Image::filled(SIZE, f32::from(i) * 50.0))).median_px(), None);
        assert_eq!(watch([]).median_px(), None);
        assert_eq!(watch([picture(0.0)]).median_px(), None);
        let thin = Size { width: 1, height: 1 };
        assert_eq!(watch((0..3u8).map(|i| Image::filled(thin, f32::from(i) * 9.0))).median_px(), None);
    }

    #[test]
    fn another_picture_is_not_found_again() {
        // Squares of 4x4 pixels, with greys of their own in each frame.
        let mixed = |n: u32| {
            let n = (n ^ (n >> 16)).wrapping_mul(0x85eb_ca6b);
            (n ^ (n >> 13)).wrapping_mul(0xc2b2_ae35)
        };
        let unrelated = |frame: u32| {
            let square = |i: u32| frame * 10_000 + i / 160 / 4 * 100 + i % 160 / 4;
            let grey = |i: u32| f32::from(mixed(square(i)).to_be_bytes()[0]);
            Image::from_vec(SIZE, (0..160 * 120).map(grey).collect())
        };
        assert_eq!(watch((0..4).map(unrelated)).median_px(), Some(f32::INFINITY));
    }

    #[test]
    fn repeated_frames_are_counted_if_they_alternate() {
        let up = |times: i32, frames: i32| watch((0..frames).map(|i| picture(3.0 * f64::from(i / times))));
        assert_eq!(up(10, 60).repeated(), Some([54, 59]));
        assert_eq!(up(2, 40).repeated(), Some([20, 39]));
        assert_eq!(up(1, 40).repeated(), None);
        let rests = (0..40).map(|i| picture(3.0 * f64::from(if i < 20 { i } else { 20 })));
        assert_eq!(watch(rests).repeated(), None);
    }
}
