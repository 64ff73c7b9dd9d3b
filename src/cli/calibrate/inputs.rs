//! The recording, read into memory and cut into the part that is fitted and the part that is held out.

use super::CalibrateArgs;
use crate::cli::convert::events::SUPPORTED;
use crate::cli::simulate::{FrameInputs, StampedFrames};
use crate::cli::{VerbError, input};
use gs2e_calibrate::{PixelTrains, Recording, StaticRecording};
use gs2e_event::evt::EvtVersion;
use gs2e_event::file::{EventFormat, OpenEventFile};
use gs2e_event::sorted::SortedEvents;
use gs2e_event::{Event, EventSource as _};
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
    pub(super) fn read(&self) -> Result<Parts, VerbError> {
        let mut sequence = StampedFrames::open_inputs(FrameInputs {
            frames: &self.frames,
            rates: None,
            stamps: self.stamps.as_deref(),
            fps: self.fps,
            full_scale: self.full_scale,
        })?;
        let size = sequence.frames.size();
        let (found, events) = self.events_of(&self.events)?;
        if found != size {
            let what = format!("events of {found} and frames of {size}, wanted the same pixels");
            return Err(VerbError::usage("size", what));
        }
        let mut frames = Vec::with_capacity(sequence.stamps_us.len() * size.pixels());
        loop {
            let frame = sequence.frames.next();
            let frame = frame.map_err(|e| input::unreadable_file("frames", &e).path(&self.frames))?;
            let Some(frame) = frame else { break };
            frames.extend_from_slice(frame.luminance.pixels());
        }
        self.cut(&Whole { size, stamps_us: sequence.stamps_us, frames, events })
    }

    /// The recording of constant light.
    pub(super) fn read_noise(&self, size: Size) -> Result<Option<StaticRecording>, VerbError> {
        let Some(path) = &self.noise else { return Ok(None) };
        let (found, events) = self.events_of(path)?;
        if found != size {
            let what = format!("{}: events of {found}, wanted {size} as the frames", path.display());
            return Err(VerbError::usage("size", what));
        }
        let trains = PixelTrains::new(size, &events);
        let Some(span_us) = trains.span_us() else {
            return Err(VerbError::usage("no-events", format!("{} has no events", path.display())));
        };
        Ok(Some(StaticRecording { trains, span_us }))
    }

    fn events_of(&self, path: &Path) -> Result<(Size, Vec<Event>), VerbError> {
        let format = EventFormat::for_path(path, EvtVersion::Evt2).ok_or_else(|| {
            let what = format!("{}: not an event format", path.display());
            VerbError::usage("format", what).help(SUPPORTED)
        })?;
        let OpenEventFile { header, mut source, .. } = self.options.open(path, format)?;
        let mut sorted = SortedEvents::new(&mut *source);
        let (mut all, mut chunk) = (Vec::new(), Vec::new());
        while sorted.next_chunk(&mut chunk).map_err(|e| input::wrong_events(path, &e))? {
            all.extend_from_slice(&chunk);
        }
        Ok((header.size, all))
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
