//! E2VID (Rebecq et al., CVPR 2019; GitHub uzh-rpg/rpg_e2vid at d0a7c00).
//!
//! | file | content |
//! |---|---|
//! | `events.txt`, or `events.zip` with that file alone | `W H`, then a line `t x y p` per event; t in s, p 0 or 1 |
//! | `images/NNNNNN.png`, `images/timestamps.txt` | sharp frames, and their stamps in s, for comparison |
//!
//! Times have six decimals, which are exact.

use super::camera_needs::{products, unmet_events};
use crate::plan::seconds_text;
use crate::{ExportError, ExportFolder, ExportFormat, ExportLoss, ExportPlan, UnmetNeed};
use gs2e_event::Polarity;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

/// The layout of E2VID.
#[derive(Debug)]
pub(super) struct E2Vid(EventContainer);

/// The layout with a text.
pub(super) static TEXT: E2Vid = E2Vid(EventContainer::Text);

/// The layout with a zip archive.
pub(super) static ZIP: E2Vid = E2Vid(EventContainer::Zip);

/// The file of the events.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum EventContainer {
    Text,
    Zip,
}

impl EventContainer {
    fn file_name(self) -> &'static str {
        match self {
            Self::Text => TEXT_FILE,
            Self::Zip => "events.zip",
        }
    }
}

/// Name of the text, which an archive has too.
const TEXT_FILE: &str = "events.txt";

impl ExportFormat for E2Vid {
    fn name(&self) -> &'static str {
        match self.0 {
            EventContainer::Text => "e2vid",
            EventContainer::Zip => "e2vid-zip",
        }
    }

    fn consumer(&self) -> &'static str {
        "github.com/uzh-rpg/rpg_e2vid at d0a7c00"
    }

    fn takes_lens(&self) -> bool {
        true
    }

    fn unmet(&self, plan: &ExportPlan<'_>) -> Vec<UnmetNeed> {
        unmet_events(plan).into_iter().collect()
    }

    fn losses(&self, _: &ExportPlan<'_>) -> Vec<ExportLoss> {
        vec![
            products(&["blur", "depth", "flow", "labels of events"]),
            ExportLoss::lost("poses", "poses, camera matrix and thresholds"),
        ]
    }

    fn write(&self, plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<Value, ExportError> {
        let name = self.0.file_name();
        let path = out.file(name)?;
        let events = match self.0 {
            EventContainer::Text => write_text(plan, &path, out)?,
            EventContainer::Zip => write_archive(plan, &path, out)?,
        };
        write_images(plan, out)?;
        Ok(json!({
            "events": events, "frames": plan.frames.len(),
            "command": format!("python run_reconstruction.py -i {name} --fixed_duration"),
        }))
    }
}

fn write_text(plan: &ExportPlan<'_>, path: &Path, out: &mut ExportFolder<'_>) -> Result<u64, ExportError> {
    let mut file = BufWriter::new(File::create_new(path).map_err(ExportError::unwritten(path))?);
    let events = write_lines(plan, (path, &mut file), out)?;
    file.flush().map_err(ExportError::unwritten(path))?;
    Ok(events)
}

fn write_archive(plan: &ExportPlan<'_>, path: &Path, out: &mut ExportFolder<'_>) -> Result<u64, ExportError> {
    let failed = |e: io::Error| ExportError::unwritten(path)(e);
    let mut archive = ZipWriter::new(BufWriter::new(File::create_new(path).map_err(failed)?));
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Deflated)
        .last_modified_time(DateTime::DEFAULT)
        .unix_permissions(0o644)
        .large_file(true);
    archive.start_file(TEXT_FILE, options).map_err(|e| failed(e.into()))?;
    // The archive takes long writes only at its full speed.
    let mut text = BufWriter::with_capacity(1 << 16, archive);
    let events = write_lines(plan, (path, &mut text), out)?;
    let archive = text.into_inner().map_err(|e| failed(e.into_error()))?;
    archive.finish().map_err(|e| failed(e.into()))?.flush().map_err(failed)?;
    Ok(events)
}

/// Writes the size of the sensor and a line per event.
fn write_lines(
    plan: &ExportPlan<'_>,
    (path, to): (&Path, &mut impl Write),
    out: &mut ExportFolder<'_>,
) -> Result<u64, ExportError> {
    let size = plan.subject.camera.size;
    writeln!(to, "{} {}", size.width, size.height).map_err(ExportError::unwritten(path))?;
    let mut events = 0;
    plan.for_each_event(|event, t_us| {
        events += 1;
        out.count_event()?;
        let p = u8::from(event.polarity == Polarity::On);
        let (seconds, micros) = (t_us / 1_000_000, t_us % 1_000_000);
        let written = writeln!(to, "{seconds}.{micros:06} {} {} {p}", event.x, event.y);
        written.map_err(ExportError::unwritten(path))
    })?;
    Ok(events)
}

fn write_images(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<(), ExportError> {
    let mut stamps = String::new();
    for (index, frame) in plan.frames.iter().enumerate() {
        out.write_file(&format!("images/{index:06}.png"), &plan.subject.sharp_file(*frame)?)?;
        writeln!(stamps, "{}", seconds_text(plan.stamp_us(*frame))).expect("a String takes any text");
        out.report()?;
    }
    if stamps.is_empty() { Ok(()) } else { out.write_file("images/timestamps.txt", stamps.as_bytes()) }
}
