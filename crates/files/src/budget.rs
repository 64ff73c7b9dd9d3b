//! Memory budget of an input.
//!
//! A number in a file that leads to an allocation is a claim. It is compared with a limit before
//! anything is allocated for it. `docs/files.md` lists the limits. An input that is refused takes
//! at most 64 MB and four times its own size: one time for the input itself, [`MAX_PER_BYTE`] times
//! for the values made from it, and `MAX_FREE`, apart from the program's own memory.

use std::collections::TryReserveError;
use std::io::{self, BufRead, Read as _};

/// Bytes that any input may take, however small: a plain picture compresses to almost nothing.
pub(crate) const MAX_FREE: usize = 24 << 20;

/// Bytes that an input may take for each of its own bytes, apart from those that hold the input.
pub const MAX_PER_BYTE: usize = 3;

/// Deflate's best ratio: a length of 258 bytes in two bits (RFC 1951). No stream expands further.
pub const MAX_DEFLATE_RATIO: u64 = 1032;

/// Maximum length of one record of a line-based text format, bytes.
pub const MAX_LINE: usize = 1 << 16;

/// Bytes that each of these characters of a JSON document takes in its parsed form: a number, a
/// list with room for its first four values, a map with room for its first eleven.
const JSON_BYTES: [(&[u8], usize); 3] = [(b",:", 32), (b"[", 128), (b"{", 640)];

/// An input that claims more memory than it may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{wanted} bytes of memory, wanted at most {limit} for an input of {input} bytes")]
pub struct OverBudget {
    /// Bytes that all claims of the input add up to.
    pub wanted: usize,
    /// Bytes that it may take.
    pub limit: usize,
    /// Bytes of the input.
    pub input: usize,
}

/// The memory that is left to an input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ByteBudget {
    input: usize,
    taken: usize,
}

impl ByteBudget {
    /// The budget of an input of this many bytes.
    #[must_use]
    pub fn of(input: usize) -> Self {
        Self { input, taken: 0 }
    }

    /// The budget of an input whose length is a file's.
    #[must_use]
    pub fn of_file(bytes: u64) -> Self {
        Self::of(usize::try_from(bytes).unwrap_or(usize::MAX))
    }

    /// Maximum bytes that the input may take in all.
    #[must_use]
    pub fn limit(&self) -> usize {
        self.input.saturating_mul(MAX_PER_BYTE).saturating_add(MAX_FREE)
    }

    /// Adds bytes to the input.
    pub fn grow(&mut self, input: usize) {
        self.input = self.input.saturating_add(input);
    }

    /// Takes memory for `count` values of `bytes` each.
    ///
    /// # Errors
    /// The claims of the input add up to more than its limit.
    pub fn take(&mut self, count: usize, bytes: usize) -> Result<(), OverBudget> {
        self.check(count, bytes)?;
        // The product cannot overflow: `check` refuses it long before.
        self.taken += count * bytes;
        Ok(())
    }

    /// Checks that [`take`](Self::take) would succeed.
    ///
    /// # Errors
    /// The same as `take`.
    pub fn check(&self, count: usize, bytes: usize) -> Result<(), OverBudget> {
        // Saturating: a file may claim any number.
        let wanted = self.taken.saturating_add(count.saturating_mul(bytes));
        let (limit, input) = (self.limit(), self.input);
        if wanted > limit { Err(OverBudget { wanted, limit, input }) } else { Ok(()) }
    }
}

/// An empty vector with room for `count` values.
///
/// # Errors
/// There is not enough memory for them.
pub fn try_with_room<T>(count: usize) -> Result<Vec<T>, TryReserveError> {
    let mut values = Vec::new();
    // Exact: the count comes from a file, and a rounded size would exceed the budget.
    values.try_reserve_exact(count)?;
    Ok(values)
}

/// A vector of `count` equal values.
///
/// # Errors
/// There is not enough memory for them.
pub fn try_filled<T: Clone>(value: T, count: usize) -> Result<Vec<T>, TryReserveError> {
    // `vec!` has no fallible form, and zeros that it takes from the system cost nothing until they
    // are written. Therefore the room is tried first and released again.
    drop(try_with_room::<T>(count)?);
    Ok(vec![value; count])
}

/// Compares a JSON document with its budget before it is parsed into values: one digit becomes 32
/// bytes, `{}` becomes 640.
///
/// # Errors
/// Its values would take more than its budget.
pub fn check_json(text: &[u8]) -> Result<(), OverBudget> {
    // Characters inside strings count too. The sum is an upper bound, found without a parser.
    let mut counts = [0_usize; JSON_BYTES.len()];
    for byte in text {
        for ((marks, _), count) in JSON_BYTES.iter().zip(&mut counts) {
            *count += usize::from(marks.contains(byte));
        }
    }
    let mut budget = ByteBudget::of(text.len());
    JSON_BYTES.iter().zip(counts).try_for_each(|((_, bytes), count)| budget.take(count, *bytes))
}

/// Iterator over lines of at most `limit` bytes, line ends included. The items have no line ends.
#[derive(Debug)]
pub struct ShortLines<R> {
    input: R,
    limit: usize,
}

impl<R: BufRead> ShortLines<R> {
    /// The lines of an input.
    pub fn new(input: R, limit: usize) -> Self {
        Self { input, limit }
    }

    /// The input from the next line on, for lines that are read in another way.
    pub fn get_mut(&mut self) -> &mut R {
        &mut self.input
    }
}

impl<R: BufRead> Iterator for ShortLines<R> {
    type Item = io::Result<String>;

    /// The next line; an error if it is too long or not UTF-8.
    fn next(&mut self) -> Option<Self::Item> {
        let mut line = Vec::new();
        // One byte beyond the limit, so that a line that is too long can be recognised.
        match self.input.by_ref().take(self.limit as u64 + 1).read_until(b'\n', &mut line) {
            Ok(0) => return None,
            Ok(_) => {}
            Err(error) => return Some(Err(error)),
        }
        if line.len() > self.limit {
            let because = format!("a line of more than {} bytes", self.limit);
            return Some(Err(io::Error::new(io::ErrorKind::InvalidData, because)));
        }
        if line.last() == Some(&b'\n') {
            line.pop();
            // One `\r` only, like `BufRead::lines`.
            line.pop_if(|last| *last == b'\r');
        }
        Some(String::from_utf8(line).map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn claims_add_up() {
        let mut budget = ByteBudget::of(1000);
        let limit = 24 * 1024 * 1024 + 3000;
        budget.take(limit / 4, 4).unwrap();
        let error = budget.take(usize::MAX, 8).unwrap_err();
        assert_eq!((error.wanted, error.limit, error.input), (usize::MAX, limit, 1000));
        budget.take(1, 1).unwrap_err();
        budget.grow(1);
        budget.take(3, 1).unwrap();
        budget.take(1, 1).unwrap_err();
    }

    #[test]
    fn memory_that_is_not_there_is_an_error() {
        assert!(try_filled(0_u8, usize::MAX).is_err());
        assert!(try_with_room::<u64>(usize::MAX / 8 - 1).is_err());
        assert_eq!(try_filled(7_u8, 3).unwrap(), [7; 3]);
    }

    #[test]
    fn many_small_values_of_json_are_refused() {
        check_json(b"{\"frames\": [1, 2, 3]}").unwrap();
        let numbers = |count: usize| format!("[{}0]", "0,".repeat(count)).into_bytes();
        check_json(&numbers(100_000)).unwrap();
        let error = check_json(&numbers(2_000_000)).unwrap_err().to_string();
        assert!(error.ends_with("wanted at most 37165833 for an input of 4000003 bytes"), "{error}");
        check_json("[{}]".repeat(60_000).as_bytes()).unwrap_err();
        // Numbers of 17 digits, as poses have them, pass in any amount.
        check_json(format!("[{}0]", "0.12345678901234567,".repeat(2_000_000)).as_bytes()).unwrap();
    }

    #[test]
    fn lines_are_those_of_the_standard_library_up_to_their_limit() {
        let text = "a\r\n\nbcd\r\r\nlast";
        let read = |limit| ShortLines::new(text.as_bytes(), limit).collect::<io::Result<Vec<_>>>();
        assert_eq!(read(10).unwrap(), text.as_bytes().lines().collect::<io::Result<Vec<_>>>().unwrap());
        assert_eq!(read(4).unwrap_err().to_string(), "a line of more than 4 bytes");
        assert!(ShortLines::new(&b"\xff\n"[..], 4).next().unwrap().is_err());
    }
}
