//! Sensors by name.

use super::AxisModel;
use serde::{Deserialize, Serialize};

/// A sensor by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ImuPreset {
    /// No errors.
    Ideal,
    /// Bosch BMI088 (data sheet BST-BMI088-DS001): densities, offsets and ranges of the data sheet, which has no
    /// random walks; those are assumed.
    #[default]
    Bmi088,
    /// InvenSense MPU-6500, as in the DAVIS346 (data sheet PS-MPU-6500A-01): densities and ranges of the data
    /// sheet; offsets after calibration and random walks are assumed.
    Mpu6500,
}

/// Radians per degree.
const DEGREE: f64 = std::f64::consts::PI / 180.0;
/// m/s^2 per g.
const G: f64 = super::GRAVITY;

impl ImuPreset {
    /// The gyroscope (rad/s) and the accelerometer (m/s^2).
    #[must_use]
    pub fn axes(self) -> [AxisModel; 2] {
        match self {
            Self::Ideal => [AxisModel::IDEAL; 2],
            Self::Bmi088 => [
                AxisModel {
                    noise: 0.014 * DEGREE,
                    walk: 2.0e-5,
                    bias: 1.0 * DEGREE,
                    range: Some(2000.0 * DEGREE),
                },
                AxisModel { noise: 175e-6 * G, walk: 3.0e-4, bias: 20e-3 * G, range: Some(24.0 * G) },
            ],
            Self::Mpu6500 => [
                AxisModel {
                    noise: 0.01 * DEGREE,
                    walk: 2.0e-5,
                    bias: 1.0 * DEGREE,
                    range: Some(2000.0 * DEGREE),
                },
                AxisModel { noise: 300e-6 * G, walk: 3.0e-4, bias: 20e-3 * G, range: Some(16.0 * G) },
            ],
        }
    }
}
