//! The first events of each pixel between two frames, the rest counted and left out: what `--allow-cap` makes of a sensor
//! whose own cap is out of the way.

use crate::event::{Event, EventSink, Polarity};
use crate::image::Size;

/// What was left out of a stream.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LeftOut {
    /// Events brighter.
    pub on: u64,
    /// Events darker.
    pub off: u64,
}

/// Hands on at most `cap` events of each pixel between two frames. An event at a frame's stamp belongs to the frames
/// before it, as for the sensors.
pub struct Capped<'a> {
    sink: &'a mut dyn EventSink,
    cap: u32,
    width: usize,
    /// In nanoseconds since the first.
    stamps: &'a [i64],
    /// Number of the frame that ends the present interval.
    frame: usize,
    /// Of each pixel the interval of its last event, and its events in it.
    seen: Vec<(usize, u32)>,
    left_out: LeftOut,
    kept: Vec<Event>,
}

impl std::fmt::Debug for Capped<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Capped")
            .field("cap", &self.cap)
            .field("left_out", &self.left_out)
            .finish_non_exhaustive()
    }
}

impl<'a> Capped<'a> {
    /// For a stream of frames of `size` at these stamps, in nanoseconds since the first.
    pub fn new(sink: &'a mut dyn EventSink, cap: u32, size: Size, stamps: &'a [i64]) -> Self {
        let seen = vec![(0, 0); size.pixels()];
        let (width, left_out) = (size.width as usize, LeftOut::default());
        Self { sink, cap, width, stamps, frame: 1, seen, left_out, kept: Vec::new() }
    }

    /// What was left out so far.
    #[must_use]
    pub fn left_out(&self) -> LeftOut {
        self.left_out
    }

    /// Whether it is one of the first of its pixel and interval.
    fn keeps(&mut self, event: &Event) -> bool {
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

impl EventSink for Capped<'_> {
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        let mut kept = std::mem::take(&mut self.kept);
        kept.clear();
        for event in events {
            if self.keeps(event) {
                kept.push(*event);
            } else if event.polarity == Polarity::On {
                self.left_out.on += 1;
            } else {
                self.left_out.off += 1;
            }
        }
        let appended = self.sink.append(&kept);
        self.kept = kept;
        appended
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::Timestamp;

    #[test]
    fn the_first_of_each_pixel_and_interval_are_kept() {
        let mut all = Vec::new();
        let stamps = [0, 10_000, 20_000, 90_000];
        let mut capped = Capped::new(&mut all, 2, Size { width: 2, height: 1 }, &stamps);
        let event = |ns, x, polarity| Event { t: Timestamp(ns), x, y: 0, polarity };
        let (on, off) = (Polarity::On, Polarity::Off);
        // the third of pixel 0 in the first interval is at its very end, the next is in the second
        let first = [event(1000, 0, on), event(1000, 1, on), event(2000, 0, off), event(10_000, 0, off)];
        let second = [event(10_001, 0, on), event(20_001, 0, on), event(30_000, 0, on), event(31_000, 0, on)];
        capped.append(&first).unwrap();
        capped.append(&second).unwrap();
        assert_eq!(capped.left_out(), LeftOut { on: 1, off: 1 });
        assert_eq!(all, [&first[..3], &second[..3]].concat());
    }
}
