//! Event sensors: from luminance over time to events.
//!
//! A sensor knows time and the luminance (or the colours) of frames. It knows neither the scene nor
//! the renderer.
//!
//! # Examples
//!
//! ```
//! use gs2e_event::Polarity;
//! use gs2e_num::seed::Seed;
//! use gs2e_sensor::frames::array::{ArrayFrames, ArraySamples};
//! use gs2e_sensor::{SensorChoice, simulate_one, voltmeter::VoltmeterPreset};
//! use std::ops::ControlFlow::Continue;
//!
//! // The left pixel becomes four times as bright within a millisecond, and the right one stays.
//! let samples = ArraySamples::Bytes(vec![50, 90, 200, 90]);
//! let mut frames = ArrayFrames::new(gs2e_image::Size { width: 2, height: 1 }, samples, &[0, 1000])?;
//! let sensor = SensorChoice::from(VoltmeterPreset::Davis346.model()).without_noise();
//! let mut events = Vec::new();
//! simulate_one(&mut frames, sensor.as_model(), Seed(1), &mut events, &mut |_| Continue(()))?;
//! assert!(!events.is_empty() && events.iter().all(|e| e.x == 0 && e.polarity == Polarity::On));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod bandwidth;
mod cap;
mod chain;
mod choice;
mod course;
mod dead_time;
mod detector;
pub mod esim;
mod event_file;
pub mod frames;
pub mod front_end;
mod input;
mod label;
pub mod latency;
mod named;
pub mod noise;
mod pairs;
mod parameters;
pub mod readout;
pub mod screening;
mod set;
mod simulate;
mod spontaneous;
pub mod statistics;
pub mod twin;
pub mod v2e;
pub mod voltmeter;
mod window;

pub use choice::SensorChoice;
pub use event_file::SimulatedStream;
pub use parameters::{QuietCells, SensorFacts, SensorParameters, SensorSettings};
pub use set::SensorSet;
pub use simulate::{SensorChannel, SimulateError, simulate_all, simulate_one};

use crate::frames::DenseFrame;
use chain::{FilteredPixels, PixelArray};
use front_end::FrontEnd;
use gs2e_event::EventSink;
use gs2e_image::Size;
use gs2e_num::seed::Seed;
use latency::{LateEvents, LatencyAccount};
use readout::{BusState, ReadoutAccount};
use serde::{Deserialize, Serialize};

/// White on the grey scale of luminance.
pub const WHITE: f64 = 255.0;

/// The law of a sensor.
pub trait SensorModel: SensorParameters {
    /// Version of the law that draws the events. Raise it when the same parameters give other
    /// events.
    fn law_version(&self) -> u32;

    /// The front end, which turns frames into the brightness that the pixels see.
    fn front_end(&self) -> FrontEnd {
        self.settings().front_end
    }

    /// Brightness contrast of one ON and one OFF event, as a difference of natural logarithms.
    fn contrast(&self) -> (f64, f64);

    /// Returns true if its events are labelled as signal or noise.
    fn labels(&self) -> bool {
        self.settings().labels
    }

    /// Returns false if brightness alone makes all of its events.
    fn makes_noise(&self) -> bool {
        true
    }

    /// The pixels of the law, with the filters for the settings that the law does not follow itself.
    fn law_pixels(&self, array: PixelArray) -> FilteredPixels;

    /// Pixels at rest, before the first frame of a sequence. `origin` is the sensor position of the
    /// frames' top-left pixel, so that a crop draws the same noise as the whole image.
    ///
    /// # Errors
    /// A parameter is outside its range, or a pixel is outside the 65536 x 65536 that events can
    /// name.
    fn start(&self, size: Size, origin: [u16; 2], seed: Seed) -> Result<Box<dyn SensorPixels>, SensorError> {
        self.validate().map_err(|error| SensorError::Setup(error.to_string()))?;
        let settings = self.settings();
        let array = PixelArray { size, origin, seed, labels: settings.labels };
        array.check_extent()?;
        let late = settings.delays().map(|delays| LateEvents::new(delays, &settings, array));
        let bus = settings.readout.map(|bus| BusState::new(bus, array));
        Ok(Box::new(self.law_pixels(array).behind(late).behind(bus)))
    }
}

/// State of a sensor's pixels.
pub trait SensorPixels: std::fmt::Debug {
    /// Takes the next frame, and passes on the events that are now final.
    ///
    /// # Errors
    /// A pixel exceeds its cap, or the sink fails.
    fn advance(&mut self, frame: &DenseFrame, sink: &mut dyn EventSink) -> Result<(), SensorError>;

    /// Passes on the remaining events, up to and including the stamp of the last frame, and returns
    /// the counts.
    ///
    /// # Errors
    /// As [`SensorPixels::advance`].
    fn finish(&mut self, sink: &mut dyn EventSink) -> Result<SimulationAccount, SensorError>;
}

/// Counts of a simulation over all pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct SimulationAccount {
    /// Events passed on.
    pub events: u64,
    /// ON events among them.
    pub on: u64,
    /// OFF events among them.
    pub off: u64,
    /// Pairs of events of one pixel in the same microsecond.
    pub same_us_same_pixel: u64,
    /// Luminance values below zero, set to zero.
    pub negative_luminance: u64,
    /// Largest number of events of one pixel between two frames.
    pub max_per_pixel_frame: u64,
    /// Visited leaf cells of the clock.
    pub leaves: u64,
    /// Cells split.
    pub splits: u64,
    /// Pixels with at least one event.
    pub active_pixels: u64,
    /// Pixels with an event balance that differs from their drift by more than the law allows. 0 in
    /// a sound run.
    pub drift_violations: u64,
    /// Largest difference of that kind, divided by its bound. At most 1 in a sound run.
    pub drift_worst: f64,
    /// Events left out because of the cap.
    #[serde(default, skip_serializing_if = "is_default")]
    pub capped: u64,
    /// Counts of the readout, if a bus limits the rate of events.
    #[serde(default, skip_serializing_if = "is_default")]
    pub readout: Option<ReadoutAccount>,
    /// Counts of the delays, if events are late.
    #[serde(default, skip_serializing_if = "is_default")]
    pub latency: Option<LatencyAccount>,
    /// Events left out because they fell into the dead time of their pixel.
    #[serde(default, skip_serializing_if = "is_default")]
    pub refractory: u64,
}

impl SimulationAccount {
    /// Adds the events of one pixel, and the difference of their balance from its drift, relative to the
    /// bound of the law.
    fn add_pixel(&mut self, on: u32, off: u32, imbalance: f64) {
        self.on += u64::from(on);
        self.off += u64::from(off);
        self.active_pixels += u64::from(on + off > 0);
        self.drift_worst = self.drift_worst.max(imbalance);
        self.drift_violations += u64::from(imbalance > 1.0);
    }
}

/// Returns true if a value is the default of its type. Defaults are left out of records, because
/// older records lack the field.
fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// The reason why a simulation cannot continue.
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
        /// Index of the earlier frame.
        frame: usize,
        /// Luminance at the earlier frame, 0..255.
        before: f32,
        /// Luminance at the later frame, 0..255.
        after: f32,
        /// `max_events_per_pixel_frame`.
        cap: u32,
    },
    /// The sensor cannot be set up.
    #[error("{0}")]
    Setup(String),
    /// A frame does not fit the sequence.
    #[error("frame {frame}: {because}")]
    Frame {
        /// Index of the frame.
        frame: usize,
        /// The value found and the value wanted.
        because: String,
    },
    /// The events could not be written.
    #[error("events cannot be written: {0}")]
    Sink(#[from] std::io::Error),
}
