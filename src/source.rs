//! Captured datasets: photos with solved poses, whatever their files look like.

use crate::camera::Camera;
use crate::se3::Se3;
use serde::{Deserialize, Serialize};

/// What a source says: its views in capture order (natural order of the image file names).
#[derive(Debug, Clone, PartialEq)]
pub struct Capture {
    /// The registered views.
    pub views: Vec<View>,
}

/// One photo and where it was taken.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Image file name as the source gives it.
    pub name: String,
    /// Camera to world, OpenCV camera axes.
    pub world_from_camera: Se3,
    /// Pinhole part of the camera, in pixels of the photo.
    pub camera: Camera,
    /// The lens distortion that the source states.
    pub lens: Lens,
    /// SHA-256 of the photo's bytes (hexadecimal), where the photo is there.
    pub sha256: Option<String>,
}

/// Lens distortion by COLMAP's model names and parameters; `Pinhole` has none.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE", deny_unknown_fields)]
pub enum Lens {
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
