//! E2VID (Rebecq et al., CVPR 2019; GitHub uzh-rpg/rpg_e2vid at d0a7c00).
//!
//! | file | content |
//! |---|---|
//! | `events.txt`, or `events.zip` with that file alone | `W H`, then a line `t x y p` per event; t in s, p 0 or 1 |
//! | `images/NNNNNN.png`, `images/timestamps.txt` | sharp frames, and their stamps in s, for comparison |
//!
//! Times have six decimals, which are exact.

use super::camera_needs::{products, unmet_events};
use super::marks::frame_lines;
use crate::npy::entry_options;
use crate::plan::seconds_text;
use crate::{ExportError, ExportFolder, ExportFormat, ExportLoss, ExportPlan, UnmetNeed};
use serde_json::{Value, json};
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use zip::{CompressionMethod, ZipWriter};

/// The layout with a text.
pub(super) static TEXT: ExportFormat = ExportFormat::new("e2vid", CONSUMER, unmet, losses, |plan, out| {
    let path = out.file(TEXT_FILE)?;
    let events = write_text(plan, &path, out)?;
    write_images(plan, TEXT_FILE, events, out)
})
.for_any_lens();

/// The layout with a zip archive.
pub(super) static ZIP: ExportFormat = ExportFormat::new("e2vid-zip", CONSUMER, unmet, losses, |plan, out| {
    let path = out.file(ARCHIVE)?;
    let events = write_archive(plan, &path, out)?;
    write_images(plan, ARCHIVE, events, out)
})
.for_any_lens();

const CONSUMER: &str = "github.com/uzh-rpg/rpg_e2vid at d0a7c00";

/// Name of the text, which an archive has too.
const TEXT_FILE: &str = "events.txt";
const ARCHIVE: &str = "events.zip";

fn unmet(plan: &ExportPlan<'_>) -> Vec<Option<UnmetNeed>> {
    vec![unmet_events(plan)]
}

fn losses(_: &ExportPlan<'_>) -> Vec<ExportLoss> {
    vec![
        products(&["blur", "depth", "flow", "labels of events"]),
        ExportLoss::lost("poses", "poses, camera matrix and thresholds"),
    ]
}

fn write_text(plan: &ExportPlan<'_>, path: &Path, out: &mut ExportFolder<'_>) -> Result<u64, ExportError> {
    let mut file = BufWriter::new(File::create_new(path).map_err(ExportError::unwritten(path))?);
    let events = write_lines(plan, &mut file, path, out)?;
    file.flush().map_err(ExportError::unwritten(path))?;
    Ok(events)
}

fn write_archive(plan: &ExportPlan<'_>, path: &Path, out: &mut ExportFolder<'_>) -> Result<u64, ExportError> {
    let failed = |e: io::Error| ExportError::unwritten(path)(e);
    let mut archive = ZipWriter::new(BufWriter::new(File::create_new(path).map_err(failed)?));
    let options = entry_options(CompressionMethod::Deflated).large_file(true);
    archive.start_file(TEXT_FILE, options).map_err(|e| failed(e.into()))?;
    // The archive takes long writes only at its full speed.
    let mut text = BufWriter::with_capacity(1 << 16, archive);
    let events = write_lines(plan, &mut text, path, out)?;
    let archive = text.into_inner().map_err(|e| failed(e.into_error()))?;
    archive.finish().map_err(|e| failed(e.into()))?.flush().map_err(failed)?;
    Ok(events)
}

/// Writes the size of the sensor and a line per event to the file at `path`.
fn write_lines(
    plan: &ExportPlan<'_>,
    to: &mut impl Write,
    path: &Path,
    out: &mut ExportFolder<'_>,
) -> Result<u64, ExportError> {
    let size = plan.subject.camera.size;
    writeln!(to, "{} {}", size.width, size.height).map_err(ExportError::unwritten(path))?;
    let mut events = 0;
    plan.for_each_event(|event, t_us| {
        events += 1;
        out.count_event()?;
        let p = event.polarity as u8;
        let (seconds, micros) = (t_us / 1_000_000, t_us % 1_000_000);
        let written = writeln!(to, "{seconds}.{micros:06} {} {} {p}", event.x, event.y);
        written.map_err(ExportError::unwritten(path))
    })?;
    Ok(events)
}

/// Writes the sharp frames. Returns facts on them and on the file `name` of this number of events.
fn write_images(
    plan: &ExportPlan<'_>,
    name: &str,
    events: u64,
    out: &mut ExportFolder<'_>,
) -> Result<Value, ExportError> {
    out.write_frames("images", plan.subject, &plan.frames)?;
    if !plan.frames.is_empty() {
        let stamps = frame_lines(plan, seconds_text);
        out.write_file("images/timestamps.txt", stamps.as_bytes())?;
    }
    Ok(json!({
        "events": events, "frames": plan.frames.len(),
        "command": format!("python run_reconstruction.py -i {name} --fixed_duration"),
    }))
}
