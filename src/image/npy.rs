//! Images as numpy's `.npy`, float32, in C order: the numbers as they are, neither clamped nor encoded.
//!
//! Format: version 1.0 of numpy's `lib/format.py`. No time, no name: equal images are equal bytes.

use super::{Image, Size};
use npyz::WriterBuilder;
use std::io::{self, Write};

/// A pixel of one or several 32-bit numbers.
pub trait Pixel: Copy {
    /// How many numbers stand in the array's last axis; `None` where there is no such axis.
    const CHANNELS: Option<u64>;
    /// The numbers of a row of pixels.
    fn values(pixels: &[Self]) -> &[f32];
}

impl Pixel for f32 {
    const CHANNELS: Option<u64> = None;
    fn values(pixels: &[Self]) -> &[f32] {
        pixels
    }
}

impl<const N: usize> Pixel for [f32; N] {
    const CHANNELS: Option<u64> = Some(N as u64);
    fn values(pixels: &[Self]) -> &[f32] {
        pixels.as_flattened()
    }
}

/// Writes an image: `[H, W]`, or `[H, W, N]` where a pixel is several numbers.
///
/// # Errors
/// When `out` fails.
pub fn write<P: Pixel>(image: &Image<P>, out: impl Write) -> io::Result<()> {
    let Size { width, height } = image.size();
    let shape: Vec<u64> = [height.into(), width.into()].into_iter().chain(P::CHANNELS).collect();
    let mut writer = npyz::WriteOptions::new().default_dtype().shape(&shape).writer(out).begin_nd()?;
    writer.extend(P::values(image.pixels()).iter().copied())?;
    writer.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { width: 2, height: 3 };

    fn written<P: Pixel>(image: &Image<P>) -> Vec<u8> {
        let mut out = Vec::new();
        write(image, &mut out).unwrap();
        out
    }

    /// What is on disk is frozen. By hand from the format: magic, version, header padded with spaces to a multiple of 64,
    /// then the numbers. numpy's own `save` leaves out the comma at the end of the shape, and reads both.
    #[test]
    fn the_bytes_are_frozen() {
        let image = Image::from_vec(SIZE, (0u8..6).map(f32::from).collect());
        let mut wanted = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
        let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 2, ), }";
        wanted.extend(format!("{header:117}\n").into_bytes());
        wanted.extend((0u8..6).flat_map(|v| f32::from(v).to_le_bytes()));
        assert_eq!(String::from_utf8_lossy(&written(&image)), String::from_utf8_lossy(&wanted));
        assert_eq!(written(&image), wanted);
    }

    #[test]
    fn pixels_of_several_numbers_have_an_axis_of_their_own() {
        let image = Image::from_vec(SIZE, (0u8..6).map(|v| [f32::from(v), f32::NAN, -2.5]).collect());
        let bytes = written(&image);
        let file = npyz::NpyFile::new(bytes.as_slice()).unwrap();
        assert_eq!((file.shape(), file.order()), (&[3, 2, 3][..], npyz::Order::C));
        let values: Vec<f32> = file.into_vec().unwrap();
        let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&values), bits(image.pixels().as_flattened()));
    }
}
