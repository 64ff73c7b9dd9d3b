//! The cap of a sensor with `allow_cap`: the first events of each pixel between two frames are
//! kept, the others are counted and dropped.

use super::{SensorError, SensorPixels, SimulationAccount};
use crate::frames::DenseFrame;
use gs2e_event::{Event, EventSink, Polarity};
use gs2e_image::Size;

/// Pixels that each pass on at most `cap` events between two frames.
pub(super) struct CappedPixels {
    pixels: Box<dyn SensorPixels>,
    first: FirstOnes,
}

impl CappedPixels {
    /// Wraps `pixels`, which have no cap of their own.
    pub(super) fn new(pixels: Box<dyn SensorPixels>, cap: u32, size: Size) -> Self {
        Self { pixels, first: FirstOnes::new(cap, size) }
    }
}

impl SensorPixels for CappedPixels {
    fn advance(&mut self, frame: &DenseFrame, sink: &mut dyn EventSink) -> Result<(), SensorError> {
        // Before the events of the frame, which are assigned to intervals by these stamps.
        self.first.stamps.push(frame.t.0);
        self.pixels.advance(frame, &mut KeptEvents { sink, by: &mut self.first })
    }

    fn finish(&mut self, sink: &mut dyn EventSink) -> Result<SimulationAccount, SensorError> {
        let account = self.pixels.finish(&mut KeptEvents { sink, by: &mut self.first })?;
        let FirstOnes { on, off, cap, .. } = self.first;
        Ok(SimulationAccount {
            // The account of the inner pixels counts the dropped events too.
            events: account.events - on - off,
            on: account.on - on,
            off: account.off - off,
            capped: on + off,
            max_per_pixel_frame: account.max_per_pixel_frame.min(cap.into()),
            ..account
        })
    }
}

/// Selects the first events of each pixel between two frames. As in the sensors, an event at the
/// stamp of a frame belongs to the interval before it.
struct FirstOnes {
    cap: u32,
    width: usize,
    /// Stamps of the frames so far, ns. Events may arrive some frames after their interval.
    stamps: Vec<i64>,
    /// Index of the frame that ends the present interval.
    frame: usize,
    /// For each pixel, the interval of its last event and its number of events in it.
    seen: Vec<(usize, u32)>,
    /// Number of dropped ON events.
    on: u64,
    /// Number of dropped OFF events.
    off: u64,
    kept: Vec<Event>,
}

impl FirstOnes {
    fn new(cap: u32, size: Size) -> Self {
        let (seen, width) = (vec![(0, 0); size.pixels()], size.width as usize);
        Self { cap, width, stamps: Vec::new(), frame: 1, seen, on: 0, off: 0, kept: Vec::new() }
    }

    /// Returns true if the event is among the first of its pixel and interval.
    fn keeps(&mut self, event: &Event) -> bool {
        // Events come in file order, so the interval only moves forward.
        while self.stamps.get(self.frame).is_some_and(|&end| end < event.t.0) {
            self.frame += 1;
        }
        let (frame, count) = &mut self.seen[usize::from(event.y) * self.width + usize::from(event.x)];
        if *frame != self.frame {
            (*frame, *count) = (self.frame, 0);
        }
        *count = count.saturating_add(1);
        *count <= self.cap
    }
}

/// A sink that passes on the selected events.
struct KeptEvents<'a> {
    sink: &'a mut dyn EventSink,
    by: &'a mut FirstOnes,
}

impl EventSink for KeptEvents<'_> {
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        let mut kept = std::mem::take(&mut self.by.kept);
        kept.clear();
        for event in events {
            if self.by.keeps(event) {
                kept.push(*event);
            } else if event.polarity == Polarity::On {
                self.by.on += 1;
            } else {
                self.by.off += 1;
            }
        }
        let appended = self.sink.append(&kept);
        self.by.kept = kept;
        appended
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_event::EventLabel;
    use gs2e_num::units::Timestamp;

    #[test]
    fn the_first_of_each_pixel_and_interval_are_kept() {
        let mut all = Vec::new();
        let mut first_ones = FirstOnes::new(2, Size { width: 2, height: 1 });
        first_ones.stamps = vec![0, 10_000, 20_000, 90_000];
        let mut capped = KeptEvents { sink: &mut all, by: &mut first_ones };
        let event =
            |ns, x, polarity| Event { t: Timestamp(ns), x, y: 0, polarity, label: EventLabel::Signal };
        let (on, off) = (Polarity::On, Polarity::Off);
        // The third event of pixel 0 in the first interval is at its very end; the next one is in
        // the second interval.
        let first = [event(1000, 0, on), event(1000, 1, on), event(2000, 0, off), event(10_000, 0, off)];
        let second = [event(10_001, 0, on), event(20_001, 0, on), event(30_000, 0, on), event(31_000, 0, on)];
        capped.append(&first).unwrap();
        capped.append(&second).unwrap();
        assert_eq!((first_ones.on, first_ones.off), (1, 1));
        assert_eq!(all, [&first[..3], &second[..3]].concat());
    }
}
