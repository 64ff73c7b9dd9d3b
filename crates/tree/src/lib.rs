//! A reader of released datasets.
//!
//! ```text
//! folder ── Release ── ReleasedScene ── ReleasedTrajectory ── poses, pictures, events, inertial data
//! ```
//! A [`Release`] is a folder with a `manifest.json`. A [`ReleasedScene`] is what a `scene.json` states:
//! camera, recipe and trajectories. A [`TrajectoryFiles`] gives the files of one trajectory as the types that
//! they hold.
//!
//! Nothing outside of the folder is opened, and no link is followed, because a release may come from anyone.
//! The files of a release that is not written yet are read in the same way: see [`ReleaseFiles`]. The reader
//! takes the files as they are; whether they are sound and agree with each other, the audit of `gs2e-audit`
//! judges.
//!
//! Poses are those of `gs2e-trajectory`, cameras of `gs2e-scene`, events of `gs2e-event` and pictures of
//! `gs2e-image`; `gs2e-files` opens the files. `gs2e-release` describes its scenes with these types, and
//! `gs2e-audit` and `gs2e-export` read releases with it. Other programs can take it too.
//!
//! # Examples
//!
//! ```
//! use gs2e_tree::Release;
//!
//! let folder = tempfile::tempdir()?;
//! let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text);
//! std::fs::create_dir_all(folder.path().join("lab/base"))?;
//! write("manifest.json", r#"{ "format": 1, "scenes": [{ "id": "lab" }] }"#)?;
//! write(
//!     "lab/scene.json",
//!     r#"{ "id": "lab", "recipe": { "seed": 7 }, "trajectories": [{ "name": "base" }],
//!          "camera": { "width": 64, "height": 48, "fx": 60, "fy": 60, "cx": 32, "cy": 24 } }"#,
//! )?;
//! write("lab/base/poses.txt", "0 0 0 0 0 0 0 1\n1000 0.5 0 0 0 0 0 1\n")?;
//!
//! let release = Release::open(folder.path())?;
//! let scene = release.scene("lab")?;
//! let base = release.trajectory(&scene, &scene.trajectories[0])?;
//! let poses = base.poses()?;
//! assert_eq!(poses.stamps_us, [0, 1000]);
//! assert_eq!(poses.world_from_camera[1].translation.x, 0.5);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod description;
mod files;
mod trajectory;

pub use description::{
    CameraPart, MountedCamera, Release, ReleasedScene, ReleasedTrajectory, read_manifest, read_scene,
};
pub use files::{ListedFile, ListedFiles, ReleaseFiles, ReleaseFolder, TreeError, json_of};
pub use trajectory::{Exposure, PictureKind, TrajectoryFiles, event_file};
