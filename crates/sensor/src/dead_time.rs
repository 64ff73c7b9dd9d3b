//! The dead time of a sensor that does not model it: events that follow too soon on the pixel's last
//! one are dropped.
//!
//! The reference of the pixel moves on in the dead time (`reference: passing`): a threshold that is
//! crossed then makes no event, and the next one counts from it. The first event of a pixel always
//! passes.

use super::noise::RefractoryPeriod;
use super::{SensorError, SensorPixels, SimulationAccount};
use crate::frames::DenseFrame;
use gs2e_event::{Event, EventSink, Polarity};
use gs2e_image::Size;

/// Pixels behind a dead time.
pub(super) struct WithDeadTime {
    pixels: Box<dyn SensorPixels>,
    kept: ApartEvents,
}

impl WithDeadTime {
    /// Wraps `pixels`. The period is at least 1 us.
    pub(super) fn new(pixels: Box<dyn SensorPixels>, period: &RefractoryPeriod, size: Size) -> Self {
        Self { pixels, kept: ApartEvents::new(period.period_ns(), size) }
    }
}

impl SensorPixels for WithDeadTime {
    fn advance(&mut self, frame: &DenseFrame, sink: &mut dyn EventSink) -> Result<(), SensorError> {
        self.pixels.advance(frame, &mut ApartSink { sink, kept: &mut self.kept })
    }

    fn finish(&mut self, sink: &mut dyn EventSink) -> Result<SimulationAccount, SensorError> {
        let account = self.pixels.finish(&mut ApartSink { sink, kept: &mut self.kept })?;
        let ApartEvents { on, off, .. } = self.kept;
        Ok(SimulationAccount {
            events: account.events - on - off,
            on: account.on - on,
            off: account.off - off,
            // Events of a pixel are at least a microsecond apart now.
            same_us_same_pixel: 0,
            refractory: on + off,
            ..account
        })
    }
}

/// Selects the events of each pixel that are at least a period apart.
struct ApartEvents {
    period_ns: i64,
    width: usize,
    /// Time of the last event that passed, for each pixel, ns.
    last: Vec<i64>,
    /// Number of dropped ON events.
    on: u64,
    /// Number of dropped OFF events.
    off: u64,
    passed: Vec<Event>,
}

impl ApartEvents {
    fn new(period_ns: i64, size: Size) -> Self {
        // Half of the range, so that a difference cannot overflow.
        let last = vec![i64::MIN / 2; size.pixels()];
        Self { period_ns, width: size.width as usize, last, on: 0, off: 0, passed: Vec::new() }
    }

    fn passes(&mut self, event: &Event) -> bool {
        let last = &mut self.last[usize::from(event.y) * self.width + usize::from(event.x)];
        // Within a microsecond, events are in order of polarity and not of time: an earlier one is
        // dropped too.
        let passes = event.t.0 - *last >= self.period_ns;
        if passes {
            *last = event.t.0;
        }
        passes
    }
}

/// A sink that passes on the selected events.
struct ApartSink<'a> {
    sink: &'a mut dyn EventSink,
    kept: &'a mut ApartEvents,
}

impl EventSink for ApartSink<'_> {
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        let mut passed = std::mem::take(&mut self.kept.passed);
        passed.clear();
        for event in events {
            if self.kept.passes(event) {
                passed.push(*event);
            } else if event.polarity == Polarity::On {
                self.kept.on += 1;
            } else {
                self.kept.off += 1;
            }
        }
        let appended = self.sink.append(&passed);
        self.kept.passed = passed;
        appended
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_event::EventLabel;
    use gs2e_num::units::Timestamp;

    #[test]
    fn events_of_a_pixel_are_a_period_apart() {
        let event =
            |ns, x, polarity| Event { t: Timestamp(ns), x, y: 0, polarity, label: EventLabel::Signal };
        let (on, off) = (Polarity::On, Polarity::Off);
        let mut out = Vec::new();
        let mut kept = ApartEvents::new(79_000, Size { width: 2, height: 1 });
        let all = [
            event(1_000, 0, on),
            event(1_500, 1, off),
            event(79_999, 0, on),
            event(80_000, 0, off),
            event(80_499, 1, off),
            event(158_999, 0, off),
        ];
        ApartSink { sink: &mut out, kept: &mut kept }.append(&all).unwrap();
        assert_eq!(out, [all[0], all[1], all[3]]);
        assert_eq!((kept.on, kept.off), (1, 2));
    }
}
