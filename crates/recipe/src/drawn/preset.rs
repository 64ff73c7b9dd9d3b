//! The preset `randomised` of a sensor: ranges instead of numbers.

use crate::tree::{NodeKind, TreeNode};
use gs2e_sensor::SensorChoice;

/// Name of the preset.
pub(crate) const RANDOMISED: &str = "randomised";

/// Removes the preset from a sensor as written. Returns a sensor with the ranges of its model, as YAML.
pub(crate) fn take_preset(sensor: &mut TreeNode) -> Option<String> {
    let NodeKind::Map(models) = &mut sensor.kind else { return None };
    let [model] = models.as_mut_slice() else { return None };
    let facts = SensorChoice::FAMILY.into_iter().find(|facts| facts.name == model.key)?;
    let ranges = facts.ranges?;
    let NodeKind::Map(keys) = &mut model.value.kind else { return None };
    let named = |value: &TreeNode| matches!(&value.kind, NodeKind::Scalar { text, .. } if text == RANDOMISED);
    let before = keys.len();
    keys.retain(|entry| entry.key != "preset" || !named(&entry.value));
    let indented: String = ranges.lines().map(|line| format!("  {line}\n")).collect();
    (keys.len() < before).then(|| format!("{}:\n{indented}", facts.name))
}
