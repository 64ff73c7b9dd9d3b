//! Whether a release holds what is to be passed on no longer.

use super::{Code, Fault};
use crate::licence::ledger;
use crate::recipe::Takedown;
use crate::release::manifest::ManifestScene;
use crate::release::scene::SceneFile;

/// A scene that is there and is on the list: by its id, also where its own description cannot be read, and by what its
/// upstream calls it. What is listed is not repeated in the message: the list may be nobody else's business.
pub(super) fn takedown_fault(
    list: &Takedown,
    listed: &ManifestScene,
    scene: Option<&SceneFile>,
) -> Option<Fault> {
    let upstream_id = scene.and_then(|scene| scene.source.upstream_id.as_deref());
    let url = scene.and_then(|scene| scene.source.upstream_url.as_deref());
    let own = scene.map_or(listed.source.as_str(), |scene| scene.source.kind.as_str());
    let since = [own, ledger::find_origin(own, url), &listed.source]
        .into_iter()
        .find_map(|kind| list.since(&listed.id, kind, upstream_id));
    let message = format!("it is on the takedown list since {}", since?);
    Some(Fault::of_scene(Code::Takedown, &listed.id, message))
}
