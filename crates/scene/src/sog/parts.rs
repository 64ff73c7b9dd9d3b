//! Access to the parts of a SOG, in an archive or in a folder.

use crate::SceneError;
use crate::cursor::ByteCursor;
use gs2e_files as files;
use gs2e_files::budget::ByteBudget;
use std::io::{self, Read};
use std::path::Path;
use zip::ZipArchive;
use zip::result::ZipError;

const ARCHIVE: &str = ".sog (archive)";

/// A set of named files.
pub(super) trait SogParts {
    /// The content of `name`, which errors call `part`. Its memory is taken from `budget`.
    fn part(
        &mut self,
        name: &str,
        part: &'static str,
        budget: &mut ByteBudget,
    ) -> Result<Vec<u8>, SceneError>;
}

/// The files of a zip archive.
pub(super) struct ArchiveParts<'a> {
    bytes: &'a [u8],
    zip: ZipArchive<io::Cursor<&'a [u8]>>,
}

impl<'a> ArchiveParts<'a> {
    pub(super) fn open(bytes: &'a [u8]) -> Result<Self, SceneError> {
        let zip = ZipArchive::new(io::Cursor::new(bytes)).map_err(|e| broken_archive(bytes, &e))?;
        Ok(Self { bytes, zip })
    }

    /// Maximum number of bytes of a part: images do not compress further, and `meta.json` is small.
    fn limit(&self) -> usize {
        self.bytes.len().saturating_add(1 << 20)
    }
}

fn broken_archive(bytes: &[u8], because: &ZipError) -> SceneError {
    let at = ByteCursor::new(ARCHIVE, bytes);
    at.malformed(format!("a broken archive ({because})"), "a zip archive, stored or deflated")
}

impl SogParts for ArchiveParts<'_> {
    fn part(
        &mut self,
        name: &str,
        part: &'static str,
        budget: &mut ByteBudget,
    ) -> Result<Vec<u8>, SceneError> {
        let limit = self.limit();
        let mut file = match self.zip.by_name(name) {
            Ok(file) => file,
            Err(ZipError::FileNotFound) => {
                let at = ByteCursor::new(ARCHIVE, self.bytes);
                return Err(at.malformed("an archive without the file", format!("`{name}`, the {part}")));
            }
            Err(e) => return Err(broken_archive(self.bytes, &e)),
        };
        let mut content = Vec::new();
        // One byte more than allowed shows that the limit is exceeded.
        let read = file.by_ref().take(limit as u64 + 1).read_to_end(&mut content);
        let at = ByteCursor::new(part, &content).at(content.len());
        match read {
            Err(e) => Err(at.malformed(format!("a broken stream ({e})"), format!("`{name}`"))),
            Ok(_) if content.len() > limit => Err(at.malformed("more bytes", format!("at most {limit}"))),
            Ok(_) => match budget.take(content.len(), 1) {
                Ok(()) => Ok(content),
                Err(e) => Err(at.malformed(format!("parts that take {e}"), "less")),
            },
        }
    }
}

/// The files of a folder.
pub(super) struct FolderParts<'a>(pub(super) &'a Path);

impl SogParts for FolderParts<'_> {
    fn part(&mut self, name: &str, _: &'static str, budget: &mut ByteBudget) -> Result<Vec<u8>, SceneError> {
        let path = self.0.join(name);
        let content =
            files::read(&path, files::MAX_PICTURE).map_err(|because| SceneError::File { path, because })?;
        budget.grow(content.len());
        Ok(content)
    }
}
