//! The cap of a sensor with `allow_cap`: the first events of each pixel between two frames are
//! kept, the others are counted and dropped.

use super::SimulationAccount;
use super::chain::{EventFilter, EventSelection, PixelArray};
use crate::frames::DenseFrame;
use gs2e_event::{Event, EventSink};

/// Selects the first events of each pixel between two frames. As in the sensors, an event at the
/// stamp of a frame belongs to the interval before it.
#[derive(Debug)]
pub(super) struct FirstEvents {
    cap: u32,
    array: PixelArray,
    /// Stamps of the frames so far, ns. Events may arrive some frames after their interval.
    stamps: Vec<i64>,
    /// Index of the frame that ends the present interval.
    frame: usize,
    /// For each pixel, the interval of its last event and its number of events in it.
    counts: Vec<(usize, u32)>,
    selection: EventSelection,
}

impl FirstEvents {
    /// At most `cap` events of each pixel between two frames, from pixels without a cap of their own.
    pub(super) fn new(cap: u32, array: PixelArray) -> Self {
        let counts = vec![(0, 0); array.size.pixels()];
        Self { cap, array, stamps: Vec::new(), frame: 1, counts, selection: EventSelection::default() }
    }
}

impl EventFilter for FirstEvents {
    fn see(&mut self, frame: &DenseFrame) {
        // Before the events of the frame, which are assigned to intervals by these stamps.
        self.stamps.push(frame.t.0);
    }

    fn take(&mut self, events: &[Event], sink: &mut dyn EventSink) -> std::io::Result<()> {
        let Self { cap, array, stamps, frame: present, counts, selection } = self;
        selection.pass(events, sink, |event| {
            // Events come in file order, so the interval only moves forward.
            while stamps.get(*present).is_some_and(|&end| end < event.t.0) {
                *present += 1;
            }
            let (frame, count) = &mut counts[array.pixel(event)];
            if frame != present {
                (*frame, *count) = (*present, 0);
            }
            *count = count.saturating_add(1);
            *count <= *cap
        })
    }

    fn finish(
        &mut self,
        account: SimulationAccount,
        _: &mut dyn EventSink,
    ) -> std::io::Result<SimulationAccount> {
        Ok(SimulationAccount {
            capped: self.selection.dropped(),
            max_per_pixel_frame: account.max_per_pixel_frame.min(self.cap.into()),
            ..self.selection.settle(account)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_event::{EventLabel, Polarity};
    use gs2e_image::Size;
    use gs2e_num::seed::Seed;
    use gs2e_num::units::Timestamp;

    #[test]
    fn the_first_of_each_pixel_and_interval_are_kept() {
        let mut all = Vec::new();
        let size = Size { width: 2, height: 1 };
        let array = PixelArray { size, origin: [0, 0], seed: Seed(1), labels: false };
        let mut capped = FirstEvents::new(2, array);
        capped.stamps = vec![0, 10_000, 20_000, 90_000];
        let event =
            |ns, x, polarity| Event { t: Timestamp(ns), x, y: 0, polarity, label: EventLabel::Signal };
        let (on, off) = (Polarity::On, Polarity::Off);
        // The third event of pixel 0 in the first interval is at its very end; the next one is in
        // the second interval.
        let first = [event(1000, 0, on), event(1000, 1, on), event(2000, 0, off), event(10_000, 0, off)];
        let second = [event(10_001, 0, on), event(20_001, 0, on), event(30_000, 0, on), event(31_000, 0, on)];
        capped.take(&first, &mut all).unwrap();
        capped.take(&second, &mut all).unwrap();
        assert_eq!((capped.selection.on, capped.selection.off), (1, 1));
        assert_eq!(all, [&first[..3], &second[..3]].concat());
    }
}
