//! Events of E-NeRF: a folder of `.npy` files, each float64 `[N, 4]` with x, y, the time in
//! nanoseconds, and the polarity, 1 or -1.

use gs2e_event::{Event, EventFileError, EventLabel, EventSource, Polarity};
use gs2e_files as files;
use gs2e_num::units::Timestamp;
use npyz::{NpyFile, Order};
use std::fs;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// Maximum number of files: one per frame.
const MAX_FILES: usize = 1 << 20;

/// Reads the files one by one, in the order of their names.
#[derive(Debug)]
pub struct NpyEvents {
    files: Vec<PathBuf>,
    next: usize,
}

impl NpyEvents {
    /// Lists the folder.
    ///
    /// # Errors
    /// The folder cannot be read, or has no `.npy` file.
    pub fn open(folder: &Path) -> Result<Self, EventFileError> {
        let mut found = Vec::new();
        for entry in fs::read_dir(folder)? {
            let path = entry?.path();
            if path.extension().is_some_and(|extension| extension == "npy") {
                found.push(path);
            }
        }
        if found.is_empty() || found.len() > MAX_FILES {
            let because = format!("{} .npy files, wanted 1 to {MAX_FILES}", found.len());
            return Err(EventFileError::Container(because));
        }
        found.sort();
        Ok(Self { files: found, next: 0 })
    }
}

impl EventSource for NpyEvents {
    fn next_chunk(&mut self, out: &mut Vec<Event>) -> Result<bool, EventFileError> {
        out.clear();
        let Some(path) = self.files.get(self.next) else { return Ok(false) };
        self.next += 1;
        read_file(path, out)?;
        // A file without events is followed by others.
        if out.is_empty() { self.next_chunk(out) } else { Ok(true) }
    }
}

fn read_file(path: &Path, out: &mut Vec<Event>) -> Result<(), EventFileError> {
    let refuse = |because: String| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        EventFileError::Container(format!("{name}: {because}"))
    };
    let file = files::open(path)?;
    let length = file.metadata()?.len();
    let array = NpyFile::new(BufReader::new(file)).map_err(|e| refuse(e.to_string()))?;
    let columns = match *array.shape() {
        [rows, columns] if columns >= 4 && rows.saturating_mul(columns).saturating_mul(8) <= length => {
            columns
        }
        _ => return Err(refuse(format!("shape {:?}, wanted [N, 4] as long as the file", array.shape()))),
    };
    if array.order() != Order::C {
        return Err(refuse("it is in Fortran order, wanted C order".to_owned()));
    }
    let values = array.data::<f64>().map_err(|e| refuse(e.to_string()))?;
    let mut row = Vec::new();
    for value in values {
        row.push(value?);
        if row.len() as u64 == columns {
            out.push(to_event(&row).ok_or_else(|| refuse(format!("an event of {row:?}")))?);
            row.clear();
        }
    }
    Ok(())
}

/// The event of a row; `None` if a number is out of range.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked, or within 64 bits")]
fn to_event(row: &[f64]) -> Option<Event> {
    let side = |v: f64| (0.0..65_536.0).contains(&v).then_some(v as u16);
    let polarity = match row[3] {
        p if p > 0.0 => Polarity::On,
        p if p <= 0.0 => Polarity::Off,
        _ => return None,
    };
    let t = row[2].is_finite().then_some(Timestamp(row[2] as i64))?;
    Some(Event { t, x: side(row[0])?, y: side(row[1])?, polarity, label: EventLabel::Signal })
}
