//! Faults of files that contradict each other or their formats. Every file is taken as it is: sums
//! are not read.

use super::{
    AuditFault, FaultCode, TrustedTree, bytes, claims, contents, names, published, sorted_faults, steps, top,
    walk,
};
use gs2e_release::layout;
use gs2e_release::manifest::{FileOwners, ReleaseManifest};
use gs2e_release::scene::SceneRecord;
use std::collections::BTreeSet;
use std::io;
use std::path::Path;

/// Returns the contradictions in the scenes of a release that are `wanted`, sorted. The files at
/// the top, which describe all scenes, are compared if all of them are. The pictures in `as_written` are
/// not read.
///
/// # Errors
/// The folder cannot be listed.
pub(crate) fn find_contradictions(
    dir: &Path,
    manifest: &ReleaseManifest,
    wanted: &dyn Fn(&str) -> bool,
    as_written: &BTreeSet<String>,
) -> io::Result<Vec<AuditFault>> {
    let owners = &FileOwners::new(manifest);
    let mut files = walk::walk_tree(dir)?.files;
    let whole = manifest.scenes.iter().all(|scene| wanted(&scene.id));
    files.retain(|path| owners.of(path).is_none_or(|scene| wanted(&scene.id)));
    let hashes = bytes::hash_files(dir, &files);
    let intact =
        hashes.iter().filter_map(|(path, hashes)| Some((path.as_str(), hashes.as_ref()?.sha256.as_str())));
    let tree = &TrustedTree { dir, intact: intact.collect(), composed: as_written };
    let (mut faults, mut scenes) = (Vec::new(), Vec::new());
    for listed in manifest.scenes.iter().filter(|scene| wanted(&scene.id)) {
        let path = format!("{}/{}", listed.id, layout::SCENE);
        if let Some(scene) = claims::parse_claims::<SceneRecord>(tree, &path, &mut faults) {
            faults.extend(claims::audit_scene(manifest, listed, &scene));
            faults.extend(contents::audit_scene(tree, &scene));
            faults.extend(steps::audit(manifest, listed, &scene));
            scenes.push(scene);
        }
    }
    let published = published(tree, manifest, &scenes, &mut faults);
    if whole {
        faults.extend(names::missing_files(tree));
        faults.extend(top(tree, manifest, &scenes, published.as_deref(), &faults));
    }
    faults.retain(|fault| is_contradiction(fault.code));
    Ok(sorted_faults(faults.into_iter().map(|fault| fault.placed(owners)).collect()))
}

/// Returns true for faults that two files show together, or one by its format. Terms and stray
/// files concern the audit alone; failed checks are judged again.
fn is_contradiction(code: FaultCode) -> bool {
    matches!(
        code,
        FaultCode::Missing
            | FaultCode::ClaimsDisagree
            | FaultCode::VersionDisagrees
            | FaultCode::SplitLeak
            | FaultCode::CroissantField
            | FaultCode::CroissantSum
            | FaultCode::CroissantFiles
            | FaultCode::CroissantReference
            | FaultCode::CroissantColumn
            | FaultCode::NotComposed
            | FaultCode::StepDisagrees
            | FaultCode::SceneIncomplete
            | FaultCode::Unreadable
    )
}
