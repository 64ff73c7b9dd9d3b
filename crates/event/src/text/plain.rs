//! Lines of plain digits, read from the bytes of the file without a string for each.
//!
//! Four numbers with one separator between them, and nothing else. Every other line is left to
//! [`Reader::event`](super::Reader), which alone refuses lines: what is read here, it reads alike.

use super::TextTimeUnit;
use crate::order::END_US;
use crate::{Event, EventLabel, Polarity};
use fearless_simd::{Level, Simd, SimdBase as _, SimdMask as _, dispatch, u8x64};
use gs2e_image::Size;
use gs2e_num::units::Timestamp;

/// Powers of ten in 64 bits.
const TENS: [u64; 20] = {
    let mut tens = [1; 20];
    let mut k = 1;
    while k < tens.len() {
        tens[k] = 10 * tens[k - 1];
        k += 1;
    }
    tens
};

/// Maximum number of digits on one side of a point: what fits in 64 bits with any digits.
const MAX_DIGITS: usize = 18;

/// Length of the shortest line.
const MIN_LINE: usize = 8;

/// Number of bytes from the start of a line that are looked at.
const WINDOW: usize = 64;

/// Places of time, column, row and polarity in the usual order.
const USUAL: [usize; 4] = [0, 1, 2, 3];

/// Reads lines of one layout.
#[derive(Debug)]
pub(super) struct PlainLines {
    /// The columns of a line from left to right: indices into the names of columns.
    columns: [usize; 4],
    size: Size,
    /// Number of digits that turn a whole time into nanoseconds.
    time_digits: usize,
    /// True if times may have a fraction.
    has_fraction: bool,
}

impl PlainLines {
    /// The lines of a file with these places of time, column, row and polarity. `None` if there are other
    /// columns among them.
    pub(super) fn new(places: [usize; 4], size: Size, unit: Option<TextTimeUnit>) -> Option<Self> {
        let mut columns = [None; 4];
        for (name, place) in places.into_iter().enumerate() {
            *columns.get_mut(place)? = Some(name);
        }
        let [Some(a), Some(b), Some(c), Some(d)] = columns else { return None };
        let time_digits = unit.unwrap_or(TextTimeUnit::Microsecond).digits();
        Some(Self { columns: [a, b, c, d], size, time_digits, has_fraction: unit.is_some() })
    }

    /// Appends the events of the first lines, at most `count`, and returns the number of their bytes. It ends
    /// at a line that is not plain, and before the end of the bytes.
    pub(super) fn read(&self, bytes: &[u8], count: usize, out: &mut Vec<Event>) -> usize {
        // The usual order for itself, so that it is known to the compiler.
        if self.columns == USUAL {
            dispatch!(Level::new(), simd => self.read_columns(simd, USUAL, bytes, count, out))
        } else {
            dispatch!(Level::new(), simd => self.read_columns(simd, self.columns, bytes, count, out))
        }
    }

    #[inline(always)]
    fn read_columns<S: Simd>(
        &self,
        simd: S,
        columns: [usize; 4],
        bytes: &[u8],
        count: usize,
        out: &mut Vec<Event>,
    ) -> usize {
        let (mut taken, end) = (0, out.len() + count);
        out.reserve(count.min(bytes.len() / MIN_LINE));
        while out.len() < end
            && let Some(line) = bytes[taken..].first_chunk()
            && let Some((event, length)) = self.parse(Cursor::new(simd, line), columns)
        {
            out.push(event);
            taken += length;
        }
        taken
    }

    /// The event of a line and the number of its bytes, its end included.
    #[inline(always)]
    fn parse(&self, mut cursor: Cursor<'_>, columns: [usize; 4]) -> Option<(Event, usize)> {
        let (mut t, mut sides, mut polarity) = (Timestamp(0), [0; 2], Polarity::Off);
        for (place, column) in columns.into_iter().enumerate() {
            if place > 0 && !matches!(cursor.next()?, b' ' | b',' | b'\t' | b';') {
                return None;
            }
            match column {
                0 => t = self.time(&mut cursor)?,
                1 => sides[0] = cursor.side(self.size.width)?,
                2 => sides[1] = cursor.side(self.size.height)?,
                _ => polarity = cursor.polarity()?,
            }
        }
        match cursor.next()? {
            b'\n' => {}
            b'\r' if cursor.next()? == b'\n' => {}
            _ => return None,
        }
        let [x, y] = sides;
        Some((Event { t, x, y, polarity, label: EventLabel::Signal }, cursor.at))
    }

    #[inline(always)]
    fn time(&self, cursor: &mut Cursor<'_>) -> Option<Timestamp> {
        let (whole, _) = cursor.digits()?;
        let mut ns = whole.checked_mul(TENS[self.time_digits])?;
        if self.has_fraction && cursor.line.get(cursor.at) == Some(&b'.') {
            cursor.at += 1;
            let (fraction, count) = cursor.digits()?;
            // Digits below a nanosecond are cut off.
            let kept = match self.time_digits.checked_sub(count) {
                Some(missing) => fraction * TENS[missing],
                None => fraction / TENS[count - self.time_digits],
            };
            ns = ns.checked_add(kept)?;
        }
        let t = i64::try_from(ns).ok().filter(|t| *t < END_US * 1000)?;
        Some(Timestamp(t))
    }
}

/// The start of a line, and the number of its bytes that were taken.
struct Cursor<'a> {
    line: &'a [u8; WINDOW],
    /// A bit for each byte that is no digit, the first in the lowest bit.
    others: u64,
    at: usize,
}

impl<'a> Cursor<'a> {
    #[inline(always)]
    fn new<S: Simd>(simd: S, line: &'a [u8; WINDOW]) -> Self {
        // Below `0` wraps around, so only digits are at most 9.
        let digits = u8x64::from_slice(simd, line) - b'0';
        Self { line, others: digits.simd_gt(9).to_bitmask(), at: 0 }
    }

    #[inline(always)]
    fn next(&mut self) -> Option<u8> {
        let byte = *self.line.get(self.at)?;
        self.at += 1;
        Some(byte)
    }

    /// Number of digits that come next.
    #[inline(always)]
    fn count(&self) -> usize {
        (self.others >> self.at).trailing_zeros() as usize
    }

    /// One to [`MAX_DIGITS`] digits: their value and number.
    #[inline(always)]
    fn digits(&mut self) -> Option<(u64, usize)> {
        let count = self.count();
        if !(1..=MAX_DIGITS).contains(&count) {
            return None;
        }
        let (mut value, mut left) = (0, count);
        while left > 8 {
            value = value * TENS[8] + self.eight_digits(8)?;
            left -= 8;
        }
        Some((value * TENS[left] + self.eight_digits(left)?, count))
    }

    /// Takes up to eight digits. All at once: their number varies from field to field, so a branch for each
    /// would often be predicted wrongly.
    #[inline(always)]
    fn eight_digits(&mut self, count: usize) -> Option<u64> {
        let word = u64::from_le_bytes(*self.line.get(self.at..)?.first_chunk()?);
        self.at += count;
        // Moved up, so that zeros stand before the digits, and the other characters leave.
        let digits = (word ^ 0x3030_3030_3030_3030) << (64 - 8 * count);
        // Pairs of digits, then pairs of pairs, then all: the lowest byte has the highest place.
        let pairs = digits.wrapping_mul(10).wrapping_add(digits >> 8);
        let high = (pairs & 0x0000_00ff_0000_00ff).wrapping_mul(0x000f_4240_0000_0064);
        let low = (pairs >> 16 & 0x0000_00ff_0000_00ff).wrapping_mul(0x0000_2710_0000_0001);
        Some(high.wrapping_add(low) >> 32)
    }

    /// A column or row below `end`, of up to four digits.
    #[inline(always)]
    fn side(&mut self, end: u32) -> Option<u16> {
        let count = self.count();
        let word = u32::from_le_bytes(*self.line.get(self.at..)?.first_chunk()?);
        if !(1..=4).contains(&count) {
            return None;
        }
        self.at += count;
        // As above.
        let digits = (word ^ 0x3030_3030) << (32 - 8 * count);
        let pairs = digits.wrapping_mul(10).wrapping_add(digits >> 8) & 0x00ff_00ff;
        let value = pairs.wrapping_mul(100).wrapping_add(pairs >> 16) & 0xffff;
        (value < end).then_some(value as u16)
    }

    #[inline(always)]
    fn polarity(&mut self) -> Option<Polarity> {
        let first = self.next()?;
        // Half of all events are ON, so a branch would often be predicted wrongly.
        if first | 1 == b'1' {
            return Polarity::from_number(first & 1);
        }
        match (first, self.next()?) {
            (b'-', b'1') => Some(Polarity::Off),
            (b'+', b'1') => Some(Polarity::On),
            _ => None,
        }
    }
}
