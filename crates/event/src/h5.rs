//! Event streams as HDF5 in the layout of DSEC (Gehrig et al., RA-L 2021; GitHub uzh-rpg/DSEC).
//! With the default filter, any HDF5 library can read them without a plug-in.
//!
//! | path | type | content |
//! |---|---|---|
//! | `events/x`, `events/y` | u16 | column and row |
//! | `events/p` | u8 | 1 brighter, 0 darker |
//! | `events/label` | u8 | 1 signal, 0 noise; only where the stream has labels |
//! | `events/t` | u32 | microseconds since `t_offset`, non-decreasing |
//! | `ms_to_idx` | u64 | entry `k`: number of the first event with `t >= 1000 k` |
//! | `t_offset` | i64 | microseconds, 0 unless the stream has times that 32 bits do not hold |
//! | attributes of the root | | `width`, `height`, `law_version` (u32), `c_on`, `c_off` (f64) |
//!
//! `ms_to_idx` has one entry beyond the last millisecond, because DSEC's slicer needs it for the
//! end of the stream: its length is `floor(t_end / 1000) + 2`, with `t_end` the later of the last
//! event and the last stamp.
//!
//! Noise events are those that the pixel's brightness did not make: events of hot pixels and shot
//! noise, and events for which brightness moved less than half the threshold since the pixel's
//! previous event (see `label.rs` of `gs2e-sensor`).
//!
//! All columns have chunks of 65,536 elements, shuffled and deflated unless another [`ChunkFilter`]
//! is chosen. The file has the oldest layout (superblock 0, symbol tables, B-tree indices), which
//! every HDF5 reader supports, and contains no time of writing: equal streams are equal bytes.
//!
//! # Examples
//! ```
//! # #[cfg(feature = "hdf5")] {
//! use gs2e_event::h5::{Reader, Writer};
//! use gs2e_event::{EventSink as _, EventSource as _, text};
//!
//! let mut text = text::Reader::new("# t x y p in us; sensor 4x3\n5 0 1 1\n".as_bytes(), None, None)?;
//! let (mut written, mut read) = (Vec::new(), Vec::new());
//! text.next_chunk(&mut written)?;
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("events.h5");
//! let mut writer = Writer::create(&path, &text.header())?;
//! writer.append(&written)?;
//! writer.finish(5)?;
//! Reader::open(&path)?.next_chunk(&mut read)?;
//! assert_eq!(read, written);
//! # }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#[cfg(feature = "hdf5")]
mod attributes;
#[cfg(feature = "hdf5")]
mod chunk;
mod filter;
#[cfg(feature = "hdf5")]
mod index;
#[cfg(feature = "hdf5")]
mod layout;
#[cfg(feature = "hdf5")]
mod outside;
#[cfg(feature = "hdf5")]
mod reader;
#[cfg(feature = "hdf5")]
mod writer;

pub use filter::{ChunkFilter, FilterError};
#[cfg(feature = "hdf5")]
pub use layout::foreign_object;
#[cfg(feature = "hdf5")]
pub use reader::Reader;
#[cfg(feature = "hdf5")]
pub use writer::Writer;

/// Times are u32.
const END_US: i64 = 1 << 32;

/// Options of a file.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct H5Options {
    /// Filter of the chunks.
    pub filter: ChunkFilter,
    /// Origin of the times in the file, in microseconds.
    pub t_offset_us: i64,
}

impl H5Options {
    /// Options for a stream from `first_us` to `last_us`. Its times count from 0 if 32 bits can
    /// hold them, because some readers ignore the offset, and otherwise from its first stamp, as in
    /// DSEC.
    #[must_use]
    pub fn spanning(self, first_us: i64, last_us: i64) -> Self {
        let held = 0..END_US;
        let absolute = held.contains(&first_us) && held.contains(&last_us);
        Self { t_offset_us: if absolute { 0 } else { first_us }, ..self }
    }
}
