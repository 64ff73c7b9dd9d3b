//! Lossless compression of images of 32-bit floats, in blocks that several cores take at once.
//!
//! ```text
//! floats ─ order of integers ─ difference to the left ─ planes of bytes ─ zstd
//! ```
//! Neighbouring values share their sign, exponent and first bits of the mantissa, so their differences are
//! small, and planes of the upper bytes are nearly constant.

use rayon::prelude::*;
use std::io;

/// Values of a block.
const BLOCK: usize = 1 << 16;

/// Level of zstd: higher ones take ten times as long for a hundredth of the bytes.
const LEVEL: i32 = 1;

/// The blocks of an image with `stride` interleaved channels.
pub(super) fn compress(values: &[f32], stride: usize) -> io::Result<Vec<Vec<u8>>> {
    values.par_chunks(BLOCK).map(|block| zstd::bulk::compress(&to_planes(block, stride), LEVEL)).collect()
}

/// Number of blocks of an image.
pub(super) fn count_blocks(values: usize) -> usize {
    values.div_ceil(BLOCK)
}

/// Fills an image from its blocks.
pub(super) fn decompress(blocks: &[&[u8]], stride: usize, values: &mut [f32]) -> io::Result<()> {
    let chunks = values.par_chunks_mut(BLOCK).zip(blocks);
    chunks.try_for_each(|(values, block)| {
        let planes = zstd::bulk::decompress(block, 4 * values.len())?;
        if planes.len() != 4 * values.len() {
            return Err(io::ErrorKind::InvalidData.into());
        }
        from_planes(&planes, stride, values);
        Ok(())
    })
}

/// A float as an integer of the same order, so that near values differ by little.
fn ordered(value: f32) -> u32 {
    let bits = value.to_bits();
    if bits >> 31 == 1 { !bits } else { bits | 1 << 31 }
}

fn unordered(value: u32) -> f32 {
    f32::from_bits(if value >> 31 == 1 { value & !(1 << 31) } else { !value })
}

/// A difference with its sign in the lowest bit, so that small ones of both signs have upper bytes of zero.
fn folded(difference: u32) -> u32 {
    difference << 1 ^ if difference >> 31 == 1 { u32::MAX } else { 0 }
}

fn unfolded(value: u32) -> u32 {
    value >> 1 ^ if value & 1 == 1 { u32::MAX } else { 0 }
}

fn to_planes(values: &[f32], stride: usize) -> Vec<u8> {
    let mut planes = vec![0; 4 * values.len()];
    for (i, value) in values.iter().enumerate() {
        let left = i.checked_sub(stride).map_or(0, |left| ordered(values[left]));
        let bytes = folded(ordered(*value).wrapping_sub(left)).to_le_bytes();
        for (plane, byte) in bytes.into_iter().enumerate() {
            planes[plane * values.len() + i] = byte;
        }
    }
    planes
}

fn from_planes(planes: &[u8], stride: usize, values: &mut [f32]) {
    let count = values.len();
    for i in 0..count {
        let left = i.checked_sub(stride).map_or(0, |left| ordered(values[left]));
        let bytes = [0, 1, 2, 3].map(|plane| planes[plane * count + i]);
        values[i] = unordered(left.wrapping_add(unfolded(u32::from_le_bytes(bytes))));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn returns(values: &[f32], stride: usize) -> usize {
        let blocks = compress(values, stride).unwrap();
        assert_eq!(blocks.len(), count_blocks(values.len()));
        let mut back = vec![0.0; values.len()];
        decompress(&blocks.iter().map(Vec::as_slice).collect::<Vec<_>>(), stride, &mut back).unwrap();
        // As bits: values that are not a number return, too.
        let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&back), bits(values));
        blocks.iter().map(Vec::len).sum()
    }

    proptest! {
        #[test]
        fn every_bit_returns(bits in prop::collection::vec(any::<u32>(), 0..300), stride in 1usize..4) {
            returns(&bits.into_iter().map(f32::from_bits).collect::<Vec<_>>(), stride);
        }
    }

    #[test]
    fn special_values_return() {
        returns(
            &[0.0, -0.0, f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MIN_POSITIVE, -1e-45],
            1,
        );
    }

    #[test]
    fn a_smooth_image_of_several_blocks_takes_less_than_half() {
        let values: Vec<f32> = (0..3 * BLOCK + 5).map(|i| (i as f32 * 1e-3).sin().abs()).collect();
        assert!(returns(&values, 1) < 2 * values.len());
    }

    #[test]
    fn a_block_of_another_length_is_refused() {
        let blocks = compress(&[1.0; 10], 1).unwrap();
        assert!(decompress(&[&blocks[0]], 1, &mut [0.0; 11]).is_err());
        assert!(decompress(&[&blocks[0]], 1, &mut [0.0; 9]).is_err());
        assert!(decompress(&[b"not zstd"], 1, &mut [0.0; 9]).is_err());
    }
}
