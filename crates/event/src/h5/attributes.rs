//! Numeric attributes of the root group, which rust-hdf5 0.7 can write but not read.
//!
//! Only files of the oldest layout are supported (superblock 0 or 1, version 1 object headers), as
//! [`super::Writer`], h5py and the C library write them by default. In others, no attribute is
//! found.

use crate::EventFileError;
use gs2e_files as files;
use rust_hdf5::H5Type;
use rust_hdf5::format::FormatContext;
use rust_hdf5::format::messages::attribute::AttributeMessage;
use rust_hdf5::format::messages::{MSG_ATTRIBUTE, MSG_OBJ_HEADER_CONTINUATION};
use rust_hdf5::format::object_header::ObjectHeader;
use rust_hdf5::format::superblock::SuperblockV0V1;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// Maximum number of bytes in one block of an object header, and maximum number of blocks.
const MAX_SIZE: u64 = 1 << 20;

/// The attributes of a file's root.
#[derive(Debug, Default)]
pub(super) struct RootAttributes(Vec<AttributeMessage>);

impl RootAttributes {
    pub(super) fn read(path: &Path) -> Result<Self, EventFileError> {
        let mut file = files::open(path)?;
        let Ok(superblock) = SuperblockV0V1::decode(&read_block(&mut file, 0, 256)?) else {
            return Ok(Self::default());
        };
        let (len, wanted) = (file.metadata()?.len(), superblock.end_of_file_address);
        if len < wanted {
            return Err(EventFileError::Container(format!(
                "the file is truncated: {len} bytes, wanted {wanted}"
            )));
        }
        let context =
            FormatContext { sizeof_addr: superblock.sizeof_offsets, sizeof_size: superblock.sizeof_lengths };
        let at = superblock.root_symbol_table_entry.obj_header_addr;
        let head = read_block(&mut file, at, MAX_SIZE)?;
        let (mut header, _) = ObjectHeader::decode_v1(&head).map_err(|e| damaged_file(&e.to_string()))?;
        let mut found = Vec::new();
        let mut blocks = 0;
        // Continuations may hold further continuations, so blocks are read until one has none.
        while !header.messages.is_empty() {
            let mut rest = Vec::new();
            for message in &header.messages {
                match message.msg_type {
                    MSG_ATTRIBUTE => {
                        found.extend(AttributeMessage::decode(&message.data, &context).map(|a| a.0))
                    }
                    MSG_OBJ_HEADER_CONTINUATION => rest.extend(read_continued(&mut file, &message.data)?),
                    _ => (),
                }
            }
            header.messages = rest;
            blocks += 1;
            // A continuation that points to itself would never end.
            if blocks > 64 {
                return Err(damaged_file("its header has too many continuation blocks"));
            }
        }
        Ok(Self(found))
    }

    /// The value of a scalar attribute; `None` if it is absent or of another type.
    pub(super) fn value<T: H5Type + FromBytes>(&self, name: &str) -> Option<T> {
        // The type is compared too: bytes of another type would be read as a wrong number.
        let attribute = self.0.iter().find(|a| a.name == name && a.datatype == T::hdf5_type())?;
        T::from_bytes(&attribute.data)
    }
}

/// A number from its little-endian bytes.
pub(super) trait FromBytes: Sized {
    fn from_bytes(bytes: &[u8]) -> Option<Self>;
}

impl FromBytes for u32 {
    fn from_bytes(bytes: &[u8]) -> Option<Self> {
        bytes.try_into().ok().map(Self::from_le_bytes)
    }
}

impl FromBytes for f64 {
    fn from_bytes(bytes: &[u8]) -> Option<Self> {
        bytes.try_into().ok().map(Self::from_le_bytes)
    }
}

/// The messages of a continuation block, in the form of a version 1 header.
fn read_continued(
    file: &mut File,
    message: &[u8],
) -> Result<Vec<rust_hdf5::format::object_header::ObjectHeaderMessage>, EventFileError> {
    let number = |range| {
        Some(u64::from_le_bytes(<[u8; 8]>::try_from(message.get::<std::ops::Range<usize>>(range)?).ok()?))
    };
    let (Some(at), Some(len)) = (number(0..8), number(8..16)) else {
        return Err(damaged_file("a continuation block of its header is truncated"));
    };
    let body = read_block(file, at, len.min(MAX_SIZE))?;
    // A continuation has no head, so decoding gets one: version 1, no limit on messages, one
    // reference.
    let mut header = vec![1, 0, 0xff, 0xff, 1, 0, 0, 0];
    header.extend((body.len() as u64).to_le_bytes());
    header.extend(body);
    Ok(ObjectHeader::decode_v1(&header).map_err(|e| damaged_file(&e.to_string()))?.0.messages)
}

fn read_block(file: &mut File, at: u64, len: u64) -> Result<Vec<u8>, EventFileError> {
    let mut bytes = Vec::new();
    file.seek(SeekFrom::Start(at))?;
    file.take(len).read_to_end(&mut bytes)?;
    Ok(bytes)
}

fn damaged_file(because: &str) -> EventFileError {
    EventFileError::Container(format!("the root group cannot be read: {because}"))
}
