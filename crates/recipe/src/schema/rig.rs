//! Rigs as written: cameras on one body.
//!
//! ```yaml
//! rig:
//!   cameras:
//!     - { name: left }                    # at the body's origin, with its axes
//!     - { name: right, extrinsic: { position: [0.1, 0, 0] } }
//!     - name: frames
//!       extrinsic: { position: [0.05, -0.03, 0], rotation: [0, 0, 0, 1] }
//!       camera: { width: 320, height: 240 }
//!       outputs: [sharp]
//!   stereo: [[left, right]]
//! ```

use super::super::field::Field;
use super::{CameraSection, SensorSection};
use crate::OutputKind;
use serde::Deserialize;

/// Cameras on one body that follows each trajectory. [scene.md](scene.md#rigs) describes them.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct RigSection {
    /// The cameras, at least one. The first one measures the speeds in pixels. Required.
    pub cameras: Field<Vec<Field<RigCameraSection>>>,
    /// Pairs of cameras that are rectified, by name, each camera in one pair at most: the first and the
    /// second, usually left and right. Default: `[]`.
    pub stereo: Field<Vec<Field<[Field<String>; 2]>>>,
}

/// A camera of a rig.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct RigCameraSection {
    /// Name, which is the camera's folder below that of each trajectory. Range: letters, digits, `.`, `_` and
    /// `-`; at most 100 bytes. Required.
    pub name: Field<String>,
    /// Place of the camera on the body. Default: `{}`.
    pub extrinsic: Field<ExtrinsicSection>,
    /// Size and intrinsics of the camera. Default: the recipe's `camera`.
    pub camera: Field<CameraSection>,
    /// Sensor of the camera. Default: the recipe's `sensor` or `sensors`.
    pub sensor: Field<SensorSection>,
    /// Products of the camera, among those of the recipe. Default: all of the recipe's but `imu`.
    pub outputs: Field<Vec<Field<OutputKind>>>,
}

/// Place of a camera on a body, by position and rotation or by a matrix. The axes of the body are those of a
/// camera: x right, y down, z forward.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct ExtrinsicSection {
    /// Centre of the camera in the axes of the body. Unit: scene units. Default: `[0, 0, 0]`.
    pub position: Field<[Field<f64>; 3]>,
    /// Rotation from camera to body: `[qx, qy, qz, qw]`. Range: of length 1. Default: `[0, 0, 0, 1]`.
    pub rotation: Field<[Field<f64>; 4]>,
    /// Rows of the 4x4 matrix that maps points of the body to points of the camera, instead of `position` and
    /// `rotation`: `T_cam_imu` of Kalibr, for an inertial sensor at the body. Unit: scene units. Default:
    /// none.
    pub camera_from_body: Field<[Field<[Field<f64>; 4]>; 4]>,
}
