//! `gs2e calibrate`: a sensor from a recording.

mod held_out;
mod inputs;
mod page;
mod report;

use super::recording::RecordingArgs;
use super::{CommonArgs, Console, ExitKind, VerbError, on_interrupt, output};
use gs2e_calibrate::{CalibrateError, Calibration, calibrate, calibrate_static, sensor_text};
use held_out::HeldOut;
use std::io::Write;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

/// Arguments of `calibrate`.
#[derive(Debug, clap::Args)]
// Events of constant light have something to say without frames.
#[command(mut_arg("frames", |frames| frames.required(false)))]
pub(super) struct CalibrateArgs {
    #[command(flatten)]
    recording: RecordingArgs,
    /// Events of the same pixels in constant light, for noise, leak and hot pixels; with the light on the
    /// sensor, if it is known
    #[arg(long, value_name = "FILE[@LUX]", requires = "frames", value_parser = noise_file)]
    noise: Vec<NoiseFile>,
    /// Start of the part that is used, in seconds after the first frame (without frames, the first event)
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    from: Option<f64>,
    /// End of the part that is used, in seconds after the first frame (without frames, the first event)
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    to: Option<f64>,
    /// Share of the part that is held out at its end, to compare the sensor with
    #[arg(long, value_name = "SHARE", requires = "frames", value_parser = held_share)]
    hold_out: Option<f64>,
    /// Seed of the sensor's noise in this comparison
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// File for the sensor, which a recipe takes as its `sensor`
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// File for the report with its pictures, a .html
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
}

fn seconds(text: &str) -> Result<f64, String> {
    let wanted = || format!("`{text}` is not a time of at least 0 seconds");
    text.parse().ok().filter(|s: &f64| s.is_finite() && *s >= 0.0).ok_or_else(wanted)
}

/// A file of `--noise`.
#[derive(Debug, Clone)]
struct NoiseFile {
    path: PathBuf,
    lux: Option<f64>,
}

fn noise_file(text: &str) -> Result<NoiseFile, String> {
    let Some((path, lux)) = text.rsplit_once('@') else {
        return Ok(NoiseFile { path: text.into(), lux: None });
    };
    match lux.parse() {
        Ok(lux) if f64::is_finite(lux) && lux > 0.0 => Ok(NoiseFile { path: path.into(), lux: Some(lux) }),
        Ok(_) => Err(format!("`{lux}` is not a light above 0 lux")),
        // A name with an @.
        Err(_) => Ok(NoiseFile { path: text.into(), lux: None }),
    }
}

fn held_share(text: &str) -> Result<f64, String> {
    let wanted = || format!("`{text}` is not a share from 0.1 to 0.9");
    text.parse().ok().filter(|s| (0.1..=0.9).contains(s)).ok_or_else(wanted)
}

/// A finished calibration.
struct Calibrated {
    found: Calibration,
    sensor: String,
    /// The comparison with what was held out: before and after.
    held_out: Option<HeldOut>,
    events: usize,
    frames: usize,
    seconds: f64,
}

impl CalibrateArgs {
    pub(super) fn run(self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        let inputs = self.recording.paths().chain(self.noise.iter().map(|noise| noise.path.as_path()));
        let outputs = self.out.iter().chain(&self.page).map(PathBuf::as_path);
        output::screen_outputs(outputs, inputs, console.json)?;
        common.limit_cores();
        let cancel = on_interrupt()?;
        let noise = self.noise.iter().map(|noise| &noise.path);
        [&self.recording.events]
            .into_iter()
            .chain(noise)
            .for_each(|path| self.recording.note_seconds(path, console));
        let done = if self.recording.frames().is_some() {
            self.by_frames(&cancel, console)?
        } else {
            self.by_events()?
        };
        let trust = report::trust(&done);
        let sensor = |out: &mut dyn Write| out.write_all(done.sensor.as_bytes());
        let page = |out: &mut dyn Write| out.write_all(page::page(&done, &trust).as_bytes());
        output::write_given(&[(self.out.as_deref(), &sensor), (self.page.as_deref(), &page)])?;
        report::report(&done, &trust, console);
        Ok(ExitKind::Done)
    }

    /// By frames and events.
    fn by_frames(&self, cancel: &AtomicBool, console: &Console) -> Result<Calibrated, VerbError> {
        let parts = self.read(console)?;
        let noise = self.read_noise(parts.fitted.size)?;
        let found = calibrate(&parts.fitted, &noise).map_err(|because| self.unusable(&because))?;
        let sensor = sensor_text(&found);
        let held_out = parts
            .held
            .as_ref()
            .map(|held| held_out::compare(held, &found.read_out, &sensor, self.seed, cancel));
        Ok(Calibrated {
            sensor,
            held_out: held_out.transpose()?,
            events: parts.fitted.trains.events(),
            frames: parts.fitted.stamps_us.len(),
            seconds: parts.fitted.seconds(),
            found,
        })
    }

    /// By events of constant light.
    fn by_events(&self) -> Result<Calibrated, VerbError> {
        let recording = self.read_static()?;
        let found = calibrate_static(&recording).map_err(|because| self.unusable(&because))?;
        let (first, last) = recording.span_us;
        Ok(Calibrated {
            sensor: sensor_text(&found),
            held_out: None,
            events: recording.trains.events(),
            frames: 0,
            seconds: (last - first) as f64 * 1e-6,
            found,
        })
    }

    fn unusable(&self, because: &CalibrateError) -> VerbError {
        VerbError::usage("recording", format!("{}: {because}", self.recording.events.display()))
    }
}
