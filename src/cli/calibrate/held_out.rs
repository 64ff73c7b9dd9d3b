//! The sensor next to the part of the recording that it has not seen.

use crate::cli::VerbError;
use gs2e_calibrate::{ReadOut, Recording, is_at_read_out};
use gs2e_event::{Event, EventLabel, Polarity};
use gs2e_lab::real::picture::intervals_svg;
use gs2e_lab::real::profile::StreamProfile;
use gs2e_lab::real::{ComparedSensor, ProfiledRecording, StudiedSensor, all_presets, compare_sensors};
use gs2e_num::seed::Seed;
use gs2e_num::units::Timestamp;
use gs2e_recipe::sensor_from_text;
use gs2e_sensor::frames::array::{ArrayFrames, ArraySamples, FullScale};
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Name of the sensor before the calibration.
const BEFORE: &str = "davis346";
/// Name of the calibrated sensor.
const AFTER: &str = "calibrated";

/// A comparison with the part that was held out.
pub(super) struct HeldOut {
    pub(super) rate_ev_px_s: f64,
    pub(super) on_share: Option<f64>,
    pub(super) before: ComparedSensor,
    pub(super) after: ComparedSensor,
    /// The distributions of the intervals as SVG.
    pub(super) intervals: String,
}

/// Simulates the default sensor and the calibrated one on the frames that were held out. Events of the
/// recording at the read-out of frames are left out: no sensor makes them.
pub(super) fn compare(
    held: &Recording,
    read_out: &[ReadOut],
    sensor: &str,
    seed: u64,
    cancel: &AtomicBool,
) -> Result<HeldOut, VerbError> {
    let failed = |because: String| VerbError::failed("step-failed", format!("failed to compare: {because}"));
    let last = held.stamps_us.len() - 1;
    let span = held.stamps_us[0]..=held.stamps_us[last];
    let mut profile = StreamProfile::new(held.size, span.clone(), 0);
    for pixel in 0..held.size.pixels() {
        let mut events = events_of(held, pixel);
        events.retain(|event| !is_at_read_out(event.t.floor_micros(), &held.stamps_us, read_out));
        profile.take(&events);
    }
    let samples = ArraySamples::Floats(held.frames.clone(), FullScale::Grey255);
    let frames = ArrayFrames::new(held.size, samples, &held.stamps_us);
    let mut frames = frames.map_err(|e| failed(e.to_string()))?;
    let calibrated = sensor_from_text(sensor.to_owned(), Path::new("the calibrated sensor"), None)?;
    let mut sensors = all_presets();
    sensors.retain(|studied| studied.name == BEFORE);
    sensors.push(StudiedSensor { name: AFTER.to_owned(), sensor: calibrated });
    let empty = StreamProfile::new(held.size, span, held.stamps_us[0]);
    let mut tap = |_: &_| {
        if cancel.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let recording = ProfiledRecording { profile, empty };
    let found = compare_sensors(&mut frames, &sensors, recording, Seed(seed), &mut tap);
    let found = found.map_err(|e| failed(e.to_string()))?;
    let row = |name: &str| {
        let row = found.rows.iter().find(|row| row.sensor == name);
        row.cloned().expect("every sensor has a row")
    };
    Ok(HeldOut {
        rate_ev_px_s: found.real.per_pixel() / found.seconds,
        on_share: found.real.on_share(),
        before: row(BEFORE),
        after: row(AFTER),
        intervals: intervals_svg(&found),
    })
}

fn events_of(held: &Recording, pixel: usize) -> Vec<Event> {
    let (us, on) = held.trains.of(pixel);
    let width = held.size.width as usize;
    #[expect(clippy::cast_possible_truncation, reason = "sides of a sensor have 16 bits")]
    let (x, y) = ((pixel % width) as u16, (pixel / width) as u16);
    let event = |(us, on): (&i64, &bool)| Event {
        t: Timestamp::from_micros(*us),
        x,
        y,
        polarity: if *on { Polarity::On } else { Polarity::Off },
        label: EventLabel::Signal,
    };
    us.iter().zip(on).map(event).collect()
}
