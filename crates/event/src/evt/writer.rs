//! Writing, chunk by chunk.

use super::{EDGE, EvtVersion, evt2, evt3, header};
use crate::order::{END_US, StreamOrder};
use crate::{Event, EventFileError, EventSink};
use gs2e_image::Size;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Writes one stream in constant memory. The bytes do not depend on how the stream is divided into
/// chunks.
#[derive(Debug)]
pub struct Writer<W = BufWriter<File>> {
    out: W,
    order: StreamOrder,
    encoder: EvtEncoder,
    words: Vec<u8>,
}

#[derive(Debug)]
enum EvtEncoder {
    Evt2(evt2::Evt2Encoder),
    Evt3(evt3::Evt3Encoder),
}

impl Writer {
    /// Creates a file for a stream from a sensor of this size.
    ///
    /// # Errors
    /// The sensor has more than 2,048 columns or rows, or the file cannot be created.
    pub fn create(path: &Path, version: EvtVersion, size: Size) -> Result<Self, EventFileError> {
        check_size(size)?;
        Self::new(BufWriter::new(File::create(path)?), version, size)
    }
}

impl<W: Write> Writer<W> {
    /// Writes the header of a stream from a sensor of this size.
    ///
    /// # Errors
    /// The sensor has more than 2,048 columns or rows, or writing fails.
    pub fn new(mut out: W, version: EvtVersion, size: Size) -> Result<Self, EventFileError> {
        check_size(size)?;
        // EVT 3.0 counts overflows without a limit, so only internal times bound it.
        let (encoder, end_us) = match version {
            EvtVersion::Evt2 => (EvtEncoder::Evt2(evt2::Evt2Encoder::default()), evt2::END_US),
            EvtVersion::Evt3 => (EvtEncoder::Evt3(evt3::Evt3Encoder::default()), END_US),
        };
        header::write_header(&mut out, version, size)?;
        Ok(Self { out, order: StreamOrder::new(size, end_us), encoder, words: Vec::new() })
    }

    /// Completes the file, and returns the number of events.
    ///
    /// # Errors
    /// Writing fails.
    pub fn finish(mut self) -> Result<u64, EventFileError> {
        // Events of the last run still wait in the encoder.
        if let EvtEncoder::Evt3(encoder) = &mut self.encoder {
            encoder.flush(&mut self.words);
        }
        self.out.write_all(&self.words)?;
        self.out.flush()?;
        Ok(self.order.count())
    }
}

impl<W: Write> EventSink for Writer<W> {
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        self.order.admit(events)?;
        // `admit` has counted the chunk already.
        let first = self.order.count() - events.len() as u64;
        for (event, index) in events.iter().zip(first..) {
            match &mut self.encoder {
                EvtEncoder::Evt2(encoder) => encoder.put(event, &mut self.words),
                EvtEncoder::Evt3(encoder) => {
                    encoder.put(event, &mut self.words).ok_or_else(|| too_silent(event, index))?;
                }
            }
        }
        self.out.write_all(&self.words)?;
        self.words.clear();
        Ok(())
    }
}

fn check_size(size: Size) -> Result<(), EventFileError> {
    if size.width > EDGE || size.height > EDGE {
        let because = format!("a sensor of {size}, but EVT allows at most {EDGE} columns and rows");
        return Err(EventFileError::Container(because));
    }
    Ok(())
}

/// EVT 3.0 needs a word for each 4.2 seconds, with or without events.
fn too_silent(event: &Event, index: u64) -> EventFileError {
    let t_us = event.t.floor_micros();
    let because = format!(
        "t = {t_us} us: the gap without events before it needs more than {} words of EVT 3.0, the limit; count \
         the times from the first event, or write another format",
        evt3::MAX_SILENT_WORDS
    );
    EventFileError::Order { index, because }
}
