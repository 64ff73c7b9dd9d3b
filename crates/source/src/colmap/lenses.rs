//! COLMAP's camera models (`src/colmap/sensor/models.h`).

use super::ModelCamera;
use crate::{LensModel, screen_camera};
use gs2e_image::Size;
use gs2e_scene::camera::Camera;

/// A camera model with COLMAP's number and name.
pub(super) struct CameraModel {
    id: i32,
    pub(super) name: &'static str,
    /// Number of parameters.
    pub(super) parameters: usize,
}

/// Number of the undistorted model with two focal lengths.
pub(super) const PINHOLE: i32 = 1;

const fn camera_model(id: i32, name: &'static str, parameters: usize) -> CameraModel {
    CameraModel { id, name, parameters }
}

const MODELS: [CameraModel; 11] = [
    camera_model(0, "SIMPLE_PINHOLE", 3),
    camera_model(PINHOLE, "PINHOLE", 4),
    camera_model(2, "SIMPLE_RADIAL", 4),
    camera_model(3, "RADIAL", 5),
    camera_model(4, "OPENCV", 8),
    camera_model(5, "OPENCV_FISHEYE", 8),
    camera_model(6, "FULL_OPENCV", 12),
    camera_model(7, "FOV", 5),
    camera_model(8, "SIMPLE_RADIAL_FISHEYE", 4),
    camera_model(9, "RADIAL_FISHEYE", 5),
    camera_model(10, "THIN_PRISM_FISHEYE", 12),
];

const HINT: &str =
    "undistort the photos with `colmap image_undistorter`, which writes a PINHOLE model, and use that model";

impl CameraModel {
    /// Returns the model with this number in binary files.
    pub(super) fn from_number(id: i32) -> Result<&'static Self, String> {
        let known = MODELS.iter().find(|m| m.id == id);
        known.ok_or_else(|| format!("camera model {id} is unknown, wanted 0 to 10; {HINT}"))
    }

    /// Returns the model with this name in text files.
    pub(super) fn from_name(name: &str) -> Result<&'static Self, String> {
        let known = MODELS.iter().find(|m| m.name == name);
        known.ok_or_else(|| format!("camera model {name} is unknown; {HINT}"))
    }

    /// Returns the camera with these parameters; their number must match the model.
    pub(super) fn camera(&self, size: Size, parameters: &[f64]) -> Result<ModelCamera, String> {
        let ([fx, fy, cx, cy], lens) = match (self.name, parameters) {
            ("SIMPLE_PINHOLE", &[f, cx, cy]) => ([f, f, cx, cy], LensModel::Pinhole),
            ("PINHOLE", &[fx, fy, cx, cy]) => ([fx, fy, cx, cy], LensModel::Pinhole),
            ("SIMPLE_RADIAL", &[f, cx, cy, k1]) => ([f, f, cx, cy], LensModel::SimpleRadial { k1 }),
            ("RADIAL", &[f, cx, cy, k1, k2]) => ([f, f, cx, cy], LensModel::Radial { k1, k2 }),
            ("OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2]) => {
                ([fx, fy, cx, cy], LensModel::OpenCv { k: [k1, k2, p1, p2] })
            }
            ("FULL_OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6]) => {
                ([fx, fy, cx, cy], LensModel::FullOpenCv { k: [k1, k2, p1, p2, k3, k4, k5, k6] })
            }
            _ => return Err(format!("camera model {} is not supported; {HINT}", self.name)),
        };
        let camera = Camera { size, fx, fy, cx, cy, lens: None };
        screen_camera(&camera, &lens)?;
        Ok(ModelCamera { camera, lens })
    }
}
