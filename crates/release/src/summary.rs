//! Counts of a release tree, as its own files state them. The audit decides if they are true.

use super::checksum;
use super::manifest::{ManifestFile, NAME, ReleaseManifest};
use super::scene::{SceneRecord, TrajectoryPart};
use gs2e_files as files;
use gs2e_tree::{TreeError, read_manifest, read_scene};
use serde::Serialize;
use std::path::Path;

/// Counts of a release.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ReleaseSummary {
    /// Name of the release.
    pub name: String,
    /// Version of the release.
    pub version: String,
    /// Program and version that wrote it.
    pub tool: String,
    /// SPDX expression of the whole.
    pub licence: String,
    /// Number of scenes.
    pub scenes: usize,
    /// Number of trajectories.
    pub trajectories: usize,
    /// Number of events in all streams.
    pub events: u64,
    /// Number of files that the manifest lists.
    pub files: usize,
    /// Their bytes.
    pub bytes: u64,
    /// True if the tree has a file of checksums.
    pub checksums: bool,
}

/// Returns true if the folder has the manifest of a release.
#[must_use]
pub fn is_release(dir: &Path) -> bool {
    dir.is_dir() && files::is_there(&dir.join(NAME))
}

impl ReleaseSummary {
    /// Summarizes the release in a folder. Only `manifest.json` and each `scene.json` are read.
    ///
    /// # Errors
    /// The folder is not a release, or one of these files cannot be read.
    pub fn read(dir: &Path) -> Result<Self, TreeError> {
        let manifest: ReleaseManifest = read_manifest(dir)?;
        let mut found = Self {
            scenes: manifest.scenes.len(),
            trajectories: 0,
            events: 0,
            files: 0,
            bytes: 0,
            checksums: files::is_there(&dir.join(checksum::NAME)),
            name: manifest.name.clone(),
            version: manifest.version.clone(),
            tool: manifest.tool.clone(),
            licence: manifest.licence.clone(),
        };
        for scene in &manifest.scenes {
            let SceneRecord { trajectories, .. } = read_scene(dir, &scene.id)?;
            found.trajectories += trajectories.len();
            // Numbers of a foreign release may be wrong, and must not overflow.
            found.events = trajectories.iter().map(event_count).fold(found.events, u64::saturating_add);
        }
        let all: Vec<&ManifestFile> =
            manifest.scenes.iter().flat_map(|scene| &scene.files).chain(&manifest.files).collect();
        found.files = all.len();
        found.bytes = all.iter().map(|file| file.size).fold(0, u64::saturating_add);
        Ok(found)
    }
}

fn event_count(part: &TrajectoryPart) -> u64 {
    let several = part.sensors.values().map(|sensor| sensor.statistics.events);
    several.chain([part.statistics.events]).flatten().fold(0, u64::saturating_add)
}
