//! Ways in which an HDF5 file leads to other files: external and soft links, datasets whose bytes
//! lie in other files (external file lists), and virtual datasets. All of them are refused.
//!
//! rust-hdf5 0.7 follows each of them. It opens the sources of virtual datasets together with the
//! file, so these are looked for in advance. The list of sources lies in a global heap collection,
//! which begins with `GCOL`, and ends with a checksum, so that other bytes are hardly ever taken
//! for one.

use crate::EventFileError;
use rust_hdf5::format::FormatContext;
use rust_hdf5::format::global_heap::GlobalHeapCollection;
use rust_hdf5::format::messages::virtual_mapping::VirtualMappingList;
use rust_hdf5::{H5Dataset, H5File, LinkClass};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};

/// First bytes of a global heap collection.
const HEAP: &[u8; 4] = b"GCOL";

/// Number of bytes that are searched at once.
const BLOCK: usize = 1 << 20;

/// Maximum size of a heap collection that is read, bytes. libhdf5 makes collections of 4 KiB, and
/// larger ones only for a larger object.
const MAX_HEAP: u64 = 1 << 26;

/// Widths of lengths that the library reads, in bytes.
const WIDTHS: [u8; 3] = [2, 4, 8];

/// Refuses a file that holds the sources of a virtual dataset.
///
/// # Errors
/// The file has such sources or a heap collection too large to be searched, or cannot be read.
pub(super) fn refuse_virtual(mut file: File) -> Result<(), EventFileError> {
    let heaps = heaps(&mut file)?;
    let mut search = LinkSearch { left: file.metadata()?.len().saturating_add(MAX_HEAP), file };
    for at in heaps {
        // The width of lengths is not known here, so all are tried.
        for sizeof_size in WIDTHS {
            if search.finds_sources(at, FormatContext { sizeof_addr: 8, sizeof_size })? {
                return Err(refusal("a virtual dataset, whose events are in other files"));
            }
        }
    }
    Ok(())
}

/// Offsets at which a heap collection may begin.
fn heaps(file: &mut File) -> Result<Vec<u64>, EventFileError> {
    let mut found = Vec::new();
    let mut block = vec![0; BLOCK];
    // The last bytes of a block may begin a word that ends in the next.
    let (mut start, mut kept) = (0_u64, 0);
    loop {
        let n = file.read(&mut block[kept..])?;
        if n == 0 {
            return Ok(found);
        }
        let held = kept + n;
        let begins = |at: &usize| block[*at] == HEAP[0] && block[*at..].starts_with(HEAP);
        found.extend((0..held.saturating_sub(3)).filter(begins).map(|at| start + at as u64));
        kept = held.min(3);
        start += (held - kept) as u64;
        block.copy_within(held - kept..held, 0);
    }
}

/// A search through heap collections.
struct LinkSearch {
    file: File,
    /// Bytes that may still be read: heaps of a sound file do not overlap, so together they are no
    /// longer than it.
    left: u64,
}

impl LinkSearch {
    /// Looks for a list of sources in the heap collection at `at`, if there is one.
    fn finds_sources(&mut self, at: u64, context: FormatContext) -> Result<bool, EventFileError> {
        let head = self.bytes(at, 24)?;
        let Ok(size) = GlobalHeapCollection::decode_size(&head, &context) else { return Ok(false) };
        let size = size as u64;
        // A size beyond the file belongs to other bytes that happen to begin with `GCOL`.
        if size > self.file.metadata()?.len().saturating_sub(at) {
            return Ok(false);
        }
        if size > MAX_HEAP || size > self.left {
            return Err(refusal("heaps that overlap, or one that is too large to search"));
        }
        self.left -= size;
        let bytes = self.bytes(at, size)?;
        let Ok((heap, _)) = GlobalHeapCollection::decode(&bytes, &context) else { return Ok(false) };
        let objects = (1..=heap.max_index()).filter_map(|index| heap.get_object(index));
        let mut lists = objects.filter_map(|object| VirtualMappingList::decode(object, &context).ok());
        Ok(lists.any(|list| !list.mappings.is_empty()))
    }

    fn bytes(&mut self, at: u64, count: u64) -> Result<Vec<u8>, EventFileError> {
        let mut bytes = Vec::new();
        self.file.seek(SeekFrom::Start(at))?;
        self.file.by_ref().take(count).read_to_end(&mut bytes)?;
        Ok(bytes)
    }
}

/// Refuses links on the way to the datasets, because their objects would lie elsewhere.
///
/// # Errors
/// A name on the way is a link to anything but an object of the file itself.
pub(super) fn refuse_links(file: &H5File, datasets: &[&'static str]) -> Result<(), EventFileError> {
    let root = file.root_group();
    for &dataset in datasets {
        // Every group on the way may be a link, so each prefix of the path is looked up.
        let ends = dataset.match_indices('/').map(|(at, _)| at).chain([dataset.len()]);
        for name in ends.map(|end| &dataset[..end]) {
            let leads = match root.link_class(name) {
                Ok(LinkClass::External { .. }) => "a link to another file",
                Ok(LinkClass::Soft { .. }) => "a soft link",
                Ok(LinkClass::UserDefined { .. }) => "a link of an unknown kind",
                Ok(LinkClass::Hard) | Err(_) => continue,
            };
            let because = format!("`{name}` is {leads}, wanted an object of the file itself");
            return Err(EventFileError::Dataset { dataset, because });
        }
    }
    Ok(())
}

/// Refuses a dataset whose bytes lie in other files.
///
/// # Errors
/// The dataset has other files, or the library cannot read where its bytes lie.
pub(super) fn refuse_external(dataset: &H5Dataset, name: &'static str) -> Result<(), EventFileError> {
    if dataset.external_files()?.is_empty() && dataset.virtual_mappings()?.is_empty() {
        return Ok(());
    }
    let because = "its values are in other files, wanted values in the file itself".to_owned();
    Err(EventFileError::Dataset { dataset: name, because })
}

fn refusal(what: &str) -> EventFileError {
    EventFileError::Container(format!("the file holds {what}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::h5::Reader;
    use rust_hdf5::Selection;
    use std::path::Path;

    /// A file with all datasets of a stream but `events/t`, which `make` adds.
    fn file(path: &Path, make: impl FnOnce(&H5File)) {
        let file = H5File::create(path).unwrap();
        let group = file.create_group("events").unwrap();
        for name in ["x", "y"] {
            group.new_dataset::<u16>().shape([4]).create(name).unwrap().write_raw(&[1_u16; 4]).unwrap();
        }
        group.new_dataset::<u8>().shape([4]).create("p").unwrap().write_raw(&[1_u8; 4]).unwrap();
        file.new_dataset::<u64>().shape([2]).create("ms_to_idx").unwrap().write_raw(&[0_u64, 4]).unwrap();
        file.new_dataset::<i64>().shape([1]).create("t_offset").unwrap().write_raw(&[0_i64]).unwrap();
        make(&file);
        file.close().unwrap();
    }

    fn outcome(path: &Path) -> String {
        Reader::open(path).map(|reader| reader.count().to_string()).unwrap_or_else(|error| error.to_string())
    }

    #[test]
    fn a_file_by_itself_is_read_and_no_way_out_is_followed() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let times = |file: &H5File, name: &str| {
            file.new_dataset::<u32>().shape([4]).create(name).unwrap().write_raw(&[1_u32, 2, 3, 4]).unwrap();
        };
        file(&at("whole.h5"), |file| times(file, "events/t"));
        assert_eq!(outcome(&at("whole.h5")), "4");

        file(&at("soft.h5"), |file| {
            times(file, "times");
            file.root_group().group("events").unwrap().create_soft_link("t", "/times").unwrap();
        });
        assert!(outcome(&at("soft.h5")).contains("`events/t` is a soft link"), "{}", outcome(&at("soft.h5")));

        file(&at("external.h5"), |file| {
            let events = file.root_group().group("events").unwrap();
            events.create_external_link("t", at("whole.h5").to_str().unwrap(), "/events/t").unwrap();
        });
        assert!(outcome(&at("external.h5")).contains("`events/t` is a link to another file"));

        file(&at("virtual.h5"), |file| {
            let source = at("whole.h5");
            let from = source.to_str().unwrap();
            let times = file.new_dataset::<u32>().shape([4]);
            times
                .virtual_mapping(Selection::All, from, "events/t", Selection::All)
                .create("events/t")
                .unwrap();
        });
        assert!(outcome(&at("virtual.h5")).contains("a virtual dataset"), "{}", outcome(&at("virtual.h5")));

        std::fs::write(at("raw"), [1_u32, 2, 3, 4].map(u32::to_le_bytes).concat()).unwrap();
        file(&at("list.h5"), |file| {
            let raw = at("raw");
            let files = [(raw.to_str().unwrap(), 0, 16)];
            file.new_dataset::<u32>().shape([4]).external(&files).create("events/t").unwrap();
        });
        assert!(
            outcome(&at("list.h5")).contains("its values are in other files"),
            "{}",
            outcome(&at("list.h5"))
        );
    }
}
