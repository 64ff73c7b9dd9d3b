//! JPEG files: reading of luminance (the file's own luma, which is the sum of encoded colours by
//! [`super::LUMINANCE_WEIGHTS`]) and of colours; writing of small pictures.
//!
//! Decoder and encoder are built without their vector instructions, so that a file gives the same
//! greys, and a picture the same bytes, on every machine.
//!
//! # Examples
//!
//! ```
//! use gs2e_image::{Image, Size, jpeg};
//!
//! let image = Image::filled(Size { width: 16, height: 16 }, [128_u8; 3]);
//! let bytes = jpeg::encode(&image, 90).ok_or("a picture without pixels")?;
//! let greys = jpeg::read_luminance(&bytes, Some(image.size()))?;
//! // A JPEG stores the difference from 128, so this grey has no rounding.
//! assert!(greys.pixels().iter().all(|grey| *grey == 128.0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::{GreyImage, Image, MAX_PIXELS, Size};
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use std::io::Cursor;
use zune_jpeg::JpegDecoder;
use zune_jpeg::errors::DecodeErrors;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Maximum number of columns, and of rows, of an image that is read.
const MAX_EDGE: usize = 1 << 14;

/// Maximum number of pixels per byte: each block of 64 takes at least one bit.
const MAX_PIXELS_PER_BYTE: usize = 8 * 64;

/// The reason why a JPEG cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum JpegError {
    /// The bytes are damaged or no JPEG.
    #[error("{0:?}")]
    Damaged(#[from] DecodeErrors),
    /// An image of another size, or larger than its file can hold.
    #[error("an image of {found}, wanted {wanted}")]
    Size {
        /// The size found.
        found: Size,
        /// The size wanted.
        wanted: String,
    },
}

/// The error for an image without the wanted channels.
fn lacks(channels: &'static str) -> JpegError {
    JpegError::Damaged(DecodeErrors::FormatStatic(channels))
}

/// Reads the luminance of an image, grey 0..255. If `wanted` is given, an image of another size is
/// refused by its header.
///
/// # Errors
/// The bytes are damaged or not a JPEG, the image has no luma of its own (CMYK), it has more than
/// 16,384 columns or rows, or it has another size than `wanted`.
pub fn read_luminance(bytes: &[u8], wanted: Option<Size>) -> Result<Image<f32>, JpegError> {
    let (size, _, greys) = decode_as(bytes, ColorSpace::Luma, wanted)?;
    if greys.len() != size.pixels() {
        return Err(lacks("it has no luma channel"));
    }
    Ok(Image::from_vec(size, greys.into_iter().map(f32::from).collect()))
}

/// [`read_luminance`], with the colours of the image, 0..255, unless it is grey.
///
/// # Errors
/// As [`read_luminance`]. Also, the chroma, which [`read_luminance`] does not read, is damaged or
/// smaller than the luma requires.
pub fn read_colours(bytes: &[u8], wanted: Option<Size>) -> Result<GreyImage, JpegError> {
    // Luma is decoded by itself. Computed from the decoded colours, it would be rounded twice.
    let luminance = read_luminance(bytes, wanted)?;
    let (size, stored, samples) = decode_as(bytes, ColorSpace::RGB, wanted)?;
    if stored == Some(ColorSpace::Luma) {
        return Ok(GreyImage { luminance, colours: None });
    }
    if samples.len() != 3 * size.pixels() {
        return Err(lacks("it has no red, green and blue channels"));
    }
    let colours = samples.as_chunks().0.iter().map(|rgb: &[u8; 3]| rgb.map(f32::from)).collect();
    Ok(GreyImage { luminance, colours: Some(Image::from_vec(size, colours)) })
}

/// Reads an 8-bit image as it is encoded; grey becomes three equal channels.
///
/// # Errors
/// The bytes are damaged or not a JPEG, or the image has more than 16,384 columns or rows, or
/// another size than `wanted`.
pub fn read_rgb(bytes: &[u8], wanted: Option<Size>) -> Result<Image<[u8; 3]>, JpegError> {
    let (size, _, samples) = decode_as(bytes, ColorSpace::RGB, wanted)?;
    // The decoder may give one sample per pixel for grey. An image without pixels has no ratio.
    let pixels = match samples.len().checked_div(size.pixels()) {
        Some(3) => samples.as_chunks().0.to_vec(),
        Some(1) => samples.into_iter().map(|grey| [grey; 3]).collect(),
        _ => return Err(lacks("it has neither a grey channel nor red, green and blue channels")),
    };
    Ok(Image::from_vec(size, pixels))
}

/// An image as a baseline JPEG of this quality, 1 to 100, with chroma at half the resolution. It is
/// for display; images for measurements are PNG. `None` if it has no pixels, or more than 65,535
/// columns or rows.
#[must_use]
pub fn encode(image: &Image<[u8; 3]>, quality: u8) -> Option<Vec<u8>> {
    let side = |n: u32| u16::try_from(n).ok();
    let (width, height) = (side(image.size().width)?, side(image.size().height)?);
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, quality);
    encoder.set_sampling_factor(SamplingFactor::F_2_2);
    // Optimised tables would save some 400 bytes, but the encoder would then write one scan per
    // channel, which not every decoder reads for subsampled channels; the decoder used here does
    // not.
    encoder.set_optimized_huffman_tables(false);
    encoder.encode(image.pixels().as_flattened(), width, height, ColorType::Rgb).ok()?;
    Some(bytes)
}

/// Size, the colour space of the file, and the samples in `space`.
fn decode_as(
    bytes: &[u8],
    space: ColorSpace,
    wanted: Option<Size>,
) -> Result<(Size, Option<ColorSpace>, Vec<u8>), JpegError> {
    // Strict, because the decoder otherwise makes a picture of damaged data and reports no error.
    let options = DecoderOptions::new_safe()
        .set_strict_mode(true)
        .set_max_width(MAX_EDGE)
        .set_max_height(MAX_EDGE)
        .jpeg_set_out_colorspace(space);
    let mut decoder = JpegDecoder::new_with_options(Cursor::new(bytes), options);
    decoder.decode_headers()?;
    let side = |n: usize| u32::try_from(n).unwrap_or(0);
    let (width, height) = decoder.dimensions().unwrap_or((0, 0));
    let size = Size { width: side(width), height: side(height) };
    // Before anything is decoded: a small file can claim gigabytes.
    check_claim(size, bytes.len(), wanted)?;
    let samples = decoder.decode()?;
    Ok((size, decoder.input_colorspace(), samples))
}

/// Refuses a size other than the wanted one, and more pixels than the file can hold.
fn check_claim(size: Size, file: usize, wanted: Option<Size>) -> Result<(), JpegError> {
    let refuse = |wanted: String| Err(JpegError::Size { found: size, wanted });
    if let Some(wanted) = wanted.filter(|wanted| *wanted != size) {
        return refuse(wanted.to_string());
    }
    if size.pixels() > MAX_PIXELS.min(file.saturating_mul(MAX_PIXELS_PER_BYTE)) {
        return refuse(format!("no more pixels than {file} bytes of JPEG can hold"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 16x8 pixels, left half (200, 100, 50), right half (10, 20, 240), by libjpeg-turbo (Pillow
    /// 13.0), which gives the greys 124 and 42.
    const TWO_HALVES: &str = "\
        ffd8ffe000104a46494600010100000100010000ffdb0043000302020302020303030304030304050805050404050a07\
        0706080c0a0c0c0b0a0b0b0d0e12100d0e110e0b0b1016101113141515150c0f171816141812141514ffdb0043010304\
        0405040509050509140d0b0d141414141414141414141414141414141414141414141414141414141414141414141414\
        1414141414141414141414141414ffc00011080008001003011100021101031101ffc400150001010000000000000000\
        0000000000000408ffc40014100100000000000000000000000000000000ffc400160101010100000000000000000000\
        000000080709ffc40014110100000000000000000000000000000000ffda000c03010002110311003f00221e482256cd\
        864fffd9";

    fn bytes() -> Vec<u8> {
        let digits: Vec<u8> = TWO_HALVES.bytes().filter(u8::is_ascii_hexdigit).collect();
        let digit = |c: u8| u8::try_from(char::from(c).to_digit(16).unwrap()).unwrap();
        digits.chunks(2).map(|pair| 16 * digit(pair[0]) + digit(pair[1])).collect()
    }

    #[test]
    fn the_greys_are_those_of_another_decoder() {
        let image = read_luminance(&bytes(), None).unwrap();
        assert_eq!(image.size(), Size { width: 16, height: 8 });
        for (i, &grey) in image.pixels().iter().enumerate() {
            let wanted = if i % 16 < 8 { 124.0 } else { 42.0 };
            // Decoders may round the inverse transform differently.
            assert!((grey - wanted).abs() <= 1.0, "{i}: {grey}");
        }
    }

    #[test]
    fn the_colours_are_those_that_were_written() {
        let GreyImage { luminance, colours } = read_colours(&bytes(), None).unwrap();
        assert_eq!(luminance, read_luminance(&bytes(), None).unwrap());
        for (i, colour) in colours.unwrap().pixels().iter().enumerate() {
            let wanted = if i % 16 < 8 { [200.0, 100.0, 50.0] } else { [10.0, 20.0, 240.0] };
            // Luma and chroma are each rounded twice, by half a step; blue has a factor of 1.772 on
            // its chroma.
            let off = colour.iter().zip(wanted).map(|(found, wanted): (&f32, f32)| (found - wanted).abs());
            assert!(off.fold(0.0, f32::max) <= 3.0, "{i}: {colour:?}");
        }
    }

    #[test]
    fn bytes_are_read_as_colours_are() {
        let bytes = bytes();
        let colours = read_colours(&bytes, None).unwrap().colours.unwrap();
        let read = read_rgb(&bytes, None).unwrap();
        assert_eq!(read.size(), colours.size());
        let bits = |rgb: &[f32; 3]| rgb.map(f32::to_bits);
        let same = |(a, b): (&[u8; 3], &[f32; 3])| bits(&a.map(f32::from)) == bits(b);
        assert!(read.pixels().iter().zip(colours.pixels()).all(same));
    }

    #[test]
    fn what_is_written_looks_like_the_image() {
        let size = Size { width: 45, height: 31 };
        let colour = |i: u32| {
            let shade = |n: u32| u8::try_from(n).unwrap();
            [shade(40 + 4 * (i % 45)), shade(240 - 6 * (i / 45)), 90]
        };
        let image = Image::from_vec(size, (0..45 * 31).map(colour).collect());
        let written = encode(&image, 85).unwrap();
        assert!(written.len() < 45 * 31 * 3 / 4, "{} bytes", written.len());
        let found = read_rgb(&written, None).unwrap();
        assert_eq!(found.size(), size);
        let off = |(a, b): (&[u8; 3], &[u8; 3])| (0..3).map(|c| a[c].abs_diff(b[c])).max().unwrap();
        let worst = found.pixels().iter().zip(image.pixels()).map(off).max().unwrap();
        // The quantiser of quality 85 drops little of a gradient: half a step of its coarsest low
        // frequency, twice because colours are rounded in both directions.
        assert!(worst <= 12, "{worst}");
        assert_eq!(encode(&Image::filled(Size { width: 0, height: 3 }, [0; 3]), 85), None);
    }

    #[test]
    fn sizes_are_refused_before_memory_is_taken() {
        let mut file = bytes();
        let at = file.windows(2).position(|marker| marker == [0xff, 0xc0]).unwrap();
        let other = Size { width: 8, height: 8 };
        let error = read_rgb(&file, Some(other)).unwrap_err().to_string();
        assert_eq!(error, "an image of 16x8, wanted 8x8");
        // Rows and columns stand behind the marker, a length and the number of bits.
        file[at + 5..at + 9].copy_from_slice(&[0x40, 0, 0x40, 0]);
        let error = read_luminance(&file, None).unwrap_err().to_string();
        assert_eq!(error, "an image of 16384x16384, wanted no more pixels than 292 bytes of JPEG can hold");
    }

    #[test]
    fn damage_is_an_error() {
        let whole = bytes();
        assert_eq!(whole.len(), 292);
        for cut in 0..whole.len() - 10 {
            assert!(read_luminance(&whole[..cut], None).is_err(), "{cut} of {} bytes", whole.len());
        }
        assert!(read_luminance(b"no image", None).is_err());
    }
}
