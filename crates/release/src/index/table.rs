//! Small tables as Parquet (parquet.apache.org, format 2): nullable columns, one row group, plain
//! values, compressed by zstd. No time of writing is included, so equal tables are equal bytes.

use gs2e_files as files;
use gs2e_files::LinkRule;
use gs2e_files::budget::{ByteBudget, OverBudget};
use parquet::basic::{Compression, Type as Physical, ZstdLevel};
use parquet::column::writer::ColumnWriter;
use parquet::data_type::ByteArray;
use parquet::errors::ParquetError;
use parquet::file::metadata::ParquetMetaData;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::file::writer::SerializedFileWriter;
use parquet::record::Field;
use parquet::schema::parser::parse_message_type;
use std::fmt;
use std::fs::File;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;

/// Type of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColumnKind {
    /// UTF-8.
    Text,
    /// 64-bit signed integer.
    Whole,
    /// 64-bit floating-point number.
    Number,
    /// True or false.
    Flag,
}

/// A cell.
#[derive(Debug, Clone, PartialEq)]
pub enum CellValue {
    /// Nothing.
    Null,
    /// Text.
    Text(String),
    /// A whole number.
    Whole(i64),
    /// A number.
    Number(f64),
    /// True or false.
    Flag(bool),
}

impl fmt::Display for CellValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Null => f.write_str("nothing"),
            Self::Text(text) => write!(f, "`{text}`"),
            Self::Whole(value) => write!(f, "{value}"),
            Self::Number(value) => write!(f, "{value}"),
            Self::Flag(value) => write!(f, "{value}"),
        }
    }
}

impl From<&str> for CellValue {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for CellValue {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl From<i64> for CellValue {
    fn from(value: i64) -> Self {
        Self::Whole(value)
    }
}

impl From<u64> for CellValue {
    /// Counts never reach 2^63.
    fn from(value: u64) -> Self {
        i64::try_from(value).map_or(Self::Null, Self::Whole)
    }
}

impl From<f64> for CellValue {
    fn from(value: f64) -> Self {
        Self::Number(value)
    }
}

impl From<bool> for CellValue {
    fn from(value: bool) -> Self {
        Self::Flag(value)
    }
}

impl<T: Into<Self>> From<Option<T>> for CellValue {
    fn from(value: Option<T>) -> Self {
        value.map_or(Self::Null, Into::into)
    }
}

/// A table read from a file.
#[derive(Debug)]
pub struct IndexTable {
    /// Name and kind of each column; no kind for a type that this program never writes.
    pub columns: Vec<(String, Option<ColumnKind>)>,
    /// Rows, with one cell per column.
    pub rows: Vec<Vec<CellValue>>,
}

/// Composes a file with these rows. Each row has one cell per column, of its kind or null.
pub(crate) fn write_table(columns: &[(&str, ColumnKind)], rows: &[Vec<CellValue>], writer: &str) -> Vec<u8> {
    encode_table(columns, rows, writer).expect("a Vec takes any bytes, and cells are of their columns' kinds")
}

fn encode_table(
    columns: &[(&str, ColumnKind)],
    rows: &[Vec<CellValue>],
    writer: &str,
) -> Result<Vec<u8>, ParquetError> {
    let field = |(name, kind): &(&str, ColumnKind)| match kind {
        ColumnKind::Text => format!("optional binary {name} (STRING);"),
        ColumnKind::Whole => format!("optional int64 {name};"),
        ColumnKind::Number => format!("optional double {name};"),
        ColumnKind::Flag => format!("optional boolean {name};"),
    };
    let fields: String = columns.iter().map(field).collect();
    let schema = parse_message_type(&format!("message rows {{ {fields} }}"))?;
    let properties = WriterProperties::builder()
        // The library would write its own version, and an update of it would change the bytes.
        .set_created_by(writer.to_owned())
        .set_compression(Compression::ZSTD(ZstdLevel::default()))
        .set_dictionary_enabled(false)
        .set_statistics_enabled(EnabledStatistics::Chunk)
        // One row group, however many rows: the library splits at a number of its own.
        .set_max_row_group_row_count(Some(rows.len().max(1)))
        .build();
    let mut file = SerializedFileWriter::new(Vec::new(), Arc::new(schema), Arc::new(properties))?;
    let mut group = file.next_row_group()?;
    for i in 0..columns.len() {
        let mut column = group.next_column()?.expect("the schema has as many columns");
        let cells: Vec<&CellValue> = rows.iter().map(|row| &row[i]).collect();
        write_column(column.untyped(), &cells)?;
        column.close()?;
    }
    group.close()?;
    file.into_inner()
}

fn write_column(column: &mut ColumnWriter<'_>, cells: &[&CellValue]) -> Result<(), ParquetError> {
    // Definition levels: 1 for a value, 0 for null. The values themselves follow without gaps.
    let present: Vec<i16> = cells.iter().map(|cell| i16::from(**cell != CellValue::Null)).collect();
    let present = Some(present.as_slice());
    match column {
        ColumnWriter::ByteArrayColumnWriter(column) => {
            let text = |cell: &&CellValue| match cell {
                CellValue::Text(text) => Some(ByteArray::from(text.as_str())),
                _ => None,
            };
            let values: Vec<ByteArray> = cells.iter().filter_map(text).collect();
            column.write_batch(&values, present, None)?;
        }
        ColumnWriter::Int64ColumnWriter(column) => {
            let whole =
                |cell: &&CellValue| if let CellValue::Whole(value) = cell { Some(*value) } else { None };
            let values: Vec<i64> = cells.iter().filter_map(whole).collect();
            column.write_batch(&values, present, None)?;
        }
        ColumnWriter::DoubleColumnWriter(column) => {
            let number =
                |cell: &&CellValue| if let CellValue::Number(value) = cell { Some(*value) } else { None };
            let values: Vec<f64> = cells.iter().filter_map(number).collect();
            column.write_batch(&values, present, None)?;
        }
        ColumnWriter::BoolColumnWriter(column) => {
            let flag =
                |cell: &&CellValue| if let CellValue::Flag(value) = cell { Some(*value) } else { None };
            let values: Vec<bool> = cells.iter().filter_map(flag).collect();
            column.write_batch(&values, present, None)?;
        }
        _ => unreachable!("the schema has columns of the four kinds"),
    }
    Ok(())
}

/// Reads a file.
///
/// # Errors
/// It cannot be read, or is not Parquet.
pub fn read_table(path: &Path) -> Result<IndexTable, ParquetError> {
    // The library panics on some damaged files instead of returning an error. No state outlives the
    // call.
    let read = AssertUnwindSafe(|| decode_table(files::open_with(path, LinkRule::Refuse)?));
    let damaged = |_| Err(ParquetError::General("it is damaged and cannot be decoded".into()));
    catch_unwind(read).unwrap_or_else(damaged)
}

fn decode_table(file: File) -> Result<IndexTable, ParquetError> {
    let mut budget = ByteBudget::of_file(file.metadata()?.len());
    let reader = SerializedFileReader::new(file)?;
    let schema = reader.metadata().file_metadata().schema_descr();
    let kind = |physical| match physical {
        Physical::BYTE_ARRAY => Some(ColumnKind::Text),
        Physical::INT64 => Some(ColumnKind::Whole),
        Physical::DOUBLE => Some(ColumnKind::Number),
        Physical::BOOLEAN => Some(ColumnKind::Flag),
        _ => None,
    };
    let columns = schema.columns().iter();
    let columns = columns.map(|column| (column.path().string(), kind(column.physical_type())));
    let columns: Vec<(String, Option<ColumnKind>)> = columns.collect();
    claim(reader.metadata(), columns.len(), &mut budget)?;
    let mut rows = Vec::new();
    let mut text = 0;
    for row in reader.get_row_iter(None)? {
        let cells: Vec<CellValue> =
            row?.into_columns().into_iter().map(|(_, field)| column_cell(field)).collect();
        // One long text in a dictionary can be used by many cells.
        text += cells.iter().map(text_bytes).sum::<usize>();
        budget.check(text, 1).map_err(over)?;
        rows.push(cells);
    }
    Ok(IndexTable { columns, rows })
}

/// Bytes of a cell outside the row.
fn text_bytes(cell: &CellValue) -> usize {
    if let CellValue::Text(text) = cell { text.capacity() } else { 0 }
}

fn over(error: OverBudget) -> ParquetError {
    ParquetError::General(format!("its cells would need {error}"))
}

/// Compares the rows and pages that a file claims to have with its bytes, and takes their memory
/// from the budget.
fn claim(metadata: &ParquetMetaData, columns: usize, budget: &mut ByteBudget) -> Result<(), ParquetError> {
    let negative = |_| ParquetError::General("it states a negative size".to_owned());
    for group in metadata.row_groups() {
        let rows = usize::try_from(group.num_rows()).map_err(negative)?;
        // The memory of the rows as they are read below.
        budget.take(rows, columns * size_of::<CellValue>() + size_of::<Vec<CellValue>>()).map_err(over)?;
        // Only the pages of one group at a time are in memory.
        let pages = group.columns().iter().map(|column| usize::try_from(column.uncompressed_size()));
        let pages = pages.sum::<Result<usize, _>>().map_err(negative)?;
        budget.check(pages, 1).map_err(over)?;
    }
    Ok(())
}

fn column_cell(field: Field) -> CellValue {
    match field {
        Field::Null => CellValue::Null,
        Field::Str(text) => CellValue::Text(text),
        Field::Long(value) => CellValue::Whole(value),
        Field::Double(value) => CellValue::Number(value),
        Field::Bool(value) => CellValue::Flag(value),
        // A type that is never written here must not equal a cell that is.
        other => CellValue::Text(format!("{other:?}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_written_is_read() {
        let columns = [
            ("name", ColumnKind::Text),
            ("count", ColumnKind::Whole),
            ("rate", ColumnKind::Number),
            ("good", ColumnKind::Flag),
        ];
        let rows = vec![
            vec!["a/ü".into(), CellValue::Whole(i64::MAX), CellValue::Number(-0.1), CellValue::Flag(true)],
            vec![CellValue::Null, CellValue::Null, CellValue::Null, CellValue::Null],
            vec![
                "".into(),
                CellValue::Whole(-1),
                CellValue::Number(f64::MIN_POSITIVE),
                CellValue::Flag(false),
            ],
        ];
        let bytes = write_table(&columns, &rows, "a test");
        assert_eq!(bytes, write_table(&columns, &rows, "a test"));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rows.parquet");
        std::fs::write(&path, &bytes).unwrap();
        let table = read_table(&path).unwrap();
        assert_eq!(table.rows, rows);
        let wanted: Vec<(String, Option<ColumnKind>)> =
            columns.iter().map(|(name, kind)| ((*name).to_owned(), Some(*kind))).collect();
        assert_eq!(table.columns, wanted);
        std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
        read_table(&path).unwrap_err();
    }

    #[test]
    fn a_damaged_file_stops_nobody() {
        let columns = [("name", ColumnKind::Text), ("count", ColumnKind::Whole)];
        let rows = [vec![CellValue::Null, CellValue::Whole(3)], vec!["b".into(), CellValue::Null]];
        let bytes = write_table(&columns, &rows, "a test");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rows.parquet");
        let mut refused = 0;
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 1 << (at % 8);
            std::fs::write(&path, damaged).unwrap();
            refused += usize::from(read_table(&path).is_err());
        }
        assert!(refused > 0);
    }
}
