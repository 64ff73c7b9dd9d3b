//! The sections of the card on files: a table, and lines of Python that load them.

use crate::facts::ReleaseFacts;
use crate::products::{FOLDERS, FilePresence, FileRow, products};
use crate::{layout, products};
use gs2e_recipe::RigCamera;
use std::fmt::Write as _;

/// Table of the files that the release has.
pub(super) fn files_section(facts: &ReleaseFacts<'_>) -> String {
    let counts = facts.counts();
    let several =
        facts.scenes.iter().any(|scene| scene.file.trajectories.iter().any(|part| !part.sensors.is_empty()));
    let held_out = facts
        .scenes
        .iter()
        .flat_map(|scene| &scene.files)
        .any(|file| file.path.strip_suffix(layout::HELD_OUT).is_some_and(|folder| folder.ends_with('/')));
    let shown =
        |is: &dyn Fn(&RigCamera) -> bool| facts.scenes.iter().any(|scene| scene.recipe.rig.iter().any(is));
    let pictures = FOLDERS.into_iter().filter(|product| counts.has(product));
    let rows = products::SCENE
        .iter()
        .chain(products::EVENTS.files)
        .chain(&products::PATH)
        .chain(&products::CALIBRATION)
        .chain(pictures.flat_map(|product| product.files))
        .chain(&products::CHECKS)
        .chain(&products::EXPORTS)
        .chain(&products::TOP);
    let is_there = |row: &&FileRow| match row.presence {
        FilePresence::Always => true,
        FilePresence::WithStreams => counts.has(&products::EVENTS),
        FilePresence::WithSeveralSensors => several,
        FilePresence::WithHeldOut => held_out,
        FilePresence::WithRig => shown(&|camera| !camera.name.is_empty()),
        FilePresence::WithStereo => shown(&|camera| camera.second.is_some()),
        FilePresence::WithExports => {
            !facts.info.include.is_empty() && facts.scenes.iter().any(|scene| !scene.is_withheld())
        }
    };
    let mut text = String::from("## Files\n\n| file | content |\n|---|---|\n");
    for FileRow { name, content, .. } in rows.filter(is_there) {
        let names: Vec<String> = name.split(", ").map(|name| format!("`{name}`")).collect();
        let _ = writeln!(text, "| {} | {content} |", names.join(", "));
    }
    text
}

/// Line of Python that reads a pose, which every release has.
const POSE: &str = "world_from_camera = scene.pose(15_000)  # [4, 4], between poses by lerp and slerp";

/// Lines of Python that load what the release has.
pub(super) fn loading_section(facts: &ReleaseFacts<'_>) -> String {
    let counts = facts.counts();
    let made = products().filter(|product| counts.has(product));
    let mut lines: Vec<&str> = made.flat_map(|product| product.loading).copied().collect();
    // Events come first, and the pose second: users ask for both at one time.
    lines.insert(usize::from(counts.has(&products::EVENTS)), POSE);
    format!(
        "## How to load it\n\n```python\nfrom gs2e import Scene  # gs2e.py, copied next to your own code\n\n\
         scene = Scene(\"<scene>\", \"<trajectory>\")\n{}\n```\n",
        lines.join("\n")
    )
}
