//! The properties of a sensor by itself, printed before it runs.

use super::Console;
use gs2e_sensor::SensorSet;
use gs2e_sensor::front_end::FrontEnd;
use gs2e_sensor::screening::{ConstantLightNoise, SensorScreening};
use gs2e_sensor::twin::NearTwin;

/// The grey whose noise stands for all greys.
const MIDDLE: usize = 2;

/// Prints the contrast and the noise of a sensor in a line, and in a table if the user asks for more.
/// `whose` precedes its warnings.
pub(super) fn report_screening(
    what: &str,
    whose: &str,
    screening: &SensorScreening,
    verbose: bool,
    console: &Console,
) {
    let ([on, off], quantity) = (screening.contrast, screening.quantity);
    let ConstantLightNoise { grey, total_hz, .. } = screening.noise[MIDDLE];
    console.note(&format!(
        "{what}: contrast ON {on:.4}, OFF {off:.4} in {quantity}; noise {total_hz:.4} Hz per pixel at grey {grey}"
    ));
    for n in screening.noise.iter().filter(|_| verbose) {
        let share = n.on_share.map_or(String::new(), |share| format!(", {:.1} % ON", 100.0 * share));
        let ConstantLightNoise { grey, leak_hz, total_hz, .. } = n;
        console.note(&format!(
            "  at grey {grey:3}: leak {leak_hz:.4} Hz, leak and noise {total_hz:.4} Hz{share}"
        ));
    }
    for warning in &screening.warnings {
        console.note(&format!("warning: {whose}: {warning}"));
    }
}

/// Prints the brightness that the pixels of the sensor see and the light of white, if they are not
/// the usual ones.
pub(super) fn report_front_end(front_end: &FrontEnd, console: &Console) {
    if !front_end.is_default() {
        console.note(&format!("  brightness: {front_end}"));
    }
}

/// Prints which sensors of a scene are noise-free twins of others, and the parameters that keep a
/// sensor from being one.
pub(super) fn report_twins(scene: &str, sensors: &SensorSet, console: &Console) {
    let twins: Vec<String> = sensors
        .twins()
        .iter()
        .map(|(clean, noisy)| format!("{clean} is {noisy} without its noise"))
        .collect();
    if !twins.is_empty() {
        console.note(&format!("twins of {scene}: {}", twins.join(", ")));
    }
    for NearTwin { name, noisy, differing } in sensors.near_twins() {
        console.note(&format!(
            "sensor of {scene}/{name}: no twin of {noisy}, because of {}; twin_of: {noisy} makes one",
            differing.join(", ")
        ));
    }
}
