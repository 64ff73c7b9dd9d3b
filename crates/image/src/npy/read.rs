//! Images from `.npy` files.

use crate::{Image, Size};
use std::io::{self, Read};

/// Reads `count` images that [`write_stack`](super::write_stack) wrote. These files are our own, so
/// their headers are trusted.
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
    // Python 2 wrote long integers with an `L` behind them.
    let mut sides = shape.split(',').filter_map(|side| match side.trim().trim_end_matches('L') {
        "" => None,
        digits if digits.bytes().all(|digit| digit.is_ascii_digit()) => Some(digits.parse::<u64>().ok()),
        _ => None,
    });
    sides.try_fold(1u64, |n, side| n.checked_mul(side?)).is_some()
}
