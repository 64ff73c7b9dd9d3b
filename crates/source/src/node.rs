//! Values of a JSON document with their place in it.

use super::{SourceError, SourcePlace};
use gs2e_files as files;
use gs2e_files::budget::check_json;
use serde_json::Value;
use std::path::Path;

/// Reads the document in a file.
pub(super) fn load_document(file: &Path) -> Result<Value, SourceError> {
    let text = files::read_text(file, files::MAX_DOCUMENT).map_err(SourceError::io_error(file))?;
    let fault = |line, because| SourceError::Content {
        path: file.to_owned(),
        place: SourcePlace::Line(line),
        because,
    };
    // The parsed form may take far more memory than the text, so the check comes first.
    check_json(text.as_bytes()).map_err(|e| fault(1, format!("a document that takes {e}")))?;
    serde_json::from_str(&text).map_err(|e| fault(e.line(), e.to_string()))
}

/// A value, its file and its name within the file.
pub(super) struct JsonNode<'a> {
    path: &'a Path,
    name: String,
    value: &'a Value,
}

impl<'a> JsonNode<'a> {
    pub(super) fn top_node(path: &'a Path, value: &'a Value) -> Self {
        Self { path, name: String::new(), value }
    }

    pub(super) fn path(&self) -> &'a Path {
        self.path
    }

    /// The root of the document has no name; its place is line 1.
    pub(super) fn place(&self) -> SourcePlace {
        if self.name.is_empty() { SourcePlace::Line(1) } else { SourcePlace::Field(self.name.clone()) }
    }

    pub(super) fn fault(&self, because: String) -> SourceError {
        SourceError::Content { path: self.path.to_owned(), place: self.place(), because }
    }

    /// Creates a fault for the value of `key`, present or not.
    pub(super) fn field_fault(&self, key: &str, because: String) -> SourceError {
        let place = SourcePlace::Field(self.name_of(key));
        SourceError::Content { path: self.path.to_owned(), place, because }
    }

    pub(super) fn missing(&self, key: &str, wanted: &str) -> SourceError {
        self.field_fault(key, format!("it is missing, wanted {wanted}"))
    }

    fn name_of(&self, key: &str) -> String {
        if self.name.is_empty() { key.to_owned() } else { format!("{}.{key}", self.name) }
    }

    /// Returns the value of `key`, if it is present and not null.
    pub(super) fn find(&self, key: &str) -> Option<JsonNode<'a>> {
        let value = self.value.get(key).filter(|v| !v.is_null())?;
        Some(JsonNode { path: self.path, name: self.name_of(key), value })
    }

    pub(super) fn get(&self, key: &str) -> Result<JsonNode<'a>, SourceError> {
        self.find(key).ok_or_else(|| self.missing(key, "a value"))
    }

    pub(super) fn list(&self, key: &str) -> Result<Vec<JsonNode<'a>>, SourceError> {
        self.get(key)?.elements()
    }

    pub(super) fn elements(&self) -> Result<Vec<JsonNode<'a>>, SourceError> {
        let Value::Array(values) = self.value else { return Err(self.other("a list")) };
        let node = |(i, value)| JsonNode { path: self.path, name: format!("{}[{i}]", self.name), value };
        Ok(values.iter().enumerate().map(node).collect())
    }

    pub(super) fn text(&self, key: &str) -> Result<&'a str, SourceError> {
        self.get(key)?.string()
    }

    pub(super) fn string(&self) -> Result<&'a str, SourceError> {
        self.value.as_str().filter(|s| !s.is_empty()).ok_or_else(|| self.other("a text"))
    }

    /// Reads a number. JSON numbers are finite.
    pub(super) fn number(&self) -> Result<f64, SourceError> {
        self.value.as_f64().ok_or_else(|| self.other("a number"))
    }

    /// Reads a side of an image. Some writers store floats.
    pub(super) fn side(&self) -> Result<u32, SourceError> {
        let side = self.number()?;
        let whole = (1.0..=f64::from(u32::MAX)).contains(&side) && side.fract() == 0.0;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole and in range")]
        if whole {
            Ok(side as u32)
        } else {
            Err(self.fault(format!("{side}, wanted a whole number of pixels")))
        }
    }

    /// Reads a list of `N` numbers.
    pub(super) fn numbers<const N: usize>(&self) -> Result<[f64; N], SourceError> {
        let elements = self.elements()?;
        let elements: [JsonNode<'a>; N] =
            elements.try_into().map_err(|_| self.other(&format!("{N} numbers")))?;
        let mut numbers = [0.0; N];
        for (element, out) in elements.iter().zip(&mut numbers) {
            *out = element.number()?;
        }
        Ok(numbers)
    }

    /// Reads a matrix of `ROWS` rows and `COLUMNS` columns.
    pub(super) fn matrix<const ROWS: usize, const COLUMNS: usize>(
        &self,
    ) -> Result<[[f64; COLUMNS]; ROWS], SourceError> {
        let rows = self.elements()?;
        let rows: [JsonNode<'a>; ROWS] =
            rows.try_into().map_err(|_| self.other(&format!("{ROWS} rows of {COLUMNS} numbers")))?;
        let mut matrix = [[0.0; COLUMNS]; ROWS];
        for (row, out) in rows.iter().zip(&mut matrix) {
            *out = row.numbers()?;
        }
        Ok(matrix)
    }

    /// Returns the values of a mapping in the order of their keys, with the keys as names.
    pub(super) fn members(&self) -> Result<Vec<JsonNode<'a>>, SourceError> {
        let Value::Object(values) = self.value else { return Err(self.other("a mapping")) };
        let node =
            |(key, value): (&String, &'a Value)| JsonNode { path: self.path, name: self.name_of(key), value };
        Ok(values.iter().map(node).collect())
    }

    fn other(&self, wanted: &str) -> SourceError {
        let mut found = self.value.to_string();
        // At a border of characters, because the value need not be ASCII.
        if let Some((end, _)) = found.char_indices().nth(40) {
            found.truncate(end);
            found.push_str("...");
        }
        self.fault(format!("{found}, wanted {wanted}"))
    }
}
