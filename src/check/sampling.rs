//! Movement between rendered frames.

use super::limits;
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; what is absent has its default.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Largest 95 % quantile of the optical flow, px per frame.
    #[serde(deserialize_with = "limits::positive", skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
}
