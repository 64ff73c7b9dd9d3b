//! Short synthetic clips, and the events of a sensor for them.

pub use gs2e_num::seed::ks::scaled_distance as ks;

use gs2e_event::{Event, Polarity};
use gs2e_image::Size;
use gs2e_num::seed::Seed;
use gs2e_sensor::frames::array::{ArrayFrames, ArraySamples, FullScale};
use gs2e_sensor::{SensorModel, SimulationAccount, simulate_one};
use std::ops::ControlFlow;

/// Frames with this luminance, 0..255, as a function of column, row and time in us.
///
/// # Panics
/// Stamps do not increase.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "frames hold 32 bits")]
pub(crate) fn make_clip(
    size: Size,
    stamps_us: &[i64],
    luminance: impl Fn(u32, u32, i64) -> f64,
) -> ArrayFrames {
    let mut samples = Vec::with_capacity(size.pixels() * stamps_us.len());
    for &t in stamps_us {
        for y in 0..size.height {
            samples.extend((0..size.width).map(|x| luminance(x, y, t) as f32));
        }
    }
    ArrayFrames::new(size, ArraySamples::Floats(samples, FullScale::Grey255), stamps_us)
        .expect("stamps increase, and there is a sample a pixel")
}

/// Simulates a sensor on a clip, from the beginning.
///
/// # Panics
/// The sensor refuses the clip. Clips and sensors of cases are valid.
#[must_use]
pub(crate) fn run_sensor(
    sensor: &dyn SensorModel,
    frames: &ArrayFrames,
    seed: u64,
) -> (Vec<Event>, SimulationAccount) {
    let (mut events, mut frames) = (Vec::new(), frames.clone());
    let mut go_on = |_: &_| ControlFlow::Continue(());
    let account = simulate_one(&mut frames, sensor, Seed(seed), &mut events, &mut go_on);
    (events, account.unwrap_or_else(|e| panic!("the sensor of a case: {e}")))
}

/// A pixel's events in order of time: nanoseconds and polarity.
pub type Train = Vec<(i64, Polarity)>;

/// The events pixel by pixel.
#[must_use]
pub fn by_pixel(size: Size, events: &[Event]) -> Vec<Train> {
    let mut pixels = vec![Vec::new(); size.pixels()];
    for event in events {
        pixels[usize::from(event.y) * size.width as usize + usize::from(event.x)]
            .push((event.t.0, event.polarity));
    }
    // Within a microsecond, a stream is ordered by pixel and polarity.
    pixels.iter_mut().for_each(|events: &mut Train| events.sort_by_key(|event| event.0));
    pixels
}
