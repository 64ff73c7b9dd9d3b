//! Writing, line by line.

use super::{ColumnSeparator, NAMES};
use crate::order::{END_US, StreamOrder};
use crate::{Event, EventFileError, EventSink};
use gs2e_image::Size;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Writes one stream in constant memory.
#[derive(Debug)]
pub struct Writer<W = BufWriter<File>> {
    out: W,
    order: StreamOrder,
    separator: char,
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
            ColumnSeparator::Txt => ' ',
            ColumnSeparator::Csv => {
                writeln!(out, "{}", NAMES.join(","))?;
                ','
            }
        };
        Ok(Self { out, order: StreamOrder::new(size, END_US), separator })
    }

    /// Completes the file, and returns the number of events.
    ///
    /// # Errors
    /// Writing fails.
    pub fn finish(mut self) -> Result<u64, EventFileError> {
        self.out.flush()?;
        Ok(self.order.count())
    }
}

impl<W: Write> EventSink for Writer<W> {
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        // Before the first line, so that a refused chunk leaves no part of it.
        self.order.admit(events)?;
        let s = self.separator;
        for Event { t, x, y, polarity, .. } in events {
            writeln!(self.out, "{}{s}{x}{s}{y}{s}{}", t.floor_micros(), *polarity as u8)?;
        }
        Ok(())
    }
}
