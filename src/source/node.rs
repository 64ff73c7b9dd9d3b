//! Values of a JSON document that know their place in it.

use super::{Place, SourceError};
use serde_json::Value;
use std::path::Path;

/// A value, its file and its name within the file.
pub(super) struct Node<'a> {
    path: &'a Path,
    name: String,
    value: &'a Value,
}

impl<'a> Node<'a> {
    pub(super) fn top(path: &'a Path, value: &'a Value) -> Self {
        Self { path, name: String::new(), value }
    }

    pub(super) fn path(&self) -> &'a Path {
        self.path
    }

    pub(super) fn place(&self) -> Place {
        Place::Field(self.name.clone())
    }

    pub(super) fn fault(&self, because: String) -> SourceError {
        SourceError::Content { path: self.path.to_owned(), place: self.place(), because }
    }

    /// A fault of the value of `key`, wherever it is.
    pub(super) fn field_fault(&self, key: &str, because: String) -> SourceError {
        let place = Place::Field(self.name_of(key));
        SourceError::Content { path: self.path.to_owned(), place, because }
    }

    pub(super) fn missing(&self, key: &str, wanted: &str) -> SourceError {
        self.field_fault(key, format!("it is missing, wanted {wanted}"))
    }

    fn name_of(&self, key: &str) -> String {
        if self.name.is_empty() { key.to_owned() } else { format!("{}.{key}", self.name) }
    }

    /// The value of `key`, if it is there and not null.
    pub(super) fn find(&self, key: &str) -> Option<Node<'a>> {
        let value = self.value.get(key).filter(|v| !v.is_null())?;
        Some(Node { path: self.path, name: self.name_of(key), value })
    }

    pub(super) fn get(&self, key: &str) -> Result<Node<'a>, SourceError> {
        self.find(key).ok_or_else(|| self.missing(key, "a value"))
    }

    pub(super) fn list(&self, key: &str) -> Result<Vec<Node<'a>>, SourceError> {
        self.get(key)?.elements()
    }

    fn elements(&self) -> Result<Vec<Node<'a>>, SourceError> {
        let Value::Array(values) = self.value else { return Err(self.other("a list")) };
        let node = |(i, value)| Node { path: self.path, name: format!("{}[{i}]", self.name), value };
        Ok(values.iter().enumerate().map(node).collect())
    }

    pub(super) fn text(&self, key: &str) -> Result<&'a str, SourceError> {
        self.get(key)?.string()
    }

    pub(super) fn string(&self) -> Result<&'a str, SourceError> {
        self.value.as_str().filter(|s| !s.is_empty()).ok_or_else(|| self.other("a text"))
    }

    /// A number, finite as all of JSON's are.
    pub(super) fn number(&self) -> Result<f64, SourceError> {
        self.value.as_f64().ok_or_else(|| self.other("a number"))
    }

    /// Four rows of four numbers.
    pub(super) fn matrix(&self) -> Result<[[f64; 4]; 4], SourceError> {
        let rows = self.elements()?;
        let rows: [Node<'a>; 4] = rows.try_into().map_err(|_| self.other("4 rows of 4 numbers"))?;
        let mut matrix = [[0.0; 4]; 4];
        for (row, out) in rows.iter().zip(&mut matrix) {
            let numbers = row.elements()?;
            let numbers: [Node<'a>; 4] = numbers.try_into().map_err(|_| row.other("4 numbers"))?;
            for (number, out) in numbers.iter().zip(out) {
                *out = number.number()?;
            }
        }
        Ok(matrix)
    }

    fn other(&self, wanted: &str) -> SourceError {
        let mut found = self.value.to_string();
        if let Some((end, _)) = found.char_indices().nth(40) {
            found.truncate(end);
            found.push_str("...");
        }
        self.fault(format!("{found}, wanted {wanted}"))
    }
}
