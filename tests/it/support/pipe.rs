//! Named pipes in the place of files: what is in them is decided when they are opened.

use rustix::fs::{CWD, FileType, Mode, mknodat};
use std::fs;
use std::path::Path;

/// Puts a new pipe at `path`, in place of what is there. Whoever serves a pipe does so before it closes its end: a slow
/// reader would else take what the next one gets for more of its own.
pub(crate) fn renew(path: &Path) {
    let aside = path.with_extension("pipe");
    mknodat(CWD, &aside, FileType::Fifo, Mode::from_raw_mode(0o600), 0).unwrap();
    fs::rename(aside, path).unwrap();
}
