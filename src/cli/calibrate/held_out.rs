//! The sensor next to the part of the recording that it has not seen.

use crate::cli::VerbError;
use gs2e_calibrate::{ReadOut, Recording, is_at_read_out};
use gs2e_event::picture::WindowCounts;
use gs2e_event::{Event, EventLabel, EventSink as _, Polarity};
use gs2e_image::png::write_image;
use gs2e_lab::real::picture::intervals_svg;
use gs2e_lab::real::profile::StreamProfile;
use gs2e_lab::real::{ComparedSensor, ProfiledRecording, StudiedSensor, all_presets, compare_sensors};
use gs2e_num::seed::Seed;
use gs2e_num::units::Timestamp;
use gs2e_recipe::sensor_from_text;
use gs2e_sensor::frames::array::{ArrayFrames, ArraySamples, FullScale};
use gs2e_sensor::{SensorSettings, simulate_one};
use std::collections::TryReserveError;
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
    /// Events of the recording and of the calibrated sensor in one window.
    pub(super) events: EventPictures,
}

/// Pictures of the same moment, in PNG.
pub(super) struct EventPictures {
    /// Start of the window after the first frame that was held out, and its length, us.
    pub(super) from_us: i64,
    pub(super) length_us: i64,
    pub(super) recorded: Vec<u8>,
    pub(super) simulated: Vec<u8>,
}

/// Length of the window of the pictures, us: long enough for edges to appear.
const PICTURED_US: i64 = 20_000;

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
    let frames = || {
        let samples = ArraySamples::Floats(held.frames.clone(), FullScale::Grey255);
        ArrayFrames::new(held.size, samples, &held.stamps_us).map_err(|e| failed(e.to_string()))
    };
    let calibrated = sensor_from_text(sensor.to_owned(), Path::new("the calibrated sensor"), None)?;
    let mut sensors = all_presets();
    sensors.retain(|studied| studied.name == BEFORE);
    sensors.push(StudiedSensor { name: AFTER.to_owned(), sensor: calibrated.clone() });
    let empty = StreamProfile::new(held.size, span, held.stamps_us[0]);
    let mut tap = |_: &_| {
        if cancel.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let recording = ProfiledRecording { profile, empty };
    let found = compare_sensors(&mut frames()?, &sensors, recording, Seed(seed), &mut tap);
    let found = found.map_err(|e| failed(e.to_string()))?;
    let from_us = busiest_us(held);
    let window = from_us..from_us + PICTURED_US;
    let no_memory = |e: TryReserveError| failed(e.to_string());
    let mut recorded = WindowCounts::new(held.size, window.clone()).map_err(no_memory)?;
    for pixel in 0..held.size.pixels() {
        recorded.append(&events_of(held, pixel)).map_err(|e| failed(e.to_string()))?;
    }
    // Simulated streams begin at 0.
    let first_us = held.stamps_us[0];
    let window = window.start - first_us..window.end - first_us;
    let mut simulated = WindowCounts::new(held.size, window).map_err(no_memory)?;
    let settings = SensorSettings { allow_cap: true, ..calibrated.settings() };
    let sensor = calibrated.with_settings(settings);
    simulate_one(&mut frames()?, sensor.as_model(), Seed(seed), &mut simulated, &mut tap)
        .map_err(|e| failed(e.to_string()))?;
    let png = |counts: &WindowCounts| {
        let mut bytes = Vec::new();
        write_image(&counts.image(), &mut bytes).map_err(|e| failed(e.to_string()))?;
        Ok::<_, VerbError>(bytes)
    };
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
        events: EventPictures {
            from_us: from_us - first_us,
            length_us: PICTURED_US,
            recorded: png(&recorded)?,
            simulated: png(&simulated)?,
        },
    })
}

/// The stamp of the frame that most events follow until the next.
fn busiest_us(held: &Recording) -> i64 {
    let mut counts = vec![0_usize; held.stamps_us.len()];
    for pixel in 0..held.size.pixels() {
        for us in held.trains.of(pixel).0 {
            // The last frame has no next one.
            let frame = held.stamps_us.partition_point(|stamp| stamp <= us);
            if frame > 0 && frame < held.stamps_us.len() {
                counts[frame - 1] += 1;
            }
        }
    }
    let busiest = counts.iter().enumerate().max_by_key(|(_, count)| **count);
    held.stamps_us[busiest.map_or(0, |(frame, _)| frame)]
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
