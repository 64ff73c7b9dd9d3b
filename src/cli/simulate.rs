//! `gs2e simulate`: simulates a sensor on the user's own frames, and writes its events.

mod account;
mod sensor;
mod sequence;
mod warnings;

pub(super) use sensor::sensor_from;
pub(super) use sequence::{FrameInputs, StampedFrames, full_scale, open_stack, parse_rate};

use super::convert::events::{EventOutputOptions, WRITTEN};
use super::output::{self, unwritable_file};
use super::{CommonArgs, Console, ExitKind, VerbError, input};
use account::SimulateReport;
use gs2e_event::file::{EventFile, EventFormat};
use gs2e_event::{EventFileError, EventSink};
use gs2e_files::{is_there, write_by_rename};
use gs2e_num::seed::Seed;
use gs2e_num::units::Hertz;
use gs2e_sensor::frames::DenseFrame;
use gs2e_sensor::frames::array::FullScale;
use gs2e_sensor::frames::motion::FrameMotion;
use gs2e_sensor::front_end::{ChannelDecode, GreyRange, LuminanceWeights};
use gs2e_sensor::voltmeter::{BetweenFrames, DriftGain, InitialVoltage, SamplerKind};
use gs2e_sensor::{
    SensorChannel, SensorChoice, SensorError, SimulateError, SimulatedStream, SimulationAccount, simulate_all,
};
use indicatif::ProgressBar;
use serde::de::DeserializeOwned;
use serde::de::value::{Error as WordError, StrDeserializer};
use std::io;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Arguments of `simulate`.
#[derive(Debug, clap::Args)]
#[command(group(clap::ArgGroup::new("input").required(true).args(["frames", "video"])))]
pub(super) struct SimulateArgs {
    /// Frames: a .npy [N, H, W] of uint8 or float32, a folder of images, a folder with
    /// DVS-Voltmeter's info.txt, or an .aedat4 with frames
    #[arg(long, value_name = "FILE or DIR")]
    frames: Option<PathBuf>,
    /// Video, decoded by the program ffmpeg, with the stamps of its frames
    #[arg(long, value_name = "FILE", conflicts_with_all = ["frames", "rates", "stamps", "fps", "full_scale"])]
    video: Option<PathBuf>,
    /// Change of luminance per second on the frames' own scale, for hermite: a .npy [N, H, W] of
    /// float32
    #[arg(long, value_name = "FILE")]
    rates: Option<PathBuf>,
    /// Time stamps of the frames: a .npy [N] of int64, in microseconds, strictly increasing
    #[arg(long, value_name = "FILE", conflicts_with = "fps")]
    stamps: Option<PathBuf>,
    /// Frames per second, if there are no stamps, such as 30 or 30000/1001
    #[arg(long, value_name = "N", value_parser = sequence::parse_rate)]
    fps: Option<Hertz>,
    /// Recipe, one of its sensors as recipe.yaml:name, file with the content of a recipe's
    /// `sensor`, or preset: davis346, evk4, dvxplorer, dvs346-paper, dvs240, gs2e-si, v2e-noisy, v2e-clean, esim
    #[arg(long, value_name = "FILE or NAME")]
    sensor: String,
    /// Contrast thresholds: the change of ln(brightness) that makes an event [default: the sensor's]
    #[arg(long, value_name = "C or ON,OFF", value_parser = sensor::parse_threshold)]
    threshold: Option<(f64, f64)>,
    /// Sampler: exact or official [default: the sensor's]
    #[arg(long, value_parser = parse_word::<SamplerKind>)]
    law: Option<SamplerKind>,
    /// Brightness that drives the drift: log or midpoint [default: the sensor's]
    #[arg(long, value_parser = parse_word::<DriftGain>)]
    gain: Option<DriftGain>,
    /// Brightness between two frames: linear, catmull or hermite [default: the sensor's]
    #[arg(long, value_parser = parse_word::<BetweenFrames>)]
    between: Option<BetweenFrames>,
    /// Voltages at the first frame: zero or stationary [default: the sensor's]
    #[arg(long, value_parser = parse_word::<InitialVoltage>)]
    initial: Option<InitialVoltage>,
    /// Weights of the colours: rec601, rec709, or R,G,B with sum 1 [default: the sensor's]
    #[arg(long, value_name = "NAME or R,G,B", value_parser = sensor::luminance)]
    luminance: Option<LuminanceWeights>,
    /// Decoding of the colours: none, or srgb for linear light [default: the sensor's]
    #[arg(long, value_parser = parse_word::<ChannelDecode>)]
    decode: Option<ChannelDecode>,
    /// Factor on the brightness, above 0 [default: the sensor's]
    #[arg(long, value_name = "FACTOR")]
    exposure: Option<f64>,
    /// Range that brightness is clamped to, in grey: 0,255 or 5,inf [default: the sensor's]
    #[arg(long, value_name = "MIN,MAX", value_parser = sensor::parse_range)]
    range: Option<GreyRange>,
    /// Light on the sensor at grey 255 in lux, for the presets davis346, evk4 and dvxplorer [default: 250]
    #[arg(long, value_name = "LUX")]
    lux: Option<f64>,
    /// White in float frames: 1 or 255 [default: decided by the first two frames, and printed]
    #[arg(long, value_parser = sequence::full_scale)]
    full_scale: Option<FullScale>,
    /// Position of the frames' top-left pixel on the sensor, so that a crop draws the same noise as
    /// the whole
    #[arg(long, value_name = "X,Y", default_value = "0,0", value_parser = sequence::parse_origin)]
    origin: [u16; 2],
    /// Seed of the sensor's noise
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Keep the first max_events_per_pixel_frame events of a pixel between two frames and count the
    /// rest, instead of failing
    #[arg(long)]
    allow_cap: bool,
    /// Label each event as signal or noise, in .h5 and .npz
    #[arg(long)]
    labels: bool,
    /// File for the events: .h5, .npz, .raw, .aedat4, .txt or .csv
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    output: EventOutputOptions,
}

/// A value by its name in recipes.
fn parse_word<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    T::deserialize(StrDeserializer::<WordError>::new(text)).map_err(|e| e.to_string())
}

impl SimulateArgs {
    /// Path of the frames or of the video.
    fn input_path(&self) -> &Path {
        self.video.as_ref().or(self.frames.as_ref()).expect("the parser requires one of them")
    }

    pub(super) fn run(self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        let sensor_file = Some(Path::new(&self.sensor)).filter(|path| is_there(path));
        let sensor_file = sensor_file.or(sensor::named_in_recipe(&self.sensor).map(|(path, _)| path));
        let optional = [self.rates.as_deref(), self.stamps.as_deref(), sensor_file];
        let inputs = optional.into_iter().flatten().chain([self.input_path()]);
        output::screen_outputs([self.out.as_path()], inputs, console.json)?;
        let format = EventFormat::for_output(&self.out, self.output.codec).ok_or_else(|| {
            let what = format!("{}: not an event format", self.out.display());
            VerbError::usage("format", what).help(WRITTEN)
        })?;
        common.limit_cores();
        // Interrupts are caught before a file exists that an interrupt could leave behind.
        let stop = super::on_interrupt()?;
        let (sensor, drawn) = sensor::choose_sensor(&self)?;
        let mut sequence = match &self.video {
            None => StampedFrames::open_inputs(self.inputs())?,
            Some(video) => StampedFrames::open_video(video, &common.programs())?,
        };
        // Labels that were asked for must not be dropped silently.
        if sensor.as_model().labels() && !format.keeps_labels() {
            let what = format!("{} cannot store the labels of events", self.out.display());
            return Err(VerbError::usage("labels", what).help("write .h5 or .npz, or leave the labels out"));
        }
        sensor::check_rates(&sensor, self.rates.is_some(), sequence.may_be_coloured)?;
        let screening = sensor.screen(sequence.rate());
        let screening = screening.map_err(|e| VerbError::usage("sensor", format!("{}: {e}", self.sensor)))?;
        let what = format!("sensor {}", self.sensor);
        super::screening::report_screening(&what, &self.sensor, &screening, true, console);
        super::screening::report_front_end(&sensor.as_model().front_end(), console);
        if !drawn.is_empty() {
            let numbers: Vec<String> = drawn.iter().map(|(path, x)| format!("{path} {x:.4}")).collect();
            console.note(&format!("drawn with seed {}: {}", self.seed, numbers.join(", ")));
        }
        sequence.notices.iter().for_each(|line| console.note(line));
        let account = self.write(&sensor, &mut sequence, format, &Watch { console, stop: &stop })?;
        if account.events == 0 {
            // A note, so that programs get one object.
            console.note(
                "warning: no events: the frames change less than the thresholds, or --full-scale is wrong",
            );
        }
        SimulateReport { asked: &self, sensor: &sensor, drawn, screening, sequence: &sequence, account }
            .report(console)?;
        Ok(ExitKind::Done)
    }

    fn inputs(&self) -> FrameInputs<'_> {
        FrameInputs {
            frames: self.input_path(),
            rates: self.rates.as_deref(),
            stamps: self.stamps.as_deref(),
            fps: self.fps,
            full_scale: self.full_scale,
        }
    }

    /// Writes the file whole or not at all.
    fn write(
        &self,
        sensor: &SensorChoice,
        sequence: &mut StampedFrames,
        format: EventFormat,
        watch: &Watch<'_>,
    ) -> Result<SimulationAccount, VerbError> {
        let size = sequence.frames.size();
        let stream = SimulatedStream { sensor, size, span_us: sequence.span_us() };
        let mut done = SimulationAccount::default();
        let written = write_by_rename(&self.out, |part| {
            let mut sink = stream.create_file(part, format, self.output.h5_filter)?;
            done = self.simulate(sensor, sequence, &mut *sink, watch)?;
            EventFile::finish(sink, stream.length_us())?;
            Ok(())
        });
        written.map_err(|failure: SimulateFailure| self.to_error(failure)).map(|()| done)
    }

    /// Feeds every frame to the sensor.
    fn simulate(
        &self,
        sensor: &SensorChoice,
        sequence: &mut StampedFrames,
        sink: &mut dyn EventSink,
        Watch { console, stop }: &Watch<'_>,
    ) -> Result<SimulationAccount, SimulateFailure> {
        let length = sequence.frames.len() as u64;
        let bar = if console.is_live() { ProgressBar::new(length) } else { ProgressBar::hidden() };
        let mut motion = FrameMotion::new(sequence.frames.len());
        let mut tap = |frame: &DenseFrame| {
            motion.see(&frame.luminance);
            bar.inc(1);
            if stop.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let model = sensor.as_model();
        let pixels = model.start(sequence.frames.size(), self.origin, Seed(self.seed));
        let pixels = pixels.map_err(SimulateError::from)?;
        let mut channel = [SensorChannel::new(pixels, sink).behind(model.front_end())];
        let accounts = simulate_all(&mut *sequence.frames, &mut channel, &mut tap);
        bar.finish_and_clear();
        // Before a failure is returned: too much motion between two frames may be its reason.
        let warnings = warnings::motion_warnings(&motion, self.input_path(), sequence);
        warnings.iter().for_each(|line| console.note(line));
        Ok(accounts?.pop().expect("an account a sensor"))
    }

    fn to_error(&self, failure: SimulateFailure) -> VerbError {
        let error = match failure {
            SimulateFailure::Write(EventFileError::Io(e)) => return unwritable_file(&self.out, e),
            SimulateFailure::Write(e) => {
                return VerbError::failed("not-written", "failed to write the events").because(e);
            }
            SimulateFailure::Simulate(error) => error,
        };
        match error {
            SimulateError::Interrupted => {
                VerbError::interrupted(format!("interrupted: nothing was written to {}", self.out.display()))
            }
            SimulateError::Frames(e) => input::unreadable_file("frames", &e).path(self.input_path()),
            SimulateError::Sensor(SensorError::Sink(e)) => unwritable_file(&self.out, e),
            SimulateError::Sensor(SensorError::Setup(because)) => {
                VerbError::usage("sensor", format!("{}: {because}", self.sensor))
            }
            SimulateError::Sensor(e) => {
                let failed = VerbError::failed("step-failed", "failed to simulate the events").because(&e);
                if !matches!(e, SensorError::Cap { .. }) {
                    return failed;
                }
                failed.help(
                    "raise max_events_per_pixel_frame, or pass --allow-cap to keep the first events and count the others",
                )
            }
        }
    }
}

/// The console, and the flag that an interrupt sets.
struct Watch<'a> {
    console: &'a Console,
    stop: &'a AtomicBool,
}

/// The reason why there is no file.
enum SimulateFailure {
    Write(EventFileError),
    Simulate(SimulateError),
}

impl From<SimulateError> for SimulateFailure {
    fn from(error: SimulateError) -> Self {
        Self::Simulate(error)
    }
}

impl From<EventFileError> for SimulateFailure {
    fn from(error: EventFileError) -> Self {
        Self::Write(error)
    }
}

impl From<io::Error> for SimulateFailure {
    fn from(error: io::Error) -> Self {
        Self::Write(error.into())
    }
}
