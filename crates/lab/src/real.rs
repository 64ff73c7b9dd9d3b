//! Simulated streams against a recording of the same scene: each sensor sees the frames that a camera
//! recorded with its events.
//!
//! Three statements do not need the same events at the same times: the number of events of each
//! pixel, the share of ON events, and the intervals between events of a pixel. The distance of a
//! sensor from the recording is the sum of the Kolmogorov-Smirnov distances of both distributions
//! and of the difference of the ON shares, from 0 to 3. The inverse-Gaussian likelihood is that of
//! the recorded intervals under the law that fits the simulated ones: first passages of a Brownian
//! motion are inverse-Gaussian, the model of DVS-Voltmeter (Lin et al., ECCV 2022).

mod aligned;
mod blur;
mod events;
mod ladder;
mod light;
pub mod mask;
pub mod picture;
pub mod profile;
mod signed;

pub use aligned::{AlignedFigures, AlignedStudy, RecordedStream, align_sensors};
pub use light::LightCounts;

use gs2e_event::EventSink;
use gs2e_num::seed::Seed;
use gs2e_sensor::esim::EsimModel;
use gs2e_sensor::frames::{DenseFrame, FrameSequence};
use gs2e_sensor::v2e::{V2eModel, V2ePreset};
use gs2e_sensor::voltmeter::VoltmeterPreset;
use gs2e_sensor::{
    SensorChannel, SensorChoice, SensorSettings, SimulateError, SimulationAccount, simulate_all,
};
use profile::StreamProfile;
use serde::Serialize;
use std::ops::ControlFlow;

/// A sensor of the comparison.
#[derive(Debug, Clone)]
pub struct StudiedSensor {
    /// Its name in the table.
    pub name: String,
    /// The sensor.
    pub sensor: SensorChoice,
}

/// All presets: those of `voltmeter` by their names, the defaults of ESIM by the name of the model,
/// and those of `v2e` as `v2e-NAME`.
#[must_use]
pub fn all_presets() -> Vec<StudiedSensor> {
    let voltmeters = VoltmeterPreset::ALL
        .map(|preset| StudiedSensor { name: preset.name().to_owned(), sensor: preset.model().into() });
    let esim = SensorChoice::from(EsimModel::default());
    let esim = StudiedSensor { name: esim.name().to_owned(), sensor: esim };
    let v2es = V2ePreset::ALL.map(|preset| {
        let sensor = SensorChoice::from(V2eModel::from(preset));
        StudiedSensor { name: format!("{}-{}", sensor.name(), preset.name()), sensor }
    });
    voltmeters.into_iter().chain([esim]).chain(v2es).collect()
}

/// A sensor compared with the recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ComparedSensor {
    /// Name of the sensor.
    pub sensor: String,
    /// Number of events.
    pub events: u64,
    /// Events beyond the cap per pixel and frame, which were dropped.
    pub capped: u64,
    /// Events per pixel and second.
    pub rate_ev_px_s: f64,
    /// Share of ON events; null without events.
    pub on_share: Option<f64>,
    /// Kolmogorov-Smirnov distance of the numbers of events over the pixels.
    pub ks_counts: f64,
    /// Kolmogorov-Smirnov distance of the intervals between the events of a pixel.
    pub ks_intervals: f64,
    /// Mean logarithm of the density of the recorded intervals (in us) under the inverse-Gaussian
    /// law that fits the simulated ones; null if there is no such law.
    pub ln_density: Option<f64>,
    /// Sum of both distances and of the difference of the ON shares.
    pub distance: f64,
}

/// The result of a comparison.
#[derive(Debug, Clone)]
pub struct RealStudy {
    /// The recording.
    pub real: StreamProfile,
    /// The sensors, the nearest first.
    pub rows: Vec<ComparedSensor>,
    /// Their streams, in the same order.
    pub profiles: Vec<StreamProfile>,
    /// Length of the window without what is masked, seconds.
    pub seconds: f64,
}

/// A recording.
#[derive(Debug)]
pub struct ProfiledRecording {
    /// Its profile.
    pub profile: StreamProfile,
    /// The profile of an empty stream whose times count from the first frame.
    pub empty: StreamProfile,
}

/// Simulates every sensor on the frames, which are read once, and compares the streams with the
/// recording.
///
/// # Errors
/// A frame cannot be read, a sensor fails, or `tap` stops.
pub fn compare_sensors(
    frames: &mut dyn FrameSequence,
    sensors: &[StudiedSensor],
    recording: ProfiledRecording,
    seed: Seed,
    tap: &mut dyn FnMut(&DenseFrame) -> ControlFlow<()>,
) -> Result<RealStudy, SimulateError> {
    let ProfiledRecording { profile: real, empty } = recording;
    let mut profiles = vec![empty; sensors.len()];
    let accounts = simulate_sensors(frames, sensors, &mut profiles, seed, tap)?;
    let found = compare_all(sensors, &accounts, &real, &profiles);
    let (rows, profiles) = ranked(found.into_iter().zip(profiles), |(row, _)| row).into_iter().unzip();
    Ok(RealStudy { seconds: real.seconds(), real, rows, profiles })
}

/// Passes the frames to all sensors, which write to one sink each.
fn simulate_sensors<S: EventSink>(
    frames: &mut dyn FrameSequence,
    sensors: &[StudiedSensor],
    sinks: &mut [S],
    seed: Seed,
    tap: &mut dyn FnMut(&DenseFrame) -> ControlFlow<()>,
) -> Result<Vec<SimulationAccount>, SimulateError> {
    let capped: Vec<SensorChoice> = sensors.iter().map(|studied| with_cap(&studied.sensor)).collect();
    let size = frames.size();
    let mut channels = Vec::new();
    for (sensor, sink) in capped.iter().zip(sinks) {
        let model = sensor.as_model();
        let pixels = model.start(size, [0, 0], seed)?;
        channels.push(SensorChannel::new(pixels, sink).behind(model.front_end()));
    }
    simulate_all(frames, &mut channels, tap)
}

/// Each sensor compared with the recording.
fn compare_all(
    sensors: &[StudiedSensor],
    accounts: &[SimulationAccount],
    real: &StreamProfile,
    profiles: &[StreamProfile],
) -> Vec<ComparedSensor> {
    let all = sensors.iter().zip(accounts).zip(profiles);
    all.map(|((studied, account), made)| compare(&studied.name, account, real, made)).collect()
}

/// The sensors with what belongs to them, the nearest first.
fn ranked<T>(all: impl Iterator<Item = T>, row: impl Fn(&T) -> &ComparedSensor) -> Vec<T> {
    let mut all: Vec<T> = all.collect();
    // Ties by name, so that the order of the arguments does not matter.
    all.sort_by(|a, b| {
        let [a, b] = [a, b].map(&row);
        a.distance.total_cmp(&b.distance).then_with(|| a.sensor.cmp(&b.sensor))
    });
    all
}

/// A sensor that drops and counts the events beyond its cap. A preset that fires far too often is a
/// result here, and no error.
fn with_cap(sensor: &SensorChoice) -> SensorChoice {
    sensor.clone().with_settings(SensorSettings { allow_cap: true, ..sensor.settings() })
}

fn compare(
    name: &str,
    account: &SimulationAccount,
    real: &StreamProfile,
    made: &StreamProfile,
) -> ComparedSensor {
    let (ks_counts, ks_intervals) = (real.count_distance(made), real.intervals().distance(made.intervals()));
    // A stream without events has no share, and differs as much as a share can.
    let shares = match (real.on_share(), made.on_share()) {
        (Some(a), Some(b)) => (a - b).abs(),
        (None, None) => 0.0,
        _ => 1.0,
    };
    ComparedSensor {
        sensor: name.to_owned(),
        events: made.events(),
        capped: account.capped,
        rate_ev_px_s: made.per_pixel() / real.seconds(),
        on_share: made.on_share(),
        ks_counts,
        ks_intervals,
        ln_density: made.intervals().inverse_gaussian().and_then(|law| real.intervals().mean_ln_density(law)),
        distance: ks_counts + ks_intervals + shares,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_image::Size;
    use gs2e_sensor::frames::array::{ArrayFrames, ArraySamples, FullScale};
    use gs2e_sensor::simulate_one;

    const SIZE: Size = Size { width: 24, height: 16 };
    const COUNT: usize = 120;

    /// 0.24 s of gratings that move over a ramp from dark to bright.
    fn frames() -> ArrayFrames {
        let stamps: Vec<i64> = (0..COUNT as i64).map(|i| 2000 * i).collect();
        let grey = |i: usize| {
            let (frame, x, y) = (i / SIZE.pixels(), i % 24, i / 24 % 16);
            let wave = (0.5 * x as f32 - 0.15 * frame as f32 + 0.3 * y as f32).sin();
            (6.0 + 12.0 * y as f32) * (1.0 + 0.6 * wave)
        };
        let samples = (0..COUNT * SIZE.pixels()).map(grey).collect();
        ArrayFrames::new(SIZE, ArraySamples::Floats(samples, FullScale::Grey255), &stamps).unwrap()
    }

    /// A recording by each preset in turn, with the noise of another seed: this preset is nearest.
    #[test]
    fn the_preset_that_made_the_recording_wins() {
        let empty = StreamProfile::new(SIZE, 0..=2000 * (COUNT as i64 - 1), 0);
        let mut go_on = |_: &DenseFrame| ControlFlow::Continue(());
        for planted in all_presets() {
            let mut real = empty.clone();
            let model = with_cap(&planted.sensor);
            simulate_one(&mut frames(), model.as_model(), Seed(99), &mut real, &mut go_on).unwrap();
            let recording = ProfiledRecording { profile: real, empty: empty.clone() };
            let found = compare_sensors(&mut frames(), &all_presets(), recording, Seed(1), &mut go_on);
            let found = found.unwrap();
            let seen: Vec<String> =
                found.rows.iter().map(|row| format!("{} {:.4}", row.sensor, row.distance)).collect();
            println!("{}: {}", planted.name, seen.join(", "));
            assert_eq!(found.rows[0].sensor, planted.name);
            let svg = picture::intervals_svg(&found);
            assert!(svg.contains(">recording<") && svg.contains(&format!(">{}<", planted.name)));
        }
    }
}
