//! PNG files, grey or sRGB: written with 8 bits, read with 8 or 16.
//!
//! Only the three chunks that every PNG has, with a fixed filter and compressor: equal images are
//! equal bytes. The filter is Paeth and the compressor fdeflate's fast one: on a rendered view it
//! takes 1.06 bytes and 4 ns per pixel, where deflate's level 4 with adaptive filters takes 0.98
//! bytes and 90 ns. Encoding must not cost as much as rendering.
//!
//! # Examples
//!
//! ```
//! use gs2e_image::{Image, Size, png};
//! use std::io::Cursor;
//!
//! let encoded = Image::filled(Size { width: 2, height: 2 }, [1.0, 0.5, -0.1]);
//! let image = png::to_bytes(&encoded);
//! let mut bytes = Vec::new();
//! png::write_image(&image, &mut bytes)?;
//! assert_eq!(png::read_rgb(Cursor::new(&bytes))?, image);
//! // 127.5 is rounded up, and what is below 0 is clipped.
//! assert_eq!(image.pixels()[0], [255, 128, 0]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::{GreyImage, Image, LUMINANCE_WEIGHTS, MAX_PIXELS, Size, to_byte};
use gs2e_files::budget;
use gs2e_files::budget::{ByteBudget, MAX_DEFLATE_RATIO};
use png::{BitDepth, ColorType, DecodingError, DeflateCompression, Filter, Reader, Transformations};
use std::collections::TryReserveError;
use std::io::{self, BufRead, Cursor, Seek, SeekFrom, Write};

/// A pixel in the form in which a PNG stores it.
pub trait PngPixel: Copy {
    /// Colour type of the PNG.
    const COLOUR: ColorType;
    /// The bytes of a row of pixels.
    fn bytes(pixels: &[Self]) -> &[u8];
}

impl PngPixel for u8 {
    const COLOUR: ColorType = ColorType::Grayscale;
    fn bytes(pixels: &[Self]) -> &[u8] {
        pixels
    }
}

impl PngPixel for [u8; 3] {
    const COLOUR: ColorType = ColorType::Rgb;
    fn bytes(pixels: &[Self]) -> &[u8] {
        pixels.as_flattened()
    }
}

/// The reason why a PNG cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum PngError {
    /// The bytes are damaged or not a PNG.
    #[error("{0}")]
    Damaged(#[from] DecodingError),
    /// A PNG of an unsupported kind.
    #[error("{found}, wanted {wanted}")]
    Kind {
        /// The kind found.
        found: String,
        /// The kind wanted.
        wanted: &'static str,
    },
    /// An image of another size, or larger than its file can hold.
    #[error("an image of {found}, wanted {wanted}")]
    Size {
        /// The size found.
        found: Size,
        /// The size wanted.
        wanted: String,
    },
    /// There is no memory for the pixels.
    #[error("{0}")]
    Memory(#[from] TryReserveError),
}

impl From<io::Error> for PngError {
    fn from(error: io::Error) -> Self {
        Self::Damaged(error.into())
    }
}

/// An encoded colour image on the scale 0..1 as bytes, with [`to_byte`].
#[must_use]
pub fn to_bytes(image: &Image<[f32; 3]>) -> Image<[u8; 3]> {
    Image::from_vec(image.size(), image.pixels().iter().map(|rgb| rgb.map(to_byte)).collect())
}

/// Writes an image.
///
/// # Errors
/// `out` fails, or the image has no pixels.
pub fn write_image<P: PngPixel>(image: &Image<P>, out: impl Write) -> std::io::Result<()> {
    write_rows(image.size(), P::COLOUR, P::bytes(image.pixels()), out)
}

/// Writes a colour image of 16 bits, whose channels may hold anything.
///
/// # Errors
/// `out` fails, or the image has no pixels.
pub fn write_wide(image: &Image<[u16; 3]>, out: impl Write) -> std::io::Result<()> {
    let bytes: Vec<u8> = image.pixels().as_flattened().iter().flat_map(|v| v.to_be_bytes()).collect();
    write_depth(image.size(), ColorType::Rgb, BitDepth::Sixteen, &bytes, out)
}

/// Writes the rows of an image of 8 bits.
fn write_rows(size: Size, colour: ColorType, rows: &[u8], out: impl Write) -> std::io::Result<()> {
    write_depth(size, colour, BitDepth::Eight, rows, out)
}

fn write_depth(
    size: Size,
    colour: ColorType,
    depth: BitDepth,
    rows: &[u8],
    out: impl Write,
) -> std::io::Result<()> {
    let Size { width, height } = size;
    let mut encoder = png::Encoder::new(out, width, height);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    encoder.set_filter(Filter::Paeth);
    encoder.set_deflate_compression(DeflateCompression::FdeflateUltraFast);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(rows)?;
    Ok(writer.finish()?)
}

/// Reads an 8-bit colour image; grey becomes three equal channels.
///
/// # Errors
/// The bytes are damaged, or the image has another depth, a palette, transparency, or more than
/// 2^28 pixels.
pub fn read_rgb(input: impl BufRead + Seek) -> Result<Image<[u8; 3]>, PngError> {
    colours(read_stored(input, None)?)
}

/// As [`read_rgb`], for an image of known size: one of another size is refused by its header.
///
/// # Errors
/// As [`read_rgb`], or the image has another size.
pub fn read_sized(input: impl BufRead + Seek, wanted: Size) -> Result<Image<[u8; 3]>, PngError> {
    colours(read_stored(input, Some(wanted))?)
}

fn colours(stored: StoredImage) -> Result<Image<[u8; 3]>, PngError> {
    let StoredImage { size, colour, depth, bytes } = stored;
    let pixels = match (depth, colour) {
        (BitDepth::Eight, ColorType::Grayscale) => bytes.iter().map(|&v| [v; 3]).collect(),
        (BitDepth::Eight, ColorType::Rgb) => bytes.as_chunks().0.to_vec(),
        _ => return Err(other_kind(depth, colour, "grey or RGB of 8 bits")),
    };
    Ok(Image::from_vec(size, pixels))
}

/// Reads the luminance of an image of 8 or 16 bits on the grey scale 0..255: grey values unchanged,
/// colours by [`super::LUMINANCE_WEIGHTS`]. With 16 bits, the full scale is 65,535. If `wanted` is
/// given, an image of another size is refused.
///
/// # Errors
/// As [`read_sized`], except that 16 bits are accepted.
pub fn read_luminance(input: impl BufRead + Seek, wanted: Option<Size>) -> Result<Image<f32>, PngError> {
    Ok(read_samples(input, wanted)?.luminance())
}

/// [`read_luminance`], with the colours on the same scale, unless the image is grey.
///
/// # Errors
/// As [`read_luminance`].
pub fn read_colours(input: impl BufRead + Seek, wanted: Option<Size>) -> Result<GreyImage, PngError> {
    let samples = read_samples(input, wanted)?;
    Ok(GreyImage { luminance: samples.luminance(), colours: samples.colours() })
}

/// [`read_colours`] of the bytes of a file, and true if this program writes the same bytes for the
/// colours: then the file holds nothing else.
///
/// # Errors
/// As [`read_luminance`].
pub fn read_composed(file: &[u8], wanted: Option<Size>) -> Result<(GreyImage, bool), PngError> {
    let samples = read_samples(Cursor::new(file), wanted)?;
    let image = GreyImage { luminance: samples.luminance(), colours: samples.colours() };
    Ok((image, samples.are_written_as(file)))
}

/// An image with its samples on the grey scale.
struct GreySamples {
    size: Size,
    /// True if three samples make a pixel.
    coloured: bool,
    samples: StoredSamples,
}

/// Samples as they are stored: numbers of 8 bits, or pairs of bytes, the higher one first.
enum StoredSamples {
    Bytes(Vec<u8>),
    Pairs(Vec<u8>),
}

/// 257 is 65,535 / 255, so that full scale is 255 for both depths.
fn wide_sample(pair: [u8; 2]) -> f64 {
    f64::from(u16::from_be_bytes(pair)) / 257.0
}

impl GreySamples {
    fn luminance(&self) -> Image<f32> {
        let weights = GreyWeights::default();
        let weigh = |rgb: [f64; 3]| weights.weigh(rgb);
        let pixels = match (&self.samples, self.coloured) {
            (StoredSamples::Bytes(bytes), true) => {
                let tables = weights.of_bytes();
                let weigh = |rgb: &[u8; 3]| weigh_bytes(&tables, *rgb);
                bytes.as_chunks().0.iter().map(weigh).collect()
            }
            (StoredSamples::Bytes(bytes), false) => bytes.iter().map(|v| f32::from(*v)).collect(),
            (StoredSamples::Pairs(bytes), true) => {
                bytes.as_chunks::<2>().0.as_chunks().0.iter().map(|rgb| weigh(rgb.map(wide_sample))).collect()
            }
            (StoredSamples::Pairs(bytes), false) => {
                bytes.as_chunks().0.iter().map(|pair| to_single(wide_sample(*pair))).collect()
            }
        };
        Image::from_vec(self.size, pixels)
    }

    /// Returns true if [`write_image`] makes this file of the colours.
    fn are_written_as(&self, file: &[u8]) -> bool {
        let StoredSamples::Bytes(bytes) = &self.samples else { return false };
        let mut written = Vec::with_capacity(file.len());
        let done = self.coloured && write_rows(self.size, ColorType::Rgb, bytes, &mut written).is_ok();
        done && written == file
    }

    fn colours(&self) -> Option<Image<[f32; 3]>> {
        let pixels = || match &self.samples {
            StoredSamples::Bytes(bytes) => {
                bytes.as_chunks().0.iter().map(|rgb: &[u8; 3]| rgb.map(f32::from)).collect()
            }
            StoredSamples::Pairs(bytes) => {
                let wide = |rgb: &[[u8; 2]; 3]| rgb.map(|pair| to_single(wide_sample(pair)));
                bytes.as_chunks::<2>().0.as_chunks().0.iter().map(wide).collect()
            }
        };
        self.coloured.then(|| Image::from_vec(self.size, pixels()))
    }
}

fn read_samples(input: impl BufRead + Seek, wanted: Option<Size>) -> Result<GreySamples, PngError> {
    let StoredImage { size, colour, depth, bytes } = read_stored(input, wanted)?;
    let samples = match depth {
        BitDepth::Eight => StoredSamples::Bytes(bytes),
        BitDepth::Sixteen => StoredSamples::Pairs(bytes),
        depth => return Err(other_kind(depth, colour, GREY_OR_RGB)),
    };
    match colour {
        ColorType::Grayscale | ColorType::Rgb => {
            Ok(GreySamples { size, coloured: colour == ColorType::Rgb, samples })
        }
        colour => Err(other_kind(depth, colour, GREY_OR_RGB)),
    }
}

/// Reads the whole numbers of a grey image of 16 bits, such as a depth image. If `wanted` is given, an
/// image of another size is refused.
///
/// # Errors
/// The bytes are damaged, or the image is not grey with 16 bits.
pub fn read_wide(input: impl BufRead + Seek, wanted: Option<Size>) -> Result<Image<u16>, PngError> {
    let StoredImage { size, colour, depth, bytes } = read_stored(input, wanted)?;
    match (depth, colour) {
        (BitDepth::Sixteen, ColorType::Grayscale) => {
            let pixels = bytes.as_chunks().0.iter().map(|pair| u16::from_be_bytes(*pair)).collect();
            Ok(Image::from_vec(size, pixels))
        }
        _ => Err(other_kind(depth, colour, "grey of 16 bits")),
    }
}

const GREY_OR_RGB: &str = "grey or RGB of 8 or 16 bits";

/// The weights of the channels in a luminance.
#[derive(Debug, Clone, Copy)]
pub struct GreyWeights([f64; 3]);

impl Default for GreyWeights {
    /// Those of [`LUMINANCE_WEIGHTS`], as decimals in 64 bits.
    fn default() -> Self {
        Self(LUMINANCE_WEIGHTS.map(weight_decimal))
    }
}

impl GreyWeights {
    /// The luminance of a colour.
    #[must_use]
    pub fn weigh(&self, rgb: [f64; 3]) -> f32 {
        to_single(self.0.iter().zip(rgb).map(|(weight, v)| weight * v).sum())
    }

    /// The products of the weights with all numbers of 8 bits.
    fn of_bytes(&self) -> [[f64; 256]; 3] {
        self.0.map(|weight| std::array::from_fn(|v| weight * v as f64))
    }
}

/// [`GreyWeights::weigh`] by a table: the same sums, without conversions and products.
fn weigh_bytes([red, green, blue]: &[[f64; 256]; 3], [r, g, b]: [u8; 3]) -> f32 {
    // In the order of `weigh`, so that both give the same bits.
    to_single(red[usize::from(r)] + green[usize::from(g)] + blue[usize::from(b)])
}

/// The decimal fraction of a weight with three digits, nearest in 64 bits. The decimals sum to 1
/// closely enough that equal channels give that grey.
fn weight_decimal(weight: f32) -> f64 {
    libm::round(1000.0 * f64::from(weight)) / 1000.0
}

#[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest")]
fn to_single(v: f64) -> f32 {
    v as f32
}

/// An image as stored in a file.
struct StoredImage {
    size: Size,
    colour: ColorType,
    depth: BitDepth,
    bytes: Vec<u8>,
}

fn read_stored(mut input: impl BufRead + Seek, wanted: Option<Size>) -> Result<StoredImage, PngError> {
    // The length of the file bounds the pixels that it can hold.
    let file = input.seek(SeekFrom::End(0))?;
    input.rewind()?;
    let mut reader = opened(&mut input)?;
    let (width, height) = reader.info().size();
    let size = Size { width, height };
    let (colour, depth) = reader.output_color_type();
    let wide = if depth == BitDepth::Sixteen { 2 } else { 1 };
    let claimed = check_claim(size, colour.samples() * wide, file, wanted)?;
    if ByteBudget::of_file(file).check(claimed, 1).is_err() {
        // It compresses better than photos do. A first pass keeps nothing, so that a broken file
        // takes no memory.
        while reader.next_row()?.is_some() {}
        reader.finish()?;
        drop(reader);
        input.rewind()?;
        reader = opened(&mut input)?;
    }
    let mut bytes = budget::try_filled(0, claimed)?;
    reader.next_frame(&mut bytes)?;
    // Up to the last chunk: a file that is cut behind its pixels is damaged too.
    reader.finish()?;
    Ok(StoredImage { size, colour, depth, bytes })
}

/// A decoder that has read the header. Texts and profiles, which inflate on their own, are ignored.
fn opened<R: BufRead + Seek>(input: R) -> Result<Reader<R>, DecodingError> {
    let mut decoder = png::Decoder::new(input);
    // Palettes and transparency are refused, not expanded.
    decoder.set_transformations(Transformations::IDENTITY);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    decoder.read_info()
}

/// The number of bytes of an image of this size. The size must be the wanted one, and a file of
/// `file` bytes must be able to hold it.
fn check_claim(size: Size, bytes_a_pixel: usize, file: u64, wanted: Option<Size>) -> Result<usize, PngError> {
    let refuse = |wanted: String| Err(PngError::Size { found: size, wanted });
    if let Some(wanted) = wanted.filter(|wanted| *wanted != size) {
        return refuse(wanted.to_string());
    }
    if size.pixels() > MAX_PIXELS {
        return refuse(format!("at most {MAX_PIXELS} pixels"));
    }
    let claimed = size.pixels() * bytes_a_pixel;
    if claimed as u64 > file.saturating_mul(MAX_DEFLATE_RATIO) {
        return refuse(format!("no more pixels than {file} bytes of PNG can hold"));
    }
    Ok(claimed)
}

fn other_kind(depth: BitDepth, colour: ColorType, wanted: &'static str) -> PngError {
    PngError::Kind { found: format!("{colour:?} of {} bits", depth as u8), wanted }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { width: 37, height: 23 };

    fn noise(count: usize) -> Vec<u8> {
        (0..count).map(|i| ((i * 2_654_435_761) >> 13 & 0xff).try_into().unwrap()).collect()
    }

    fn encoded<P: PngPixel>(image: &Image<P>) -> Vec<u8> {
        let mut out = Vec::new();
        write_image(image, &mut out).unwrap();
        out
    }

    #[test]
    fn images_are_read_back() {
        let rgb = Image::from_vec(SIZE, noise(SIZE.pixels() * 3).as_chunks().0.to_vec());
        assert_eq!(read_rgb(Cursor::new(encoded(&rgb))).unwrap(), rgb);
        let grey = Image::from_vec(SIZE, noise(SIZE.pixels()));
        let spread = grey.pixels().iter().map(|&v| [v; 3]).collect();
        assert_eq!(read_rgb(Cursor::new(encoded(&grey))).unwrap(), Image::from_vec(SIZE, spread));
    }

    #[test]
    fn a_file_is_composed_if_it_holds_its_colours_alone() {
        let rgb = Image::from_vec(SIZE, noise(SIZE.pixels() * 3).as_chunks().0.to_vec());
        let file = encoded(&rgb);
        let (image, is_composed) = read_composed(&file, Some(SIZE)).unwrap();
        assert!(is_composed);
        let plain = read_colours(Cursor::new(&file), Some(SIZE)).unwrap();
        assert_eq!((image.luminance, image.colours), (plain.luminance, plain.colours));
        let t = |what: &str, file: &[u8]| {
            let read = read_composed(file, Some(SIZE)).unwrap();
            assert!(!read.1, "{what}");
        };
        t("bytes after the end", &[file.as_slice(), b"more"].concat());
        t("a grey picture", &encoded(&Image::from_vec(SIZE, noise(SIZE.pixels()))));
        let mut other = Vec::new();
        let mut encoder = png::Encoder::new(&mut other, SIZE.width, SIZE.height);
        encoder.set_color(ColorType::Rgb);
        encoder.set_filter(Filter::NoFilter);
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(rgb.pixels().as_flattened()).unwrap();
        writer.finish().unwrap();
        t("another filter", &other);
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

    /// The format on disk is frozen: a change requires a new revision of the stages that write
    /// pictures.
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
            assert!(read_rgb(Cursor::new(&whole[..cut])).is_err(), "{cut} of {} bytes", whole.len());
        }
        for at in 0..whole.len() {
            let mut changed = whole.clone();
            changed[at] ^= 0x5a;
            assert!(read_rgb(Cursor::new(&changed)).is_err(), "byte {at} changed");
        }
    }

    /// The header of a grey image of this size, and behind it `data` as the stream of its pixels.
    fn claim(width: u32, height: u32, data: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        let mut encoder = png::Encoder::new(&mut out, width, height);
        encoder.set_color(ColorType::Grayscale);
        let mut writer = encoder.write_header().unwrap();
        writer.write_chunk(png::chunk::IDAT, data).unwrap();
        drop(writer);
        out
    }

    #[test]
    fn sizes_are_refused_before_memory_is_taken() {
        let t = |file: &[u8], wanted: Option<Size>, message: &str| {
            let error = read_luminance(Cursor::new(file), wanted).unwrap_err().to_string();
            assert_eq!(error, message);
        };
        let huge = claim(65_535, 65_535, b"");
        t(&huge, None, "an image of 65535x65535, wanted at most 268435456 pixels");
        t(&huge, Some(SIZE), "an image of 65535x65535, wanted 37x23");
        let large = claim(16_384, 16_384, b"");
        let bytes = large.len();
        t(
            &large,
            None,
            &format!("an image of 16384x16384, wanted no more pixels than {bytes} bytes of PNG can hold"),
        );
        let grey = encoded(&Image::filled(SIZE, 9u8));
        assert!(read_sized(Cursor::new(&grey), SIZE).is_ok());
        let other = Size { width: 38, height: 23 };
        assert!(matches!(read_sized(Cursor::new(&grey), other), Err(PngError::Size { found: SIZE, .. })));
    }

    /// 48 MB of one grey in some hundred kilobytes: read by way of a decoder that keeps nothing.
    #[test]
    fn a_plain_image_beyond_the_budget_is_read_all_the_same() {
        let size = Size { width: 8192, height: 6000 };
        let file = encoded(&Image::filled(size, 7u8));
        assert!(file.len() < 1 << 20, "{}", file.len());
        let stored = read_stored(Cursor::new(&file), Some(size)).unwrap();
        assert!(stored.bytes.len() == size.pixels() && stored.bytes.iter().all(|v| *v == 7));
        let error = stored_error(&file[..file.len() - 20]);
        assert!(!error.is_empty());
    }

    fn stored_error(file: &[u8]) -> String {
        read_stored(Cursor::new(file), None).map(|_| ()).unwrap_err().to_string()
    }

    #[test]
    fn other_kinds_are_refused_by_name() {
        let mut out = Vec::new();
        let mut encoder = png::Encoder::new(&mut out, 1, 1);
        encoder.set_color(ColorType::Rgba);
        encoder.write_header().unwrap().write_image_data(&[1, 2, 3, 4]).unwrap();
        let error = read_rgb(Cursor::new(out)).unwrap_err().to_string();
        assert_eq!(error, "Rgba of 8 bits, wanted grey or RGB of 8 bits");
    }

    #[test]
    fn luminance_is_that_of_the_stored_colour() {
        let t = |colour: ColorType, depth: BitDepth, bytes: &[u8], wanted: f32| {
            let mut out = Vec::new();
            let mut encoder = png::Encoder::new(&mut out, 1, 1);
            encoder.set_color(colour);
            encoder.set_depth(depth);
            encoder.write_header().unwrap().write_image_data(bytes).unwrap();
            let found = read_luminance(Cursor::new(&out), None).unwrap().into_pixels();
            assert_eq!(found, [wanted], "{colour:?} {depth:?} {bytes:?}");
            let GreyImage { luminance, colours } = read_colours(Cursor::new(&out), None).unwrap();
            let greys = colours.as_ref().map_or([wanted; 3], |colours| colours.pixels()[0]);
            assert_eq!((luminance.pixels(), colours.is_some()), (&[wanted][..], colour == ColorType::Rgb));
            let sample = |c: usize| f32::from(bytes[c * bytes.len() / 3]);
            let exact = colour == ColorType::Rgb && depth == BitDepth::Eight;
            assert!(!exact || greys.map(f32::to_bits) == [0, 1, 2].map(|c| sample(c).to_bits()), "{greys:?}");
        };
        for v in 0..=255u8 {
            t(ColorType::Grayscale, BitDepth::Eight, &[v], v.into());
            t(ColorType::Rgb, BitDepth::Eight, &[v; 3], v.into());
            t(ColorType::Grayscale, BitDepth::Sixteen, &[v; 2], v.into());
            t(ColorType::Rgb, BitDepth::Sixteen, &[v; 6], v.into());
        }
        // 0.299 200 + 0.587 100 + 0.114 50; a step of 16 bits is 1/257 of a grey
        t(ColorType::Rgb, BitDepth::Eight, &[200, 100, 50], 124.2);
        t(ColorType::Grayscale, BitDepth::Sixteen, &[0, 1], 1.0 / 257.0);
    }
}
