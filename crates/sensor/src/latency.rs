//! Latency: the time from the crossing of a threshold to the stamp of its event, with its jitter.
//!
//! An event at light `E` is late by a normal deviate with the mean `us + tau_us * 1000 lux / E` and the
//! standard deviation `jitter_us`, within 0 and `max_us`. The second term is the time constant of the
//! photoreceptor, which is inversely proportional to the light, and is stated for 1000 lux: a low-pass
//! filter delays brightness that changes steadily by its time constant. Source: Joubert et al., Frontiers
//! in Neuroscience 15, 2021, and its program IEBCS (neuromorphicsystems/IEBCS, `DvsSensor`), which
//! have a mean, a jitter, and a time constant at 1 klux. The program also delays an event by the response of
//! the filter to the height of a step, and makes the jitter larger for small steps. Here, the delay follows
//! from the light alone, and no event is lost by the filter.
//!
//! A pixel finishes an event before it makes the next: events of a pixel keep their order and their dead
//! time. Events that would be stamped after the last frame are left out and counted, and the first ones of a
//! clip come as late as all others.
//!
//! # Examples
//!
//! ```
//! use gs2e_sensor::latency::PixelLatency;
//!
//! let latency = PixelLatency { us: 100.0, jitter_us: 20.0, tau_us: 50.0, max_us: 2000.0 };
//! // The time constant is ten times as long at a tenth of 1000 lux.
//! assert_eq!(latency.mean_us(1000.0), 150.0);
//! assert_eq!(latency.mean_us(100.0), 600.0);
//! // In darkness, the largest delay holds.
//! assert_eq!(latency.mean_us(0.0), 2000.0);
//! assert_eq!(latency.without_jitter().jitter_us, 0.0);
//! ```

mod light;

use super::chain::{EventFilter, PassedEvents, PixelArray};
use super::front_end::FrontEnd;
use super::noise::PixelSite;
use super::screening::{ScreenError, at_least_zero};
use super::{SensorSettings, SimulationAccount};
use crate::frames::DenseFrame;
use gs2e_event::{Event, EventSink};
use gs2e_num::seed::DrawSpace;
use light::RecentLight;
use serde::{Deserialize, Serialize};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::io;

/// Delays of the events of a sensor, in microseconds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PixelLatency {
    /// Mean delay in bright light, at most `max_us`.
    pub us: f64,
    /// Standard deviation of the delay.
    #[serde(default, skip_serializing_if = "super::is_default")]
    pub jitter_us: f64,
    /// Time constant of the photoreceptor at 1000 lux, which is added to the mean, inversely proportional to
    /// the light.
    #[serde(default, skip_serializing_if = "super::is_default")]
    pub tau_us: f64,
    /// Largest delay; above 0.
    pub max_us: f64,
}

/// Light at which `tau_us` is stated, lux.
const STATED_LUX: f64 = 1000.0;
/// Largest delay of a recipe that states none, as in the program.
pub const MAX_US: f64 = 1e4;

impl PixelLatency {
    /// Returns true if no event is late.
    #[must_use]
    pub fn is_absent(&self) -> bool {
        // `max_us` alone delays nothing, so it does not keep a sensor from the path without latency.
        self.us == 0.0 && self.jitter_us == 0.0 && self.tau_us == 0.0
    }

    /// Mean delay at a light, us, before deviates below 0 and above `max_us` are cut.
    #[must_use]
    pub fn mean_us(&self, lux: f64) -> f64 {
        // In darkness, the quotient of 0 by 0 would be no number.
        let filter = if self.tau_us > 0.0 { self.tau_us * (STATED_LUX / lux.max(0.0)) } else { 0.0 };
        (self.us + filter).min(self.max_us)
    }

    /// The same delays without their jitter.
    #[must_use]
    pub fn without_jitter(self) -> Self {
        Self { jitter_us: 0.0, ..self }
    }

    /// Checks the numbers, for a sensor behind this front end.
    ///
    /// # Errors
    /// A number is outside its range, or the light is needed and not stated.
    pub(super) fn validate(&self, front_end: &FrontEnd) -> Result<(), ScreenError> {
        let numbers =
            [("latency.us", self.us), ("latency.jitter_us", self.jitter_us), ("latency.tau_us", self.tau_us)];
        for (name, found) in numbers {
            at_least_zero(name, found)?;
        }
        if !(self.max_us > 0.0 && self.max_us.is_finite()) {
            let (name, wanted) = ("latency.max_us", "a finite number above 0");
            return Err(ScreenError::Parameter { name, found: self.max_us, wanted });
        }
        if self.us > self.max_us {
            return Err(ScreenError::Combination("`latency.us` must be at most `latency.max_us`"));
        }
        if self.tau_us > 0.0 && front_end.lux.is_none() {
            let message = "`latency.tau_us` requires `front_end.lux`, the light of white";
            return Err(ScreenError::Combination(message));
        }
        Ok(())
    }
}

/// Counts of a latency. `kept` and `unread` sum to `made`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LatencyAccount {
    /// Events of the pixels.
    pub made: u64,
    /// Events that are in the stream.
    pub kept: u64,
    /// Events left out because they would be stamped after the last frame.
    pub unread: u64,
    /// Mean delay of the events in the stream, us.
    pub mean_us: f64,
    /// Largest delay, us.
    pub max_us: f64,
}

impl EventFilter for LateEvents {
    fn see(&mut self, frame: &DenseFrame) {
        self.last_ns = frame.t.0;
        if let Some(light) = &mut self.light {
            light.add(frame);
        }
    }

    fn take(&mut self, events: &[Event], sink: &mut dyn EventSink) -> io::Result<()> {
        events.iter().try_for_each(|event| self.take_one(*event, sink))
    }

    /// Passes on the events up to the last frame, and counts the others.
    fn finish(
        &mut self,
        account: SimulationAccount,
        sink: &mut dyn EventSink,
    ) -> io::Result<SimulationAccount> {
        self.delay_microsecond();
        self.pass_before(self.last_ns.saturating_add(1), sink)?;
        self.flush(sink)?;
        self.counts.unread = self.waiting.len() as u64;
        self.counts.kept = self.counted.count;
        if self.counts.kept > 0 {
            self.counts.mean_us /= self.counts.kept as f64;
        }
        Ok(SimulationAccount { latency: Some(self.counts), ..self.counted.settle(account) })
    }
}

/// The previous event of a pixel, late.
#[derive(Debug, Clone, Copy)]
struct PixelPast {
    t_ns: i64,
    /// Number of events of the pixel, which numbers their draws.
    count: u32,
}

/// A late event, in the order of files.
#[derive(Debug, PartialEq, Eq)]
struct LateEvent {
    event: Event,
    /// Its delay, ns.
    delay_ns: i64,
}

impl PartialOrd for LateEvent {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for LateEvent {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        let key =
            |late: &Self| (late.event.file_order(), late.event.t, late.delay_ns, late.event.label as u8);
        key(self).cmp(&key(other))
    }
}

/// Late events collected before they are passed on.
const CHUNK: usize = 1 << 14;

/// The events of pixels that are late.
#[derive(Debug)]
pub(super) struct LateEvents {
    latency: PixelLatency,
    /// The light of the last frames, if the delay depends on it.
    light: Option<RecentLight>,
    dead_ns: i64,
    array: PixelArray,
    past: Vec<PixelPast>,
    /// Events of the present microsecond. Files are not sorted within one.
    arriving: Vec<Event>,
    waiting: BinaryHeap<Reverse<LateEvent>>,
    passed: Vec<Event>,
    /// Stamp of the last frame, ns.
    last_ns: i64,
    counts: LatencyAccount,
    counted: PassedEvents,
}

impl LateEvents {
    /// The delays of a sensor with these settings, for its pixels.
    pub(super) fn new(latency: PixelLatency, settings: &SensorSettings, array: PixelArray) -> Self {
        // Half of the range, so that the sum with a dead time cannot overflow.
        let past = PixelPast { t_ns: i64::MIN / 2, count: 0 };
        Self {
            latency,
            light: (latency.tau_us > 0.0).then(|| RecentLight::new(settings.front_end.white_lux())),
            dead_ns: settings.refractory.period_ns(),
            array,
            past: vec![past; array.size.pixels()],
            arriving: Vec::new(),
            waiting: BinaryHeap::new(),
            passed: Vec::new(),
            last_ns: 0,
            counts: LatencyAccount::default(),
            counted: PassedEvents::new(&array),
        }
    }

    /// Takes the next event of the pixels, in file order.
    fn take_one(&mut self, event: Event, sink: &mut dyn EventSink) -> io::Result<()> {
        let same = |first: &Event| first.t.floor_micros() == event.t.floor_micros();
        if !self.arriving.first().is_none_or(same) {
            self.delay_microsecond();
            // A delay is not negative, so no event comes before this microsecond any more.
            self.pass_before(event.t.floor_micros() * 1000, sink)?;
        }
        self.arriving.push(event);
        Ok(())
    }

    /// Delays the events of the collected microsecond, those of each pixel in order of time.
    fn delay_microsecond(&mut self) {
        let mut arriving = std::mem::take(&mut self.arriving);
        // Stable, so that events of one nanosecond keep the order of files.
        arriving.sort_by_key(|event| event.t);
        arriving.drain(..).for_each(|event| self.delay(event));
        self.arriving = arriving;
    }

    fn delay(&mut self, event: Event) {
        let pixel = self.array.pixel(&event);
        let site = self.array.site(pixel);
        let lux = self.light.as_ref().map_or(f64::INFINITY, |light| light.at(event.t.0, pixel));
        let PixelPast { t_ns: before, count } = self.past[pixel];
        let due = event.t.0 + self.latency.draw_ns(lux, site, count);
        // The pixel is at rest again `dead_ns` after its previous event. This never makes an event later than
        // `max_us`: it was the same time after the previous crossing.
        let late = due.max(before + self.dead_ns);
        self.past[pixel] = PixelPast { t_ns: late, count: count.wrapping_add(1) };
        self.counts.made += 1;
        let delay_ns = late - event.t.0;
        let event = Event { t: gs2e_num::units::Timestamp(late), ..event };
        self.waiting.push(Reverse(LateEvent { event, delay_ns }));
    }

    /// Passes on the events before a time, ns.
    fn pass_before(&mut self, end_ns: i64, sink: &mut dyn EventSink) -> io::Result<()> {
        while self.waiting.peek().is_some_and(|Reverse(late)| late.event.t.0 < end_ns) {
            let Some(Reverse(late)) = self.waiting.pop() else { break };
            self.pass(late);
            if self.passed.len() >= CHUNK {
                self.flush(sink)?;
            }
        }
        Ok(())
    }

    fn pass(&mut self, LateEvent { event, delay_ns }: LateEvent) {
        let delay_us = delay_ns as f64 * 1e-3;
        // The sum; `finish` divides it.
        self.counts.mean_us += delay_us;
        self.counts.max_us = self.counts.max_us.max(delay_us);
        self.counted.add(&event, self.array.pixel(&event));
        self.passed.push(event);
    }

    fn flush(&mut self, sink: &mut dyn EventSink) -> io::Result<()> {
        sink.append(&self.passed)?;
        self.passed.clear();
        Ok(())
    }
}

impl PixelLatency {
    /// The delay of event `count` of a pixel, ns.
    #[expect(clippy::cast_possible_truncation, reason = "delays are below 2^53 ns")]
    fn draw_ns(&self, lux: f64, site: PixelSite, count: u32) -> i64 {
        let mut us = self.mean_us(lux);
        if self.jitter_us > 0.0 {
            us += self.jitter_us * site.draws(DrawSpace::Latency, u64::from(count)).normal();
        }
        (us.clamp(0.0, self.max_us) * 1e3).round() as i64
    }
}

#[cfg(test)]
mod tests;
