//! Exports in a release: `<scene>/<trajectory>/exports/<format>/`.
//!
//! The formats are in the room of exports, which comes after this one, so a release is given a
//! [`ReleaseExporter`]. An export is stored like the outputs of a step: its key holds the export's
//! options and the digests of the scene's files. A release with the same key takes the stored files,
//! and every other change of the scene makes the export anew.

use super::layout;
use super::manifest::ReleaseManifest;
use super::scene::SceneRecord;
use gs2e_recipe::{IncludedExport, Recipe};
use gs2e_tree::{ListedFile, ListedFiles};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Makes the exports of a release.
pub trait ReleaseExporter: std::fmt::Debug + Sync {
    /// Everything that decides the bytes of an export of this format, except for its options and
    /// the release: the revision of the formats, and the program whose loader was read.
    fn identity(&self, format: &str) -> (u32, &'static str);

    /// Refuses an export that no build of the recipe can have.
    ///
    /// # Errors
    /// The trajectory lacks a product that the format needs, or the camera has another size.
    fn foresee(
        &self,
        recipe: &Recipe,
        trajectory: &str,
        include: &IncludedExport,
    ) -> Result<(), IncludeRefusal>;

    /// Writes the export of a trajectory to the new folder `to`.
    ///
    /// # Errors
    /// A need is unmet, a loss is not accepted, reading or writing fails, or the user stopped it.
    fn write(
        &self,
        scene: &Arc<ComposedScene>,
        trajectory: &str,
        include: &IncludedExport,
        to: &Path,
    ) -> Result<(), IncludeRefusal>;

    /// Writes the export of a released scene once more, to the new folder `to`, unless `is_over` becomes
    /// true.
    ///
    /// # Errors
    /// As [`ReleaseExporter::write`]; [`IncludeFailure::Interrupted`] if `is_over` became true.
    fn rewrite(
        &self,
        order: ExportOrder<'_>,
        to: &Path,
        is_over: &(dyn Fn() -> bool + Sync),
    ) -> Result<(), IncludeRefusal>;
}

/// An export of a trajectory.
#[derive(Debug, Clone, Copy)]
pub struct ExportOrder<'a> {
    /// The scene.
    pub scene: &'a Arc<ComposedScene>,
    /// Name of the trajectory.
    pub trajectory: &'a str,
    /// The format and its options.
    pub include: &'a IncludedExport,
}

/// The reason why an export of a release cannot be made.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{export}: {because}")]
pub struct IncludeRefusal {
    /// Scene, trajectory and format.
    pub export: String,
    /// The reason.
    pub because: String,
    /// One line per unmet need, with its remedy, or per loss.
    pub details: Vec<String>,
    /// The kind of the failure.
    pub kind: IncludeFailure,
}

/// Kind of a failure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum IncludeFailure {
    /// The recipes or `release.yaml` have to change.
    Refused,
    /// Reading failed.
    Failed,
    /// The export could not be written.
    Unwritten,
    /// The user stopped it.
    Interrupted,
}

/// The name of an export in messages.
#[must_use]
pub fn export_name(scene: &str, trajectory: &str, format: &str) -> String {
    format!("{scene}/{trajectory}/{}{format}", layout::EXPORTS)
}

/// Refuses exports that no build of these recipes can have.
///
/// # Errors
/// A format has an unmet need, or an entry names a trajectory that no recipe has.
pub fn foresee_exports(
    recipes: &[Recipe],
    include: &[IncludedExport],
    exporter: &dyn ReleaseExporter,
) -> Result<(), IncludeRefusal> {
    let refused = |export: String, because: String| IncludeRefusal {
        export,
        because,
        details: Vec::new(),
        kind: IncludeFailure::Refused,
    };
    for entry in include {
        let mut covered = 0;
        for recipe in recipes {
            // `croissant.json` excludes exports by the name of their folder.
            let names = recipe.trajectories.iter().map(|path| path.name.as_str());
            if recipe.scene.split('/').chain(names).any(|part| format!("{part}/") == layout::EXPORTS) {
                let because = "found a scene id or a trajectory with the name `exports`, wanted another name: exports have this folder";
                return Err(refused(recipe.scene.clone(), because.to_owned()));
            }
            // The body of a rig sees nothing that a method could read.
            let seeing = recipe.trajectories.iter().filter(|path| !recipe.is_of_body(&path.name));
            for trajectory in seeing.filter(|path| entry.covers(&path.name)) {
                covered += 1;
                exporter.foresee(recipe, &trajectory.name, entry)?;
            }
        }
        if covered == 0 && !recipes.is_empty() {
            let named = entry.trajectory.as_deref().unwrap_or("no other than test_from");
            let names = recipes.iter().flat_map(|recipe| &recipe.trajectories).map(|path| path.name.as_str());
            let names: std::collections::BTreeSet<&str> = names.collect();
            let names: Vec<&str> = names.into_iter().take(12).collect();
            let because = format!("found the trajectory `{named}`, wanted one of: {}", names.join(", "));
            return Err(refused(format!("include of {}", entry.format), because));
        }
    }
    Ok(())
}

/// A scene of a release that is not written yet.
#[derive(Debug)]
pub struct ComposedScene {
    /// Name of the release.
    pub release: String,
    /// Version of the release.
    pub version: String,
    /// The program.
    pub tool: &'static str,
    /// Content of `scene.json`.
    pub record: SceneRecord,
    /// Its files, by their paths in the release.
    pub files: Arc<ListedFiles>,
}

impl ComposedScene {
    /// A scene of a release with this name and version, with its files by their paths in the release.
    pub fn new(
        [release, version]: [&str; 2],
        record: &SceneRecord,
        files: BTreeMap<String, ListedFile>,
    ) -> Self {
        let [release, version] = [release, version].map(str::to_owned);
        let files = Arc::new(ListedFiles(files));
        Self { release, version, tool: super::TOOL, record: record.clone(), files }
    }

    /// A scene of a written release, with the places of its files by their paths in the release.
    pub fn released(
        manifest: &ReleaseManifest,
        record: &SceneRecord,
        files: BTreeMap<String, PathBuf>,
    ) -> Self {
        let files = files.into_iter().map(|(path, place)| (path, ListedFile::Stored(place))).collect();
        Self::new([&manifest.name, &manifest.version], record, files)
    }
}
