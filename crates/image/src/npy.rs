//! Images as numpy's `.npy`, float32, in C order, with unclamped and unencoded values; and the
//! headers of these files.
//!
//! Format: version 1.0 of numpy's `lib/format.py`. The file has no time and no name, so equal
//! images are equal bytes.
//!
//! # Examples
//!
//! ```
//! use gs2e_image::{Image, Size, npy};
//!
//! let image = Image::from_vec(Size { width: 3, height: 2 }, vec![0.0_f32, 1.0, 2.0, 3.0, 4.0, 5.0]);
//! let mut bytes = Vec::new();
//! npy::write_image(&image, &mut bytes)?;
//! // The shape begins with the number of rows.
//! assert_eq!(npy::read_values(&[2, 3], &mut &bytes[..])?, image.pixels());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod read;

pub use read::{checked_header, read_floats, read_stack, read_values};

use super::{Image, Size};
use npyz::WriterBuilder;
use std::io::{self, BufWriter, Write};

/// A pixel of one or several 32-bit numbers.
pub trait NpyPixel: Copy {
    /// Length of the array's last axis; `None` without this axis.
    const CHANNELS: Option<u64>;
    /// Returns the numbers of a row of pixels.
    fn values(pixels: &[Self]) -> &[f32];
}

impl NpyPixel for f32 {
    const CHANNELS: Option<u64> = None;
    fn values(pixels: &[Self]) -> &[f32] {
        pixels
    }
}

impl<const N: usize> NpyPixel for [f32; N] {
    const CHANNELS: Option<u64> = Some(N as u64);
    fn values(pixels: &[Self]) -> &[f32] {
        pixels.as_flattened()
    }
}

/// Writes an image: `[H, W]`, or `[H, W, N]` if a pixel has several numbers.
///
/// # Errors
/// Writing to `out` fails.
pub fn write_image<P: NpyPixel>(image: &Image<P>, out: impl Write) -> io::Result<()> {
    let Size { width, height } = image.size();
    let shape: Vec<u64> = [height.into(), width.into()].into_iter().chain(P::CHANNELS).collect();
    write_values(&shape, P::values(image.pixels()), out)
}

/// Writes the numbers of an array of this shape, in C order.
///
/// # Errors
/// Writing to `out` fails.
pub fn write_values(shape: &[u64], values: &[f32], out: impl Write) -> io::Result<()> {
    write_array(shape, values.iter().copied(), out)
}

/// Writes images of one size, `[K, H, W]`; an empty list is `[0, 0, 0]`.
///
/// # Errors
/// Writing to `out` fails.
pub fn write_stack(images: &[Image<f32>], out: impl Write) -> io::Result<()> {
    let Size { width, height } = images.first().map_or(Size { width: 0, height: 0 }, Image::size);
    let shape = [images.len() as u64, height.into(), width.into()];
    write_array(&shape, images.iter().flat_map(|image| image.pixels().iter().copied()), out)
}

fn write_array(shape: &[u64], values: impl Iterator<Item = f32>, out: impl Write) -> io::Result<()> {
    // `npyz` writes number by number: without a buffer, each is a call of the system.
    let mut out = BufWriter::with_capacity(1 << 16, out);
    let mut writer = npyz::WriteOptions::new().default_dtype().shape(shape).writer(&mut out).begin_nd()?;
    writer.extend(values)?;
    writer.finish()?;
    // A buffer that is dropped writes its rest too, but swallows the error of a full disk.
    out.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { width: 2, height: 3 };

    fn written<P: NpyPixel>(image: &Image<P>) -> Vec<u8> {
        let mut out = Vec::new();
        write_image(image, &mut out).unwrap();
        out
    }

    /// The format on disk is frozen. The expected bytes are derived from the format by hand: magic,
    /// version, header padded with spaces to a multiple of 64, then the numbers. numpy's own `save`
    /// omits the comma at the end of the shape, and reads both.
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

    #[test]
    fn heads_that_the_parser_is_not_safe_to_be_given_are_refused() {
        let stored = |text: &str| {
            [b"\x93NUMPY\x01\x00", &[u8::try_from(text.len()).unwrap(), 0][..], text.as_bytes()].concat()
        };
        let t = |text: &str, sound: bool| {
            assert_eq!(checked_header(&mut &stored(text)[..]).is_ok(), sound, "{text}")
        };
        t("{'descr': '<u2', 'fortran_order': False, 'shape': (300, ), }\n", true);
        let shaped =
            |shape: &str| format!("{{'descr': '|u1', 'fortran_order': False, 'shape': ({shape}), }}\n");
        t(&shaped("4294967296, 4294967295"), true);
        t(&shaped("4294967296, 4294967296"), false);
        t(&shaped("4294967296, 4294967296, 0"), false);
        t(&shaped("99999999999999999999"), false);
        t(&"{".repeat(54), false);
        t("{'descr': [('a', '<u2')], 'fortran_order': False, 'shape': (300, ), }\n", false);
        let mut later = stored("{}");
        later[6] = 3;
        assert!(checked_header(&mut &later[..]).is_err(), "no head of 4 GB");
    }
}
