//! Checks that scenes are in the splits that the release's own rule gives, and that splits share
//! nothing.

use super::{AuditFault, FaultCode};
use gs2e_release::manifest::ReleaseManifest;
use gs2e_release::scene::{SceneRecord, SplitPart};
use gs2e_release::{manifest, split};

/// Reports scenes in a wrong split, and things that splits share. `scenes` are those that could be
/// read.
pub(super) fn audit_splits(manifest: &ReleaseManifest, scenes: &[SceneRecord]) -> Vec<AuditFault> {
    let rule = manifest.splits.as_ref();
    if let Some(because) = rule.and_then(|rule| rule.fault()) {
        let message = format!("its splits are not valid: {because}");
        return vec![AuditFault::of_file(FaultCode::SplitLeak, manifest::NAME, message)];
    }
    let mut faults = Vec::new();
    for scene in scenes {
        let wanted = rule.map(|rule| split::split_part(scene, rule));
        if scene.split != wanted {
            let name_of = |part: &Option<SplitPart>| match part {
                Some(part) => format!("in `{}`, group `{}`", part.name, part.group),
                None => "in no split".to_owned(),
            };
            let (found, wanted) = (name_of(&scene.split), name_of(&wanted));
            let message = format!("it is listed {found}; the rule of {} puts it {wanted}", manifest::NAME);
            faults.push(AuditFault::of_scene(FaultCode::SplitLeak, &scene.id, message));
        }
    }
    // The rule keeps groups together; splits can still share a photo or the Gaussians.
    let leaks = split::find_leaks(scenes);
    faults.extend(
        leaks
            .iter()
            .map(|leak| AuditFault::of_scene(FaultCode::SplitLeak, &leak.scenes[0].0, leak.to_string())),
    );
    faults
}
