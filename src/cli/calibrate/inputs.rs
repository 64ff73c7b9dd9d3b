//! The recording, read into memory and cut into the part that is fitted and the part that is held out.

use super::{CalibrateArgs, NoiseFile};
use crate::cli::{Console, VerbError, input};
use gs2e_calibrate::{PixelTrains, Recording, StaticRecording};
use gs2e_event::Event;
use gs2e_image::Size;
use std::path::Path;

/// Fewest frames of a part.
const FEWEST_FRAMES: usize = 4;

/// The parts of a recording.
pub(super) struct Parts {
    pub(super) fitted: Recording,
    pub(super) held: Option<Recording>,
}

impl CalibrateArgs {
    /// Reads frames and events.
    pub(super) fn read(&self, console: &Console) -> Result<Parts, VerbError> {
        let mut sequence = self.recording.open_frames(console)?;
        let size = sequence.frames.size();
        let events = self.events_of(&self.recording.events, size)?;
        let mut frames = Vec::with_capacity(sequence.stamps_us.len() * size.pixels());
        loop {
            let frame = sequence.frames.next();
            let frame = frame.map_err(|e| {
                let error = input::unreadable_file("frames", &e);
                match self.recording.frames() {
                    Some(path) => error.path(path),
                    None => error,
                }
            })?;
            let Some(frame) = frame else { break };
            frames.extend_from_slice(frame.luminance.pixels());
        }
        self.cut(&Whole { size, stamps_us: sequence.stamps_us, frames, events })
    }

    /// The recordings of constant light.
    pub(super) fn read_noise(&self, size: Size) -> Result<Vec<StaticRecording>, VerbError> {
        let read = |NoiseFile { path, lux }: &NoiseFile| {
            let events = self.events_of(path, size)?;
            Ok(StaticRecording { lux: *lux, ..static_recording(path, size, &events)? })
        };
        self.noise.iter().map(read).collect()
    }

    /// The events of constant light, where there are no frames.
    pub(super) fn read_static(&self) -> Result<StaticRecording, VerbError> {
        let path = &self.recording.events;
        let size = self.recording.size()?;
        let mut events = self.events_of(path, size)?;
        let us = |event: &Event| event.t.floor_micros();
        if let Some(first) = events.first().map(us) {
            let second = |event: &Event| (us(event) - first) as f64 * 1e-6;
            let [from, to] = [self.from.unwrap_or(0.0), self.to.unwrap_or(f64::INFINITY)];
            events.retain(|event| (from..=to).contains(&second(event)));
        }
        static_recording(path, size, &events)
    }

    fn events_of(&self, path: &Path, size: Size) -> Result<Vec<Event>, VerbError> {
        let mut all = Vec::new();
        self.recording.read_events(path, size, &mut |chunk| all.extend_from_slice(chunk))?;
        Ok(all)
    }

    fn cut(&self, whole: &Whole) -> Result<Parts, VerbError> {
        let first_us = whole.stamps_us[0];
        let second = |us: i64| (us - first_us) as f64 * 1e-6;
        let last = second(whole.stamps_us[whole.stamps_us.len() - 1]);
        let [from, to] = [self.from.unwrap_or(0.0), self.to.unwrap_or(last).min(last)];
        let middle = to - (to - from) * self.hold_out.unwrap_or(0.0);
        let place = |at: f64| whole.stamps_us.partition_point(|us| second(*us) < at);
        let end = whole.stamps_us.partition_point(|us| second(*us) <= to);
        let begin = place(from);
        let split = if self.hold_out.is_some() { place(middle) } else { end };
        let held = (split < end).then(|| whole.part(split, end));
        Ok(Parts { fitted: whole.part(begin, split)?, held: held.transpose()? })
    }
}

fn static_recording(path: &Path, size: Size, events: &[Event]) -> Result<StaticRecording, VerbError> {
    let trains = PixelTrains::new(size, events);
    let Some(span_us) = trains.span_us() else {
        return Err(VerbError::usage("no-events", format!("{} has no events", path.display())));
    };
    Ok(StaticRecording { trains, span_us, lux: None })
}

/// A whole recording.
struct Whole {
    size: Size,
    stamps_us: Vec<i64>,
    frames: Vec<f32>,
    events: Vec<Event>,
}

impl Whole {
    /// The frames from one to before another, with their events.
    fn part(&self, from: usize, to: usize) -> Result<Recording, VerbError> {
        if to < from + FEWEST_FRAMES {
            let found = to.saturating_sub(from);
            let what = format!("a part has {found} frames, wanted at least {FEWEST_FRAMES}");
            return Err(VerbError::usage("frames", what).help("--from, --to and --hold-out set the parts"));
        }
        let stamps_us = self.stamps_us[from..to].to_vec();
        let pixels = self.size.pixels();
        // The parts on either side of a border see the events between its frames once.
        let begin = if from == 0 { i64::MIN } else { stamps_us[0] };
        let end = self.stamps_us.get(to).copied().unwrap_or(i64::MAX);
        let us = |event: &Event| event.t.floor_micros();
        let (low, high) = (
            self.events.partition_point(|event| us(event) < begin),
            self.events.partition_point(|event| us(event) < end),
        );
        Ok(Recording {
            size: self.size,
            stamps_us,
            frames: self.frames[from * pixels..to * pixels].to_vec(),
            trains: PixelTrains::new(self.size, &self.events[low..high]),
        })
    }
}
