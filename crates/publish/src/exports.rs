//! The exports that a release includes, made once.

use super::ReleaseError;
use super::made_once::{FileInputs, digest_of_files};
use gs2e_recipe::IncludedExport;
use gs2e_release::composed::{FileContent, ReleaseTree};
use gs2e_release::include::{ComposedScene, ReleaseExporter, export_name};
use gs2e_release::scene::SceneRecord;
use gs2e_store::description::describe_value;
use gs2e_store::record::StoredOutput;
use gs2e_store::{Digest, Key, Store};
use serde::Serialize;
use std::sync::Arc;

/// Name of the stage in the records of exports.
const STAGE: &str = "export";
/// Name of the export's folder in a workspace.
const MADE: &str = "made";

/// The parameters in the key of an export.
#[derive(Serialize)]
struct ExportParameters<'a> {
    trajectory: &'a str,
    include: &'a IncludedExport,
    consumer: &'a str,
    // `export.json` states them.
    release: &'a str,
    version: &'a str,
    tool: &'a str,
}

/// Makes the exports of a release, or takes stored ones.
#[derive(Debug, Clone, Copy)]
pub(super) struct ReleaseExports<'a> {
    pub(super) include: &'a [IncludedExport],
    pub(super) exporter: &'a dyn ReleaseExporter,
    pub(super) store: &'a Store,
    /// Name and version of the release.
    pub(super) release: [&'a str; 2],
}

impl ReleaseExports<'_> {
    /// The files of a scene's exports, with the keys of their records. `files` are the scene's own
    /// files.
    pub(super) fn of_scene(
        &self,
        record: &SceneRecord,
        files: &ReleaseTree,
    ) -> Result<(ReleaseTree, Vec<Key>), ReleaseError> {
        let (mut tree, mut keys) = (ReleaseTree::default(), Vec::new());
        // Upstream forbids passing on anything that shows the scene.
        if self.include.is_empty() || record.licence.withheld {
            return Ok((tree, keys));
        }
        let inputs = digest_of_files(files);
        let scene = Arc::new(ComposedScene::new(self.release, record, files.listed()));
        for part in record.trajectories.iter().filter(|part| part.cameras.is_empty()) {
            for entry in self.include.iter().filter(|entry| entry.covers(&part.name)) {
                let (key, outputs) = self.outputs(&scene, &part.name, entry, inputs)?;
                keys.push(key);
                for output in &outputs {
                    let name = output.name.strip_prefix(MADE).unwrap_or(&output.name);
                    let at = export_name(&record.id, &part.name, &entry.format);
                    let StoredOutput { digest, size, .. } = *output;
                    let content = FileContent::Blob { path: self.store.path_of(&digest), digest, size };
                    tree.add(format!("{at}{name}"), content);
                }
            }
        }
        Ok((tree, keys))
    }

    /// The stored files of an export. They are made if they are not stored.
    fn outputs(
        &self,
        scene: &Arc<ComposedScene>,
        trajectory: &str,
        include: &IncludedExport,
        inputs: Digest,
    ) -> Result<(Key, Vec<StoredOutput>), ReleaseError> {
        let (revision, consumer) = self.exporter.identity(&include.format);
        let [release, version] = self.release;
        let parameters =
            ExportParameters { trajectory, include, consumer, release, version, tool: scene.tool };
        let made_of =
            FileInputs { stage: STAGE, revision, parameters: describe_value(&parameters), files: inputs };
        made_of.outputs(self.store, |folder| {
            // An export is written to a folder that must not exist yet, and the workspace exists.
            Ok(self.exporter.write(scene, trajectory, include, &folder.join(MADE))?)
        })
    }
}
