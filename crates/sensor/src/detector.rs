//! A change detector: a pixel that stores a reference brightness and makes an event when its
//! brightness differs from it by a threshold. ESIM and v2e share this part.

use super::course::BrightnessCourse;
use super::label;
use super::noise::poisson::{LinearRate, PoissonTrain};
use super::noise::{PixelSite, ReferenceRule, RefractoryPeriod};
use super::pairs::PairWriter;
use gs2e_event::{EventLabel, Polarity};
use gs2e_num::seed::DrawSpace;
use std::ops::ControlFlow;

/// State of one pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct DetectorPixel {
    /// Thresholds of ON and OFF.
    pub(super) thresholds: [f64; 2],
    /// The reference brightness.
    pub(super) reference: f64,
    /// The part of the reference that is leak and not brightness. Together with the course's
    /// addition since the previous frame, this is the leak since the reference was last set.
    leaked: f64,
    /// The first nanosecond in which the pixel may make an event again, since the previous frame; 0
    /// if that time has passed.
    dead: i64,
}

/// The sign of a change, and what made it.
#[derive(Clone, Copy)]
struct EventCause {
    polarity: Polarity,
    label: EventLabel,
}

/// Events that do not depend on brightness.
#[derive(Debug)]
pub(super) struct SpontaneousKind<'a> {
    pub(super) train: &'a mut PoissonTrain,
    pub(super) rates: LinearRate,
    pub(super) site: PixelSite,
    pub(super) space: DrawSpace,
    /// Probability of ON.
    pub(super) on_share: f64,
    /// True if an event of this kind sets the reference to the present brightness.
    pub(super) resets: bool,
}

impl SpontaneousKind<'_> {
    /// Time of the next event after `start`; infinite if it is not before the later frame.
    fn due(&mut self, start: f64) -> f64 {
        self.train.advance(&self.rates, start).unwrap_or(f64::INFINITY)
    }
}

impl DetectorPixel {
    pub(super) fn new(thresholds: [f64; 2], reference: f64) -> Self {
        Self { thresholds, reference, leaked: 0.0, dead: 0 }
    }

    /// Returns true if a brightness that moves on a straight line makes no event. The pixel may then go on to
    /// the later frame as it is, if it has no leak and no events of its own.
    #[inline(always)]
    pub(super) fn rests(&self, from: f64, to: f64) -> bool {
        let (high, low) = (self.reference + self.thresholds[0], self.reference - self.thresholds[1]);
        // `from` is compared too: after a dead time, or with new thresholds, it may lie past a level already.
        self.dead == 0 && from < high && from > low && to < high && to > low
    }

    /// Follows the course to the later frame and makes events in order of time.
    pub(super) fn cross<const N: usize>(
        &mut self,
        course: &BrightnessCourse,
        refractory: &RefractoryPeriod,
        sources: &mut [SpontaneousKind<'_>; N],
        writer: &mut PairWriter<'_>,
    ) -> ControlFlow<()> {
        let length = course.length();
        let mut due = std::array::from_fn::<f64, N, _>(|i| sources[i].due(0.0));
        let mut now = 0.0;
        loop {
            // Without further own events all times are infinite, and the watch below reaches the
            // later frame.
            let which = (1..N).fold(0, |first, i| if due[i] < due[first] { i } else { first });
            let until = due[which].min(length);
            // Crossings up to the own event come first: it may move the reference and starts a dead
            // time.
            self.watch(course, [now, until], refractory, writer)?;
            // Not `>=`: an interval contains its end, so an own event at the later frame is made here.
            if due[which] > length {
                break;
            }
            now = until;
            let source = &mut sources[which];
            // Drawn in the dead time as well. The process belongs to a source that knows nothing of
            // the dead time, which only hides its events.
            let mark = source.train.wait(source.site, source.space);
            due[which] = source.due(now);
            let ns = PairWriter::nanosecond(now);
            if ns >= self.dead {
                let on = mark < source.on_share;
                let polarity = if on { Polarity::On } else { Polarity::Off };
                self.note(now, EventCause { polarity, label: EventLabel::Noise }, refractory, writer)?;
                if source.resets {
                    self.remember(course, now);
                }
            }
        }
        #[expect(clippy::cast_possible_truncation, reason = "times between frames are below 2^56 ns")]
        let passed = length as i64;
        // Both are counted from the later frame on, because the next call measures time from there.
        self.dead = (self.dead - passed).max(0);
        self.leaked += course.added(length);
        ControlFlow::Continue(())
    }

    /// Follows the brightness between two instants.
    fn watch(
        &mut self,
        course: &BrightnessCourse,
        [from, until]: [f64; 2],
        refractory: &RefractoryPeriod,
        writer: &mut PairWriter<'_>,
    ) -> ControlFlow<()> {
        let mut now = from;
        // A search for a crossing assumes a monotonic course, so the stretch is cut where it turns.
        let turn = course.turn().filter(|turn| *turn > from && *turn < until);
        for end in turn.into_iter().chain([until]) {
            while let Some((t, polarity)) = self.next(course, [now, end], refractory) {
                let label = self.pass(course, t, polarity);
                now = t;
                // Only a crossing inside the dead time is too early.
                if PairWriter::nanosecond(t) >= self.dead {
                    self.note(t, EventCause { polarity, label }, refractory, writer)?;
                }
            }
            now = end;
        }
        ControlFlow::Continue(())
    }

    /// Sets the reference to the brightness at `t`.
    fn remember(&mut self, course: &BrightnessCourse, t: f64) {
        self.reference = course.at(t);
        // The course adds leak from the earlier frame on. This offset makes the sum 0 at `t`.
        self.leaked = -course.added(t);
    }

    /// Moves the reference by the threshold that is crossed at `t`. The part of the threshold that
    /// leak did not cover is brightness.
    fn pass(&mut self, course: &BrightnessCourse, t: f64, polarity: Polarity) -> EventLabel {
        let (threshold, way) = match polarity {
            Polarity::On => (self.thresholds[0], 1.0),
            Polarity::Off => (self.thresholds[1], -1.0),
        };
        self.reference += way * threshold;
        let added = course.added(t);
        let leaked = way * (self.leaked + added);
        // After a dead time, more than one threshold may have been crossed. The next search starts
        // with the rest.
        let left = if leaked > threshold {
            (leaked - threshold).min((way * (course.at(t) - self.reference)).max(0.0))
        } else {
            0.0
        };
        self.leaked = way * left - added;
        label::label_of(threshold - leaked, threshold)
    }

    /// The next crossing of a threshold on a monotonic stretch. A pixel in its dead time does not
    /// look, unless crossed thresholds move its reference.
    fn next(
        &mut self,
        course: &BrightnessCourse,
        [mut now, end]: [f64; 2],
        refractory: &RefractoryPeriod,
    ) -> Option<(f64, Polarity)> {
        let dead = self.dead as f64;
        if refractory.reference != ReferenceRule::Passing && dead > now {
            if dead > end {
                return None;
            }
            now = dead;
            if refractory.reference == ReferenceRule::AtEnd {
                self.remember(course, now);
            }
        }
        let (high, low) = (self.reference + self.thresholds[0], self.reference - self.thresholds[1]);
        let [here, there] = [course.at(now), course.at(end)];
        // If a threshold is lost in the last digit of the reference, the loop would never end.
        if high <= self.reference || low >= self.reference {
            return None;
        }
        // Past the level already at `now`: after a dead time, or under thresholds that were drawn
        // again.
        if here >= high {
            Some((now, Polarity::On))
        } else if here <= low {
            Some((now, Polarity::Off))
        } else if there >= high {
            Some((course.reaches(high, [now, end]), Polarity::On))
        } else if there <= low {
            Some((course.reaches(low, [now, end]), Polarity::Off))
        } else {
            None
        }
    }

    fn note(
        &mut self,
        t: f64,
        cause: EventCause,
        refractory: &RefractoryPeriod,
        writer: &mut PairWriter<'_>,
    ) -> ControlFlow<()> {
        let ns = writer.event(t, cause.polarity, cause.label)?;
        let period = refractory.period_ns();
        if period > 0 {
            self.dead = ns + period;
        }
        ControlFlow::Continue(())
    }
}

/// Difference between a pixel's event balance and the `change` of its brightness, in larger
/// thresholds.
pub(super) fn event_imbalance(detector: &DetectorPixel, change: f64, on: u32, off: u32) -> f64 {
    let [up, down] = detector.thresholds;
    let balance = up * f64::from(on) - down * f64::from(off) - change;
    // Each event rounds the reference once, in the last of 53 bits of numbers below about 100
    // thresholds.
    balance.abs() / (up.max(down) * (1.0 + 1e-9))
}
