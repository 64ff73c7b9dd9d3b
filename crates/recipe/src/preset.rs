//! Named groups of settings.

use super::tree::{NodeKind, TreeNode};

/// The key that names a group.
const KEY: &str = "preset";

/// The settings of the paper (GS2E, arXiv 2505.15287): sections 3.5.1 and 3.5.2, appendices A and C.
pub(super) const PAPER: &str = "\
trajectories:
  - name: base
    refine: { window: 2, factor: 5, curve: cubic }
    speed: { function: \"0.25*sin(t) + 1.1\" }
  - name: mini
    novel: { groups: 3, keyframes: 5, frames: 150, curve: any }
sampling: { rate: 2400, between: linear }
render: { rules: official, antialiased: auto, background: [0, 0, 0] }
sensor:
  voltmeter: { preset: dvs346-paper, threshold: { on: 1.0, off: 1.0 } }
outputs: [events, sharp]
";

/// The keys that a preset sets.
const SET_KEYS: [&str; 6] = ["trajectories", "sampling", "render", "sensor", "sensors", "outputs"];

/// Returns true if the recipe names the paper's preset. The reader reports any other name.
pub(super) fn names_paper(tree: &TreeNode) -> bool {
    let NodeKind::Map(entries) = &tree.kind else { return false };
    let is_paper = |value: &TreeNode| matches!(&value.kind, NodeKind::Scalar { text, .. } if text == "paper");
    entries.iter().any(|entry| entry.key == KEY && is_paper(&entry.value))
}

/// Removes the keys that a preset sets from the defaults under a recipe with a preset: a sampling of
/// both would be neither.
pub(super) fn remove_keys(defaults: &mut TreeNode) {
    if let NodeKind::Map(entries) = &mut defaults.kind {
        entries.retain(|entry| !SET_KEYS.contains(&entry.key.as_str()));
    }
}
