//! Events against frames: what the pixels counted is what the frames changed.

use super::limits;
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; what is absent has its default.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Largest relative difference of the fitted threshold from the stated one.
    #[serde(deserialize_with = "limits::share", skip_serializing_if = "Option::is_none")]
    pub tolerance: Option<f64>,
    /// Smallest share of pixels whose residual is below 1.5 thresholds.
    #[serde(deserialize_with = "limits::share", skip_serializing_if = "Option::is_none")]
    pub residual: Option<f64>,
    /// Smallest share of pixels whose events and frames agree in sign.
    #[serde(deserialize_with = "limits::share", skip_serializing_if = "Option::is_none")]
    pub sign: Option<f64>,
}
