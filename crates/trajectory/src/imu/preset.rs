//! Sensors by name.

use super::AxisModel;
use serde::{Deserialize, Serialize};

/// A sensor by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ImuPreset {
    /// No errors.
    Ideal,
    /// Bosch BMI088 (data sheet BST-BMI088-DS001): densities, offsets and ranges of the data sheet, which has
    /// no random walks; those are assumed.
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

/// What both gyroscopes have in common; the noise is that of the sensor.
const GYROSCOPE: AxisModel =
    AxisModel { noise: 0.0, walk: 2.0e-5, bias: 1.0 * DEGREE, range: Some(2000.0 * DEGREE) };
/// What both accelerometers have in common; noise and range are those of the sensor.
const ACCELEROMETER: AxisModel = AxisModel { noise: 0.0, walk: 3.0e-4, bias: 20e-3 * G, range: None };

impl ImuPreset {
    /// The gyroscope (rad/s) and the accelerometer (m/s^2).
    #[must_use]
    pub fn axes(self) -> [AxisModel; 2] {
        let of = |noise: [f64; 2], range: f64| {
            [
                AxisModel { noise: noise[0] * DEGREE, ..GYROSCOPE },
                AxisModel { noise: noise[1] * G, range: Some(range * G), ..ACCELEROMETER },
            ]
        };
        match self {
            Self::Ideal => [AxisModel::IDEAL; 2],
            Self::Bmi088 => of([0.014, 175e-6], 24.0),
            Self::Mpu6500 => of([0.01, 300e-6], 16.0),
        }
    }
}
