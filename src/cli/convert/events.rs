//! Events in another file format.

use super::refuse_losses;
use crate::cli::words::{Word, one_of};
use crate::cli::{Console, ExitKind, VerbError, input, output, path};
use gs2e_event::evt::EvtVersion;
use gs2e_event::file::{EventFile, EventFormat, OpenEventFile, ReadHints};
use gs2e_event::sorted::SortedEvents;
use gs2e_event::text::TextTimeUnit;
use gs2e_event::{Event, EventFileError, EventSource as _, file, h5, text};
use gs2e_files::{self as files, write_by_rename};
use gs2e_image::Size;
use gs2e_num::units::format_amount;
use serde_json::json;
use std::io;
use std::path::Path;

/// The names of the event formats, for help texts.
pub(in crate::cli) const SUPPORTED: &str = "events: .h5, .npz, .raw, .aedat4, .txt, .csv, .mcap";

/// The formats that are written.
pub(in crate::cli) const WRITTEN: &str = "events: .h5, .npz, .raw, .aedat4, .txt, .csv";

/// Options of event conversions.
#[derive(Debug, clap::Args)]
pub(super) struct EventOptions {
    #[command(flatten)]
    output: EventOutputOptions,
    #[command(flatten)]
    input: EventInputOptions,
}

/// Options of event files that are written.
#[derive(Debug, clap::Args)]
pub(in crate::cli) struct EventOutputOptions {
    /// Codec of a .raw
    #[arg(long, value_parser = one_of(&CODECS), default_value = "evt2")]
    pub(in crate::cli) codec: EvtVersion,
    /// Compression of a .h5: gzip[:0-9], zstd[:1-19], lz4 or none; other programs need a plugin for
    /// zstd and lz4
    #[arg(long, value_name = "FILTER", default_value_t)]
    pub(in crate::cli) h5_filter: h5::ChunkFilter,
}

/// Properties of event files that do not state them.
#[derive(Debug, clap::Args)]
pub(in crate::cli) struct EventInputOptions {
    /// Size of the sensor, if an event file does not state it
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = input::parse_size)]
    size: Option<Size>,
    /// Unit of the times in a .txt or .csv [default: whole numbers are microseconds]
    #[arg(long, value_parser = one_of(&TIME_UNITS), value_name = "UNIT")]
    time_unit: Option<TextTimeUnit>,
    /// Topic of a .mcap, if several hold events
    #[arg(long, value_name = "NAME")]
    topic: Option<String>,
}

/// The codecs of a .raw.
const CODECS: [Word<EvtVersion>; 2] =
    [("evt2", "Prophesee's EVT 2.0", EvtVersion::Evt2), ("evt3", "Prophesee's EVT 3.0", EvtVersion::Evt3)];

/// The note on a text whose whole times have no unit.
pub(in crate::cli) const ASSUMED: &str = "note: no unit is stated for the times: whole numbers are read as microseconds; --time-unit states another";

/// Units of time.
pub(in crate::cli) const TIME_UNITS: [Word<TextTimeUnit>; 4] = [
    ("s", "Seconds", TextTimeUnit::Second),
    ("ms", "Milliseconds", TextTimeUnit::Millisecond),
    ("us", "Microseconds", TextTimeUnit::Microsecond),
    ("ns", "Nanoseconds", TextTimeUnit::Nanosecond),
];

impl EventOptions {
    /// The event format that belongs to a name.
    pub(super) fn format(&self, path: &Path) -> Option<EventFormat> {
        EventFormat::for_path(path, self.output.codec)
    }
}

impl EventInputOptions {
    /// Opens a file of events.
    pub(in crate::cli) fn open(&self, path: &Path, format: EventFormat) -> Result<OpenEventFile, VerbError> {
        self.open_in(path, format, self.time_unit)
    }

    /// The unit of a text whose times have fractions although nothing states it: cameras' programs write
    /// seconds.
    pub(in crate::cli) fn assumed_unit(&self, path: &Path, format: EventFormat) -> Option<TextTimeUnit> {
        if self.time_unit.is_some() || !matches!(format, EventFormat::Text(_)) {
            return None;
        }
        // What cannot be read is refused when it is.
        let reader = text::Reader::open(path, self.size, None).ok()?;
        reader.lacks_unit().then_some(TextTimeUnit::Second)
    }

    /// Opens a file of events with times in a unit.
    pub(in crate::cli) fn open_in(
        &self,
        path: &Path,
        format: EventFormat,
        unit: Option<TextTimeUnit>,
    ) -> Result<OpenEventFile, VerbError> {
        if let Err(e) = files::open(path) {
            return Err(VerbError::usage("input-missing", format!("{} cannot be read: {e}", path.display())));
        }
        let hints = ReadHints { size: self.size, unit, topic: self.topic.as_deref() };
        file::open(path, format, hints).map_err(|e| input::wrong_events(path, &e))
    }
}

/// The event file of a conversion.
pub(super) struct InputEvents<'a> {
    pub(super) path: &'a Path,
    pub(super) format: EventFormat,
    pub(super) options: &'a EventOptions,
}

impl InputEvents<'_> {
    /// Opens the file. Says so if its times are assumed to be in microseconds.
    pub(super) fn open(&self, console: &Console) -> Result<OpenEventFile, VerbError> {
        let opened = self.options.input.open(self.path, self.format)?;
        if opened.assumes_us {
            console.note(ASSUMED);
        }
        Ok(opened)
    }
}

/// A conversion of events from one file to another.
pub(super) struct EventConversion<'a> {
    pub(super) from: InputEvents<'a>,
    pub(super) output: &'a Path,
    /// The format of the output.
    pub(super) to: EventFormat,
    pub(super) lossy: bool,
}

/// The number of events written, and of those that were changed or dropped.
#[derive(Debug, Default)]
struct ConversionSummary {
    events: u64,
    on: u64,
    untimed: u64,
    /// Events whose time has a part below a microsecond.
    rounded: u64,
    bytes: u64,
}

impl EventConversion<'_> {
    pub(super) fn run(&self, console: &Console) -> Result<ExitKind, VerbError> {
        // Losses that follow from the formats are refused before the events are read.
        output::screen_outputs([self.output], [], false)?;
        let mut opened = self.from.open(console)?;
        let before = self.losses_of_format(&opened);
        if !before.is_empty() && !self.lossy {
            return Err(refuse_losses(self.output, before.into_iter()));
        }
        let mut done = ConversionSummary::default();
        let written = write_by_rename(self.output, |part| {
            done = self.copy(&mut opened, part)?;
            // These losses are only known after all events were read.
            if self.lossy || done.losses().is_empty() { Ok(()) } else { Err(ConvertFailure::Lossy) }
        });
        written.map_err(|failure| match failure {
            ConvertFailure::Lossy => refuse_losses(self.output, done.losses().into_iter()),
            ConvertFailure::Read(e) => input::wrong_events(self.from.path, &e),
            ConvertFailure::Write(e) => output::not_written(self.output, e),
        })?;
        let losses = [before, done.losses()].concat();
        self.report(&opened, &done, &losses, console);
        Ok(ExitKind::Done)
    }

    /// Properties of events that the output's format cannot hold.
    fn losses_of_format(&self, opened: &OpenEventFile) -> Vec<String> {
        let labels = opened.header.labelled && !self.to.keeps_labels();
        let labels = labels.then(|| "labels (signal or noise) are dropped".to_owned());
        labels.into_iter().collect()
    }

    /// Properties of the recording that the output's format cannot hold: no event changes without them.
    fn notes_of_format(&self, opened: &OpenEventFile) -> Vec<String> {
        let law = opened.header.law.filter(|_| !self.to.keeps_law());
        let law = law.map(|law| {
            format!("the contrast thresholds are not stored: ON {:.4}, OFF {:.4}", law.c_on, law.c_off)
        });
        law.into_iter().collect()
    }

    fn copy(&self, opened: &mut OpenEventFile, part: &Path) -> Result<ConversionSummary, ConvertFailure> {
        let mut sorted = SortedEvents::new(&mut *opened.source);
        let (mut done, mut chunk) = (ConversionSummary::default(), Vec::new());
        let mut more = sorted.next_chunk(&mut chunk).map_err(ConvertFailure::Read)?;
        let last = |chunk: &[Event]| chunk.last().map(|event| event.t.floor_micros());
        let mut last_us = last(&chunk).unwrap_or(opened.offset_us);
        let filter = self.from.options.output.h5_filter;
        let h5 = h5::H5Options { filter, t_offset_us: opened.offset_us };
        // A file that states the origin of its times is believed. For other files, the times of the
        // first chunk show whether 32 bits can hold them.
        let h5 = match chunk.first() {
            Some(first) if h5.t_offset_us == 0 => h5.spanning(first.t.floor_micros(), last_us),
            _ => h5,
        };
        let options = file::WriteOptions { zero_us: 0, h5 };
        let sink = file::create(part, self.to, &opened.header, options);
        let mut sink = sink.map_err(ConvertFailure::Write)?;
        while more {
            done.count(&chunk);
            last_us = last(&chunk).unwrap_or(last_us);
            sink.append(&chunk).map_err(|e| ConvertFailure::Write(e.into()))?;
            more = sorted.next_chunk(&mut chunk).map_err(ConvertFailure::Read)?;
        }
        done.untimed = sorted.untimed();
        let written = EventFile::finish(sink, last_us).map_err(ConvertFailure::Write)?;
        debug_assert_eq!(written, done.events);
        done.bytes = std::fs::metadata(part).map_err(|e| ConvertFailure::Write(e.into()))?.len();
        Ok(done)
    }

    fn report(&self, opened: &OpenEventFile, done: &ConversionSummary, losses: &[String], console: &Console) {
        let (output, size) = (self.output, opened.header.size);
        let ConversionSummary { events, on, untimed, bytes, .. } = *done;
        let amounts = [format_amount(events, "events"), format_amount(bytes, "B")];
        console.note(&format!(
            "{}: {} from a sensor of {size}, {}",
            output.display(),
            amounts[0],
            amounts[1]
        ));
        let notes = self.notes_of_format(opened);
        notes.iter().for_each(|note| console.note(&format!("note: {note}")));
        losses.iter().for_each(|loss| console.note(loss));
        console.result(&json!({
            "input": path(self.from.path), "output": path(output), "width": size.width, "height": size.height,
            "events": events, "on": on, "untimed": untimed, "bytes": bytes, "lost": losses, "notes": notes,
        }));
    }
}

impl ConversionSummary {
    fn count(&mut self, events: &[Event]) {
        self.events += events.len() as u64;
        // The polarity is 1 for ON and 0 for OFF.
        self.on += events.iter().map(|e| e.polarity as u64).sum::<u64>();
        // Times are in nanoseconds, and every output format has microseconds.
        self.rounded += events.iter().filter(|e| e.t.0 % 1000 != 0).count() as u64;
    }

    fn losses(&self) -> Vec<String> {
        let untimed = (self.untimed > 0).then(|| {
            format!("events: {} before the first timestamp of the recording are dropped", self.untimed)
        });
        let rounded =
            (self.rounded > 0).then(|| format!("times: {} are truncated to the microsecond", self.rounded));
        [untimed, rounded].into_iter().flatten().collect()
    }
}

/// The reason why a file was not finished.
enum ConvertFailure {
    Read(EventFileError),
    Write(EventFileError),
    /// The file would lose something, and the user does not allow it.
    Lossy,
}

impl From<io::Error> for ConvertFailure {
    fn from(e: io::Error) -> Self {
        Self::Write(e.into())
    }
}
