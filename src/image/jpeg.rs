//! JPEG files: reading of luminance (the file's own luma, which is the sum of encoded colours by
//! [`super::LUMINANCE_WEIGHTS`]) and of colours; writing of small pictures.
//!
//! Decoder and encoder are built without their vector instructions, so that a file gives the same
//! greys, and a picture the same bytes, on every machine.

use super::{Image, Shades, Size};
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use std::io::Cursor;
use zune_jpeg::JpegDecoder;
use zune_jpeg::errors::DecodeErrors;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Most columns and rows of an image that is read: what a file claims is bounded before memory is taken for it.
const MOST_EDGE: usize = 1 << 14;

/// The reason why a JPEG cannot be read.
#[derive(Debug, thiserror::Error)]
#[error("{0:?}")]
pub struct JpegError(#[from] DecodeErrors);

/// Reads the luminance of an image, grey 0..255.
///
/// # Errors
/// The bytes are damaged or not a JPEG, the image has no luma (CMYK), or it exceeds 16,384 columns
/// or rows.
pub fn read_luminance(bytes: &[u8]) -> Result<Image<f32>, JpegError> {
    let (size, _, greys) = decoded(bytes, ColorSpace::Luma)?;
    if greys.len() != size.pixels() {
        return Err(JpegError(DecodeErrors::FormatStatic("it has no luma of its own")));
    }
    Ok(Image::from_vec(size, greys.into_iter().map(f32::from).collect()))
}

/// [`read_luminance`], with the colours of the image, 0..255, unless it is grey.
///
/// # Errors
/// As [`read_luminance`]; or the chroma, which that function does not read, is damaged or of the
/// wrong size.
pub fn read_colours(bytes: &[u8]) -> Result<Shades, JpegError> {
    let luminance = read_luminance(bytes)?;
    let (size, stored, samples) = decoded(bytes, ColorSpace::RGB)?;
    if stored == Some(ColorSpace::Luma) {
        return Ok(Shades { luminance, colours: None });
    }
    if samples.len() != 3 * size.pixels() {
        return Err(JpegError(DecodeErrors::FormatStatic("it has no red, green and blue")));
    }
    let colours = samples.as_chunks().0.iter().map(|rgb: &[u8; 3]| rgb.map(f32::from)).collect();
    Ok(Shades { luminance, colours: Some(Image::from_vec(size, colours)) })
}

/// Reads an 8-bit image as it is encoded; grey becomes three equal channels.
///
/// # Errors
/// The bytes are damaged or not a JPEG, or the image exceeds 16,384 columns or rows.
pub fn read(bytes: &[u8]) -> Result<Image<[u8; 3]>, JpegError> {
    let (size, _, samples) = decoded(bytes, ColorSpace::RGB)?;
    let pixels = match samples.len().checked_div(size.pixels()) {
        Some(3) => samples.as_chunks().0.to_vec(),
        Some(1) => samples.into_iter().map(|grey| [grey; 3]).collect(),
        _ => {
            return Err(JpegError(DecodeErrors::FormatStatic("it has neither grey nor red, green and blue")));
        }
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

/// Size, the colour space of the file, and the samples in the requested one.
fn decoded(bytes: &[u8], wanted: ColorSpace) -> Result<(Size, Option<ColorSpace>, Vec<u8>), JpegError> {
    let options = DecoderOptions::new_safe()
        .set_strict_mode(true)
        .set_max_width(MOST_EDGE)
        .set_max_height(MOST_EDGE)
        .jpeg_set_out_colorspace(wanted);
    let mut decoder = JpegDecoder::new_with_options(Cursor::new(bytes), options);
    let samples = decoder.decode()?;
    let side = |n: usize| u32::try_from(n).unwrap_or(0);
    let (width, height) = decoder.dimensions().unwrap_or((0, 0));
    Ok((Size { width: side(width), height: side(height) }, decoder.input_colorspace(), samples))
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
        let image = read_luminance(&bytes()).unwrap();
        assert_eq!(image.size(), Size { width: 16, height: 8 });
        for (i, &grey) in image.pixels().iter().enumerate() {
            let wanted = if i % 16 < 8 { 124.0 } else { 42.0 };
            // Decoders may round the inverse transform differently.
            assert!((grey - wanted).abs() <= 1.0, "{i}: {grey}");
        }
    }

    #[test]
    fn the_colours_are_those_that_were_written() {
        let Shades { luminance, colours } = read_colours(&bytes()).unwrap();
        assert_eq!(luminance, read_luminance(&bytes()).unwrap());
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
        let colours = read_colours(&bytes).unwrap().colours.unwrap();
        let read = read(&bytes).unwrap();
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
        let found = read(&written).unwrap();
        assert_eq!(found.size(), size);
        let off = |(a, b): (&[u8; 3], &[u8; 3])| (0..3).map(|c| a[c].abs_diff(b[c])).max().unwrap();
        let worst = found.pixels().iter().zip(image.pixels()).map(off).max().unwrap();
        // The quantiser of quality 85 drops little of a gradient: half a step of its coarsest low
        // frequency, twice because colours are rounded in both directions.
        assert!(worst <= 12, "{worst}");
        assert_eq!(encode(&Image::filled(Size { width: 0, height: 3 }, [0; 3]), 85), None);
    }

    #[test]
    fn damage_is_an_error() {
        let whole = bytes();
        assert_eq!(whole.len(), 292);
        for cut in 0..whole.len() - 10 {
            assert!(read_luminance(&whole[..cut]).is_err(), "{cut} of {} bytes", whole.len());
        }
        assert!(read_luminance(b"no image").is_err());
    }
}
