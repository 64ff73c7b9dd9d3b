//! 8-bit PNG files, grey or sRGB.
//!
//! No chunk but the three that every PNG has, fixed filter and compressor: equal images are equal bytes. The filter is
//! Paeth and the compressor fdeflate's fast one: on a rendered view 1.06 bytes and 4 ns a pixel, where deflate's level
//! 4 under adaptive filters takes 0.98 bytes and 90 ns; encoding must not cost as much as rendering.

use super::{Image, Size, to_byte};
use png::{BitDepth, ColorType, DecodingError, DeflateCompression, Filter, Transformations};
use std::io::{BufRead, Seek, Write};

/// Most pixels of an image that is read: what a file claims is bounded before memory is taken for it.
const MOST_PIXELS: u64 = 1 << 28;

/// A pixel that a PNG holds as it is.
pub trait Pixel: Copy {
    /// Number of bytes.
    const CHANNELS: usize;
    /// How PNG names it.
    const COLOUR: ColorType;
    /// The bytes of a row of pixels.
    fn bytes(pixels: &[Self]) -> &[u8];
}

impl Pixel for u8 {
    const CHANNELS: usize = 1;
    const COLOUR: ColorType = ColorType::Grayscale;
    fn bytes(pixels: &[Self]) -> &[u8] {
        pixels
    }
}

impl Pixel for [u8; 3] {
    const CHANNELS: usize = 3;
    const COLOUR: ColorType = ColorType::Rgb;
    fn bytes(pixels: &[Self]) -> &[u8] {
        pixels.as_flattened()
    }
}

/// Why a PNG cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum PngError {
    /// The bytes are damaged or no PNG.
    #[error("{0}")]
    Damaged(#[from] DecodingError),
    /// A PNG of a kind that is not used here.
    #[error("{found}, wanted {wanted}")]
    Kind {
        /// What it is.
        found: String,
        /// What it should be.
        wanted: &'static str,
    },
}

/// An encoded colour image on the scale 0..1 as bytes, by [`to_byte`].
#[must_use]
pub fn to_bytes(image: &Image<[f32; 3]>) -> Image<[u8; 3]> {
    Image::from_vec(image.size(), image.pixels().iter().map(|rgb| rgb.map(to_byte)).collect())
}

/// Writes an image.
///
/// # Errors
/// When `out` fails, or the image has no pixels.
pub fn write<P: Pixel>(image: &Image<P>, out: impl Write) -> std::io::Result<()> {
    let Size { width, height } = image.size();
    let mut encoder = png::Encoder::new(out, width, height);
    encoder.set_color(P::COLOUR);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_filter(Filter::Paeth);
    encoder.set_deflate_compression(DeflateCompression::FdeflateUltraFast);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(P::bytes(image.pixels()))?;
    Ok(writer.finish()?)
}

/// Reads an 8-bit colour image; grey becomes three equal channels.
///
/// # Errors
/// When the bytes are damaged, or the image has another depth, a palette, transparency, or more than 2^28 pixels.
pub fn read(input: impl BufRead + Seek) -> Result<Image<[u8; 3]>, PngError> {
    let mut decoder = png::Decoder::new(input);
    decoder.set_transformations(Transformations::IDENTITY);
    let mut reader = decoder.read_info()?;
    let (width, height) = reader.info().size();
    if u64::from(width) * u64::from(height) > MOST_PIXELS {
        let found = format!("an image of {width}x{height}");
        return Err(PngError::Kind { found, wanted: "at most 2^28 pixels" });
    }
    let kind = reader.output_color_type();
    let (BitDepth::Eight, ColorType::Grayscale | ColorType::Rgb) = (kind.1, kind.0) else {
        let found = format!("{:?} of {} bits", kind.0, kind.1 as u8);
        return Err(PngError::Kind { found, wanted: "grey or RGB of 8 bits" });
    };
    let size = Size { width, height };
    let mut bytes = vec![0; size.pixels() * kind.0.samples()];
    reader.next_frame(&mut bytes)?;
    reader.finish()?;
    let pixels = match kind.0 {
        ColorType::Grayscale => bytes.iter().map(|&v| [v; 3]).collect(),
        _ => bytes.as_chunks().0.to_vec(),
    };
    Ok(Image::from_vec(size, pixels))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    const SIZE: Size = Size { width: 37, height: 23 };

    fn noise(count: usize) -> Vec<u8> {
        (0..count).map(|i| ((i * 2_654_435_761) >> 13 & 0xff).try_into().unwrap()).collect()
    }

    fn encoded<P: Pixel>(image: &Image<P>) -> Vec<u8> {
        let mut out = Vec::new();
        write(image, &mut out).unwrap();
        out
    }

    #[test]
    fn images_are_read_back() {
        let rgb = Image::from_vec(SIZE, noise(SIZE.pixels() * 3).as_chunks().0.to_vec());
        assert_eq!(read(Cursor::new(encoded(&rgb))).unwrap(), rgb);
        let grey = Image::from_vec(SIZE, noise(SIZE.pixels()));
        let spread = grey.pixels().iter().map(|&v| [v; 3]).collect();
        assert_eq!(read(Cursor::new(encoded(&grey))).unwrap(), Image::from_vec(SIZE, spread));
    }

    #[test]
    fn nothing_but_header_pixels_and_end_is_stored() {
        let file = encoded(&Image::filled(SIZE, [9u8, 8, 7]));
        let mut at = 8;
        let mut names = Vec::new();
        while at < file.len() {
            let len = u32::from_be_bytes(file[at..at + 4].try_into().unwrap()) as usize;
            names.push(String::from_utf8(file[at + 4..at + 8].to_vec()).unwrap());
            at += 12 + len;
        }
        assert_eq!(names, ["IHDR", "IDAT", "IEND"]);
    }

    /// What is on disk is frozen: a change raises the revision of the stages that write pictures.
    #[test]
    fn the_bytes_are_frozen() {
        let rgb = Image::from_vec(SIZE, noise(SIZE.pixels() * 3).as_chunks().0.to_vec());
        let flat = Image::filled(Size { width: 640, height: 360 }, [1u8, 2, 3]);
        let digest = |image: &Image<[u8; 3]>| blake3::hash(&encoded(image)).to_hex()[..16].to_owned();
        assert_eq!([digest(&rgb), digest(&flat)], ["0ec6bbd29f47390c", "f45669a197581962"]);
    }

    #[test]
    fn floats_become_bytes_by_the_one_rule() {
        let image =
            Image::from_vec(Size { width: 2, height: 1 }, vec![[0.0, 0.5, 1.63], [f32::NAN, -1.0, 1.0]]);
        assert_eq!(to_bytes(&image).pixels(), [[0, 128, 255], [0, 0, 255]]);
    }

    #[test]
    fn damage_is_an_error() {
        let whole = encoded(&Image::filled(SIZE, 200u8));
        for cut in 0..whole.len() {
            assert!(read(Cursor::new(&whole[..cut])).is_err(), "{cut} of {} bytes", whole.len());
        }
        for at in 0..whole.len() {
            let mut changed = whole.clone();
            changed[at] ^= 0x5a;
            assert!(read(Cursor::new(&changed)).is_err(), "byte {at} changed");
        }
    }

    #[test]
    fn other_kinds_are_refused_by_name() {
        let mut out = Vec::new();
        let mut encoder = png::Encoder::new(&mut out, 1, 1);
        encoder.set_color(ColorType::Rgba);
        encoder.write_header().unwrap().write_image_data(&[1, 2, 3, 4]).unwrap();
        let error = read(Cursor::new(out)).unwrap_err().to_string();
        assert_eq!(error, "Rgba of 8 bits, wanted grey or RGB of 8 bits");
    }
}
