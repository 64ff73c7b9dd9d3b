//! Simulation of several sensors: a sequence of frames is read once, and each sensor's events go to
//! its own sink.

use super::front_end::FrontEnd;
use super::{SensorError, SensorModel, SensorPixels, SimulationAccount};
use crate::frames::{DenseFrame, FrameError, FrameSequence};
use gs2e_event::EventSink;
use gs2e_num::seed::Seed;
use std::ops::ControlFlow;

/// The reason why a simulation ended early.
#[derive(Debug, thiserror::Error)]
pub enum SimulateError {
    /// The next frame could not be read or rendered.
    #[error(transparent)]
    Frames(#[from] FrameError),
    /// The sensor failed.
    #[error(transparent)]
    Sensor(#[from] SensorError),
    /// The caller stopped the simulation.
    #[error("interrupted")]
    Interrupted,
}

/// A sensor during a simulation, and the sink of its events.
pub struct SensorChannel<'a> {
    pixels: Box<dyn SensorPixels>,
    sink: &'a mut dyn EventSink,
    front_end: FrontEnd,
    watch: Option<&'a mut dyn FnMut(&DenseFrame)>,
}

impl<'a> SensorChannel<'a> {
    /// Pixels at rest that see the frames as they are and write to `sink`.
    pub fn new(pixels: Box<dyn SensorPixels>, sink: &'a mut dyn EventSink) -> Self {
        Self { pixels, sink, front_end: FrontEnd::default(), watch: None }
    }

    /// Places the pixels behind a front end.
    #[must_use]
    pub fn behind(self, front_end: FrontEnd) -> Self {
        Self { front_end, ..self }
    }

    /// Adds an observer of each frame as the pixels see it.
    #[must_use]
    pub fn watched(self, watch: &'a mut dyn FnMut(&DenseFrame)) -> Self {
        Self { watch: Some(watch), ..self }
    }

    /// Passes a frame to the pixels as they see it, without the front end.
    ///
    /// # Errors
    /// As [`SensorPixels::advance`].
    pub fn take(&mut self, frame: &DenseFrame) -> Result<(), SensorError> {
        self.see(frame)
    }

    /// Ends the sequence, and returns the counts.
    ///
    /// # Errors
    /// As [`SensorPixels::finish`].
    pub fn finish(&mut self) -> Result<SimulationAccount, SensorError> {
        self.pixels.finish(self.sink)
    }

    fn see(&mut self, frame: &DenseFrame) -> Result<(), SensorError> {
        self.pixels.advance(frame, self.sink)?;
        self.watch.iter_mut().for_each(|watch| watch(frame));
        Ok(())
    }
}

impl std::fmt::Debug for SensorChannel<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SensorChannel").finish_non_exhaustive()
    }
}

/// Passes a whole sequence of frames to sensors, once, and returns the counts of each. Each front
/// end converts a frame once, for all sensors behind it. `tap` gets each frame after the sensors,
/// and may stop the simulation.
///
/// # Errors
/// A frame cannot be read, a sensor fails, or `tap` stops.
pub fn simulate_all(
    frames: &mut dyn FrameSequence,
    channels: &mut [SensorChannel<'_>],
    tap: &mut dyn FnMut(&DenseFrame) -> ControlFlow<()>,
) -> Result<Vec<SimulationAccount>, SimulateError> {
    let front_ends: Vec<FrontEnd> = channels.iter().map(|channel| channel.front_end).collect();
    for front_end in &front_ends {
        front_end.validate().map_err(|error| SensorError::Setup(error.to_string()))?;
    }
    // Before the first frame: sources prepare colours only if they were asked for them by then.
    if front_ends.iter().any(FrontEnd::needs_colour) {
        frames.want_colour();
    }
    while let Some(frame) = frames.next()? {
        for (i, front_end) in front_ends.iter().enumerate() {
            // The sensors of this front end were served when it first occurred.
            if front_ends[..i].contains(front_end) {
                continue;
            }
            let seen = (!front_end.is_plain()).then(|| front_end.see(&frame, frames.colour()));
            let alike = channels.iter_mut().filter(|channel| channel.front_end == *front_end);
            for channel in alike {
                channel.see(seen.as_ref().unwrap_or(&frame))?;
            }
        }
        if tap(&frame).is_break() {
            return Err(SimulateError::Interrupted);
        }
    }
    channels.iter_mut().map(|SensorChannel { pixels, sink, .. }| Ok(pixels.finish(*sink)?)).collect()
}

/// Passes a whole sequence of frames to one sensor. See [`simulate_all`].
///
/// # Errors
/// As [`simulate_all`].
pub fn simulate_one(
    frames: &mut dyn FrameSequence,
    model: &dyn SensorModel,
    seed: Seed,
    sink: &mut dyn EventSink,
    tap: &mut dyn FnMut(&DenseFrame) -> ControlFlow<()>,
) -> Result<SimulationAccount, SimulateError> {
    let pixels = model.start(frames.size(), [0, 0], seed)?;
    let channel = SensorChannel::new(pixels, sink).behind(model.front_end());
    let mut accounts = simulate_all(frames, &mut [channel], tap)?;
    Ok(accounts.pop().expect("an account a sensor"))
}

#[cfg(test)]
mod tests {
    use super::super::{
        SensorChoice, SensorSettings, bandwidth, esim, front_end, latency, noise, v2e, voltmeter,
    };
    use super::*;
    use crate::frames::array::{ArrayFrames, ArraySamples, FullScale};
    use gs2e_event::Event;
    use gs2e_image::{Image, Size};

    /// The sensor with a bandwidth.
    fn slow(sensor: &voltmeter::VoltmeterModel) -> voltmeter::VoltmeterModel {
        let points = vec![bandwidth::BandwidthPoint { lux: 1.0, cutoff_hz: 2000.0 }];
        let bandwidth = bandwidth::PixelBandwidth { order: 2, points };
        voltmeter::VoltmeterModel { bandwidth, ..sensor.clone() }
    }

    /// All members of the family, without noise.
    fn quiet() -> Vec<SensorChoice> {
        let [k1, k2, ..] = voltmeter::VoltmeterPreset::Dvs346.k();
        let voltmeter = voltmeter::VoltmeterModel::new([k1, k2, 0.0, 0.0, 0.0, 0.0]);
        let official =
            voltmeter::VoltmeterModel { law: voltmeter::SamplerKind::Official, ..voltmeter.clone() };
        vec![
            SensorChoice::Voltmeter(slow(&voltmeter)),
            SensorChoice::Voltmeter(voltmeter),
            SensorChoice::Voltmeter(official),
            SensorChoice::Esim(esim::EsimModel::default()),
            SensorChoice::V2e(v2e::V2eModel::from(v2e::V2ePreset::Clean)),
        ]
    }

    /// All members of the family, with noise.
    fn noisy_family() -> Vec<SensorChoice> {
        let presets =
            voltmeter::VoltmeterPreset::ALL.map(|preset| voltmeter::VoltmeterModel::new(preset.k()));
        let official =
            voltmeter::VoltmeterModel { law: voltmeter::SamplerKind::Official, ..presets[0].clone() };
        let threshold = noise::ThresholdMismatch { on: 0.15, off: 0.2, spread: 0.03 };
        let refractory = noise::RefractoryPeriod { period_us: 50.0, reference: noise::ReferenceRule::AtEnd };
        let hot_pixels = noise::HotPixelNoise { share: 0.1, rate: 1000.0, ..noise::HotPixelNoise::default() };
        let esim = esim::EsimModel {
            threshold,
            settings: SensorSettings { refractory, hot_pixels, ..SensorSettings::default() },
            ..esim::EsimModel::default()
        };
        let redrawn = esim::EsimModel { mismatch: noise::RedrawRule::PerFrame, ..esim.clone() };
        let delays = latency::PixelLatency { us: 100.0, jitter_us: 30.0, tau_us: 10.0, max_us: 1000.0 };
        let front_end = FrontEnd { lux: Some(250.0), ..FrontEnd::default() };
        let late = esim::EsimModel {
            settings: SensorSettings { latency: Some(delays), front_end, ..esim.settings },
            ..esim.clone()
        };
        let noisy = v2e::V2eModel {
            settings: SensorSettings { hot_pixels, ..v2e::V2eModel::from(v2e::V2ePreset::Noisy).settings },
            ..v2e::V2eModel::from(v2e::V2ePreset::Noisy)
        };
        let slow = slow(&presets[0]);
        let voltmeters = presets.into_iter().chain([official, slow]).map(SensorChoice::Voltmeter);
        voltmeters
            .chain([esim, redrawn, late].map(SensorChoice::Esim))
            .chain([SensorChoice::V2e(noisy)])
            .collect()
    }

    fn clip(grey: impl Fn(usize, usize) -> f32) -> ArrayFrames {
        let size = Size { width: 16, height: 9 };
        let stamps: Vec<i64> = (0..12).map(|i| 417 * i).collect();
        let samples = (0..12).flat_map(|i| (0..size.pixels()).map(move |p| (i, p)));
        let samples = samples.map(|(i, p)| grey(i, p)).collect();
        ArrayFrames::new(size, ArraySamples::Floats(samples, FullScale::Grey255), &stamps).unwrap()
    }

    fn moving() -> ArrayFrames {
        clip(|i, p| 128.0 + 120.0 * ((p % 16 + 3 * i) as f32).sin())
    }

    fn run(sensor: &SensorChoice, mut frames: ArrayFrames) -> (Vec<Event>, SimulationAccount) {
        let mut events = Vec::new();
        let mut go_on = |_: &DenseFrame| ControlFlow::Continue(());
        let account = simulate_one(&mut frames, sensor.as_model(), Seed(1), &mut events, &mut go_on).unwrap();
        (events, account)
    }

    #[test]
    fn constant_light_without_noise_makes_no_event() {
        for sensor in quiet() {
            assert_eq!(run(&sensor, clip(|_, p| p as f32)).1, SimulationAccount::default(), "{sensor:?}");
        }
    }

    #[test]
    fn streams_are_in_file_order_within_the_clip_and_counted() {
        for sensor in quiet().into_iter().chain(noisy_family()) {
            let (events, account) = run(&sensor, moving());
            assert!(account.events > 100, "{sensor:?}");
            assert_eq!((events.len() as u64, account.on + account.off), (account.events, account.events));
            assert!(events.is_sorted_by_key(Event::file_order));
            assert!(events.iter().all(|event| event.t.0 > 0 && event.t.floor_micros() <= 417 * 11));
        }
    }

    #[test]
    fn a_seed_is_a_stream() {
        for sensor in noisy_family() {
            assert_eq!(run(&sensor, moving()), run(&sensor, moving()));
        }
    }

    #[test]
    fn sensors_that_share_their_frames_see_what_each_sees_alone() {
        let sensors = noisy_family();
        let mut streams: Vec<Vec<Event>> = vec![Vec::new(); sensors.len()];
        let size = moving().size();
        let start = |sensor: &SensorChoice| sensor.as_model().start(size, [0, 0], Seed(1)).unwrap();
        let channel = |(sensor, stream)| SensorChannel::new(start(sensor), stream);
        let mut channels: Vec<SensorChannel<'_>> = sensors
            .iter()
            .zip(streams.iter_mut().map(|s| -> &mut dyn EventSink { s }))
            .map(channel)
            .collect();
        let mut go_on = |_: &DenseFrame| ControlFlow::Continue(());
        let accounts = simulate_all(&mut moving(), &mut channels, &mut go_on).unwrap();
        for ((sensor, stream), account) in sensors.iter().zip(streams).zip(accounts) {
            assert_eq!((stream, account), run(sensor, moving()), "{sensor:?}");
        }
    }

    /// Coloured frames that change, with their encoded luminance.
    #[derive(Debug)]
    struct Coloured {
        greys: ArrayFrames,
        wanted: bool,
        colour: Option<Image<[f32; 3]>>,
    }

    impl FrameSequence for Coloured {
        fn size(&self) -> Size {
            self.greys.size()
        }

        fn len(&self) -> usize {
            self.greys.len()
        }

        fn next(&mut self) -> Result<Option<DenseFrame>, FrameError> {
            let frame = self.greys.next()?;
            let colours = frame.as_ref().map(|frame| {
                let colours = frame.luminance.pixels().iter().map(|l| [*l, 0.5 * l, 255.0 - l]).collect();
                Image::from_vec(self.size(), colours)
            });
            self.colour = colours.filter(|_| self.wanted);
            Ok(frame)
        }

        fn want_colour(&mut self) {
            self.wanted = true;
        }

        fn colour(&self) -> Option<&Image<[f32; 3]>> {
            self.colour.as_ref()
        }
    }

    #[test]
    fn each_sees_the_frames_through_its_own_front_end() {
        let weights = |rgb| front_end::LuminanceWeights::from_weights(rgb).unwrap();
        let plain = FrontEnd::default();
        let front_ends = [
            FrontEnd { luminance: weights([1.0, 0.0, 0.0]), ..plain },
            plain,
            FrontEnd { luminance: weights([0.0, 0.0, 1.0]), ..plain },
            FrontEnd { luminance: weights([1.0, 0.0, 0.0]), ..plain },
        ];
        let mut frames = Coloured { greys: moving(), wanted: false, colour: None };
        let mut streams: [Vec<Event>; 4] = Default::default();
        let mut seen: [Vec<f32>; 4] = Default::default();
        let mut watchers: Vec<_> =
            seen.iter_mut().map(|seen| |frame: &DenseFrame| seen.extend(frame.luminance.pixels())).collect();
        let sensor = &noisy_family()[0];
        let mut channels = Vec::new();
        for ((stream, watch), front_end) in streams.iter_mut().zip(&mut watchers).zip(front_ends) {
            let pixels = sensor.as_model().start(frames.size(), [0, 0], Seed(1)).unwrap();
            channels.push(SensorChannel::new(pixels, stream).behind(front_end).watched(watch));
        }
        let mut go_on = |_: &DenseFrame| ControlFlow::Continue(());
        simulate_all(&mut frames, &mut channels, &mut go_on).unwrap();
        drop(channels);
        drop(watchers);
        // Red equals the grey value, blue is its negative.
        let wanted = run(sensor, moving()).0;
        assert!(streams[0] == wanted && streams[1] == wanted && streams[3] == wanted);
        let negative = clip(|i, p| 255.0 - (128.0 + 120.0 * ((p % 16 + 3 * i) as f32).sin()));
        assert!(streams[2] == run(sensor, negative).0);
        assert!(seen[0] == seen[1] && seen[0] == seen[3]);
        assert!(seen[0].iter().zip(&seen[2]).all(|(red, blue)| blue.to_bits() == (255.0 - red).to_bits()));
    }

    #[test]
    fn a_front_end_that_is_none_is_refused() {
        let pixels = noisy_family()[0].as_model().start(moving().size(), [0, 0], Seed(1)).unwrap();
        let mut events = Vec::new();
        let front_end = FrontEnd { exposure: 0.0, ..FrontEnd::default() };
        let mut channel = [SensorChannel::new(pixels, &mut events).behind(front_end)];
        let mut go_on = |_: &DenseFrame| ControlFlow::Continue(());
        let error = simulate_all(&mut moving(), &mut channel, &mut go_on).unwrap_err().to_string();
        assert_eq!(error, "the exposure is 0, wanted a finite number above 0");
    }

    #[test]
    fn a_run_can_be_broken_off() {
        let mut seen = Vec::new();
        let mut stop = |frame: &DenseFrame| {
            seen.push(frame.index);
            if frame.index == 2 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let sensor = &noisy_family()[0];
        let result = simulate_one(&mut moving(), sensor.as_model(), Seed(1), &mut Vec::new(), &mut stop);
        assert!(matches!(result, Err(SimulateError::Interrupted)));
        assert_eq!(seen, [0, 1, 2]);
    }
}
