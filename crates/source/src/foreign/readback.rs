//! Released files as other programs read them: events by h5py, their index by numpy, pictures by
//! OpenCV.

use super::{ForeignAnswer, ForeignError, TrajectoryPicture, python, versions};
use crate::reconstruct::ProgramWorkspace;
use gs2e_event::{Event, EventSource as _, h5};
use gs2e_files as files;
use gs2e_image::png;
use serde::{Deserialize, Serialize};
use serde_json::json;
use sha2::{Digest as _, Sha256};
use std::collections::BTreeMap;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// Results of reading a trajectory's files with other programs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReadbackReport {
    /// The programs, with their versions.
    pub program: String,
    /// The event streams, ordered by name.
    pub streams: Vec<StreamRead>,
    /// The pictures, or the reason why they were not read.
    pub pictures: ForeignAnswer<PicturesRead>,
}

/// Comparison of an event file as read by other programs and by this program.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StreamRead {
    /// Number of events, as read by this program.
    pub events: u64,
    /// Columns with different bytes or a different number of events.
    pub differing: Vec<String>,
    /// Number of entries of `ms_to_idx`.
    pub entries: u64,
    /// Number of entries that differ from numpy's computation by their definition.
    pub wrong_entries: u64,
}

/// Results of reading pictures with other programs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PicturesRead {
    /// Number of pictures.
    pub count: usize,
    /// Indices of poses whose pictures have different pixels.
    pub differing: Vec<usize>,
}

/// The answer of the script.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ReadbackAnswer {
    streams: Vec<ReadColumns>,
    pictures: Vec<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ReadColumns {
    count: u64,
    columns: BTreeMap<String, String>,
    entries: u64,
    wrong_entries: u64,
}

/// Lets other programs read event files and pictures.
///
/// # Errors
/// A file cannot be used or read by this program, Python fails, or the work was asked to stop.
pub fn read_back(
    streams: &[PathBuf],
    pictures: &[TrajectoryPicture],
    workspace: ProgramWorkspace<'_>,
) -> Result<ForeignAnswer<ReadbackReport>, ForeignError> {
    let mut program = match versions::having(&["h5py", "numpy"], workspace.programs) {
        Ok(program) => program,
        Err(because) => return Ok(Err(because)),
    };
    // Events are read back even if OpenCV is absent.
    let opencv = versions::having(&["cv2"], workspace.programs);
    let looks = match &opencv {
        Ok(opencv) if !pictures.is_empty() => {
            program = format!("{program}, {opencv}");
            pictures
        }
        _ => &[],
    };
    let whole = |file: &Path| std::path::absolute(file).map_err(ForeignError::io_error(file));
    let streams: Vec<PathBuf> = streams.iter().map(|file| whole(file)).collect::<Result<_, _>>()?;
    let files: Vec<PathBuf> = looks.iter().map(|picture| whole(&picture.file)).collect::<Result<_, _>>()?;
    let request = json!({ "streams": streams, "pictures": files });
    let answer: ReadbackAnswer = python::ask_script("readback", &request, workspace)?;
    let own: Vec<ColumnDigests> =
        streams.iter().map(|file| ColumnDigests::from_file(file, workspace)).collect::<Result<_, _>>()?;
    // The script answers in the order of the request.
    let streams = own.iter().zip(&answer.streams).map(|(own, found)| own.against(found)).collect();
    let mut differing = Vec::new();
    for (picture, found) in looks.iter().zip(&answer.pictures) {
        if pixel_hash(&picture.file)? != *found {
            differing.push(picture.pose);
        }
    }
    let pictures = match opencv {
        _ if pictures.is_empty() => Err("there are no pictures".to_owned()),
        Err(because) => Err(because),
        Ok(_) => Ok(PicturesRead { count: pictures.len(), differing }),
    };
    Ok(Ok(ReadbackReport { program, streams, pictures }))
}

/// An event file as this program reads it: SHA-256 of each column, times as 64 bits and the others
/// as 16, little-endian.
struct ColumnDigests {
    events: u64,
    columns: BTreeMap<&'static str, String>,
}

impl ColumnDigests {
    fn from_file(file: &Path, workspace: ProgramWorkspace<'_>) -> Result<Self, ForeignError> {
        let mut reader = h5::Reader::open(file).map_err(ForeignError::product_error(file))?;
        let names: &[&'static str] =
            if reader.labelled() { &["t", "x", "y", "p", "label"] } else { &["t", "x", "y", "p"] };
        let mut columns: BTreeMap<&'static str, Sha256> =
            names.iter().map(|name| (*name, Sha256::new())).collect();
        let (mut chunk, mut events) = (Vec::new(), 0);
        while reader.next_chunk(&mut chunk).map_err(ForeignError::product_error(file))? {
            if !(workspace.goes_on)() {
                return Err(ForeignError::Stopped);
            }
            events += chunk.len() as u64;
            for (name, column) in &mut columns {
                column.update(column_bytes(name, &chunk));
            }
        }
        let columns = columns.into_iter().map(|(name, column)| (name, hex_digest(column))).collect();
        Ok(Self { events, columns })
    }

    fn against(&self, found: &ReadColumns) -> StreamRead {
        let mut differing: Vec<String> = Vec::new();
        if self.events != found.count {
            differing.push("count".to_owned());
        }
        // A column that the other program lacks differs too.
        let other = |(name, digest): &(&&str, &String)| found.columns.get(**name) != Some(digest);
        differing.extend(self.columns.iter().filter(other).map(|(name, _)| (*name).to_owned()));
        let ReadColumns { entries, wrong_entries, .. } = *found;
        StreamRead { events: self.events, differing, entries, wrong_entries }
    }
}

fn column_bytes(column: &str, events: &[Event]) -> Vec<u8> {
    let narrow = |value: fn(&Event) -> u16| events.iter().flat_map(|e| value(e).to_le_bytes()).collect();
    match column {
        // Released stamps are whole microseconds.
        "t" => events.iter().flat_map(|e| e.t.floor_micros().to_le_bytes()).collect(),
        "x" => narrow(|e| e.x),
        "y" => narrow(|e| e.y),
        "p" => narrow(|e| e.polarity as u16),
        _ => narrow(|e| e.label as u16),
    }
}

/// Returns the SHA-256 of a picture's pixels.
fn pixel_hash(file: &Path) -> Result<String, ForeignError> {
    let opened = files::open(file).map_err(ForeignError::io_error(file))?;
    let picture = png::read_rgb(BufReader::new(opened)).map_err(ForeignError::product_error(file))?;
    let mut hash = Sha256::new();
    hash.update(picture.pixels().as_flattened());
    Ok(hex_digest(hash))
}

fn hex_digest(hash: Sha256) -> String {
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}
