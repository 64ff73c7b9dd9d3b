//! Brightness of the blocks of a frame, and its change.

use gs2e_image::Image;

/// Number of blocks across and down.
const BLOCKS: [usize; 2] = [12, 9];
/// Share of the blocks that change at least as much, in one direction. An object that enters, or an edge
/// that moves, changes less of the picture.
const SHARE: f64 = 0.2;

/// Mean brightness of each block of a frame, greys.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameBlocks {
    /// Number of its pose.
    pub pose: usize,
    means: Vec<f64>,
}

impl FrameBlocks {
    /// The blocks of a frame. A picture has at most as many of them as pixels.
    #[must_use]
    pub fn new(pose: usize, brightness: &Image<f32>) -> Self {
        let size = brightness.size();
        let [width, height] = [size.width, size.height].map(|edge| edge as usize);
        let [across, down] = [width.min(BLOCKS[0]), height.min(BLOCKS[1])];
        let (mut sums, mut counts) = (vec![0.0; across * down], vec![0.0; across * down]);
        for (y, row) in brightness.pixels().chunks(width).enumerate() {
            let first = y * down / height * across;
            for (x, grey) in row.iter().enumerate() {
                let block = first + x * across / width;
                sums[block] += f64::from(*grey);
                counts[block] += 1.0;
            }
        }
        Self { pose, means: sums.iter().zip(&counts).map(|(sum, count)| sum / count).collect() }
    }

    /// The change to another frame of the same size that `SHARE` of the blocks have or exceed, in the
    /// direction in which it is larger.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an index of a block")]
    pub fn change(&self, other: &Self) -> f64 {
        let mut changes: Vec<f64> = self.means.iter().zip(&other.means).map(|(from, to)| to - from).collect();
        changes.sort_unstable_by(f64::total_cmp);
        let at = (SHARE * changes.len() as f64) as usize;
        // Ascending: `at + 1` blocks fall at least by the first of both, and as many rise by the second.
        (-changes[at]).max(changes[changes.len() - 1 - at]).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_image::Size;

    /// A frame of 60x45 px: 100 grey, with other greys where `add` says so.
    fn frame(add: impl Fn(u32, u32) -> f32) -> FrameBlocks {
        let size = Size { width: 60, height: 45 };
        let pixels = (0..45).flat_map(|y| (0..60).map(move |x| (x, y))).map(|(x, y)| 100.0 + add(x, y));
        FrameBlocks::new(0, &Image::from_vec(size, pixels.collect()))
    }

    #[test]
    fn a_veil_changes_by_its_grey_and_a_small_thing_does_not() {
        let still = frame(|_, _| 0.0);
        assert!((still.change(&frame(|_, _| 7.0)) - 7.0).abs() < 1e-9);
        assert!((still.change(&frame(|x, _| if x < 30 { -7.0 } else { 0.0 })) - 7.0).abs() < 1e-9);
        // A tenth of the picture.
        assert!(still.change(&frame(|x, _| if x < 6 { 90.0 } else { 0.0 })) < 1e-9);
        assert!(still.change(&still) < 1e-9);
    }

    #[test]
    fn blocks_are_never_empty() {
        let small = Image::from_vec(Size { width: 5, height: 2 }, vec![3.0; 10]);
        assert_eq!(FrameBlocks::new(4, &small).means, vec![3.0; 10]);
    }
}
