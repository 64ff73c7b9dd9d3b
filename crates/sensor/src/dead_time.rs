//! The dead time of a sensor that does not model it: events that follow too soon on the pixel's last
//! one are dropped.
//!
//! The reference of the pixel moves on in the dead time (`reference: passing`): a threshold that is
//! crossed then makes no event, and the next one counts from it. The first event of a pixel always
//! passes.

use super::SimulationAccount;
use super::chain::{EventFilter, EventSelection, PixelArray};
use super::noise::RefractoryPeriod;
use gs2e_event::{Event, EventSink};

/// Selects the events of each pixel that are at least a period apart.
#[derive(Debug)]
pub(super) struct DeadTime {
    period_ns: i64,
    array: PixelArray,
    /// Time of the last event that passed, for each pixel, ns.
    last: Vec<i64>,
    selection: EventSelection,
}

impl DeadTime {
    /// The dead time of a period, if it is above 0. The period is at least 1 us then.
    pub(super) fn new(period: &RefractoryPeriod, array: PixelArray) -> Option<Self> {
        let period_ns = period.period_ns();
        (period_ns > 0).then(|| {
            // Half of the range, so that a difference cannot overflow.
            let last = vec![i64::MIN / 2; array.size.pixels()];
            Self { period_ns, array, last, selection: EventSelection::default() }
        })
    }
}

impl EventFilter for DeadTime {
    fn take(&mut self, events: &[Event], sink: &mut dyn EventSink) -> std::io::Result<()> {
        let Self { period_ns, array, last, selection } = self;
        selection.pass(events, sink, |event| {
            let last = &mut last[array.pixel(event)];
            // Within a microsecond, events are in order of polarity and not of time: an earlier one is
            // dropped too.
            let passes = event.t.0 - *last >= *period_ns;
            if passes {
                *last = event.t.0;
            }
            passes
        })
    }

    fn finish(
        &mut self,
        account: SimulationAccount,
        _: &mut dyn EventSink,
    ) -> std::io::Result<SimulationAccount> {
        // Events of a pixel are at least a microsecond apart now.
        let refractory = self.selection.dropped();
        Ok(SimulationAccount { same_us_same_pixel: 0, refractory, ..self.selection.settle(account) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::ReferenceRule;
    use gs2e_event::{EventLabel, Polarity};
    use gs2e_image::Size;
    use gs2e_num::seed::Seed;
    use gs2e_num::units::Timestamp;

    #[test]
    fn events_of_a_pixel_are_a_period_apart() {
        let event =
            |ns, x, polarity| Event { t: Timestamp(ns), x, y: 0, polarity, label: EventLabel::Signal };
        let (on, off) = (Polarity::On, Polarity::Off);
        let mut out = Vec::new();
        let size = Size { width: 2, height: 1 };
        let array = PixelArray { size, origin: [0, 0], seed: Seed(1), labels: false };
        let period = RefractoryPeriod { period_us: 79.0, reference: ReferenceRule::Passing };
        let mut dead_time = DeadTime::new(&period, array).unwrap();
        let all = [
            event(1_000, 0, on),
            event(1_500, 1, off),
            event(79_999, 0, on),
            event(80_000, 0, off),
            event(80_499, 1, off),
            event(158_999, 0, off),
        ];
        dead_time.take(&all, &mut out).unwrap();
        assert_eq!(out, [all[0], all[1], all[3]]);
        assert_eq!((dead_time.selection.on, dead_time.selection.off), (1, 2));
    }
}
