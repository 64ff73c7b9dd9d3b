//! `gs2e study real`: simulated streams against a recording.

use super::{end_problem, go_unless};
use crate::cli::recording::RecordingArgs;
use crate::cli::simulate::StampedFrames;
use crate::cli::{CommonArgs, Console, ExitKind, VerbError, on_interrupt, output};
use gs2e_lab::real::picture::intervals_svg;
use gs2e_lab::real::profile::StreamProfile;
use gs2e_lab::real::{
    ComparedSensor, ProfiledRecording, RealStudy, StudiedSensor, all_presets, compare_sensors,
};
use gs2e_num::seed::Seed;
use gs2e_recipe::read_sensor;
use serde_json::json;
use std::io::{self, Write};
use std::path::PathBuf;

/// Arguments of `study real`.
#[derive(Debug, clap::Args)]
pub(super) struct RealArgs {
    #[command(flatten)]
    recording: RecordingArgs,
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
        let mut sequence = self.recording.open_frames()?;
        let profile = self.profile(&sequence)?;
        let (first_us, last_us) = sequence.span_us();
        // Simulated streams begin at 0, so they are shifted to the clock of the recording before they are
        // compared.
        let empty = StreamProfile::new(sequence.frames.size(), first_us..=last_us, first_us);
        let recording = ProfiledRecording { profile, empty };
        let mut tap = |_: &_| go_unless(&cancel);
        let found = compare_sensors(&mut *sequence.frames, &sensors, recording, Seed(self.seed), &mut tap);
        let found = found.map_err(end_problem)?;
        self.write(&found)?;
        report(&found, console);
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

    /// The profile of the recorded events between the first and the last frame.
    fn profile(&self, sequence: &StampedFrames) -> Result<StreamProfile, VerbError> {
        let path = &self.recording.events;
        let place = path.display();
        let size = sequence.frames.size();
        let (first_us, last_us) = sequence.span_us();
        let mut profile = StreamProfile::new(size, first_us..=last_us, 0);
        self.recording.read_events(path, size, &mut |chunk| profile.take(chunk))?;
        if profile.events() == 0 {
            let count = profile.outside();
            let what = format!(
                "{place}: none of {count} events is between the first frame, {first_us} us, and the last, {last_us} us"
            );
            let help = "--stamps has times on the clock of the events";
            return Err(VerbError::usage("no-events", what).help(help));
        }
        Ok(profile)
    }

    fn write(&self, found: &RealStudy) -> Result<(), VerbError> {
        let table = |out: &mut dyn Write| write_csv(found, out);
        let picture = |out: &mut dyn Write| out.write_all(intervals_svg(found).as_bytes());
        output::write_given(&[(self.csv.as_deref(), &table), (self.picture.as_deref(), &picture)])
    }
}

/// The recording as a row: its distances from itself are 0.
fn recorded_row(found: &RealStudy) -> ComparedSensor {
    let intervals = found.real.intervals();
    ComparedSensor {
        sensor: "recording".to_owned(),
        events: found.real.events(),
        capped: 0,
        rate_ev_px_s: found.real.per_pixel() / found.seconds,
        on_share: found.real.on_share(),
        ks_counts: 0.0,
        ks_intervals: 0.0,
        ln_density: intervals.inverse_gaussian().and_then(|law| intervals.mean_ln_density(law)),
        distance: 0.0,
    }
}

fn write_csv(found: &RealStudy, out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "sensor,events,capped,rate_ev_px_s,on_share,ks_counts,ks_intervals,ln_density,distance")?;
    let number = |value: Option<f64>| value.map(|value| value.to_string()).unwrap_or_default();
    for row in [recorded_row(found)].iter().chain(&found.rows) {
        let ComparedSensor { sensor, events, capped, rate_ev_px_s, .. } = row;
        let ComparedSensor { ks_counts, ks_intervals, distance, .. } = row;
        let (on_share, ln_density) = (number(row.on_share), number(row.ln_density));
        writeln!(
            out,
            "{sensor},{events},{capped},{rate_ev_px_s},{on_share},{ks_counts},{ks_intervals},{ln_density},{distance}"
        )?;
    }
    Ok(())
}

fn report(found: &RealStudy, console: &Console) {
    let outside = found.real.outside();
    if console.json {
        return console.result(&json!({
            "seconds": found.seconds, "recording": recorded_row(found), "outside": outside,
            "sensors": found.rows, "nearest": found.rows.first().map(|row| &row.sensor),
        }));
    }
    if outside > 0 {
        console.note(&format!(
            "{outside} recorded events are before the first or after the last frame, and do not count"
        ));
    }
    console.print(
        "sensor                 events    ev/px/s    ON  KS counts  KS intervals  ln density  distance",
    );
    for row in [recorded_row(found)].iter().chain(&found.rows) {
        let share = row.on_share.map_or_else(|| "-".to_owned(), |share| format!("{:.0} %", 100.0 * share));
        let density = row.ln_density.map_or_else(|| "-".to_owned(), |mean| format!("{mean:.3}"));
        console.print(&format!(
            "{:18}  {:9}  {:9.4}  {share:>4}  {:9.3}  {:12.3}  {density:>10}  {:8.3}",
            row.sensor, row.events, row.rate_ev_px_s, row.ks_counts, row.ks_intervals, row.distance
        ));
    }
    for row in found.rows.iter().filter(|row| row.capped > 0) {
        console.note(&format!("{}: {} events beyond the cap were dropped", row.sensor, row.capped));
    }
    if let Some(nearest) = found.rows.first() {
        console.print(&format!("nearest: {}", nearest.sensor));
    }
}
