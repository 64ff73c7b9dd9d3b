//! The short forms of a sensor's `contrast`: one number, or a list of ON and OFF.

use crate::drawn::entries_of;
use crate::tree::{MappingEntry, NodeKind, TreeNode};

/// The key.
pub(super) const CONTRAST: &str = "contrast";

/// Writes the contrast of a sensor as a mapping. Other values than the short forms are left to the reader.
pub(crate) fn expand_contrast(sensor: &mut TreeNode) {
    let models = entries_of(sensor).iter_mut();
    let keys = models.flat_map(|model| entries_of(&mut model.value)).filter(|entry| entry.key == CONTRAST);
    for TreeNode { place, kind } in keys.map(|entry| &mut entry.value) {
        let [on, off] = match kind {
            NodeKind::Scalar { .. } => [
                TreeNode { place: *place, kind: kind.clone() },
                TreeNode { place: *place, kind: kind.clone() },
            ],
            NodeKind::List(items) => match items.as_slice() {
                [on, off] => [on.clone(), off.clone()],
                _ => continue,
            },
            _ => continue,
        };
        let side =
            |key: &str, value: TreeNode| MappingEntry { key: key.to_owned(), place: value.place, value };
        *kind = NodeKind::Map(vec![side("on", on), side("off", off)]);
    }
}
