//! WebDataset (GitHub webdataset/webdataset at e0953f9), also read by Hugging Face `datasets`.
//!
//! | member of `train-NNNNNN.tar` or `test-NNNNNN.tar` | content |
//! |---|---|
//! | `KEY.json` | times, poses, camera matrix and thresholds of a window |
//! | `KEY.events.npz` | `t` uint32, us from the first frame; `x`, `y` uint16; `p` uint8, 1 for ON |
//! | `KEY.sharp.png` | the frame at the end of the window |
//! | `KEY.depth.npy` | float32 (H, W), depth at that frame; if all frames have it |
//!
//! Traps of its loaders: a key ends at the first dot of a name; the members of a sample are neighbours; all
//! samples have members of the same kinds.

use super::windows::{self, EventWindow};
use crate::{ExportError, ExportFolder, ExportFormat, ExportLoss, ExportPlan, UnmetNeed, npy};
use gs2e_tree::PictureKind;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::PathBuf;
use tar::{Builder, EntryType, Header};

/// The layout of WebDataset.
pub(super) static FORMAT: ExportFormat =
    ExportFormat::new("webdataset", "github.com/webdataset/webdataset at e0953f9", unmet, losses, write)
        .for_any_lens();

/// Bytes after which an archive is complete: loaders read whole archives in parallel.
const ARCHIVE_BYTES: u64 = 256 << 20;

fn unmet(plan: &ExportPlan<'_>) -> Vec<Option<UnmetNeed>> {
    windows::unmet(plan)
}

fn losses(plan: &ExportPlan<'_>) -> Vec<ExportLoss> {
    windows::losses(has_depth(plan))
}

fn write(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<Value, ExportError> {
    let mut sets: BTreeMap<&str, TarSet> = BTreeMap::new();
    let depth = has_depth(plan);
    let counts = windows::for_each_window(plan, out, |window, out| {
        let set = sets.entry(window.split()).or_default();
        let archive = set.archive(window.split(), out)?;
        members(plan, window, depth)?.iter().try_for_each(|(name, bytes)| archive.add(name, bytes))
    })?;
    sets.into_values().try_for_each(TarSet::finish)?;
    Ok(json!({ "windows": counts.facts(), "depth": depth }))
}

/// Returns true if every frame has depth.
fn has_depth(plan: &ExportPlan<'_>) -> bool {
    plan.frames.iter().all(|pose| plan.subject.depth.binary_search(pose).is_ok())
}

fn members(
    plan: &ExportPlan<'_>,
    window: &EventWindow,
    depth: bool,
) -> Result<Vec<(String, Vec<u8>)>, ExportError> {
    // A dot would end the key.
    let place = format!("{}-{}", plan.subject.scene, plan.subject.trajectory).replace(['.', '/'], "-");
    let named = |end: &str| format!("{place}-{:06}.{end}", window.number);
    let length = [window.t.len() as u64];
    let bytes = |values: &[u16]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    let times: Vec<u8> = window.t.iter().flat_map(|t| t.to_le_bytes()).collect();
    let events = npy::compressed_archive(&[
        ("t", npy::array("<u4", &length, &times)),
        ("x", npy::array("<u2", &length, &bytes(&window.x))),
        ("y", npy::array("<u2", &length, &bytes(&window.y))),
        ("p", npy::array("|u1", &length, &window.p)),
    ]);
    let description = serde_json::to_vec(&window.description(plan)?).expect("a JSON value can be written");
    let mut members = vec![
        (named("json"), description),
        (named("events.npz"), events),
        (named("sharp.png"), plan.subject.sharp_file(window.frames[1])?),
    ];
    if depth {
        members.push((named("depth.npy"), plan.subject.tree.picture(PictureKind::Depth, window.frames[1])?));
    }
    Ok(members)
}

/// The archives of one set.
#[derive(Default)]
struct TarSet {
    archives: usize,
    open: Option<TarFile>,
}

impl TarSet {
    /// The archive for the next sample.
    fn archive(&mut self, split: &str, out: &mut ExportFolder<'_>) -> Result<&mut TarFile, ExportError> {
        if self.open.as_ref().is_some_and(|archive| archive.bytes >= ARCHIVE_BYTES) {
            self.open.take().map_or(Ok(()), TarFile::finish)?;
        }
        if self.open.is_none() {
            self.open = Some(TarFile::create(out.file(&format!("{split}-{:06}.tar", self.archives))?)?);
            self.archives += 1;
        }
        Ok(self.open.as_mut().expect("it was opened above"))
    }

    fn finish(self) -> Result<(), ExportError> {
        self.open.map_or(Ok(()), TarFile::finish)
    }
}

struct TarFile {
    path: PathBuf,
    archive: Builder<BufWriter<File>>,
    bytes: u64,
}

impl TarFile {
    fn create(path: PathBuf) -> Result<Self, ExportError> {
        let file = File::create_new(&path).map_err(ExportError::unwritten(&path))?;
        Ok(Self { path, archive: Builder::new(BufWriter::new(file)), bytes: 0 })
    }

    /// Adds a file without owner and date, so that equal data are equal bytes.
    fn add(&mut self, name: &str, bytes: &[u8]) -> Result<(), ExportError> {
        let mut header = Header::new_ustar();
        header.set_entry_type(EntryType::Regular);
        header.set_mode(0o644);
        header.set_uid(0);
        header.set_gid(0);
        header.set_mtime(0);
        header.set_size(bytes.len() as u64);
        self.bytes += bytes.len() as u64;
        self.archive.append_data(&mut header, name, bytes).map_err(ExportError::unwritten(&self.path))
    }

    fn finish(self) -> Result<(), ExportError> {
        let Self { path, archive, .. } = self;
        archive.into_inner().and_then(|mut file| file.flush()).map_err(ExportError::unwritten(&path))
    }
}
