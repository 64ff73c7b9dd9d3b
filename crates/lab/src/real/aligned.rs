//! Figures that need the events themselves, beside those of the profiles: a delay, signed windows, the
//! ladder, and still and moving pixels apart.

use super::events::PackedEvents;
use super::ladder::{LadderFigures, Ladders, StreamLadder};
use super::light::{LightCounts, PixelCourses, PixelLight};
use super::mask::StampMask;
use super::profile::StreamProfile;
use super::signed::{SignedWindows, WindowMatch, WindowScore};
use super::{RealStudy, StudiedSensor, compare_all, ranked, simulate_sensors};
use gs2e_event::{Event, EventSink};
use gs2e_image::Size;
use gs2e_num::seed::Seed;
use gs2e_sensor::SimulateError;
use gs2e_sensor::frames::{DenseFrame, FrameSequence};
use serde::Serialize;
use std::cell::RefCell;
use std::ops::{ControlFlow, RangeInclusive};
use std::rc::Rc;

/// A recording with its events in memory, 12 bytes each.
#[derive(Debug)]
pub struct RecordedStream {
    profile: StreamProfile,
    events: PackedEvents,
}

impl RecordedStream {
    /// An empty recording of the time from the first to the last frame, without what is masked.
    #[must_use]
    pub fn new(size: Size, span_us: RangeInclusive<i64>, mask: StampMask) -> Self {
        let profile = StreamProfile::new(size, span_us, 0).masked_by(Rc::new(mask));
        Self { profile, events: PackedEvents::default() }
    }

    /// Takes events in order of time.
    pub fn take(&mut self, events: &[Event]) {
        for event in events {
            if let Some(event) = self.profile.count(event) {
                self.events.push(event);
            }
        }
    }

    /// The profile of the events so far.
    #[must_use]
    pub fn profile(&self) -> &StreamProfile {
        &self.profile
    }
}

/// The figures of a stream beside the recording. A figure is null where the recording or the stream does not
/// determine it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct AlignedFigures {
    /// Events per second of the pixels whose frames stand still, per pixel.
    pub still_rate_ev_px_s: Option<f64>,
    /// Share of ON events there.
    pub still_on_share: Option<f64>,
    /// The same of the pixels whose frames move.
    pub moving_rate_ev_px_s: Option<f64>,
    /// See `still_on_share`.
    pub moving_on_share: Option<f64>,
    /// Recorded events behind those of the stream.
    pub delay_us: Option<i64>,
    /// Normalised cross-correlation of the signed windows at this delay: mean over the windows.
    pub ncc: Option<f64>,
    /// Pearson's correlation of the numbers of events of the pixels.
    pub counts_r: Option<f64>,
    /// Contrast of the ladder, ON.
    pub contrast_on: Option<f64>,
    /// Contrast of the ladder, OFF.
    pub contrast_off: Option<f64>,
    /// Events behind frames, by the ladder.
    pub lag_us: Option<f64>,
}

/// A comparison with these figures.
#[derive(Debug)]
pub struct AlignedStudy {
    /// The comparison by profiles.
    pub study: RealStudy,
    /// The figures of the recording.
    pub recording: AlignedFigures,
    /// The figures of the sensors, in the order of the study's rows.
    pub sensors: Vec<AlignedFigures>,
    /// Number of pixels by what their frames do.
    pub pixels: LightCounts,
}

/// A simulated stream on its way.
struct StreamSink {
    profile: StreamProfile,
    windows: WindowMatch,
    ladders: Rc<RefCell<Ladders>>,
    /// Its place in the ladders.
    place: usize,
}

impl EventSink for StreamSink {
    /// Never fails.
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        let mut ladders = self.ladders.borrow_mut();
        for event in events {
            if let Some(event) = self.profile.count(event) {
                self.windows.take(event);
                ladders.take(self.place, event);
            }
        }
        Ok(())
    }
}

/// Simulates every sensor on the frames, which are read once, and compares the streams with the recording.
///
/// # Errors
/// A frame cannot be read, a sensor fails, or `tap` stops.
pub fn align_sensors(
    frames: &mut dyn FrameSequence,
    sensors: &[StudiedSensor],
    recording: RecordedStream,
    seed: Seed,
    tap: &mut dyn FnMut(&DenseFrame) -> ControlFlow<()>,
) -> Result<AlignedStudy, SimulateError> {
    let RecordedStream { profile: real, events } = recording;
    let (span_us, size, events) = (real.window_us().clone(), real.size(), Rc::new(events));
    let first_us = *span_us.start();
    let windows = Rc::new(SignedWindows::new(Rc::clone(&events), size, &span_us));
    let mut ladders = vec![StreamLadder::recorded(events, size.pixels())];
    ladders.extend(sensors.iter().map(|_| StreamLadder::simulated(size.pixels())));
    let ladders = Rc::new(RefCell::new(Ladders::new(span_us, ladders)));
    let sink = |place: usize| StreamSink {
        // Simulated streams begin at 0, so they are shifted to the clock of the recording.
        profile: real.emptied(first_us),
        windows: WindowMatch::new(Rc::clone(&windows)),
        ladders: Rc::clone(&ladders),
        place,
    };
    let mut sinks: Vec<StreamSink> = (1..=sensors.len()).map(sink).collect();
    let mut courses = PixelCourses::new(size.pixels());
    let mut see = |frame: &DenseFrame| {
        let greys = frame.luminance.pixels();
        courses.see(greys);
        ladders.borrow_mut().see(first_us + frame.t.floor_micros(), greys);
        tap(frame)
    };
    let accounts = simulate_sensors(frames, sensors, &mut sinks, seed, &mut see)?;
    let (lights, ladders) = (courses.lights(), ladders.borrow_mut().finish());
    let streams = sinks.into_iter().map(|sink| (sink.profile, sink.windows.finish()));
    let (profiles, scores): (Vec<StreamProfile>, Vec<Option<WindowScore>>) = streams.unzip();
    let rows = compare_all(sensors, &accounts, &real, &profiles);
    let beside = Beside { real: &real, lights: &lights };
    let figures = profiles.iter().zip(scores).zip(&ladders[1..]);
    let figures: Vec<_> =
        figures.map(|((made, score), ladder)| beside.figures(made, score, *ladder)).collect();
    let all = rows.into_iter().zip(profiles).zip(figures);
    let (both, sensors): (Vec<_>, _) = ranked(all, |((row, _), _)| row).into_iter().unzip();
    let (rows, profiles) = both.into_iter().unzip();
    // The recording is like itself without a delay.
    let own = WindowScore { ncc: 1.0, delay_us: Some(0) };
    let recording = beside.figures(&real, (real.events() > 0).then_some(own), ladders[0]);
    let seconds = real.seconds();
    let pixels = LightCounts::of(&lights);
    Ok(AlignedStudy { study: RealStudy { real, rows, profiles, seconds }, recording, sensors, pixels })
}

/// What streams are compared with.
struct Beside<'a> {
    real: &'a StreamProfile,
    lights: &'a [PixelLight],
}

impl Beside<'_> {
    fn figures(
        &self,
        made: &StreamProfile,
        score: Option<WindowScore>,
        ladder: LadderFigures,
    ) -> AlignedFigures {
        let seconds = self.real.seconds();
        let [still, moving] =
            [PixelLight::Still, PixelLight::Moving].map(|light| made.rates_of(self.lights, light));
        AlignedFigures {
            still_rate_ev_px_s: still.per_pixel.map(|count| count / seconds),
            still_on_share: still.on_share,
            moving_rate_ev_px_s: moving.per_pixel.map(|count| count / seconds),
            moving_on_share: moving.on_share,
            delay_us: score.and_then(|score| score.delay_us),
            ncc: score.map(|score| score.ncc),
            counts_r: self.real.count_correlation(made),
            contrast_on: ladder.contrast_on,
            contrast_off: ladder.contrast_off,
            lag_us: ladder.lag_us,
        }
    }
}
