//! The embedded scene `still-life`: a scene and a capture of it that need no download.

use serde::{Deserialize, Serialize};

/// Parameters of the still life.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StillLife {
    /// Number of Gaussians, 100 to 10,000,000.
    pub gaussians: u32,
    /// Number of key views, 2 to 10,000.
    pub views: u32,
    /// Extent of the capture's arc in degrees, above 0 to 360.
    pub arc: f64,
    /// Seed of the scene and of the capture's unevenness.
    pub seed: u64,
}

impl Default for StillLife {
    fn default() -> Self {
        Self { gaussians: 20_000, views: 30, arc: 20.0, seed: 1 }
    }
}
