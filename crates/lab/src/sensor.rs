//! A sensor is shown steps of known height and constant light, and its answers are compared with what
//! it states: the checks `contrast` and `noise_curve`.

pub mod contrast;
pub mod noise_curve;
pub mod picture;

use gs2e_event::Event;
use gs2e_image::{Image, Size};
use gs2e_num::seed::Seed;
use gs2e_num::units::Timestamp;
use gs2e_sensor::frames::DenseFrame;
use gs2e_sensor::{SensorChannel, SensorChoice, SensorError};
use serde::Serialize;

pub use contrast::{ContrastRow, measure_contrast};
pub use noise_curve::{NoiseCurve, NoiseRow, measure_noise};

/// The answers of a sensor.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SensorStudy {
    /// Check `contrast`: one row per light and polarity.
    pub contrast: Vec<ContrastRow>,
    /// Check `noise_curve`.
    pub noise: NoiseCurve,
}

impl SensorStudy {
    /// Returns true if both checks pass.
    #[must_use]
    pub fn passes(&self) -> bool {
        self.contrast.iter().all(|row| row.passes) && self.noise.passes
    }
}

/// The events of a sensor that sees these greys at these times, ns. The front end is left out: the
/// greys are what the pixels see.
fn show(
    sensor: &SensorChoice,
    size: Size,
    frames: &[(i64, Vec<f32>)],
    seed: Seed,
) -> Result<Vec<Event>, SensorError> {
    let mut events = Vec::new();
    // A latency changes neither thresholds nor rates, and its events may come after the last frame.
    let sensor = sensor.without_latency();
    let pixels = sensor.as_model().start(size, [0, 0], seed)?;
    let mut channel = SensorChannel::new(pixels, &mut events);
    for (index, (t, greys)) in frames.iter().enumerate() {
        let luminance = Image::from_vec(size, greys.clone());
        channel.take(&DenseFrame { index, t: Timestamp(*t), luminance, rate: None })?;
    }
    channel.finish()?;
    Ok(events)
}
