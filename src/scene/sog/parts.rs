//! Access to the parts of a SOG, in an archive or in a folder.

use crate::scene::SceneError;
use crate::scene::cursor::Cursor;
use std::io::{self, Read};
use std::path::Path;
use zip::ZipArchive;
use zip::result::ZipError;

const ARCHIVE: &str = ".sog (archive)";

/// A set of named files.
pub(super) trait Parts {
    /// Reads the content of `name`; errors call it `part`.
    fn part(&mut self, name: &str, part: &'static str) -> Result<Vec<u8>, SceneError>;
}

/// The files of a zip archive.
pub(super) struct Archive<'a> {
    bytes: &'a [u8],
    zip: ZipArchive<io::Cursor<&'a [u8]>>,
}

impl<'a> Archive<'a> {
    pub(super) fn open(bytes: &'a [u8]) -> Result<Self, SceneError> {
        let zip = ZipArchive::new(io::Cursor::new(bytes)).map_err(|e| broken(bytes, &e))?;
        Ok(Self { bytes, zip })
    }

    /// Returns the maximum size of a part in bytes. Images do not compress further; `meta.json`
    /// compresses about ten times.
    fn limit(&self) -> usize {
        self.bytes.len().saturating_mul(16).saturating_add(1 << 20)
    }
}

fn broken(bytes: &[u8], because: &ZipError) -> SceneError {
    let at = Cursor::new(ARCHIVE, bytes);
    at.malformed(format!("a broken archive ({because})"), "a zip archive, stored or deflated")
}

impl Parts for Archive<'_> {
    fn part(&mut self, name: &str, part: &'static str) -> Result<Vec<u8>, SceneError> {
        let limit = self.limit();
        let mut file = match self.zip.by_name(name) {
            Ok(file) => file,
            Err(ZipError::FileNotFound) => {
                let at = Cursor::new(ARCHIVE, self.bytes);
                return Err(at.malformed("an archive without it", format!("`{name}`, the {part}")));
            }
            Err(e) => return Err(broken(self.bytes, &e)),
        };
        let mut content = Vec::new();
        let read = file.by_ref().take(limit as u64 + 1).read_to_end(&mut content);
        let at = Cursor::new(part, &content).at(content.len());
        match read {
            Err(e) => Err(at.malformed(format!("a broken stream ({e})"), format!("`{name}`"))),
            Ok(_) if content.len() > limit => Err(at.malformed("more bytes", format!("at most {limit}"))),
            Ok(_) => Ok(content),
        }
    }
}

/// The files of a folder.
pub(super) struct Folder<'a>(pub(super) &'a Path);

impl Parts for Folder<'_> {
    fn part(&mut self, name: &str, _: &'static str) -> Result<Vec<u8>, SceneError> {
        let path = self.0.join(name);
        std::fs::read(&path).map_err(|because| SceneError::File { path, because })
    }
}
