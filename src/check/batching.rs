//! Event times that cling to frames.

use super::limits;
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; what is absent has its default.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Fewest distinct event times per frame.
    #[serde(deserialize_with = "limits::positive", skip_serializing_if = "Option::is_none")]
    pub unique_per_frame: Option<f64>,
    /// Largest coefficient of variation of event counts over the phase of the frame interval.
    #[serde(deserialize_with = "limits::positive", skip_serializing_if = "Option::is_none")]
    pub phase_cv: Option<f64>,
}
