//! Whether the release is lawful, as far as it can be said from the tree (pipeline.md section 9).

use super::{Code, Fault, Tree};
use crate::licence::{Expression, SourceKind, is_metadata};
use crate::release::manifest::Manifest;
use crate::release::scene::SceneFile;
use std::collections::BTreeSet;

/// A scene's own terms, and what its source demands of them.
pub(super) fn scene(scene: &SceneFile, tree: &Tree<'_>) -> Vec<Fault> {
    let fault = |code, message: String| Fault::of_scene(code, &scene.id, message);
    let text = scene.licence.expression.trim();
    if text.is_empty() {
        return vec![fault(Code::LicenceMissing, "its scene.json has no licence expression".into())];
    }
    let expression = match Expression::parse(text) {
        Ok(expression) => expression,
        Err(e) => return vec![fault(Code::LicenceInvalid, e.to_string())],
    };
    let mut faults = photos(scene, tree);
    let Some(kind) = SourceKind::by_name(&scene.source.kind) else {
        let message = format!("its source is `{}`, which is none that is known", scene.source.kind);
        faults.push(fault(Code::LicenceInvalid, message));
        return faults;
    };
    for id in kind.upstream_ids().iter().filter(|id| !expression.demands(id)) {
        let message = format!("its source {} demands {id}, its terms are `{expression}`", kind.name());
        faults.push(fault(Code::LicenceForbidden, message));
    }
    if kind.restricted() {
        faults.extend(restricted(scene, kind, tree));
    }
    faults
}

/// Upstream photos are never passed on, whatever their name.
fn photos(scene: &SceneFile, tree: &Tree<'_>) -> Vec<Fault> {
    let photos: BTreeSet<&str> = scene.images.iter().filter_map(|image| image.sha256.as_deref()).collect();
    let found = tree.intact.iter().filter(|(_, sha256)| photos.contains(*sha256));
    let message = "it is a photo of the source, by its SHA-256";
    found.map(|(path, _)| Fault::of_file(Code::LicenceForbidden, path, message).in_scene(&scene.id)).collect()
}

/// What is derived from restricted material may be there where the releaser says why, and the scene is gated.
fn restricted(scene: &SceneFile, kind: SourceKind, tree: &Tree<'_>) -> Vec<Fault> {
    let mut faults = Vec::new();
    if !scene.licence.gated {
        let message = format!("its source {} must be gated, and it is not", kind.name());
        faults.push(Fault::of_scene(Code::LicenceForbidden, &scene.id, message));
    }
    let reason = scene.licence.redistribution.as_deref().unwrap_or_default();
    if !reason.trim().is_empty() && !scene.licence.withheld {
        return faults;
    }
    let folder = format!("{}/", scene.id);
    let derived = tree.intact.keys().filter(|path| path.starts_with(&folder) && !is_metadata(path));
    faults.extend(derived.map(|path| {
        let message =
            format!("it is derived from {}, and nothing says why this release may pass that on", kind.name());
        Fault::of_file(Code::LicenceForbidden, path, message).in_scene(&scene.id)
    }));
    faults
}

/// A text for every id in use, and none for another; and the whole release's terms are those of its scenes.
pub(super) fn texts(manifest: &Manifest, tree: &Tree<'_>) -> Vec<Fault> {
    let parsed = manifest.scenes.iter().filter_map(|scene| Expression::parse(&scene.licence).ok());
    let expressions: Vec<Expression> = parsed.collect();
    let used: BTreeSet<String> = expressions.iter().flat_map(Expression::ids).collect();
    let name = |path: &str| Some(path.strip_prefix("LICENSES/")?.strip_suffix(".txt")?.to_owned());
    let shipped: BTreeSet<String> = tree.intact.keys().filter_map(|path| name(path)).collect();
    let path = |id: &String| format!("LICENSES/{id}.txt");
    let mut faults = Vec::new();
    for id in used.difference(&shipped) {
        faults.push(Fault::of_file(
            Code::LicenceTextMissing,
            &path(id),
            "the licence is in use and has no text that is whole",
        ));
    }
    for id in shipped.difference(&used) {
        faults.push(Fault::of_file(Code::LicenceUnused, &path(id), "no scene is under this licence"));
    }
    if !expressions.is_empty() {
        let whole = Expression::all(expressions).to_string();
        if manifest.licence != whole {
            let message = format!("its licence is `{}`, the scenes' together is `{whole}`", manifest.licence);
            faults.push(Fault::of_file(Code::ClaimsDisagree, crate::release::manifest::NAME, message));
        }
    }
    faults
}

/// The card's head states the terms of the whole.
pub(super) fn card(tree: &Tree<'_>, manifest: &Manifest) -> Option<Fault> {
    const CARD: &str = "README.md";
    if !tree.has(CARD) {
        return None;
    }
    let text = std::fs::read_to_string(tree.path_of(CARD)).unwrap_or_default();
    let stated = text.lines().find_map(|line| line.strip_prefix("license_name: "));
    let stated = stated.and_then(|text| serde_json::from_str::<String>(text).ok());
    if stated.as_ref() == Some(&manifest.licence) {
        return None;
    }
    let stated = stated.unwrap_or_else(|| "nothing".into());
    let message = format!("its head says `{stated}`, the release is under `{}`", manifest.licence);
    Some(Fault::of_file(Code::CardLicence, CARD, message))
}
