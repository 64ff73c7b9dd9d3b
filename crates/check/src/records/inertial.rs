//! Inertial data against the poses and the recipe of a path.

use super::{Finding, NAME, judge_agreement};
use crate::subject::Judgement;
use gs2e_trajectory::Trajectory;
use gs2e_trajectory::imu::ImuModel;
use gs2e_trajectory::imu::consistency::{InertialComparison, compare_inertial};
use gs2e_trajectory::imu::files::{
    SAMPLES, SAMPLES_HEAD, SENSOR, STATES, STATES_HEAD, read_gravity, read_lines, sensor_differences,
};

/// Files of inertial data, in the order [`InertialBytes::NAMES`].
#[derive(Debug, Clone, Copy)]
pub struct InertialBytes<'a>(pub [&'a [u8]; 3]);

impl InertialBytes<'_> {
    /// The names of the files.
    pub const NAMES: [&'static str; 3] = [SAMPLES, STATES, SENSOR];
}

/// A file of inertial data that cannot be read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InertialFault {
    /// Its name.
    pub file: &'static str,
    /// The reason.
    pub because: String,
}

/// Compares samples and states with the poses, and the description of the sensor with the recipe's.
///
/// # Errors
/// A file does not have its form.
pub fn judge_inertial(
    subject: &str,
    model: &ImuModel,
    files: InertialBytes<'_>,
    poses: &Trajectory,
) -> Result<Finding, InertialFault> {
    let fault = |file| move |because| InertialFault { file, because };
    let InertialBytes([samples, states, sensor]) = files;
    let samples = read_lines(samples, SAMPLES_HEAD).map_err(fault(SAMPLES))?;
    let states = read_lines(states, STATES_HEAD).map_err(fault(STATES))?;
    let gravity = read_gravity(sensor).map_err(fault(SENSOR))?;
    let differences = sensor_differences(sensor, model, gravity).map_err(fault(SENSOR))?;
    let mut faults: Vec<String> = differences.iter().map(|found| format!("imu/{SENSOR}: {found}")).collect();
    if (gravity.length() - model.gravity).abs() > 1e-9 {
        faults.push(format!("the gravity of imu/{SENSOR} is not the {} m/s^2 of the recipe", model.gravity));
    }
    let bounded = match compare_inertial(model, &samples, &states, gravity, poses) {
        Err(because) => {
            faults.insert(0, because);
            Vec::new()
        }
        Ok(InertialComparison { differences, bounded }) => {
            faults.extend(differences.iter().filter(|d| !d.is_allowed()).map(ToString::to_string));
            bounded
        }
    };
    Ok(match bounded.first().filter(|_| faults.is_empty()) {
        Some(sensor) => {
            let because = format!(
                "the {sensor} was not compared with the states: each of its samples is next to one at its bound"
            );
            Judgement::not_run(because).finding(subject, NAME, "imu")
        }
        None => judge_agreement(subject, "imu", "poses, states, samples and sensor of imu/", &faults),
    })
}
