//! The card's table of files, and lines of Python that load them.

use crate::facts::ReleaseFacts;
use crate::markdown::markup;
use crate::products::{FOLDERS, FilePresence, FileRow, products};
use crate::{layout, products};
use gs2e_recipe::RigCamera;
use minijinja::{Value, context};

/// Line of Python that reads a pose, which every release has.
const POSE: &str = "world_from_camera = scene.pose(15_000)  # [4, 4], between poses by lerp and slerp";

pub(super) fn files_values(facts: &ReleaseFacts<'_>) -> Value {
    let counts = facts.counts();
    let made = products().filter(|product| counts.has(product));
    let mut loading: Vec<&str> = made.flat_map(|product| product.loading).copied().collect();
    // Events come first, and the pose second: users ask for both at one time.
    loading.insert(usize::from(counts.has(&products::EVENTS)), POSE);
    let row = |row: &FileRow| {
        let names: Vec<String> = row.name.split(", ").map(|name| format!("`{name}`")).collect();
        [markup(names.join(", ")), markup(row.content)]
    };
    context! { files => file_rows(facts).map(row).collect::<Value>(), loading => markup(loading.join("\n")) }
}

/// The rows of the files that the release has.
fn file_rows(facts: &ReleaseFacts<'_>) -> impl Iterator<Item = &'static FileRow> {
    let counts = facts.counts();
    let held_out = facts
        .scenes
        .iter()
        .flat_map(|scene| &scene.files)
        .any(|file| file.path.strip_suffix(layout::HELD_OUT).is_some_and(|folder| folder.ends_with('/')));
    let included =
        |is: &dyn Fn(&RigCamera) -> bool| facts.scenes.iter().any(|scene| scene.recipe.rig.iter().any(is));
    let pictures = FOLDERS.into_iter().filter(|product| counts.has(product));
    let rows: Vec<&FileRow> = products::SCENE
        .iter()
        .chain(products::EVENTS.files)
        .chain(&products::PATH)
        .chain(&products::CALIBRATION)
        .chain(pictures.flat_map(|product| product.files))
        .chain(&products::CHECKS)
        .chain(&products::EXPORTS)
        .chain(&products::TOP)
        .filter(|row| match row.presence {
            FilePresence::Always => true,
            FilePresence::WithStreams => counts.has(&products::EVENTS),
            FilePresence::WithSeveralSensors => facts.has_several_sensors(),
            FilePresence::WithHeldOut => held_out,
            FilePresence::WithRig => included(&|camera| !camera.name.is_empty()),
            FilePresence::WithStereo => included(&|camera| camera.second.is_some()),
            FilePresence::WithExports => {
                !facts.info.include.is_empty() && facts.scenes.iter().any(|scene| !scene.is_withheld())
            }
        })
        .collect();
    rows.into_iter()
}
