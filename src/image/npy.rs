//! Images as numpy's `.npy`, float32, in C order, with unclamped and unencoded values; and the
//! headers of these files.
//!
//! Format: version 1.0 of numpy's `lib/format.py`. The file has no time and no name, so equal
//! images are equal bytes.

use super::{Image, Size};
use npyz::WriterBuilder;
use std::io::{self, Read, Write};

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
    let mut writer = npyz::WriteOptions::new().default_dtype().shape(shape).writer(out).begin_nd()?;
    writer.extend(values.iter().copied())?;
    writer.finish()
}

/// Writes images of one size, `[K, H, W]`; an empty list is `[0, 0, 0]`.
///
/// # Errors
/// Writing to `out` fails.
pub fn write_stack(images: &[Image<f32>], out: impl Write) -> io::Result<()> {
    let Size { width, height } = images.first().map_or(Size { width: 0, height: 0 }, Image::size);
    let shape = [images.len() as u64, height.into(), width.into()];
    let mut writer = npyz::WriteOptions::new().default_dtype().shape(&shape).writer(out).begin_nd()?;
    for image in images {
        writer.extend(image.pixels().iter().copied())?;
    }
    writer.finish()
}

/// Reads `count` images that [`write_stack`] wrote. These files are our own, so their headers are
/// trusted.
///
/// # Errors
/// The bytes are not a float32 `.npy` with this number of images.
pub fn read_stack(count: usize, input: impl Read) -> io::Result<Vec<Image<f32>>> {
    let file = npyz::NpyFile::new(input)?;
    let invalid = |found: &[u64]| {
        let wanted = format!("shape {found:?}, wanted [{count}, H, W]");
        io::Error::new(io::ErrorKind::InvalidData, wanted)
    };
    let size = match *file.shape() {
        [k, h, w] if k == count as u64 => u32::try_from(w).ok().zip(u32::try_from(h).ok()),
        _ => None,
    };
    let Some((width, height)) = size else { return Err(invalid(file.shape())) };
    let size = Size { width, height };
    let values = file.into_vec::<f32>()?;
    // `chunks` refuses a length of 0, which images without pixels would have.
    Ok(values.chunks(size.pixels().max(1)).map(|v| Image::from_vec(size, v.to_vec())).collect())
}

/// Reads the numbers of a float32 array with this shape, in C order. No bytes may follow.
///
/// # Errors
/// The bytes are not an array with this shape.
pub fn read_values(shape: &[u64], input: &mut impl Read) -> io::Result<Vec<f32>> {
    let head = checked_header(input)?;
    let values = open_shaped(shape, head.as_slice().chain(&mut *input))?.into_vec::<f32>()?;
    require_end(input)?;
    Ok(values)
}

/// As [`read_values`], for an array of float32 or float64. The latter is rounded.
///
/// # Errors
/// As [`read_values`].
pub fn read_floats(shape: &[u64], input: &mut impl Read) -> io::Result<Vec<f32>> {
    let head = checked_header(input)?;
    let file = open_shaped(shape, head.as_slice().chain(&mut *input))?;
    #[expect(clippy::cast_possible_truncation, reason = "depth has 32 bits")]
    let round = |value: f64| value as f32;
    let values = match file.dtype().descr().as_str() {
        "'<f8'" => file.into_vec::<f64>()?.into_iter().map(round).collect(),
        _ => file.into_vec::<f32>()?,
    };
    require_end(input)?;
    Ok(values)
}

fn open_shaped<R: Read>(shape: &[u64], input: R) -> io::Result<npyz::NpyFile<R>> {
    let file = npyz::NpyFile::new(input)?;
    if file.shape() != shape || file.order() != npyz::Order::C {
        let found = (file.shape(), file.order());
        let because = format!("an array of shape and order {found:?}, wanted {shape:?} in C order");
        return Err(io::Error::new(io::ErrorKind::InvalidData, because));
    }
    Ok(file)
}

fn require_end(input: &mut impl Read) -> io::Result<()> {
    match input.read(&mut [0])? {
        0 => Ok(()),
        _ => Err(io::Error::new(io::ErrorKind::InvalidData, "found bytes after the array, wanted none")),
    }
}

/// Reads the header of an array, if it is safe for the parser. The time of the parser doubles with
/// every open bracket; the header of a plain array has two, of its dictionary and its shape. The
/// parser also multiplies the shape without a check for overflow.
///
/// # Errors
/// The header cannot be read, has another version or more brackets, or states more than 2^64
/// elements.
pub fn checked_header(data: &mut impl Read) -> io::Result<Vec<u8>> {
    let refusal = |because: String| Err(io::Error::new(io::ErrorKind::InvalidData, because));
    let mut head = vec![0; 10];
    data.read_exact(&mut head)?;
    // The magic bytes are left to the parser, which reads them again.
    let version = head[6];
    if version != 1 {
        return refusal(format!("version {version} of its format, wanted 1"));
    }
    // Version 1 has a length of 16 bits, so a header takes at most 64 KiB.
    let len = usize::from(u16::from_le_bytes([head[8], head[9]]));
    head.resize(10 + len, 0);
    data.read_exact(&mut head[10..])?;
    let brackets = head[10..].iter().filter(|byte| b"([{".contains(byte)).count();
    if brackets > 2 {
        return refusal(format!(
            "{brackets} opening brackets in its header, wanted 2 (a dictionary and a shape)"
        ));
    }
    if !is_countable(&String::from_utf8_lossy(&head[10..])) {
        return refusal("its header states more elements than 64 bits can count".to_owned());
    }
    Ok(head)
}

/// Returns true if the product of the shape in parentheses is below 2^64. Text that is not a number
/// is left for the parser to refuse.
fn is_countable(head: &str) -> bool {
    let shape = head.split_once('(').map_or("", |(_, rest)| rest.split(')').next().unwrap_or_default());
    let mut sides = shape.split(',').filter_map(|side| match side.trim().trim_end_matches('L') {
        "" => None,
        digits if digits.bytes().all(|digit| digit.is_ascii_digit()) => Some(digits.parse::<u64>().ok()),
        _ => None,
    });
    sides.try_fold(1u64, |n, side| n.checked_mul(side?)).is_some()
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
