//! The section of the card on conventions: units, axes, polarity, and brightness.

use super::built_trajectories;
use crate::facts::ReleaseFacts;
use crate::published::PublishedScene;
use crate::scene::TrajectoryPart;
use std::collections::BTreeSet;
use std::fmt::Write as _;

const CONVENTIONS: &str = "\
## Conventions

Times are integer microseconds from the first pose. Camera axes are those of OpenCV: x right, y down, z forward; only \
`transforms.json` has those of OpenGL (y up, z back). The centre of pixel (i, j) is (i+0.5, j+0.5). Lengths are in the \
unit of the source.
";

/// Conventions of events.
const EVENT_CONVENTIONS: &str = "
Polarity 1 is brighter, 0 is darker. Brightness is display-encoded (sRGB) luminance, 0.299 R + 0.587 G + 0.114 B, on \
the grey scale 0..255.
";

/// Meaning of labels, for streams that have them.
const LABELS: &str = "\
`events/label`, where a stream has it, is 1 for signal and 0 for noise. An event is noise if it comes from a hot pixel or from shot \
noise, or if the brightness moved by less than half a threshold in the event's direction since the \
previous event of the pixel.
";

/// The scenes whose light changes.
fn lit_scenes(scenes: &[PublishedScene]) -> String {
    let shown = scenes.iter().filter(|scene| !scene.is_withheld());
    let lit = shown.filter_map(|scene| Some((&scene.recipe.scene, scene.recipe.lights.as_ref()?)));
    let rows: Vec<String> = lit.map(|(scene, lights)| format!("| {scene} | {lights} |\n")).collect();
    if rows.is_empty() {
        return String::new();
    }
    format!(
        "\nThe light of these scenes changes with time, in events and pictures alike. Depth and flow do not depend on it. \
         `lights` in the recipe of `scene.json` has the numbers:\n\n| scene | light |\n|---|---|\n{}\n",
        rows.concat()
    )
}

/// The cameras with a lens that distorts.
fn lens_cameras(scenes: &[PublishedScene]) -> String {
    let row = |scene: &PublishedScene, part: &TrajectoryPart| {
        let lens = scene.file.camera_of(part).lens?;
        let camera = scene.recipe.mounted(&part.name).map_or("", |mounted| &mounted.camera.name);
        Some(format!("| {} | {camera} | {lens} |\n", scene.recipe.scene))
    };
    let shown = scenes.iter().filter(|scene| !scene.is_withheld());
    // Trajectories share their cameras.
    let rows: BTreeSet<String> =
        shown.flat_map(|scene| scene.file.trajectories.iter().filter_map(|part| row(scene, part))).collect();
    if rows.is_empty() {
        return String::new();
    }
    format!(
        "\nThe lenses of these cameras distort, in all products alike. The numbers are those of OpenCV (`opencv`: k1, k2, \
         p1, p2, k3, k4, k5, k6; `fisheye`: k1, k2, k3, k4):\n\n| scene | camera | lens |\n|---|---|---|\n{}\n",
        Vec::from_iter(rows).concat()
    )
}

/// The scenes whose sharp frames have a rolling shutter.
fn rolling_scenes(scenes: &[PublishedScene]) -> String {
    let shown = scenes.iter().filter(|scene| !scene.is_withheld() && scene.recipe.has_sharp());
    let rolling = shown.filter_map(|scene| Some((&scene.recipe.scene, scene.recipe.readout_us?)));
    let rows: Vec<String> = rolling.map(|(scene, us)| format!("| {scene} | {us} |\n")).collect();
    if rows.is_empty() {
        return String::new();
    }
    format!(
        "\nThe rows of the sharp frames of these scenes are seen one after another. Row r of H is seen at t + readout \
         (r / (H - 1) - 1/2), where t is the time of the pose, so the pose is that of the middle row:\n\n\
         | scene | readout, us |\n|---|---|\n{}\n",
        rows.concat()
    )
}

/// Conventions for reading the numbers, and the sensors that see another brightness than the
/// others.
pub(super) fn conventions_section(facts: &ReleaseFacts<'_>) -> String {
    let scenes = facts.scenes;
    let mut text = CONVENTIONS.to_owned();
    if facts.provenance().has_events() {
        text.push_str(EVENT_CONVENTIONS);
    }
    let streams = built_trajectories(scenes).flat_map(|(scene, part)| scene.streams(part));
    if streams.into_iter().any(|(_, sensor)| sensor.as_model().labels()) {
        text.push_str(LABELS);
    }
    let encoded = built_trajectories(scenes).filter(|(scene, part)| {
        part.blur.is_some() && !scene.recipe.shutter.mean.is_linear() && !scene.is_withheld()
    });
    let encoded: BTreeSet<&str> = encoded.map(|(scene, _)| scene.recipe.scene.as_str()).collect();
    if !encoded.is_empty() {
        let names = encoded.into_iter().collect::<Vec<_>>().join(", ");
        let _ = write!(
            text,
            "\nThe blurred pictures of these scenes are means of encoded values, not of linear light: {names}.\n"
        );
    }
    text.push_str(&lens_cameras(scenes));
    text.push_str(&lit_scenes(scenes));
    text.push_str(&rolling_scenes(scenes));
    let sensors = scenes.iter().flat_map(|scene| scene.recipe.every_sensor().map(move |each| (scene, each)));
    let others: Vec<String> = sensors
        .map(|(scene, (name, sensor))| (scene.recipe.scene.clone(), name, sensor.as_model().front_end()))
        .filter(|(.., front_end)| !front_end.is_plain())
        .map(|(scene, name, front_end)| match name {
            Some(name) => format!("| {scene} | {name} | {front_end} |\n"),
            None => format!("| {scene} | | {front_end} |\n"),
        })
        .collect();
    if !others.is_empty() {
        let head = "| scene | sensor | brightness |\n|---|---|---|\n";
        let _ = write!(
            text,
            "These sensors use a different brightness on the same scale:\n\n{head}{}",
            others.concat()
        );
    }
    text
}
