//! Event files of every format, with one interface.
//!
//! # Examples
//! ```
//! use gs2e_event::evt::EvtVersion;
//! use gs2e_event::file::{EventFormat, ReadHints, open};
//! use std::path::Path;
//!
//! let raw = EventFormat::for_path(Path::new("a.raw"), EvtVersion::Evt3);
//! assert_eq!(raw, Some(EventFormat::Evt(EvtVersion::Evt3)));
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("events.txt");
//! std::fs::write(&path, "# t x y p in us; sensor 4x3\n5 0 1 1\n")?;
//! let format = EventFormat::for_path(&path, EvtVersion::Evt3).ok_or("no format of events")?;
//! let opened = open(&path, format, ReadHints::default())?;
//! assert_eq!((opened.header.size.width, opened.header.size.height), (4, 3));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::evt::{self, EvtVersion};
use super::text::{self, ColumnSeparator, TextTimeUnit};
use super::{Event, EventFileError, EventSink, EventSource, StreamHeader, aedat4, h5, mcap, npz};
use gs2e_image::Size;
use gs2e_num::units::Timestamp;
use std::path::Path;

/// The formats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EventFormat {
    /// HDF5 in the layout of DSEC.
    H5,
    /// A NumPy archive.
    Npz,
    /// Prophesee's raw files.
    Evt(EvtVersion),
    /// iniVation's AEDAT 4.0.
    Aedat4,
    /// Text.
    Text(ColumnSeparator),
    /// Recordings of ROS 2. They are read; an export of a release writes them.
    Mcap,
    /// Bags of ROS 2 in SQLite, and bags of ROS 1. They are refused with the way to convert them.
    Bag,
}

impl EventFormat {
    /// The format that belongs to a file name. A `.raw` file is of `version`, whatever an existing
    /// file contains.
    #[must_use]
    pub fn for_path(path: &Path, version: EvtVersion) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "h5" | "hdf5" => Some(Self::H5),
            "npz" => Some(Self::Npz),
            "raw" => Some(Self::Evt(version)),
            "aedat4" => Some(Self::Aedat4),
            "txt" => Some(Self::Text(ColumnSeparator::Txt)),
            "csv" => Some(Self::Text(ColumnSeparator::Csv)),
            "mcap" => Some(Self::Mcap),
            "db3" | "bag" => Some(Self::Bag),
            _ => None,
        }
    }

    /// The format that belongs to the name of a file to be written.
    #[must_use]
    pub fn for_output(path: &Path, version: EvtVersion) -> Option<Self> {
        Self::for_path(path, version).filter(|format| !matches!(format, Self::Mcap | Self::Bag))
    }

    /// Returns true if they store the simulation law.
    #[must_use]
    pub fn keeps_law(self) -> bool {
        self == Self::H5
    }

    /// Returns true if they store labels of events.
    #[must_use]
    pub fn keeps_labels(self) -> bool {
        matches!(self, Self::H5 | Self::Npz)
    }
}

/// Properties given by the user, for files that do not state them.
#[derive(Debug, Clone, Copy, Default)]
pub struct ReadHints<'a> {
    /// Columns and rows of the sensor.
    pub size: Option<Size>,
    /// Unit of integer times in a text.
    pub unit: Option<TextTimeUnit>,
    /// Topic of a recording, if it has several with events.
    pub topic: Option<&'a str>,
}

/// An event file open for reading.
pub struct OpenEventFile {
    /// The properties that it states.
    pub header: StreamHeader,
    /// Origin of the file's own times, in microseconds.
    pub offset_us: i64,
    /// True if whole numbers are read as microseconds although nothing states their unit.
    pub assumes_us: bool,
    /// The events, in the order of the file.
    pub source: Box<dyn EventSource>,
}

impl std::fmt::Debug for OpenEventFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("OpenEventFile").field("header", &self.header).finish_non_exhaustive()
    }
}

/// Opens a file in the format that belongs to its name.
///
/// # Errors
/// It is not of that format, or the sensor size is unknown.
pub fn open(path: &Path, format: EventFormat, hints: ReadHints<'_>) -> Result<OpenEventFile, EventFileError> {
    let (mut offset_us, mut labelled, mut assumes_us) = (0, false, false);
    let (header, source): (Option<StreamHeader>, Box<dyn EventSource>) = match format {
        EventFormat::H5 => {
            let (header, source);
            (offset_us, labelled, header, source) = open_h5(path)?;
            (header, source)
        }
        EventFormat::Npz => {
            let reader = npz::Reader::open(path)?;
            labelled = reader.labelled();
            let header = reader.size().map(|size| StreamHeader { size, law: None, labelled });
            (header, Box::new(reader))
        }
        EventFormat::Evt(_) => {
            let reader = evt::Reader::open(path)?;
            (Some(reader.header()), Box::new(reader))
        }
        EventFormat::Aedat4 => {
            let reader = aedat4::Reader::open(path)?;
            (Some(reader.header()), Box::new(reader))
        }
        EventFormat::Text(_) => {
            let reader = text::Reader::open(path, hints.size, hints.unit)?;
            assumes_us = !reader.states_unit();
            (Some(reader.header()), Box::new(reader))
        }
        EventFormat::Mcap => {
            let reader = mcap::Reader::open(path, hints.topic)?;
            (Some(reader.header()), Box::new(reader))
        }
        EventFormat::Bag => return Err(EventFileError::Container(CONVERT_BAG.to_owned())),
    };
    let header = match (header, hints.size) {
        // A size in the file is never overridden: the readers check the events against it.
        (Some(header), Some(said)) if header.size != said => {
            let because = format!("a sensor of {}, but --size is {said}", header.size);
            return Err(EventFileError::Container(because));
        }
        (Some(header), _) => header,
        (None, Some(size)) => StreamHeader { size, law: None, labelled },
        (None, None) => {
            let because = "the file does not state the sensor's size: give --size WIDTHxHEIGHT";
            return Err(EventFileError::Container(because.to_owned()));
        }
    };
    header.size.check_sensor().map_err(|e| EventFileError::Container(format!("a sensor of {e}")))?;
    Ok(OpenEventFile { header, offset_us, assumes_us, source })
}

/// An event file open for writing.
pub trait EventFile: EventSink {
    /// Completes the file, and returns the number of events. `last_us` is the last instant that the
    /// stream covers.
    ///
    /// # Errors
    /// Writing fails.
    fn finish(self: Box<Self>, last_us: i64) -> Result<u64, EventFileError>;
}

#[cfg(feature = "hdf5")]
impl EventFile for h5::Writer {
    fn finish(self: Box<Self>, last_us: i64) -> Result<u64, EventFileError> {
        Self::finish(*self, last_us)
    }
}

macro_rules! ends_with_its_last_event {
    ($($writer:ty)+) => {$(
        impl EventFile for $writer {
            fn finish(self: Box<Self>, _: i64) -> Result<u64, EventFileError> {
                Self::finish(*self)
            }
        }
    )+};
}
ends_with_its_last_event!(npz::Writer aedat4::Writer evt::Writer text::Writer);

/// Options of a file that is written.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct WriteOptions {
    /// Origin of the times of the given events, in microseconds.
    pub zero_us: i64,
    /// Options of an HDF5 file.
    pub h5: h5::H5Options,
}

/// Creates a file.
///
/// # Errors
/// The format cannot hold such a stream, or the file cannot be created.
pub fn create(
    path: &Path,
    format: EventFormat,
    header: &StreamHeader,
    WriteOptions { zero_us, h5 }: WriteOptions,
) -> Result<Box<dyn EventFile>, EventFileError> {
    let file: Box<dyn EventFile> = match format {
        #[cfg(feature = "hdf5")]
        EventFormat::H5 => Box::new(h5::Writer::create_as(path, header, h5)?),
        #[cfg(not(feature = "hdf5"))]
        EventFormat::H5 => return Err(without_hdf5()),
        EventFormat::Npz => Box::new(npz::Writer::create(path, header)?),
        EventFormat::Evt(version) => Box::new(evt::Writer::create(path, version, header.size)?),
        EventFormat::Aedat4 => Box::new(aedat4::Writer::create(path, header.size)?),
        EventFormat::Text(table) => Box::new(text::Writer::create(path, table, header.size)?),
        EventFormat::Mcap | EventFormat::Bag => {
            let because = "a recording is an export of a release, and no file of events alone";
            return Err(EventFileError::Container(because.to_owned()));
        }
    };
    // An HDF5 file states the origin of its times. The other formats count from 0.
    let offset_us = if format == EventFormat::H5 { h5.t_offset_us } else { 0 };
    match zero_us.checked_sub(offset_us) {
        Some(0) => Ok(file),
        // The chunks are copied only where the clocks differ.
        Some(by_us) => Ok(Box::new(ShiftedClock { file, by_us, shifted: Vec::new() })),
        None => Err(too_far(zero_us)),
    }
}

/// The way to read a bag. Of the readers of SQLite's bags in Rust none is kept well, and SQLite itself would
/// be a heavy dependency for one container.
const CONVERT_BAG: &str = "a bag of ROS is not read: convert it to MCAP with `rosbags-convert --src BAG --dst NEW \
     --dst-storage mcap` (pip install rosbags), or with `ros2 bag convert` where its message definitions are absent";

/// Offset, labels, header and events of a file.
type OpenH5 = (i64, bool, Option<StreamHeader>, Box<dyn EventSource>);

#[cfg(feature = "hdf5")]
fn open_h5(path: &Path) -> Result<OpenH5, EventFileError> {
    let reader = h5::Reader::open(path)?;
    Ok((reader.offset_us(), reader.labelled(), reader.header(), Box::new(reader)))
}

#[cfg(not(feature = "hdf5"))]
fn open_h5(_path: &Path) -> Result<OpenH5, EventFileError> {
    Err(without_hdf5())
}

#[cfg(not(feature = "hdf5"))]
fn without_hdf5() -> EventFileError {
    EventFileError::Container("this program was built without the feature `hdf5` of gs2e-event".to_owned())
}

fn too_far(us: i64) -> EventFileError {
    EventFileError::Container(format!("times from {us} us on do not fit in 64 bits of nanoseconds"))
}

/// The event shifted in time; `None` if 64 bits cannot hold its time.
pub fn shift_event(event: Event, by_us: i64) -> Option<Event> {
    let ns = by_us.checked_mul(1000)?.checked_add(event.t.0)?;
    Some(Event { t: Timestamp(ns), ..event })
}

/// A file whose clock differs from that of the events.
struct ShiftedClock {
    file: Box<dyn EventFile>,
    /// Offset added to each time.
    by_us: i64,
    /// The last chunk.
    shifted: Vec<Event>,
}

impl EventSink for ShiftedClock {
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        self.shifted.clear();
        for event in events {
            self.shifted.push(shift_event(*event, self.by_us).ok_or_else(|| too_far(self.by_us))?);
        }
        self.file.append(&self.shifted)
    }
}

impl EventFile for ShiftedClock {
    fn finish(self: Box<Self>, last_us: i64) -> Result<u64, EventFileError> {
        let last = last_us.checked_add(self.by_us).ok_or_else(|| too_far(self.by_us))?;
        self.file.finish(last)
    }
}
