//! What is left out because a `takedown.txt` lists it: told once, as a number.

use super::console::Console;
use super::message::{Level, Message};

/// Says how many scenes were left out, where there are any.
pub(super) fn tell(count: usize, console: &Console) {
    if count > 0 {
        let are = if count == 1 { "scene is" } else { "scenes are" };
        let what = format!("{count} {are} left out, as takedown.txt lists them");
        console.tell(&Message::new(Level::Warning, "takedown", what));
    }
}
