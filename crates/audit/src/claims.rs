//! Comparison of the tree's own descriptions with each other.

use super::{AuditFault, FaultCode, TrustedTree, recompose};
use gs2e_files as files;
use gs2e_files::budget;
use gs2e_release::manifest::{ManifestScene, ReleaseManifest};
use gs2e_release::scene::{SceneConventions, SceneRecord};
use gs2e_release::{checksum, layout};
use gs2e_tree::ReleaseFiles as _;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Reads a JSON file of a known form, if it is intact. Unknown keys are faults, and so is any
/// spelling other than the one that the program writes.
pub(super) fn parse_claims<T: DeserializeOwned + Serialize>(
    tree: &TrustedTree<'_>,
    path: &str,
    faults: &mut Vec<AuditFault>,
) -> Option<T> {
    let value: T = read(tree, path, faults)?;
    faults.extend(recompose::spelling(tree, path, &value));
    Some(value)
}

/// Reads a JSON file of a known form, if it is intact.
fn read<T: DeserializeOwned>(tree: &TrustedTree<'_>, path: &str, faults: &mut Vec<AuditFault>) -> Option<T> {
    if !tree.has(path) {
        return None;
    }
    let parsed = match tree.read(path, files::MAX_DOCUMENT) {
        // The other files have a few values for each of their bytes at most.
        Ok(bytes)
            if path.ends_with(layout::SCENE)
                && let Err(e) = budget::check_json(&bytes) =>
        {
            Err(e.to_string())
        }
        Ok(bytes) => {
            serde_json::from_slice(&bytes).map_err(|e| format!("it does not have the expected form: {e}"))
        }
        Err(e) => Err(e.to_string()),
    };
    parsed.map_err(|message| faults.push(AuditFault::of_file(FaultCode::Unreadable, path, message))).ok()
}

/// Compares `scene.json` with the manifest and with the recipe that it contains.
pub(super) fn audit_scene(
    manifest: &ReleaseManifest,
    listed: &ManifestScene,
    scene: &SceneRecord,
) -> Vec<AuditFault> {
    let mut claims = FileClaims { path: format!("{}/scene.json", listed.id), faults: Vec::new() };
    claims.equal("id", &scene.id, "manifest.json", &listed.id);
    claims.equal("source", &scene.source.kind, "manifest.json", &listed.source);
    claims.equal("licence", &scene.licence.expression, "manifest.json", &listed.licence);
    claims.equal("schema", &scene.schema.to_string(), "this program", "1");
    let recipe = scene.recipe.get("scene").and_then(serde_json::Value::as_str).unwrap_or("missing");
    claims.equal("id", &scene.id, "its recipe", recipe);
    let seed = scene.recipe.get("seed").map_or("missing".into(), ToString::to_string);
    claims.equal("seed", &scene.seed.to_string(), "its recipe", &seed);
    // The sum is of the compact form, not of the indented text in the file.
    let compact = serde_json::to_vec(&scene.recipe).expect("a JSON value is writable");
    claims.equal("recipe_sha256", &scene.recipe_sha256, "its recipe", &checksum::sha256_hex(&compact));
    if scene.conventions != SceneConventions::for_brightness(&scene.recipe) {
        let message = "its conventions differ from those of the release format and its recipe".into();
        claims.fault(FaultCode::ClaimsDisagree, message);
    }
    let tool = format!("gs2e {}", scene.gs2e_version);
    if tool != manifest.tool {
        let message = format!("it was written by {tool}, manifest.json by {}", manifest.tool);
        claims.fault(FaultCode::VersionDisagrees, message);
    }
    claims.faults
}

struct FileClaims {
    path: String,
    faults: Vec<AuditFault>,
}

impl FileClaims {
    fn fault(&mut self, code: FaultCode, message: String) {
        self.faults.push(AuditFault::of_file(code, &self.path, message));
    }

    fn equal(&mut self, key: &str, found: &str, other: &str, wanted: &str) {
        if found != wanted {
            self.fault(FaultCode::ClaimsDisagree, format!("its {key} is `{found}`, {other} says `{wanted}`"));
        }
    }
}
