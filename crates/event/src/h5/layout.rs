//! The objects of a file: those that [`super::Writer`] makes, and no others.

use super::END_US;
use super::reader::guard_panics;
use crate::EventFileError;
use rust_hdf5::{H5File, Hdf5Error};
use std::path::Path;

pub(super) const X: &str = "events/x";
pub(super) const Y: &str = "events/y";
pub(super) const P: &str = "events/p";
pub(super) const T: &str = "events/t";
pub(super) const LABEL: &str = "events/label";
pub(super) const MS_TO_IDX: &str = "ms_to_idx";
pub(super) const T_OFFSET: &str = "t_offset";

/// Number of elements in a chunk.
pub(super) const CHUNK: usize = 65_536;

/// The offsets for which times fit into 64-bit nanoseconds.
pub(super) const OFFSETS_US: std::ops::RangeInclusive<i64> = i64::MIN / 1000 + 1..=i64::MAX / 1000 - END_US;

/// Columns of a stream, with the group that holds them.
const COLUMNS: [&str; 5] = [X, Y, P, T, LABEL];
/// Attributes of the root.
const ATTRIBUTES: [&str; 5] = ["width", "height", "law_version", "c_on", "c_off"];

/// The first object or attribute of a file that the writer of streams does not make, if any.
/// Readers pass over such an object, so it can hold anything.
///
/// # Errors
/// The structure of the file cannot be read.
pub fn foreign_object(path: &Path) -> Result<Option<String>, EventFileError> {
    guard_panics(|| {
        let file = H5File::options().no_locking().open(path)?;
        if file.userblock_size() > 0 {
            return Ok(Some("a block of the user in front of the data".to_owned()));
        }
        let events = file.root_group().group("events")?;
        let below = events.link_names()?.into_iter().map(|name| format!("events/{name}"));
        let known = |name: &String| COLUMNS.contains(&name.as_str());
        if let Some(name) = below.into_iter().find(|name| !known(name)) {
            return Ok(Some(format!("the object `{name}`")));
        }
        let known = |name: &String| ["events", MS_TO_IDX, T_OFFSET].contains(&name.as_str());
        if let Some(name) = file.root_group().link_names()?.into_iter().find(|name| !known(name)) {
            return Ok(Some(format!("the object `{name}`")));
        }
        foreign_attribute(&file)
    })
}

fn foreign_attribute(file: &H5File) -> Result<Option<String>, EventFileError> {
    let unreadable = file.attrs_unreadable_reason()?;
    if let Some(because) = unreadable {
        return Ok(Some(format!("attributes that cannot be listed ({because})")));
    }
    let known = |name: &String| ATTRIBUTES.contains(&name.as_str());
    if let Some(name) = file.attr_names()?.into_iter().find(|name| !known(name)) {
        return Ok(Some(format!("the attribute `{name}`")));
    }
    let of_group = file.root_group().group("events")?.attr_names()?.into_iter();
    if let Some(name) = of_group.into_iter().next() {
        return Ok(Some(format!("the attribute `{name}` of `events`")));
    }
    for dataset in file.dataset_names() {
        if let Some(name) = file.dataset(&dataset)?.attr_names()?.into_iter().next() {
            return Ok(Some(format!("the attribute `{name}` of `{dataset}`")));
        }
    }
    Ok(None)
}

impl From<Hdf5Error> for EventFileError {
    fn from(e: Hdf5Error) -> Self {
        match e {
            Hdf5Error::Io(e) => Self::Io(e),
            other => Self::Container(other.to_string()),
        }
    }
}
