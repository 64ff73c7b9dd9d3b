//! Whether a release holds what is to be passed on no longer.

use super::{AuditFault, FaultCode};
use crate::licence::ledger;
use crate::recipe::TakedownList;
use crate::release::manifest::ManifestScene;
use crate::release::scene::SceneRecord;

/// A scene that is there and is on the list: by its id, also where its own description cannot be read, and by what its
/// upstream calls it. What is listed is not repeated in the message: the list may be nobody else's business.
pub(super) fn takedown_fault(
    list: &TakedownList,
    listed: &ManifestScene,
    scene: Option<&SceneRecord>,
) -> Option<AuditFault> {
    let upstream_id = scene.and_then(|scene| scene.source.upstream_id.as_deref());
    let url = scene.and_then(|scene| scene.source.upstream_url.as_deref());
    let own = scene.map_or(listed.source.as_str(), |scene| scene.source.kind.as_str());
    let since = [own, ledger::find_origin(own, url), &listed.source]
        .into_iter()
        .find_map(|kind| list.since(&listed.id, kind, upstream_id));
    let message = format!("it is on the takedown list since {}", since?);
    Some(AuditFault::of_scene(FaultCode::Takedown, &listed.id, message))
}
