//! Progress of a search for poses, read off the log of COLMAP, which has a line for each photo:
//! `Processed file [12/50]` of the extractor, and `Registering image #12 (20)` of the mapper (3.8 to
//! 4.x; `feature_extraction.cc`, `incremental_pipeline.cc`).

use gs2e_files as files;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// A watch on the log of one search.
pub(super) struct PoseWatch<'a> {
    log: &'a Path,
    photos: usize,
    report: &'a (dyn Fn(&str) + Sync),
    progress: Mutex<LineProgress>,
}

/// Lines seen so far.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
struct LineProgress {
    /// Number of bytes read.
    bytes: u64,
    /// Number of calls since the log was read.
    calls: u32,
    /// Number of photos with key points.
    described: usize,
    /// Number of photos in the current model.
    registered: usize,
    /// Tenths of both that were reported.
    tenths: [usize; 2],
}

/// Calls between two looks at the log. A program is checked every 20 ms.
const CALLS: u32 = 50;

impl<'a> PoseWatch<'a> {
    pub(super) fn new(log: &'a Path, photos: usize, report: &'a (dyn Fn(&str) + Sync)) -> Self {
        Self { log, photos, report, progress: Mutex::default() }
    }

    /// Reports the state of the search in words.
    pub(super) fn say(&self, words: &str) {
        (self.report)(words);
    }

    /// Called often while a program runs.
    pub(super) fn look(&self) {
        let mut progress = self.progress.lock().unwrap_or_else(PoisonError::into_inner);
        progress.calls += 1;
        if progress.calls >= CALLS {
            self.read(&mut progress);
        }
    }

    /// Called when a program has ended.
    pub(super) fn end(&self) {
        self.read(&mut self.progress.lock().unwrap_or_else(PoisonError::into_inner));
    }

    fn read(&self, progress: &mut LineProgress) {
        progress.calls = 0;
        // Without the log the search goes on, and its failure names the log.
        let Ok(new) = text_after(self.log, progress.bytes) else { return };
        progress.take(&new);
        let counts = [("photo", progress.described), ("registered", progress.registered)];
        for ((what, count), reported) in counts.into_iter().zip(&mut progress.tenths) {
            // A second model starts with few photos again, and is not reported below the first.
            let tenth = 10 * count / self.photos.max(1);
            if tenth > *reported {
                *reported = tenth;
                self.say(&format!("{what} {}/{}", count.min(self.photos), self.photos));
            }
        }
    }
}

impl LineProgress {
    /// Counts the whole lines of new text.
    fn take(&mut self, new: &str) {
        let Some((whole, _)) = new.rsplit_once('\n') else { return };
        self.bytes += whole.len() as u64 + 1;
        for line in whole.lines() {
            if line.contains("Processed file [") {
                self.described += 1;
            } else if line.contains("Initializing with image pair") {
                // The photos of the first pair have no lines of their own.
                self.registered = 2;
            } else if line.contains("Registering image #") {
                self.registered += 1;
            } else if line.contains("Could not register") {
                self.registered = self.registered.saturating_sub(1);
            }
        }
    }
}

/// The text of a file after `from` bytes.
fn text_after(path: &Path, from: u64) -> std::io::Result<String> {
    let mut file = files::open(path)?;
    file.seek(SeekFrom::Start(from))?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes)?;
    // Invalid bytes would change the length, and with it the place of the next look.
    Ok(bytes.iter().map(|byte| if byte.is_ascii() { char::from(*byte) } else { '?' }).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lines of COLMAP 3.8 and of 4.x.
    #[test]
    fn photos_are_counted_by_whole_lines() {
        let mut progress = LineProgress::default();
        progress.take("Processed file [1/9]\n  Name: 000000.jpg\nProcessed file [2/9]\nProcessed fi");
        assert_eq!((progress.described, progress.bytes), (2, 61));
        progress.take("Processed file [3/9]\n");
        progress.take("I2 incremental_pipeline.cc:1] Initializing with image pair #1 and #2\n");
        progress.take("Registering image #3 (3)\nRegistering image #4 (4)\n  => Could not register, trying another image.\n");
        assert_eq!((progress.described, progress.registered), (3, 3));
        progress.take("Registering image #4 (num_reg_frames=4)\n");
        assert_eq!(progress.registered, 4);
    }
}
