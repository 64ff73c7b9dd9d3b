//! Scenes that are left out because a `takedown.txt` lists them.

use super::console::Console;
use super::message::{MessageLevel, UserMessage};
use gs2e_recipe::TakenDown;

/// Prints the number of scenes left out, and the number of ids in the list that match no scene, if
/// they are not zero.
pub(super) fn show_takedown(taken_down: TakenDown, console: &Console) {
    let TakenDown { scenes, unmatched } = taken_down;
    if scenes > 0 {
        let are = if scenes == 1 { "scene is" } else { "scenes are" };
        let what = format!("{scenes} {are} left out because of takedown.txt");
        console.tell(&UserMessage::new(MessageLevel::Warning, "takedown", what));
    }
    if unmatched > 0 {
        let ids = if unmatched == 1 {
            "1 id in takedown.txt matches"
        } else {
            &format!("{unmatched} ids in takedown.txt match")
        };
        let what = format!("{ids} none of these scenes");
        console.tell(&UserMessage::new(MessageLevel::Warning, "takedown-unmatched", what));
    }
}
