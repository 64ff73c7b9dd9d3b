//! Event sensors: from luminance over time to events.
//!
//! A sensor knows the colours of frames, or their luminance, and time; it sees neither the scene nor the renderer.

mod cap;
mod course;
mod detector;
pub mod esim;
pub mod front_end;
mod input;
mod label;
pub mod noise;
mod own_events;
mod pairs;
pub mod screening;
pub mod statistics;
pub mod v2e;
pub mod voltmeter;
mod window;

use crate::event::EventSink;
use crate::frames::{Frame, FrameError, Frames};
use crate::image::Size;
use crate::seed::Seed;
use crate::units::Hertz;
use front_end::FrontEnd;
use screening::{ScreenError, Screening};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use voltmeter::Between;

/// A sensor of the recipe.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sensor {
    /// The stochastic model of DVS-Voltmeter.
    Voltmeter(voltmeter::Voltmeter),
    /// Thresholds on the logarithm, as in ESIM.
    Esim(esim::Esim),
    /// A low-pass filter, leak and shot noise, as in v2e.
    V2e(v2e::V2e),
}

impl Sensor {
    /// The model behind the recipe's choice.
    #[must_use]
    pub fn as_model(&self) -> &dyn Model {
        match self {
            Self::Voltmeter(sensor) => sensor,
            Self::Esim(sensor) => sensor,
            Self::V2e(sensor) => sensor,
        }
    }

    /// The model's name in recipes.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Voltmeter(_) => "voltmeter",
            Self::Esim(_) => "esim",
            Self::V2e(_) => "v2e",
        }
    }

    /// How it takes brightness between frames.
    #[must_use]
    pub fn between(&self) -> Between {
        match self {
            Self::Voltmeter(sensor) => sensor.between,
            Self::Esim(_) | Self::V2e(_) => Between::Linear,
        }
    }

    /// Whole microseconds between two events of a pixel, as files stamp them, at least; 0 where there is no refractory
    /// period.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "a thousand seconds at most")]
    pub fn dead_us(&self) -> i64 {
        match self {
            Self::Voltmeter(_) => 0,
            Self::Esim(sensor) => sensor.refractory.period_us.floor() as i64,
            Self::V2e(sensor) => sensor.refractory.period_us.floor() as i64,
        }
    }

    /// The pixels that fire by themselves.
    #[must_use]
    pub fn hot_pixels(&self) -> noise::HotPixels {
        match self {
            Self::Voltmeter(sensor) => sensor.hot_pixels,
            Self::Esim(sensor) => sensor.hot_pixels,
            Self::V2e(sensor) => sensor.hot_pixels,
        }
    }

    /// What the sensor will do by itself at this frame rate.
    ///
    /// # Errors
    /// When its parameters make no usable stream.
    pub fn screen(&self, rate: Hertz) -> Result<Screening, ScreenError> {
        match self {
            Self::Voltmeter(sensor) => sensor.screen(rate),
            Self::Esim(sensor) => sensor.screen(rate),
            Self::V2e(sensor) => sensor.screen(rate),
        }
    }
}

/// The sensors that see one rendering.
#[derive(Debug, Clone, PartialEq)]
pub enum Sensors {
    /// The one.
    One(Sensor),
    /// Several, by name.
    Named(BTreeMap<String, Sensor>),
}

impl Sensors {
    /// Each, with its name where it has one, in the order of names.
    pub fn iter(&self) -> impl Iterator<Item = (Option<&str>, &Sensor)> {
        let (one, named) = match self {
            Self::One(sensor) => (Some((None, sensor)), None),
            Self::Named(sensors) => (None, Some(sensors.iter().map(|(name, s)| (Some(name.as_str()), s)))),
        };
        one.into_iter().chain(named.into_iter().flatten())
    }
}

/// Parameters of a sensor.
pub trait Model {
    /// Version of the law that draws the events; raised when the same parameters come to mean other events.
    fn law_version(&self) -> u32;

    /// What stands before its pixels: the frames that they see are those behind it.
    fn front_end(&self) -> FrontEnd;

    /// Brightness contrast of one ON and of one OFF event, as a difference of natural logarithms.
    fn contrast(&self) -> (f64, f64);

    /// Whether its events are labelled as signal or noise.
    fn labels(&self) -> bool;

    /// Pixels at rest, about to see the first frame of a sequence. `origin` is the sensor position of the frames'
    /// top-left pixel, so that a crop draws the noise of the whole.
    ///
    /// # Errors
    /// When a parameter is outside its range, or a pixel outside the 65536 x 65536 that events can name.
    fn start(&self, size: Size, origin: [u16; 2], seed: Seed) -> Result<Box<dyn Pixels>, SensorError>;
}

/// Whether every pixel of a frame has coordinates that events can hold.
fn check_extent(size: Size, origin: [u16; 2]) -> Result<(), SensorError> {
    let fits = |extent: u32, from: u16| u64::from(extent) + u64::from(from) <= 1 << 16;
    if fits(size.width, origin[0]) && fits(size.height, origin[1]) {
        return Ok(());
    }
    let [x, y] = origin;
    Err(SensorError::Setup(format!(
        "frames of {size} at ({x}, {y}) reach beyond the 65536 columns and rows of events"
    )))
}

/// State of a sensor's pixels.
pub trait Pixels {
    /// Sees the next frame and hands over the events that are now certain.
    ///
    /// # Errors
    /// When a pixel exceeds its cap, or the sink fails.
    fn advance(&mut self, frame: &Frame, sink: &mut dyn EventSink) -> Result<(), SensorError>;

    /// Hands over the rest, up to and including the last frame's stamp, and the account of the run.
    ///
    /// # Errors
    /// As [`Pixels::advance`].
    fn finish(&mut self, sink: &mut dyn EventSink) -> Result<Account, SensorError>;
}

/// What happened in a simulation, over all pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Account {
    /// Events handed over.
    pub events: u64,
    /// Of these, brighter.
    pub on: u64,
    /// Of these, darker.
    pub off: u64,
    /// Pairs of events of one pixel in the same microsecond.
    pub same_us_same_pixel: u64,
    /// Luminance values below zero, set to zero.
    pub negative_luminance: u64,
    /// Most events of one pixel between two frames.
    pub max_per_pixel_frame: u64,
    /// Leaf cells of the clock visited.
    pub leaves: u64,
    /// Cells split.
    pub splits: u64,
    /// Pixels with at least one event.
    pub active_pixels: u64,
    /// Pixels whose event balance differs from their drift by more than the law allows (numerics O1); 0 in a
    /// sound run.
    pub drift_violations: u64,
    /// The largest such difference over its bound: at most 1 in a sound run.
    pub drift_worst: f64,
    /// Events left out because of the cap.
    #[serde(default, skip_serializing_if = "is_default")]
    pub capped: u64,
}

/// Whether a value is its type's default, which stands in no record: older ones do not have it.
fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// Why a simulation cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum SensorError {
    /// A pixel fires more often than the cap allows.
    #[error(
        "pixel ({x}, {y}) fires more than {cap} events between frames {frame} and {next} (luminance {before} to \
         {after} of 255)", next = frame + 1
    )]
    Cap {
        /// Column.
        x: u16,
        /// Row.
        y: u16,
        /// Number of the earlier frame.
        frame: usize,
        /// Luminance before, 0..255.
        before: f32,
        /// Luminance after.
        after: f32,
        /// `max_events_per_pixel_frame`.
        cap: u32,
    },
    /// The sensor cannot be set up.
    #[error("{0}")]
    Setup(String),
    /// A frame that does not follow the one before.
    #[error("frame {frame}: {because}")]
    Frame {
        /// Its number.
        frame: usize,
        /// What was found and what was wanted.
        because: String,
    },
    /// The events could not be written.
    #[error("events cannot be written: {0}")]
    Sink(#[from] std::io::Error),
}

/// Why a simulation over a sequence of frames ended early.
#[derive(Debug, thiserror::Error)]
pub enum SimulateError {
    /// The next frame could not be had.
    #[error(transparent)]
    Frames(#[from] FrameError),
    /// The sensor could not go on.
    #[error(transparent)]
    Sensor(#[from] SensorError),
    /// The caller asked for the end.
    #[error("interrupted")]
    Interrupted,
}

/// A sensor at work, and where its events go.
pub struct Channel<'a> {
    pixels: Box<dyn Pixels>,
    sink: &'a mut dyn EventSink,
    front_end: FrontEnd,
    watch: Option<&'a mut dyn FnMut(&Frame)>,
}

impl<'a> Channel<'a> {
    /// Pixels at rest whose events will go to `sink`; they see the frames as they are.
    pub fn new(pixels: Box<dyn Pixels>, sink: &'a mut dyn EventSink) -> Self {
        Self { pixels, sink, front_end: FrontEnd::default(), watch: None }
    }

    /// The same behind a front end.
    #[must_use]
    pub fn behind(self, front_end: FrontEnd) -> Self {
        Self { front_end, ..self }
    }

    /// The same with somebody who is shown each frame as the pixels see it.
    #[must_use]
    pub fn watched(self, watch: &'a mut dyn FnMut(&Frame)) -> Self {
        Self { watch: Some(watch), ..self }
    }

    fn see(&mut self, frame: &Frame) -> Result<(), SensorError> {
        self.pixels.advance(frame, self.sink)?;
        self.watch.iter_mut().for_each(|watch| watch(frame));
        Ok(())
    }
}

impl std::fmt::Debug for Channel<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Channel").finish_non_exhaustive()
    }
}

/// Shows a whole sequence of frames to sensors, all in one pass, and gives the account of each. Every front end sees a
/// frame once, however many sensors are behind it. `tap` is shown each frame itself after the sensors; it may break the
/// run off.
///
/// # Errors
/// When a frame cannot be had, a sensor cannot go on, or `tap` breaks.
pub fn simulate_all(
    frames: &mut dyn Frames,
    channels: &mut [Channel<'_>],
    tap: &mut dyn FnMut(&Frame) -> ControlFlow<()>,
) -> Result<Vec<Account>, SimulateError> {
    let front_ends: Vec<FrontEnd> = channels.iter().map(|channel| channel.front_end).collect();
    for front_end in &front_ends {
        front_end.validate().map_err(|error| SensorError::Setup(error.to_string()))?;
    }
    if front_ends.iter().any(FrontEnd::needs_colour) {
        frames.want_colour();
    }
    while let Some(frame) = frames.next()? {
        for (i, front_end) in front_ends.iter().enumerate() {
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
    channels.iter_mut().map(|Channel { pixels, sink, .. }| Ok(pixels.finish(*sink)?)).collect()
}

/// Shows a whole sequence of frames to one sensor, as [`simulate_all`].
///
/// # Errors
/// As [`simulate_all`].
pub fn simulate(
    frames: &mut dyn Frames,
    model: &dyn Model,
    seed: Seed,
    sink: &mut dyn EventSink,
    tap: &mut dyn FnMut(&Frame) -> ControlFlow<()>,
) -> Result<Account, SimulateError> {
    let pixels = model.start(frames.size(), [0, 0], seed)?;
    let channel = Channel::new(pixels, sink).behind(model.front_end());
    let mut accounts = simulate_all(frames, &mut [channel], tap)?;
    Ok(accounts.pop().expect("an account a sensor"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::Event;
    use crate::frames::array::{ArrayFrames, FullScale, Samples};
    use crate::image::Image;

    /// Every member of the family, without noise.
    fn quiet() -> Vec<Sensor> {
        let [k1, k2, ..] = voltmeter::Preset::Dvs346.k();
        let voltmeter = voltmeter::Voltmeter::new([k1, k2, 0.0, 0.0, 0.0, 0.0]);
        let official = voltmeter::Voltmeter { law: voltmeter::Law::Official, ..voltmeter.clone() };
        vec![
            Sensor::Voltmeter(voltmeter),
            Sensor::Voltmeter(official),
            Sensor::Esim(esim::Esim::default()),
            Sensor::V2e(v2e::V2e::from(v2e::Preset::Clean)),
        ]
    }

    /// Every member as it is.
    fn usual() -> Vec<Sensor> {
        let presets = voltmeter::Preset::ALL.map(|preset| voltmeter::Voltmeter::new(preset.k()));
        let official = voltmeter::Voltmeter { law: voltmeter::Law::Official, ..presets[0].clone() };
        let threshold = noise::Threshold { on: 0.15, off: 0.2, spread: 0.03 };
        let refractory = noise::Refractory { period_us: 50.0, reference: noise::Reference::AtEnd };
        let hot_pixels = noise::HotPixels { share: 0.1, rate: 1000.0 };
        let esim = esim::Esim { threshold, refractory, hot_pixels, ..esim::Esim::default() };
        let redrawn = esim::Esim { mismatch: noise::Redraw::PerFrame, ..esim.clone() };
        let noisy = v2e::V2e { hot_pixels, ..v2e::V2e::from(v2e::Preset::Noisy) };
        let voltmeters = presets.into_iter().chain([official]).map(Sensor::Voltmeter);
        voltmeters.chain([Sensor::Esim(esim), Sensor::Esim(redrawn), Sensor::V2e(noisy)]).collect()
    }

    fn clip(grey: impl Fn(usize, usize) -> f32) -> ArrayFrames {
        let size = Size { width: 16, height: 9 };
        let stamps: Vec<i64> = (0..12).map(|i| 417 * i).collect();
        let samples = (0..12).flat_map(|i| (0..size.pixels()).map(move |p| (i, p)));
        let samples = samples.map(|(i, p)| grey(i, p)).collect();
        ArrayFrames::new(size, Samples::Floats(samples, FullScale::Grey255), &stamps).unwrap()
    }

    fn moving() -> ArrayFrames {
        clip(|i, p| 128.0 + 120.0 * ((p % 16 + 3 * i) as f32).sin())
    }

    fn run(sensor: &Sensor, mut frames: ArrayFrames) -> (Vec<Event>, Account) {
        let mut events = Vec::new();
        let mut go_on = |_: &Frame| ControlFlow::Continue(());
        let account = simulate(&mut frames, sensor.as_model(), Seed(1), &mut events, &mut go_on).unwrap();
        (events, account)
    }

    #[test]
    fn constant_light_without_noise_makes_no_event() {
        for sensor in quiet() {
            assert_eq!(run(&sensor, clip(|_, p| p as f32)).1, Account::default(), "{sensor:?}");
        }
    }

    #[test]
    fn streams_are_in_file_order_within_the_clip_and_counted() {
        for sensor in quiet().into_iter().chain(usual()) {
            let (events, account) = run(&sensor, moving());
            assert!(account.events > 100, "{sensor:?}");
            assert_eq!((events.len() as u64, account.on + account.off), (account.events, account.events));
            assert!(events.is_sorted_by_key(Event::file_order));
            assert!(events.iter().all(|event| event.t.0 > 0 && event.t.floor_micros() <= 417 * 11));
        }
    }

    #[test]
    fn a_seed_is_a_stream() {
        for sensor in usual() {
            assert_eq!(run(&sensor, moving()), run(&sensor, moving()));
        }
    }

    #[test]
    fn sensors_that_share_their_frames_see_what_each_sees_alone() {
        let sensors = usual();
        let mut streams: Vec<Vec<Event>> = vec![Vec::new(); sensors.len()];
        let size = moving().size();
        let start = |sensor: &Sensor| sensor.as_model().start(size, [0, 0], Seed(1)).unwrap();
        let channel = |(sensor, stream)| Channel::new(start(sensor), stream);
        let mut channels: Vec<Channel<'_>> = sensors
            .iter()
            .zip(streams.iter_mut().map(|s| -> &mut dyn EventSink { s }))
            .map(channel)
            .collect();
        let mut go_on = |_: &Frame| ControlFlow::Continue(());
        let accounts = simulate_all(&mut moving(), &mut channels, &mut go_on).unwrap();
        for ((sensor, stream), account) in sensors.iter().zip(streams).zip(accounts) {
            assert_eq!((stream, account), run(sensor, moving()), "{sensor:?}");
        }
    }

    /// Frames of three colours that change, and the encoded luminance of them.
    struct Coloured {
        greys: ArrayFrames,
        wanted: bool,
        colour: Option<Image<[f32; 3]>>,
    }

    impl Frames for Coloured {
        fn size(&self) -> Size {
            self.greys.size()
        }

        fn len(&self) -> usize {
            self.greys.len()
        }

        fn next(&mut self) -> Result<Option<Frame>, FrameError> {
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
        let weights = |rgb| front_end::Luminance::of(rgb).unwrap();
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
            seen.iter_mut().map(|seen| |frame: &Frame| seen.extend(frame.luminance.pixels())).collect();
        let sensor = &usual()[0];
        let mut channels = Vec::new();
        for ((stream, watch), front_end) in streams.iter_mut().zip(&mut watchers).zip(front_ends) {
            let pixels = sensor.as_model().start(frames.size(), [0, 0], Seed(1)).unwrap();
            channels.push(Channel::new(pixels, stream).behind(front_end).watched(watch));
        }
        let mut go_on = |_: &Frame| ControlFlow::Continue(());
        simulate_all(&mut frames, &mut channels, &mut go_on).unwrap();
        drop(channels);
        drop(watchers);
        // Red is what the greys are, blue its negative.
        let wanted = run(sensor, moving()).0;
        assert!(streams[0] == wanted && streams[1] == wanted && streams[3] == wanted);
        let negative = clip(|i, p| 255.0 - (128.0 + 120.0 * ((p % 16 + 3 * i) as f32).sin()));
        assert!(streams[2] == run(sensor, negative).0);
        assert!(seen[0] == seen[1] && seen[0] == seen[3]);
        assert!(seen[0].iter().zip(&seen[2]).all(|(red, blue)| blue.to_bits() == (255.0 - red).to_bits()));
    }

    #[test]
    fn a_front_end_that_is_none_is_refused() {
        let pixels = usual()[0].as_model().start(moving().size(), [0, 0], Seed(1)).unwrap();
        let mut events = Vec::new();
        let front_end = FrontEnd { exposure: 0.0, ..FrontEnd::default() };
        let mut channel = [Channel::new(pixels, &mut events).behind(front_end)];
        let mut go_on = |_: &Frame| ControlFlow::Continue(());
        let error = simulate_all(&mut moving(), &mut channel, &mut go_on).unwrap_err().to_string();
        assert_eq!(error, "the exposure is 0, wanted a finite number above 0");
    }

    #[test]
    fn a_run_can_be_broken_off() {
        let mut seen = Vec::new();
        let mut stop = |frame: &Frame| {
            seen.push(frame.index);
            if frame.index == 2 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let sensor = &usual()[0];
        let result = simulate(&mut moving(), sensor.as_model(), Seed(1), &mut Vec::new(), &mut stop);
        assert!(matches!(result, Err(SimulateError::Interrupted)));
        assert_eq!(seen, [0, 1, 2]);
    }
}
