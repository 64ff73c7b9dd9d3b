//! The files that every release has, whatever its recipes ask for.

use super::{FilePresence, FileRow, FileSet, LicenceClass};

const JSON: &str = "application/json";

/// Id of the set of all `scene.json`.
pub(crate) const SCENE_FILES: &str = "scene-files";

/// The description of a scene.
pub(crate) static SCENE: [FileRow; 2] = [
    metadata(
        "<scene>/scene.json",
        "source, camera, recipe, licence, seeds and statistics of a scene",
        Some(FileSet {
            id: SCENE_FILES,
            media: JSON,
            glob: "**/scene.json",
            description: "source, camera, recipe, licence, seeds and statistics of a scene",
        }),
    ),
    FileRow {
        name: "<scene>/held_out.png",
        content: "small photos of held-out views, their renderings, and the differences times 4",
        set: Some(FileSet {
            id: "held-out-picture-files",
            media: "image/png",
            glob: "**/held_out.png",
            description: "small photos of held-out views, their renderings, and the differences times 4",
        }),
        presence: FilePresence::WithHeldOut,
        class: LicenceClass::Material,
    },
];

/// Poses and speeds of a trajectory.
pub(crate) static PATH: [FileRow; 6] = [
    metadata(
        "poses.txt",
        "one line per pose: `t_us tx ty tz qx qy qz qw`, camera to world",
        Some(FileSet {
            id: "pose-files",
            media: "text/plain",
            glob: "**/poses.txt",
            description: "t_us tx ty tz qx qy qz qw, camera to world",
        }),
    ),
    metadata(
        "transforms.json",
        "the same poses and the camera in nerfstudio's form",
        Some(FileSet {
            id: "transform-files",
            media: JSON,
            glob: "**/transforms.json",
            description: "poses and camera in nerfstudio's form",
        }),
    ),
    metadata("timestamps_us.txt", "one time stamp per line, in microseconds", None),
    metadata(
        "speed.json",
        "requested and achieved speed of the camera",
        Some(FileSet {
            id: "speed-files",
            media: JSON,
            glob: "**/speed.json",
            description: "requested and achieved speed of the camera",
        }),
    ),
    metadata("trajectory.svg", "the path from above and from the side, and its speed over time", None),
    metadata("trajectory.png", "the path", None),
];

/// Calibration of a rig.
pub(crate) static CALIBRATION: [FileRow; 3] = [
    FileRow {
        name: "calibration/camchain.yaml, calibration/cam_to_cam.yaml",
        content: "cameras of the rig in Kalibr's form, and in that of DSEC with the rectification of stereo pairs; lengths \
                  in scene units, pixels as in OpenCV",
        set: Some(FileSet {
            id: "calibration-files",
            media: "application/yaml",
            glob: "**/calibration/*.yaml",
            description: "cameras of a rig in the forms of Kalibr and DSEC",
        }),
        presence: FilePresence::WithRig,
        class: LicenceClass::Metadata,
    },
    rectification("calibration/<camera>_rectify_map.npy", "place in the rectified picture of each pixel"),
    rectification("calibration/<camera>_remap.npy", "the inverse, for OpenCV's `remap`"),
];

/// Verdicts of the checks.
pub(crate) static CHECKS: [FileRow; 2] = [
    metadata(
        "checks.json",
        "verdicts of the checks",
        Some(FileSet {
            id: "check-files",
            media: JSON,
            glob: "**/checks.json",
            description: "verdicts of the checks",
        }),
    ),
    FileRow {
        name: "checks/*.png",
        content: "pictures made by some checks",
        set: Some(FileSet {
            id: "check-picture-files",
            media: "image/png",
            glob: "**/checks/*.png",
            description: "pictures made by some checks",
        }),
        presence: FilePresence::WithStreams,
        class: LicenceClass::Material,
    },
];

/// Exports of a trajectory.
pub(crate) static EXPORTS: [FileRow; 1] = [FileRow {
    name: "exports/*/",
    content: "the trajectory in the layouts of other programs; `export.json` in each lists what the layout lacks",
    set: None,
    presence: FilePresence::WithExports,
    class: LicenceClass::Material,
}];

/// Files of the release as a whole.
pub(crate) static TOP: [FileRow; 7] = [
    top("report.html", "the release for people, in one file: pictures, curves, verdicts"),
    top("index.parquet", "table with one row per trajectory"),
    top("croissant.json", "this release in Croissant 1.1"),
    top("DATASHEET.md", "answers to the questions of \"Datasheets for Datasets\""),
    top("REUSE.toml, LICENSES/", "holders and terms of every file, for `reuse lint`; the texts"),
    top("gs2e.py", "loader that needs only numpy and h5py"),
    top(
        "manifest.json, B3SUMS, SHA256SUMS",
        "every step with its key; size, BLAKE3 and SHA-256 of every file: `sha256sum --strict -c SHA256SUMS`",
    ),
];

const fn metadata(name: &'static str, content: &'static str, set: Option<FileSet>) -> FileRow {
    FileRow { name, content, set, presence: FilePresence::Always, class: LicenceClass::Metadata }
}

const fn rectification(name: &'static str, content: &'static str) -> FileRow {
    FileRow { name, content, set: None, presence: FilePresence::WithStereo, class: LicenceClass::Material }
}

const fn top(name: &'static str, content: &'static str) -> FileRow {
    FileRow { name, content, set: None, presence: FilePresence::Always, class: LicenceClass::Release }
}
