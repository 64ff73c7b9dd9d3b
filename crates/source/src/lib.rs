//! Captured datasets: photos with solved poses, independent of their file formats.
//!
//! A reader returns a [`Capture`] in the program's own conventions and lists the files that it
//! read, so that a change in any of them is detected. It refuses data that it cannot read
//! correctly, with file, record and byte or line. Data that it can read but not guarantee becomes a
//! [`SourceWarning`].
//!
//! Cameras are those of `gs2e-scene`, poses those of `gs2e-num` and photos those of `gs2e-image`, and
//! `gs2e-files` opens what a stranger names. To ask other programs about poses and events, it needs
//! `gs2e-trajectory`, `gs2e-event` and `gs2e-sensor`. `gs2e-recipe` names sources and `gs2e-build` reads
//! them. `gs2e-demo` makes captures, `gs2e-train` learns from them, `gs2e-check` judges them, and
//! `gs2e-export` writes COLMAP models. The terms of sources bind `gs2e-release`, `gs2e-audit` and
//! `gs2e-publish`.
//!
//! # Examples
//!
//! ```
//! use gs2e_source::{DiskCapture, kind::CaptureKind};
//!
//! let folder = tempfile::tempdir()?;
//! let json = r#"{"w": 64, "h": 48, "fl_x": 50, "fl_y": 50, "cx": 32, "cy": 24, "frames": [{
//!     "file_path": "a.png", "transform_matrix": [[1,0,0,0], [0,1,0,0], [0,0,1,2], [0,0,0,1]]}]}"#;
//! std::fs::write(folder.path().join("transforms.json"), json)?;
//! let kind = CaptureKind::kind_of(folder.path())?;
//! assert_eq!(kind, CaptureKind::Nerfstudio);
//! // The pose is known, and there is no photo.
//! let (capture, _warnings) = DiskCapture::all_views(kind, folder.path().to_owned()).read()?;
//! assert_eq!(capture.views[0].world_from_camera.translation.z, 2.0);
//! assert_eq!(capture.views[0].sha256, None);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod captured;
mod collect;
pub mod colmap;
mod dl3dv;
mod error;
mod exif;
pub mod foreign;
pub mod inventory;
pub mod kind;
mod layout;
pub mod lens;
pub mod licence;
pub mod model;
pub mod mvimgnet;
pub mod nerfstudio;
mod node;
mod photo;
pub mod photos;
pub mod reconstruct;
mod same_camera;
pub mod solving;
pub mod undistort;
mod video;
pub mod view;
mod warning;

pub use captured::{DiskCapture, PoseFile, ViewSelection, check_pattern};
pub use error::{SourceError, SourcePlace};
pub use layout::SourceDataset;
pub use warning::SourceWarning;

use collect::{FoundView, collect_views, screen_camera};
use glam::{DQuat, DVec3};
use gs2e_files as files;
use gs2e_image::Size;
use gs2e_num::se3::Se3;
use gs2e_scene::camera::Camera;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The content of a source: its views in capture order (natural order of the image file names).
/// There is at least one view unless the scene has no source.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Capture {
    /// The registered views in use.
    pub views: Vec<CapturedView>,
    /// The unused photos, in natural order of their names.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub unused: Vec<UnusedPhoto>,
}

/// A photo that is not used.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnusedPhoto {
    /// Image file name as the source gives it.
    pub name: String,
    /// SHA-256 of the file (hexadecimal), if the photo exists.
    pub sha256: Option<String>,
    /// Size in pixels, if known.
    pub size: Option<Size>,
    /// The reason.
    pub why: UnusedReason,
}

/// The reason why a photo is not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum UnusedReason {
    /// The source has no pose for it.
    NotRegistered,
    /// The recipe excludes its name.
    Excluded,
    /// The recipe asks for fewer views than the source has.
    NotPicked,
}

impl UnusedReason {
    /// Returns the reason in words, to follow "the photo".
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::NotRegistered => "has no pose in the source",
            Self::Excluded => "is excluded by its name",
            Self::NotPicked => "was not picked",
        }
    }
}

/// One photo and its pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CapturedView {
    /// Image file name as the source gives it.
    pub name: String,
    /// Camera to world, OpenCV camera axes.
    #[serde(with = "StoredPose")]
    pub world_from_camera: Se3,
    /// Pinhole part of the camera, in pixels of the photo.
    pub camera: Camera,
    /// The lens distortion that the source states.
    pub lens: LensModel,
    /// SHA-256 of the photo's bytes (hexadecimal), if the photo exists.
    pub sha256: Option<String>,
}

/// A pose as stored in files: quaternion x, y, z, w and the camera's centre.
#[derive(Serialize, Deserialize)]
#[serde(remote = "Se3", deny_unknown_fields)]
struct StoredPose {
    rotation: DQuat,
    translation: DVec3,
}

/// Lens distortion by COLMAP's model names and parameters; `Pinhole` has none.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE", deny_unknown_fields)]
pub enum LensModel {
    /// No distortion.
    Pinhole,
    /// One radial coefficient.
    SimpleRadial {
        /// Radial coefficient of r^2.
        k1: f64,
    },
    /// Two radial coefficients.
    Radial {
        /// Radial coefficient of r^2.
        k1: f64,
        /// Radial coefficient of r^4.
        k2: f64,
    },
    /// Two radial and two tangential coefficients (OpenCV's first four).
    #[serde(rename = "OPENCV")]
    OpenCv {
        /// Coefficients k1, k2, p1, p2.
        k: [f64; 4],
    },
    /// OpenCV's rational model: k1, k2, p1, p2, k3, k4, k5, k6.
    #[serde(rename = "FULL_OPENCV")]
    FullOpenCv {
        /// Coefficients k1, k2, p1, p2, k3, k4, k5, k6.
        k: [f64; 8],
    },
}

impl From<Vec<CapturedView>> for Capture {
    /// Returns a capture that uses all its photos.
    fn from(views: Vec<CapturedView>) -> Self {
        Self { views, unused: Vec::new() }
    }
}

impl Capture {
    /// Returns the camera of trajectories through this capture: the camera of the first view. The
    /// warning names a view whose size differs, or whose fx, fy, cx or cy differs by more than 1
    /// px. Returns `None` if there is no view.
    #[must_use]
    pub fn camera(&self) -> Option<(Camera, Option<SourceWarning>)> {
        let first = self.views.first()?;
        let apart = |v: &&CapturedView| cameras_differ(&first.camera, &v.camera);
        let other = self.views.iter().find(apart).map(|other| SourceWarning::CamerasDiffer {
            taken: first.name.clone(),
            other: other.name.clone(),
            count: self.views.iter().filter(apart).count(),
        });
        Some((first.camera, other))
    }

    /// The mean of the up directions of the views, in world axes; `None` if there is no view, or if they
    /// cancel.
    #[must_use]
    pub fn up(&self) -> Option<DVec3> {
        // Cameras have OpenCV axes: up in the image is `-y`.
        let ups = self.views.iter().map(|view| view.world_from_camera.rotation * DVec3::NEG_Y);
        ups.sum::<DVec3>().try_normalize()
    }

    /// Returns a warning if the lenses distort the photos, because trajectories render without
    /// distortion. A scene that was trained on the photos as taken contains the same distortion. A
    /// scene that was trained on undistorted photos is correct.
    #[must_use]
    pub fn distortion(&self) -> Option<SourceWarning> {
        let bent = |view: &CapturedView| view.lens.max_displacement_px(&view.camera);
        // Views mostly share one camera, and the measurement costs a grid of points per camera.
        let is_other = |i: usize| {
            let before = i.checked_sub(1).map(|i| &self.views[i]);
            before.is_none_or(|before| {
                (before.camera, &before.lens) != (self.views[i].camera, &self.views[i].lens)
            })
        };
        let others = (0..self.views.len()).filter(|i| is_other(*i));
        let most_px = others.map(|i| bent(&self.views[i])).fold(0.0, f64::max);
        (most_px > lens::NEGLIGIBLE_PX).then_some(SourceWarning::DistortionIgnored { most_px })
    }
}

/// Returns true if trajectories through one camera misrepresent the other.
fn cameras_differ(a: &Camera, b: &Camera) -> bool {
    let pairs = [(a.fx, b.fx), (a.fy, b.fy), (a.cx, b.cx), (a.cy, b.cy)];
    a.size != b.size || pairs.iter().any(|(a, b)| (a - b).abs() > 1.0)
}

/// Returns true if the path is a folder, and false if it is a regular file.
///
/// # Errors
/// The path is neither.
fn is_folder(path: &Path) -> Result<bool, SourceError> {
    let is_folder = std::fs::metadata(path).is_ok_and(|about| about.is_dir());
    // Opening the path gives the cause if it leads to nothing.
    if !is_folder {
        files::open(path).map_err(SourceError::io_error(path))?;
    }
    Ok(is_folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(name: &str, fx: f64) -> CapturedView {
        let size = Size { width: 640, height: 360 };
        let camera = Camera { size, fx, fy: 500.0, cx: 320.0, cy: 180.0, lens: None };
        let world_from_camera = Se3 {
            rotation: DQuat::from_xyzw(0.1, -0.2, 0.3, 0.7).normalize(),
            translation: DVec3::new(1.0 / 3.0, -2e-17, 7e9),
        };
        CapturedView {
            name: name.to_owned(),
            world_from_camera,
            camera,
            lens: LensModel::OpenCv { k: [0.1; 4] },
            sha256: None,
        }
    }

    fn found(name: &str, line: usize) -> FoundView {
        FoundView { view: view(name, 500.0), place: SourcePlace::Line(line) }
    }

    #[test]
    fn views_are_in_natural_order_and_named_once() {
        let names = |names: &[&str]| {
            let found = names.iter().zip(1..).map(|(name, line)| found(name, line)).collect();
            collect_views(Path::new("m"), found)
                .map(|c| c.views.into_iter().map(|v| v.name).collect::<Vec<_>>())
        };
        assert_eq!(names(&["b 10.jpg", "b 9.jpg", "a/2.jpg"]).unwrap(), ["a/2.jpg", "b 9.jpg", "b 10.jpg"]);
        let twice = names(&["x", "y", "x"]).unwrap_err().to_string();
        assert_eq!(twice, "m: line 3: the image name `x` is already used by line 1");
        assert_eq!(names(&[]).unwrap_err().to_string(), "m: it contains no view");
    }

    #[test]
    fn the_shared_camera_is_taken_or_the_first_with_a_warning() {
        let camera =
            |fx: &[f64]| Capture::from(fx.iter().map(|&fx| view("v", fx)).collect::<Vec<_>>()).camera();
        assert_eq!(camera(&[]), None);
        assert_eq!(camera(&[500.0, 500.9, 499.1]).unwrap().1, None);
        let (taken, warning) = camera(&[500.0, 501.1, 480.0]).unwrap();
        assert_eq!(taken, view("", 500.0).camera);
        let warning = warning.unwrap().to_string();
        assert!(warning.starts_with("2 views have a different camera"), "{warning}");
    }

    #[test]
    fn a_stored_capture_is_read_back_to_the_bit() {
        let mut capture =
            Capture::from(vec![view("a b/1.jpg", 500.123_456_789_012_3), view("c", f64::MIN_POSITIVE)]);
        assert!(!serde_json::to_string(&capture).unwrap().contains("unused"));
        let size = Some(Size { width: 3, height: 2 });
        let unused = UnusedPhoto { name: "d".into(), sha256: None, size, why: UnusedReason::NotRegistered };
        capture.unused.push(unused);
        let text = serde_json::to_string(&capture).unwrap();
        assert_eq!(serde_json::from_str::<Capture>(&text).unwrap(), capture);
        assert!(text.contains(r#""lens":{"OPENCV":{"k":[0.1,0.1,0.1,0.1]}}"#), "{text}");
    }
}
