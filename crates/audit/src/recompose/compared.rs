//! A file of the tree that is compared with bytes while they are made.

use gs2e_files as files;
use gs2e_files::LinkRule;
use std::fs::File;
use std::io::{self, BufReader, Read as _, Write};
use std::path::Path;

/// Takes the bytes that a file should have. Memory does not grow with them, and the first other byte is an
/// error.
pub(super) struct ComparedFile {
    file: BufReader<File>,
    held: Vec<u8>,
    /// Number of the line, from 1.
    line: usize,
}

impl ComparedFile {
    pub(super) fn open(path: &Path) -> io::Result<Self> {
        let file = BufReader::new(files::open_with(path, LinkRule::Refuse)?);
        Ok(Self { file, held: Vec::new(), line: 1 })
    }

    /// Checks that the file ends here.
    pub(super) fn finish(mut self) -> io::Result<()> {
        match self.file.read(&mut [0])? {
            0 => Ok(()),
            _ => Err(self.differs("which should not be there")),
        }
    }

    fn differs(&self, what: &str) -> io::Error {
        io::Error::new(io::ErrorKind::InvalidData, format!("line {}, {what}", self.line))
    }
}

impl Write for ComparedFile {
    fn write(&mut self, wanted: &[u8]) -> io::Result<usize> {
        self.held.clear();
        self.file.by_ref().take(wanted.len() as u64).read_to_end(&mut self.held)?;
        let equal = self.held.iter().zip(wanted).take_while(|(a, b)| a == b).count();
        self.line += wanted[..equal].iter().filter(|byte| **byte == b'\n').count();
        if equal < wanted.len() {
            // The line may have begun in an earlier buffer, which is gone. The message then shows its end
            // only.
            let rest =
                &wanted[wanted[..equal].iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1)..];
            let end = rest.iter().position(|byte| *byte == b'\n').unwrap_or(rest.len());
            let text = String::from_utf8_lossy(&rest[..end]);
            return Err(self.differs(&format!("which should have `{}`", super::brief(&text))));
        }
        Ok(equal)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
