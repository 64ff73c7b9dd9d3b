//! Scenes that are left out because a `takedown.txt` lists them.

use super::{Console, UserMessage};
use gs2e_recipe::TakedownEffect;

/// Prints the number of scenes left out, and the number of ids in the list that match no scene, if
/// they are not zero.
pub(super) fn report_takedown(taken_down: TakedownEffect, console: &Console) {
    let TakedownEffect { scenes, unmatched } = taken_down;
    if scenes > 0 {
        let are = if scenes == 1 { "scene is" } else { "scenes are" };
        let what = format!("{scenes} {are} left out because of takedown.txt");
        console.report(&UserMessage::warning("takedown", what));
    }
    if unmatched > 0 {
        let [ids, verb] = if unmatched == 1 { ["id", "matches"] } else { ["ids", "match"] };
        let what = format!("{unmatched} {ids} in takedown.txt {verb} none of these scenes");
        console.report(&UserMessage::warning("takedown-unmatched", what));
    }
}
