//! Checks that a release holds no scene that must no longer be passed on.

use super::{AuditFault, FaultCode};
use gs2e_recipe::TakedownList;
use gs2e_release::manifest::ManifestScene;
use gs2e_release::scene::SceneRecord;
use gs2e_source::kind::SourceKind;
use gs2e_source::licence::ledger;

/// Reports a scene that is on the list. It is found by its id, even if its own description cannot
/// be read, and by the name that its upstream gives it. The message does not repeat the entry,
/// because the list may be confidential.
pub(super) fn takedown_fault(
    list: &TakedownList,
    listed: &ManifestScene,
    scene: Option<&SceneRecord>,
) -> Option<AuditFault> {
    let upstream_id = scene.and_then(|scene| scene.source.upstream_id.as_deref());
    let url = scene.and_then(|scene| scene.source.upstream_url.as_deref());
    let own = scene.map_or(listed.source.as_str(), |scene| scene.source.kind.as_str());
    // A list can name the dataset where the scene names the reader of its files.
    let origin = SourceKind::by_name(own).map_or(own, |kind| ledger::find_origin(kind, url).name());
    let since =
        [own, origin, &listed.source].into_iter().find_map(|kind| list.since(&listed.id, kind, upstream_id));
    let message = format!("it has been on the takedown list since {}", since?);
    Some(AuditFault::of_scene(FaultCode::Takedown, &listed.id, message))
}
