//! Events compared with closed forms, with statistics that other programs measured, and with
//! themselves.
#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a test may panic, prints its statistics, and makes greys and stamps from small numbers"
)]

mod bandwidth;
mod clips;
mod cubic;
mod golden;
mod identity;
mod interval_law;
mod labels;
mod models;
mod renewal;

use gs2e_event::{Event, Polarity};
use gs2e_image::Size;
use gs2e_num::seed::Seed;
use gs2e_sensor::frames::array::{ArrayFrames, ArraySamples, FullScale};
use gs2e_sensor::{SensorModel, SimulationAccount, simulate_one};
use std::ops::ControlFlow;

/// Simulates a sequence from its beginning.
fn run(sensor: &dyn SensorModel, frames: &ArrayFrames, seed: u64) -> (Vec<Event>, SimulationAccount) {
    let (mut events, mut frames) = (Vec::new(), frames.clone());
    let mut go_on = |_: &_| ControlFlow::Continue(());
    let account = simulate_one(&mut frames, sensor, Seed(seed), &mut events, &mut go_on).unwrap();
    (events, account)
}

/// Frames with this luminance, 0..255, as a function of column, row and time in us.
fn frames(size: Size, stamps_us: &[i64], luminance: impl Fn(u32, u32, i64) -> f64) -> ArrayFrames {
    let mut samples = Vec::with_capacity(size.pixels() * stamps_us.len());
    for &t in stamps_us {
        for y in 0..size.height {
            samples.extend((0..size.width).map(|x| luminance(x, y, t) as f32));
        }
    }
    ArrayFrames::new(size, ArraySamples::Floats(samples, FullScale::Grey255), stamps_us).unwrap()
}

/// Events by pixel in order of time: nanoseconds and polarity.
fn by_pixel(size: Size, events: &[Event]) -> Vec<Vec<(i64, Polarity)>> {
    let mut pixels = vec![Vec::new(); size.pixels()];
    for event in events {
        pixels[usize::from(event.y) * size.width as usize + usize::from(event.x)]
            .push((event.t.0, event.polarity));
    }
    // Within a microsecond a stream is ordered by pixel and polarity.
    pixels.iter_mut().for_each(|events| events.sort_unstable_by_key(|event| event.0));
    pixels
}

/// Largest distance between the distribution function of a sorted sample and `cdf`, multiplied by
/// the square root of the sample's size. Critical values: 1.63 at alpha 1e-2, 2.23 at 1e-4, 2.69 at
/// 1e-6.
fn ks(sorted: &[f64], cdf: impl Fn(f64) -> f64) -> f64 {
    let n = sorted.len() as f64;
    let distance = |(i, x): (usize, &f64)| {
        let p = cdf(*x);
        (p - i as f64 / n).max((i + 1) as f64 / n - p)
    };
    sorted.iter().enumerate().map(distance).fold(0.0, f64::max) * n.sqrt()
}

/// Largest distance between the distribution functions of two sorted samples, scaled for the same
/// critical values.
fn ks_of_two(a: &[f64], b: &[f64]) -> f64 {
    let (n, m) = (a.len() as f64, b.len() as f64);
    let distance = |x: &f64| {
        let share = |sample: &[f64]| sample.partition_point(|y| y <= x) as f64 / sample.len() as f64;
        (share(a) - share(b)).abs()
    };
    a.iter().chain(b).map(distance).fold(0.0, f64::max) * (n * m / (n + m)).sqrt()
}

/// Mean and standard deviation (divisor n-1).
fn mean_and_deviation(sample: &[f64]) -> [f64; 2] {
    let n = sample.len() as f64;
    let mean = sample.iter().sum::<f64>() / n;
    [mean, (sample.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt()]
}
