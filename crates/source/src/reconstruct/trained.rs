//! Checks of a trained scene.

use crate::{SourceError, model};
use gs2e_files::is_there;
use gs2e_scene as scene;
use gs2e_scene::{Gaussians, SceneError};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Maximum share of Gaussians with a NaN or an infinity. They are dropped; a diverged training has
/// more.
const MAX_NON_FINITE: f64 = 0.01;

/// Accepted number of Gaussians of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct GaussianCount {
    /// Minimum, if stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub min: Option<u64>,
    /// Maximum, if stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max: Option<u64>,
}

impl GaussianCount {
    /// Returns true if there is no limit.
    #[must_use]
    pub(super) fn is_any(&self) -> bool {
        *self == Self::default()
    }

    fn holds(self, count: u64) -> bool {
        self.min.is_none_or(|min| count >= min) && self.max.is_none_or(|max| count <= max)
    }
}

/// The reason why the result of a trainer cannot be used.
#[derive(Debug, thiserror::Error)]
pub(super) enum TrainedError {
    #[error("it wrote no scene: {} does not exist", .0.display())]
    Absent(PathBuf),
    #[error("it wrote no scene: {0}")]
    NotFound(SourceError),
    #[error("its output is not a scene: failed to {0}")]
    Unreadable(SceneError),
    #[error("its output is not a sound scene: {non_finite} of {read} Gaussians hold a NaN or an infinity")]
    NonFinite { read: u64, non_finite: u64 },
    #[error("it made {found} Gaussians, wanted {}", wanted_count(.limits))]
    Count { found: u64, limits: GaussianCount },
}

fn wanted_count(limits: &GaussianCount) -> String {
    let min = limits.min.map(|min| format!("at least {min}"));
    let max = limits.max.map(|max| format!("at most {max}"));
    [min, max].into_iter().flatten().collect::<Vec<_>>().join(" and ")
}

/// Reads the scene that a trainer left in `out`.
pub(super) fn read_trained(
    out: &Path,
    scene: Option<&str>,
    limits: GaussianCount,
) -> Result<Gaussians, TrainedError> {
    let file = match scene {
        Some(below) => out.join(below),
        None => model::newest_scene(out).map_err(TrainedError::NotFound)?,
    };
    if !is_there(&file) {
        // The path as the recipe has it, because `out` is a working folder.
        return Err(TrainedError::Absent(scene.unwrap_or_default().into()));
    }
    let gaussians = scene::read_file(&file).map_err(TrainedError::Unreadable)?;
    let scene::SceneScreening { read, non_finite, .. } = gaussians.screening;
    if non_finite as f64 > MAX_NON_FINITE * read as f64 {
        return Err(TrainedError::NonFinite { read, non_finite });
    }
    let found = gaussians.len() as u64;
    if limits.holds(found) { Ok(gaussians) } else { Err(TrainedError::Count { found, limits }) }
}
