//! Writing, line by line.

use super::{ColumnSeparator, NAMES};
use crate::order::{END_US, StreamOrder};
use crate::{Event, EventFileError, EventSink};
use gs2e_image::Size;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Number of events whose lines are written at once.
const PIECE: usize = 2048;

/// Largest length of a line: 16 digits, twice 5, one, and 4 characters between and behind them.
const LINE: usize = 32;

/// Number of bytes that hold a time and a separator.
const STAMP: usize = 24;

/// Writes one stream in constant memory.
#[derive(Debug)]
pub struct Writer<W = BufWriter<File>> {
    out: W,
    order: StreamOrder,
    separator: u8,
    /// The time that was written last, us, and its text.
    stamp_us: i64,
    stamp: FieldText<STAMP>,
    /// The text of each column or row.
    sides: Vec<FieldText<7>>,
    /// Lines to be written, and room for what is written behind the end of a field.
    lines: Vec<u8>,
}

/// A number and its separator. It is copied as a whole, because a copy of a fixed length is faster.
#[derive(Debug, Clone, Copy)]
struct FieldText<const N: usize> {
    text: [u8; N],
    length: u8,
}

impl<const N: usize> FieldText<N> {
    #[expect(clippy::cast_possible_truncation, reason = "a digit, and a length of at most 24")]
    fn new(number: u64, separator: u8) -> Self {
        let (mut text, mut length, mut left) = ([0; N], 0, number);
        // The last digit first.
        loop {
            text[length] = b'0' + (left % 10) as u8;
            length += 1;
            left /= 10;
            if left == 0 {
                break;
            }
        }
        text[..length].reverse();
        text[length] = separator;
        Self { text, length: length as u8 + 1 }
    }

    /// Writes it to a place of `lines`, and returns the place after it.
    #[inline]
    fn put(&self, lines: &mut [u8], at: usize) -> usize {
        lines[at..at + N].copy_from_slice(&self.text);
        at + usize::from(self.length)
    }
}

impl Writer {
    /// Creates a file for a stream from a sensor of this size.
    ///
    /// # Errors
    /// The file cannot be created.
    pub fn create(path: &Path, table: ColumnSeparator, size: Size) -> Result<Self, EventFileError> {
        Self::new(BufWriter::new(File::create(path)?), table, size)
    }
}

impl<W: Write> Writer<W> {
    /// Writes the head of a stream from a sensor of this size.
    ///
    /// # Errors
    /// Writing fails.
    pub fn new(mut out: W, table: ColumnSeparator, size: Size) -> Result<Self, EventFileError> {
        writeln!(out, "# {} in us; sensor {size}", NAMES.join(" "))?;
        let separator = match table {
            ColumnSeparator::Txt => b' ',
            ColumnSeparator::Csv => {
                writeln!(out, "{}", NAMES.join(","))?;
                b','
            }
        };
        // Coordinates have 16 bits.
        let sides = 0..size.width.max(size.height).min(1 << 16);
        Ok(Self {
            out,
            order: StreamOrder::new(size, END_US),
            separator,
            stamp_us: 0,
            stamp: FieldText::new(0, separator),
            sides: sides.map(|side| FieldText::new(side.into(), separator)).collect(),
            lines: vec![0; LINE * PIECE + STAMP],
        })
    }

    /// Completes the file, and returns the number of events.
    ///
    /// # Errors
    /// Writing fails.
    pub fn finish(mut self) -> Result<u64, EventFileError> {
        self.out.flush()?;
        Ok(self.order.count())
    }

    /// Writes the lines of at most [`PIECE`] events, which are in order.
    #[expect(clippy::cast_sign_loss, reason = "times are 0 or more")]
    fn write_lines(&mut self, events: &[Event]) -> std::io::Result<()> {
        let mut at = 0;
        for Event { t, x, y, polarity, .. } in events {
            let t_us = t.floor_micros();
            // Many events share their microsecond.
            if t_us != self.stamp_us {
                (self.stamp_us, self.stamp) = (t_us, FieldText::new(t_us as u64, self.separator));
            }
            at = self.stamp.put(&mut self.lines, at);
            at = self.sides[usize::from(*x)].put(&mut self.lines, at);
            at = self.sides[usize::from(*y)].put(&mut self.lines, at);
            self.lines[at..at + 2].copy_from_slice(&[b'0' + *polarity as u8, b'\n']);
            at += 2;
        }
        self.out.write_all(&self.lines[..at])
    }
}

impl<W: Write> EventSink for Writer<W> {
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        // Before the first line, so that a refused chunk leaves no part of it.
        self.order.admit(events)?;
        events.chunks(PIECE).try_for_each(|events| self.write_lines(events))
    }
}
