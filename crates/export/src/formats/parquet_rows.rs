//! Parquet for Hugging Face `datasets`: one row per window.
//!
//! | column of `train.parquet` or `test.parquet` | content |
//! |---|---|
//! | `scene`, `trajectory` | names |
//! | `t0_us`, `t1_us` | start and end of the window, us |
//! | `t`, `x`, `y`, `p` | lists of events: uint32, us from `t0_us`; uint16; uint16; uint8, 1 for ON |
//! | `sharp` | the frame at the end of the window: bytes of a PNG |
//! | `description` | times, poses, camera matrix and thresholds, JSON |
//!
//! The key `huggingface` of the file's metadata names the types; without it, a loader shows bytes instead of
//! a picture. It counts for a column only if its types are equal to those of the file, so `sharp` and both of
//! its fields may be null, and are not.

use super::windows::{self, EventWindow};
use crate::{ExportError, ExportFolder, ExportFormat, ExportLoss, ExportPlan, UnmetNeed};
use parquet::basic::{Compression, Encoding, ZstdLevel};
use parquet::column::writer::ColumnWriter;
use parquet::data_type::ByteArray;
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use parquet::schema::types::ColumnPath;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::PathBuf;
use std::sync::Arc;

/// The layout for `datasets`.
pub(super) static FORMAT: ExportFormat =
    ExportFormat::new("parquet", "Hugging Face datasets 4", unmet, losses, write).for_any_lens();

/// Bytes of a row group: it is in memory as a whole, here and in loaders.
const GROUP_BYTES: usize = 32 << 20;
/// Bytes of an event in memory.
const EVENT_BYTES: usize = 9;

const SCHEMA: &str = "message windows {
    required binary scene (STRING);
    required binary trajectory (STRING);
    required int64 t0_us;
    required int64 t1_us;
    required group t (LIST) { repeated group list { required int32 element (INTEGER(32,false)); } }
    required group x (LIST) { repeated group list { required int32 element (INTEGER(16,false)); } }
    required group y (LIST) { repeated group list { required int32 element (INTEGER(16,false)); } }
    required group p (LIST) { repeated group list { required int32 element (INTEGER(8,false)); } }
    optional group sharp { optional binary bytes; optional binary path (STRING); }
    required binary description (STRING);
}";

fn unmet(plan: &ExportPlan<'_>) -> Vec<Option<UnmetNeed>> {
    windows::unmet(plan)
}

fn losses(_: &ExportPlan<'_>) -> Vec<ExportLoss> {
    windows::losses(false)
}

fn write(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<Value, ExportError> {
    let mut tables: BTreeMap<&str, RowFile> = BTreeMap::new();
    let counts = windows::for_each_window(plan, out, |window, out| {
        let split = window.split();
        if !tables.contains_key(split) {
            tables.insert(split, RowFile::create(out.file(&format!("{split}.parquet"))?)?);
        }
        let table = tables.get_mut(split).expect("it was inserted above");
        table.push(plan, window)
    })?;
    tables.into_values().try_for_each(RowFile::finish)?;
    Ok(json!({ "windows": counts.facts() }))
}

/// The types of the columns, as `datasets` writes them.
fn features() -> String {
    let value = |kind: &str| json!({ "dtype": kind, "_type": "Value" });
    let list = |kind: &str| json!({ "feature": value(kind), "_type": "List" });
    let features = json!({
        "scene": value("string"), "trajectory": value("string"), "t0_us": value("int64"), "t1_us": value("int64"),
        "t": list("uint32"), "x": list("uint16"), "y": list("uint16"), "p": list("uint8"),
        "sharp": { "_type": "Image" }, "description": value("string"),
    });
    json!({ "info": { "features": features } }).to_string()
}

/// A file, and the rows of its next group.
struct RowFile {
    path: PathBuf,
    file: SerializedFileWriter<File>,
    rows: RowGroup,
}

/// Rows by columns.
#[derive(Default)]
struct RowGroup {
    scene: Vec<ByteArray>,
    trajectory: Vec<ByteArray>,
    t0_us: Vec<i64>,
    t1_us: Vec<i64>,
    /// Number of events of each row.
    lengths: Vec<usize>,
    /// `t`, `x`, `y` and `p`. Unsigned numbers are stored as the signed ones of the same bits.
    events: [Vec<i32>; 4],
    sharp: Vec<ByteArray>,
    description: Vec<ByteArray>,
    bytes: usize,
}

impl RowFile {
    fn create(path: PathBuf) -> Result<Self, ExportError> {
        let file = File::create_new(&path).map_err(ExportError::unwritten(&path))?;
        // Times ascend, and pictures and texts do not repeat.
        let times = ColumnPath::from(vec!["t".to_owned(), "list".to_owned(), "element".to_owned()]);
        let properties = WriterProperties::builder()
            .set_created_by(concat!("gs2e ", env!("CARGO_PKG_VERSION")).to_owned())
            .set_compression(Compression::ZSTD(ZstdLevel::default()))
            .set_dictionary_enabled(false)
            .set_statistics_enabled(EnabledStatistics::None)
            .set_column_encoding(times, Encoding::DELTA_BINARY_PACKED)
            .set_key_value_metadata(Some(vec![KeyValue::new("huggingface".to_owned(), features())]))
            .build();
        let schema = parse_message_type(SCHEMA).expect("the schema is written above");
        let opened = SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties));
        let file = opened.map_err(|e| ExportError::unwritten(&path)(io::Error::other(e)))?;
        Ok(Self { path, file, rows: RowGroup::default() })
    }

    fn push(&mut self, plan: &ExportPlan<'_>, window: &EventWindow) -> Result<(), ExportError> {
        self.rows.push(plan, window)?;
        if self.rows.bytes >= GROUP_BYTES { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<(), ExportError> {
        let rows = std::mem::take(&mut self.rows);
        // The cause of a write that fails is in the library's error, without its kind.
        rows.write(&mut self.file).map_err(|e| ExportError::unwritten(&self.path)(io::Error::other(e)))
    }

    fn finish(mut self) -> Result<(), ExportError> {
        if !self.rows.lengths.is_empty() {
            self.flush()?;
        }
        let closed = self.file.close().map(drop);
        closed.map_err(|e| ExportError::unwritten(&self.path)(io::Error::other(e)))
    }
}

impl RowGroup {
    fn push(&mut self, plan: &ExportPlan<'_>, window: &EventWindow) -> Result<(), ExportError> {
        let [start, end] = window.span_us(plan);
        let picture = plan.subject.sharp_file(window.frames[1])?;
        let description = window.description(plan)?.to_string();
        self.bytes += picture.len() + description.len() + EVENT_BYTES * window.t.len();
        self.scene.push(plan.subject.scene.as_str().into());
        self.trajectory.push(plan.subject.trajectory.as_str().into());
        self.t0_us.push(start);
        self.t1_us.push(end);
        self.lengths.push(window.t.len());
        let [t, x, y, p] = &mut self.events;
        t.extend(window.t.iter().map(|t| t.cast_signed()));
        x.extend(window.x.iter().map(|x| i32::from(*x)));
        y.extend(window.y.iter().map(|y| i32::from(*y)));
        p.extend(window.p.iter().map(|p| i32::from(*p)));
        self.sharp.push(picture.into());
        self.description.push(description.as_str().into());
        Ok(())
    }

    fn write(&self, file: &mut SerializedFileWriter<File>) -> Result<(), ParquetError> {
        let mut group = file.next_row_group()?;
        // Levels of a list: an empty one has one entry of definition level 0; the first element of another
        // has repetition level 0, and the rest 1.
        let (mut defined, mut repeated) = (Vec::new(), Vec::new());
        for length in &self.lengths {
            defined.push(i16::from(*length > 0));
            repeated.push(0);
            let more = length.saturating_sub(1);
            defined.extend(std::iter::repeat_n(1, more));
            repeated.extend(std::iter::repeat_n(1, more));
        }
        // Of a picture's two fields, the bytes are there and the path is not.
        let [with_bytes, without_path] = [2, 1].map(|level| vec![level; self.lengths.len()]);
        let texts = |column: &mut ColumnWriter<'_>, values: &[ByteArray], defined: Option<&[i16]>| {
            let ColumnWriter::ByteArrayColumnWriter(column) = column else {
                unreachable!("the schema has bytes here")
            };
            column.write_batch(values, defined, None).map(drop)
        };
        let stamps = |column: &mut ColumnWriter<'_>, values: &[i64]| {
            let ColumnWriter::Int64ColumnWriter(column) = column else {
                unreachable!("the schema has int64 here")
            };
            column.write_batch(values, None, None).map(drop)
        };
        let mut number = 0;
        while let Some(mut column) = group.next_column()? {
            let of = column.untyped();
            match number {
                0 => texts(of, &self.scene, None)?,
                1 => texts(of, &self.trajectory, None)?,
                2 => stamps(of, &self.t0_us)?,
                3 => stamps(of, &self.t1_us)?,
                8 => texts(of, &self.sharp, Some(&with_bytes))?,
                9 => texts(of, &[], Some(&without_path))?,
                10 => texts(of, &self.description, None)?,
                list => {
                    let ColumnWriter::Int32ColumnWriter(column) = of else {
                        unreachable!("the schema has int32 here")
                    };
                    column.write_batch(&self.events[list - 4], Some(&defined), Some(&repeated))?;
                }
            }
            column.close()?;
            number += 1;
        }
        group.close().map(drop)
    }
}
