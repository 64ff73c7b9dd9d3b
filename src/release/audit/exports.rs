//! Exports: those that the manifest names are present, and each describes itself as what it is.

use super::{AuditFault, FaultCode, TrustedTree};
use crate::files::{self, LinkRule};
use crate::release::include::export_name;
use crate::release::manifest::ReleaseManifest;
use crate::release::scene::SceneRecord;
use serde_json::Value;

/// Name of the file that describes an export.
const DESCRIPTION: &str = "export.json";

/// The folders of a scene's exports, with the trajectory and the format of each.
pub(super) fn folders<'a>(
    manifest: &'a ReleaseManifest,
    scene: &'a SceneRecord,
) -> impl Iterator<Item = (String, &'a str, &'a str)> {
    let shown = scene.trajectories.iter().filter(|part| !scene.licence.withheld && part.cameras.is_empty());
    shown.flat_map(|part| {
        let covering = manifest.include.iter().filter(|entry| entry.covers(&part.name));
        covering.map(|entry| {
            let folder = export_name(&scene.id, &part.name, &entry.format);
            (folder + "/", part.name.as_str(), entry.format.as_str())
        })
    })
}

/// Returns faults of exports that are absent, incomplete, or of something else.
pub(super) fn audit(
    tree: &TrustedTree<'_>,
    manifest: &ReleaseManifest,
    scenes: &[SceneRecord],
) -> Vec<AuditFault> {
    let mut faults = Vec::new();
    for scene in scenes {
        for (folder, trajectory, format) in folders(manifest, scene) {
            let path = format!("{folder}{DESCRIPTION}");
            let read = |path: std::path::PathBuf| {
                files::read_with(&path, LinkRule::Refuse, files::MAX_DOCUMENT).ok()
            };
            let Some(bytes) = tree.intact_path(&path).and_then(read) else {
                let message = "the manifest includes this export; it is missing or damaged";
                faults.push(AuditFault::of_file(FaultCode::Missing, &path, message).in_scene(&scene.id));
                continue;
            };
            let found: Value = serde_json::from_slice(&bytes).unwrap_or_default();
            let files = tree.below(&folder).count();
            let claims = [
                ("format", &found["format"], Value::from(format)),
                ("scene", &found["selection"]["scene"], scene.id.as_str().into()),
                ("trajectory", &found["selection"]["trajectory"], trajectory.into()),
                ("number of files", &found["files"], files.into()),
            ];
            let wrong = claims.into_iter().filter(|(_, found, wanted)| *found != wanted);
            faults.extend(wrong.map(|(name, found, wanted)| {
                let message = format!("its {name} is {found}, wanted {wanted}");
                AuditFault::of_file(FaultCode::ClaimsDisagree, &path, message).in_scene(&scene.id)
            }));
        }
    }
    faults
}
