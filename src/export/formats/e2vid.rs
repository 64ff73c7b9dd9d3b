//! E2VID (Rebecq et al., CVPR 2019; GitHub uzh-rpg/rpg_e2vid at d0a7c00).
//!
//! | file | content |
//! |---|---|
//! | `events.txt`, or `events.zip` with that file alone | `W H`, then a line `t x y p` per event; t in s, p 0 or 1 |
//! | `images/NNNNNN.png`, `images/timestamps.txt` | sharp frames, and their stamps in s, for comparison |
//!
//! Times have six decimals, which are exact.

use super::camera_needs::{products, unmet_events};
use crate::event::Polarity;
use crate::export::plan::seconds_text;
use crate::export::{ExportError, ExportFolder, ExportFormat, ExportLoss, ExportPlan, UnmetNeed};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

/// The layout of E2VID as a text.
#[derive(Debug)]
pub(super) struct E2Vid;

/// The layout of E2VID as a zip archive.
#[derive(Debug)]
pub(super) struct E2VidZip;

const CONSUMER: &str = "github.com/uzh-rpg/rpg_e2vid at d0a7c00";

impl ExportFormat for E2Vid {
    fn name(&self) -> &'static str {
        "e2vid"
    }

    fn consumer(&self) -> &'static str {
        CONSUMER
    }

    fn unmet(&self, plan: &ExportPlan<'_>) -> Vec<UnmetNeed> {
        unmet_events(plan).into_iter().collect()
    }

    fn losses(&self, _: &ExportPlan<'_>) -> Vec<ExportLoss> {
        losses()
    }

    fn write(&self, plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<Value, ExportError> {
        let path = out.file("events.txt")?;
        let file = File::create_new(&path).map_err(ExportError::unwritten(&path))?;
        let mut file = BufWriter::new(file);
        let events = write_lines(plan, (&path, &mut file), out)?;
        file.flush().map_err(ExportError::unwritten(&path))?;
        write_images(plan, out)?;
        Ok(facts(events, plan, "events.txt"))
    }
}

impl ExportFormat for E2VidZip {
    fn name(&self) -> &'static str {
        "e2vid-zip"
    }

    fn consumer(&self) -> &'static str {
        CONSUMER
    }

    fn unmet(&self, plan: &ExportPlan<'_>) -> Vec<UnmetNeed> {
        unmet_events(plan).into_iter().collect()
    }

    fn losses(&self, _: &ExportPlan<'_>) -> Vec<ExportLoss> {
        losses()
    }

    fn write(&self, plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<Value, ExportError> {
        let path = out.file("events.zip")?;
        let failed = |e: io::Error| ExportError::unwritten(&path)(e);
        let mut archive = ZipWriter::new(BufWriter::new(File::create_new(&path).map_err(failed)?));
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Deflated)
            .last_modified_time(DateTime::DEFAULT)
            .unix_permissions(0o644)
            .large_file(true);
        archive.start_file("events.txt", options).map_err(|e| failed(e.into()))?;
        // The archive takes long writes only at its full speed.
        let mut text = BufWriter::with_capacity(1 << 16, archive);
        let events = write_lines(plan, (&path, &mut text), out)?;
        let archive = text.into_inner().map_err(|e| failed(e.into_error()))?;
        archive.finish().map_err(|e| failed(e.into()))?.flush().map_err(failed)?;
        write_images(plan, out)?;
        Ok(facts(events, plan, "events.zip"))
    }
}

fn losses() -> Vec<ExportLoss> {
    vec![
        products(&["blur", "depth", "flow", "labels of events"]),
        ExportLoss::lost("poses", "poses, camera matrix and thresholds"),
    ]
}

fn facts(events: u64, plan: &ExportPlan<'_>, file: &str) -> Value {
    json!({
        "events": events, "frames": plan.frames.len(),
        "command": format!("python run_reconstruction.py -i {file} --fixed_duration"),
    })
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
