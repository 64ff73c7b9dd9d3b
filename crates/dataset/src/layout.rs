//! Places of the files of known datasets.

use gs2e_files::is_there;
use std::path::{Path, PathBuf};

/// A layout of a sequence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DatasetLayout {
    /// The folder of a trajectory in a release of this program.
    Release,
    /// DSEC (Gehrig et al., 2021). Its frames are of another camera and are not compared.
    Dsec,
    /// The Event-Camera Dataset (Mueggler et al., 2017), with poses in the form of TUM.
    Tum,
    /// E-NeRF (Klenk et al., 2023).
    ENerf,
}

/// The files of a sequence. Absent ones are `None`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct DatasetPaths {
    /// Events: a file, or a folder of `.npy` files.
    pub events: PathBuf,
    /// Folder of frames of the same pixels.
    pub frames: Option<PathBuf>,
    /// Stamps of the frames.
    pub stamps: Option<PathBuf>,
    /// Poses.
    pub poses: Option<PathBuf>,
    /// Intrinsics of the camera.
    pub camera: Option<PathBuf>,
    /// Folder of depth images of the same pixels.
    pub depth: Option<PathBuf>,
}

impl DatasetLayout {
    /// The names of the layouts.
    pub const NAMES: [&str; 4] = ["release", "dsec", "tum", "e-nerf"];

    /// The layout of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        let all = [Self::Release, Self::Dsec, Self::Tum, Self::ENerf];
        Self::NAMES.iter().position(|known| *known == name).map(|at| all[at])
    }

    /// The files of the sequence in `dir`. A file of events that is absent has its usual name.
    #[must_use]
    pub fn paths(self, dir: &Path) -> DatasetPaths {
        let first = |names: &[&str]| names.iter().map(|name| dir.join(name)).find(|path| is_there(path));
        let events = |names: &[&str]| first(names).unwrap_or_else(|| dir.join(names[0]));
        match self {
            Self::Release => DatasetPaths {
                events: events(&["events.h5"]),
                frames: first(&["sharp"]),
                stamps: first(&["timestamps_us.txt"]),
                poses: first(&["poses.txt"]),
                camera: first(&["transforms.json"]),
                depth: first(&["depth"]),
            },
            Self::Dsec => DatasetPaths {
                events: events(&["events.h5", "events/left/events.h5"]),
                ..DatasetPaths::default()
            },
            Self::Tum => DatasetPaths {
                events: events(&["events.txt", "events.h5", "events.npz"]),
                frames: first(&["images"]),
                stamps: first(&["images.txt", "timestamps.txt"]),
                poses: first(&["groundtruth.txt", "poses.txt"]),
                // Its calib.txt has distortion, and its recordings have no depth.
                ..DatasetPaths::default()
            },
            Self::ENerf => DatasetPaths {
                events: events(&["events"]),
                frames: first(&["images"]),
                stamps: first(&["images/image_stamps_ns.txt"]),
                poses: first(&["poses_all.txt"]),
                ..DatasetPaths::default()
            },
        }
    }
}
