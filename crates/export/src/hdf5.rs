//! HDF5 files of columns and pictures.
//!
//! The oldest layout, as in the files of a release, so that every HDF5 library reads them. No time is
//! stored: equal data are equal bytes.

use super::ExportError;
use rust_hdf5::{H5Dataset, H5File, H5Group, H5Type, Hdf5Error, LibverBound};
use std::io;
use std::path::{Path, PathBuf};

/// Number of elements in a chunk of a column.
const CHUNK: usize = 65_536;
/// Level of deflate. Columns are shuffled first, and higher levels gain a few percent for several times the
/// time.
const LEVEL: u32 = 1;

/// A file that is being written.
pub(super) struct Hdf5File {
    path: PathBuf,
    file: H5File,
}

impl Hdf5File {
    /// Creates the file.
    pub(super) fn create(path: &Path) -> Result<Self, ExportError> {
        let created = H5File::options().no_locking().libver(LibverBound::Earliest).create(path);
        Ok(Self { path: path.to_owned(), file: created.map_err(failed(path))? })
    }

    /// Opens a complete file, to add to it.
    pub(super) fn extend(path: &Path) -> Result<Self, ExportError> {
        Ok(Self { path: path.to_owned(), file: H5File::open_rw(path).map_err(failed(path))? })
    }

    /// The root.
    pub(super) fn root(&self) -> H5Group {
        self.file.root_group()
    }

    /// Runs `add` on the file.
    pub(super) fn add<T>(&self, add: impl FnOnce(&H5File) -> Result<T, Hdf5Error>) -> Result<T, ExportError> {
        add(&self.file).map_err(failed(&self.path))
    }

    /// Completes the file.
    pub(super) fn close(self) -> Result<(), ExportError> {
        self.file.close_no_sync().map_err(failed(&self.path))
    }
}

/// Returns the error of a file that cannot be written.
fn failed(path: &Path) -> impl FnOnce(Hdf5Error) -> ExportError {
    let path = path.to_owned();
    move |error| {
        let source = match error {
            Hdf5Error::Io(e) => e,
            other => io::Error::other(other.to_string()),
        };
        ExportError::unwritten(&path)(source)
    }
}

/// A column that grows. One chunk of it is in memory.
pub(super) struct GrowingColumn {
    path: PathBuf,
    dataset: H5Dataset,
    width: usize,
    held: Vec<u8>,
    stored: usize,
}

impl GrowingColumn {
    /// Starts a column in a group.
    pub(super) fn create<T: H5Type>(
        file: &Hdf5File,
        group: &H5Group,
        name: &str,
    ) -> Result<Self, ExportError> {
        let growing = group.new_dataset::<T>().shape([0usize]).chunk(&[CHUNK]).max_shape(&[None]);
        let dataset = file.add(|_| growing.shuffle_deflate(LEVEL).create(name))?;
        let width = size_of::<T>();
        let held = Vec::with_capacity(CHUNK * width);
        Ok(Self { path: file.path.clone(), dataset, width, held, stored: 0 })
    }

    /// Appends the little-endian bytes of an element.
    pub(super) fn push(&mut self, element: &[u8]) -> Result<(), ExportError> {
        debug_assert_eq!(element.len(), self.width, "an element has the type of its column");
        self.held.extend_from_slice(element);
        if self.held.len() == CHUNK * self.width { self.store() } else { Ok(()) }
    }

    fn store(&mut self) -> Result<(), ExportError> {
        let chunk = self.stored / CHUNK;
        self.stored += self.held.len() / self.width;
        // A chunk has its full length in the file also where the column ends in it.
        self.held.resize(CHUNK * self.width, 0);
        let stored = self.dataset.extend(&[self.stored]);
        stored.and_then(|()| self.dataset.write_chunk(chunk, &self.held)).map_err(failed(&self.path))?;
        self.held.clear();
        Ok(())
    }

    /// Stores the rest.
    pub(super) fn finish(mut self) -> Result<(), ExportError> {
        if self.held.is_empty() { Ok(()) } else { self.store() }
    }
}
