//! The sections of the card on files: a table, and lines of Python that load them.

use crate::release::facts::{FileCounts, ReleaseFacts};
use std::fmt::Write as _;

/// Files of a release: name, content, and the kind of product that they belong to.
const FILES: [(&str, &str, FileKind); 22] = [
    (
        "<scene>/scene.json",
        "source, camera, recipe, licence, seeds and statistics of a scene",
        FileKind::Always,
    ),
    (
        "<scene>/<trajectory>/events.h5",
        "events in DSEC's layout: `events/{x,y,p,t}`, `ms_to_idx`, `t_offset`",
        FileKind::Events,
    ),
    (
        "<scene>/<trajectory>/events/<sensor>.h5",
        "the same, one file per sensor of the trajectory",
        FileKind::SeveralSensors,
    ),
    ("poses.txt", "one line per pose: `t_us tx ty tz qx qy qz qw`, camera to world", FileKind::Always),
    ("transforms.json", "the same poses and the camera in nerfstudio's form", FileKind::Always),
    ("timestamps_us.txt", "one time stamp per line, in microseconds", FileKind::Always),
    ("speed.json", "requested and achieved speed of the camera", FileKind::Always),
    ("trajectory.svg", "the path from above and from the side, and its speed over time", FileKind::Always),
    ("trajectory.png", "the path", FileKind::Always),
    ("sharp/%06d.png", "8-bit sRGB rendering at the pose with that number", FileKind::Sharp),
    (
        "blur/%06d.png",
        "8-bit sRGB mean over an exposure around that pose, in linear light; `transforms.json` has its times",
        FileKind::Blur,
    ),
    (
        "depth/%06d.npy",
        "float32 `[H, W]`, scene units along the optical axis: the weighted mean of the Gaussians at a pixel, so that \
         soft edges mix near and far; NaN where the opacity is below 0.5",
        FileKind::Depth,
    ),
    (
        "flow/%06d.npy",
        "float32 `[H, W, 2]`, px/s: image velocity at that pose of the static point at a pixel's depth; NaN without a \
         depth",
        FileKind::Flow,
    ),
    ("checks.json", "verdicts of the checks", FileKind::Always),
    ("checks/*.png", "pictures made by some checks", FileKind::Events),
    ("report.html", "the release for people, in one file: pictures, curves, verdicts", FileKind::Always),
    ("index.parquet", "table with one row per trajectory", FileKind::Always),
    ("croissant.json", "this release in Croissant 1.1", FileKind::Always),
    ("DATASHEET.md", "answers to the questions of \"Datasheets for Datasets\"", FileKind::Always),
    (
        "REUSE.toml, LICENSES/",
        "holders and terms of every file, for `reuse lint`; the texts",
        FileKind::Always,
    ),
    ("gs2e.py", "loader that needs only numpy and h5py", FileKind::Always),
    (
        "manifest.json, B3SUMS, SHA256SUMS",
        "every step with its key; size, BLAKE3 and SHA-256 of every file: `sha256sum --strict -c SHA256SUMS`",
        FileKind::Always,
    ),
];

/// The condition under which a release has a file.
#[derive(Clone, Copy, PartialEq)]
enum FileKind {
    Always,
    Events,
    SeveralSensors,
    Sharp,
    Blur,
    Depth,
    Flow,
}

/// Table of the files that the release has.
pub(super) fn files_section(facts: &ReleaseFacts<'_>) -> String {
    let FileCounts { streams, frames, blurred, geometry: [depth, flow], .. } = facts.counts();
    let several =
        facts.scenes.iter().any(|scene| scene.file.trajectories.iter().any(|part| !part.sensors.is_empty()));
    let has = |kind| match kind {
        FileKind::Always => true,
        FileKind::Events => streams > 0,
        FileKind::SeveralSensors => several,
        FileKind::Sharp => frames > 0,
        FileKind::Blur => blurred > 0,
        FileKind::Depth => depth > 0,
        FileKind::Flow => flow > 0,
    };
    let mut text = String::from("## Files\n\n| file | content |\n|---|---|\n");
    for (name, content, _) in FILES.into_iter().filter(|(.., kind)| has(*kind)) {
        let names: Vec<String> = name.split(", ").map(|name| format!("`{name}`")).collect();
        let _ = writeln!(text, "| {} | {content} |", names.join(", "));
    }
    text
}

/// Lines of Python that load what the release has.
pub(super) fn loading_section(facts: &ReleaseFacts<'_>) -> String {
    let FileCounts { streams, frames, blurred, geometry: [depth, flow], .. } = facts.counts();
    let lines = [
        (streams > 0, "t, x, y, p, label = scene.events(10_000, 20_000)  # t0_us <= t < t1_us"),
        (true, "world_from_camera = scene.pose(15_000)  # [4, 4], between poses by lerp and slerp"),
        (streams > 0, "voxel = scene.voxel(10_000, 20_000, bins=5)  # [bins, H, W]"),
        (frames > 0, "frame = scene.frames[0]"),
        (blurred > 0, "exposure = scene.blurred[0]"),
        (depth > 0, "depth = scene.depth(0)  # [H, W]"),
        (flow > 0, "flow = scene.flow(0)  # [H, W, 2]"),
    ];
    let lines: Vec<&str> = lines.into_iter().filter(|(has, _)| *has).map(|(_, line)| line).collect();
    format!(
        "## How to load it\n\n```python\nfrom gs2e import Scene  # gs2e.py, copied next to your own code\n\n\
         scene = Scene(\"<scene>\", \"<trajectory>\")\n{}\n```\n",
        lines.join("\n")
    )
}
