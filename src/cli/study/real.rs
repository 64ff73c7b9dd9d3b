//! `gs2e study real`: simulated streams against a recording.

mod table;

use super::{end_problem, go_unless};
use crate::cli::export::parse_window;
use crate::cli::recording::RecordingArgs;
use crate::cli::simulate::StampedFrames;
use crate::cli::{CommonArgs, Console, ExitKind, VerbError, on_interrupt, output};
use gs2e_lab::real::mask::StampMask;
use gs2e_lab::real::picture::intervals_svg;
use gs2e_lab::real::{AlignedStudy, RecordedStream, StudiedSensor, align_sensors, all_presets};
use gs2e_num::seed::Seed;
use gs2e_recipe::read_sensor;
use std::io::Write;
use std::path::PathBuf;

/// Help on a mask that leaves nothing.
const MASKED: &str = "--mask leaves out the events around each stamp: choose a shorter time";

/// Arguments of `study real`.
#[derive(Debug, clap::Args)]
pub(super) struct RealArgs {
    #[command(flatten)]
    recording: RecordingArgs,
    /// Leave out recorded and simulated events from FROM to before TO after each frame's stamp, in us: the
    /// read-out of frames makes events in some cameras
    #[arg(long, value_name = "FROM..TO", value_parser = parse_window, allow_hyphen_values = true)]
    mask: Option<[i64; 2]>,
    /// Another sensor to compare: a recipe, or a file with the content of a recipe's `sensor`
    #[arg(long, value_name = "FILE")]
    sensor: Vec<PathBuf>,
    /// Seed of the sensors' noise
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// File for the table
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// File for the picture, a .svg: the distributions of the intervals
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
}

impl RealArgs {
    pub(super) fn run(self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        let inputs = self.recording.paths().chain(self.sensor.iter().map(PathBuf::as_path));
        let outputs = self.csv.iter().chain(&self.picture).map(PathBuf::as_path);
        output::screen_outputs(outputs, inputs, console.json)?;
        common.limit_cores();
        let cancel = on_interrupt()?;
        let sensors = self.sensors()?;
        self.recording.note_seconds(&self.recording.events, console);
        let mut sequence = self.recording.open_frames(console)?;
        let recorded = self.recorded(&sequence)?;
        let mut tap = |_: &_| go_unless(&cancel);
        let found = align_sensors(&mut *sequence.frames, &sensors, recorded, Seed(self.seed), &mut tap);
        let found = found.map_err(end_problem)?;
        self.write(&found)?;
        table::report(&found, console);
        Ok(ExitKind::Done)
    }

    /// All presets, and the sensors of files.
    fn sensors(&self) -> Result<Vec<StudiedSensor>, VerbError> {
        let mut sensors = all_presets();
        for path in &self.sensor {
            let name = path.display().to_string();
            sensors.push(StudiedSensor { name, sensor: read_sensor(path, None)? });
        }
        Ok(sensors)
    }

    /// The recorded events between the first and the last frame.
    fn recorded(&self, sequence: &StampedFrames) -> Result<RecordedStream, VerbError> {
        let path = &self.recording.events;
        let size = sequence.frames.size();
        let (first_us, last_us) = sequence.span_us();
        let mask = self.mask.map(|range| StampMask::new(sequence.stamps_us.clone(), range));
        let mut recorded = RecordedStream::new(size, first_us..=last_us, mask.unwrap_or_default());
        self.recording.read_events(path, size, &mut |chunk| recorded.take(chunk))?;
        let profile = recorded.profile();
        if profile.events() == 0 {
            let place = path.display();
            let all = profile.outside() + profile.masked();
            let (what, help) = if profile.masked() == 0 {
                let what = format!(
                    "{place}: none of {all} events is between the first frame, {first_us} us, and the last, {last_us} us"
                );
                (what, "--stamps has times on the clock of the events")
            } else {
                (
                    format!("{place}: none of {all} events is between the frames and outside of the mask"),
                    MASKED,
                )
            };
            return Err(VerbError::usage("no-events", what).help(help));
        }
        Ok(recorded)
    }

    fn write(&self, found: &AlignedStudy) -> Result<(), VerbError> {
        let csv = |out: &mut dyn Write| table::write_csv(found, out);
        let picture = |out: &mut dyn Write| out.write_all(intervals_svg(&found.study).as_bytes());
        output::write_given(&[(self.csv.as_deref(), &csv), (self.picture.as_deref(), &picture)])
    }
}
