//! Frames whose voltage the events know: those between two events of the same sign.
//!
//! Each event moves the reference of its pixel by one contrast, so the voltage at an event is known from the
//! counts so far, whatever the path of the light was. In between it is a parabola through three events. The
//! frame at this time shows the same light as a grey.
//!
//! Where the reference follows the voltage during a dead time, the change in it makes no event. It is the
//! rate between the events next to it, without their dead times. At the ends of a run of one sign, the
//! voltage is taken as a parabola whose extremum lies evenly within one contrast of the last event: the means
//! over it are the numbers of [`FIRST`] and [`LAST`].

use crate::recording::{PixelTrains, Recording};

/// Longest time between the two events around a frame, us.
const LONGEST_US: f64 = 80_000.0;
/// Shortest such time, in dead times.
const DEAD_TIMES: f64 = 1.5;
/// Share of the rate between the first two events of a run that its first dead time has, and what the square
/// of dead time and rate adds.
const FIRST: [f64; 2] = [0.87, -0.13];
/// The same after the last event, with the rate before it.
const LAST: [f64; 2] = [0.66, -0.34];
/// An event may be late if it follows the one before within this number of dead times.
const LATE: f64 = 1.2;

/// A grey next to the events that led to it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Anchor {
    pub pixel: usize,
    pub grey: f64,
    /// ON and OFF steps of the voltage so far, in contrasts, with the share of the next.
    pub steps: [f64; 2],
    /// Change of the voltage per us, in contrasts; positive upward.
    pub rate: f64,
    /// Change of the rate per us.
    pub bend: f64,
    /// Time since the first frame, us.
    pub since_us: f64,
    /// Time between the events around the frame, us: the error of the parabola grows with it.
    pub gap_us: f64,
    pub on: bool,
}

/// The events of a pixel with what has been counted up to each.
struct Walk<'a> {
    us: &'a [i64],
    on: &'a [bool],
    /// True if an event came at the read-out of a frame.
    at_read_out: &'a [bool],
    dead_us: f64,
    /// True if what changes in a dead time makes no event.
    loses: bool,
}

impl Walk<'_> {
    fn gap(&self, k: usize) -> f64 {
        (self.us[k + 1] - self.us[k]) as f64
    }

    /// 0 for an ON event, 1 for an OFF event.
    fn side(&self, k: usize) -> usize {
        usize::from(!self.on[k])
    }

    /// Returns true if event `k` and the next have the same sign.
    fn goes_on(&self, k: usize) -> bool {
        k + 1 < self.us.len() && self.on[k] == self.on[k + 1]
    }

    /// Change of the voltage in a dead time at the rate between events `k` and `k + 1`, in contrasts.
    fn in_dead_time(&self, k: usize) -> f64 {
        self.dead_us / (self.gap(k) - self.dead_us).max(0.2 * self.gap(k)).max(1.0)
    }

    /// Change of the voltage in the dead time after event `k`, in contrasts of its sign.
    fn lost(&self, k: usize) -> f64 {
        if !self.loses || self.dead_us <= 0.0 {
            return 0.0;
        }
        let before = (k > 0 && self.goes_on(k - 1)).then(|| k - 1);
        let end = |k: usize, [linear, square]: [f64; 2]| {
            let change = self.in_dead_time(k).min(1.0);
            change * (linear + square * change)
        };
        match (before, self.goes_on(k)) {
            (Some(before), true) => {
                let [a, b] = [before, k].map(|k| self.gap(k));
                // Linear in time between the middles of both gaps.
                (self.in_dead_time(before) * b + self.in_dead_time(k) * a) / (a + b)
            }
            (None, true) => end(k, FIRST),
            (Some(before), false) => end(before, LAST),
            (None, false) => 0.0,
        }
    }

    /// Change of the voltage from event `k` to the next of the same sign, in contrasts.
    fn rise(&self, k: usize) -> f64 {
        1.0 + self.lost(k)
    }

    /// Returns true if the events around the gap after event `k`, or their neighbours, came at a read-out.
    fn is_disturbed(&self, k: usize) -> bool {
        self.at_read_out[k.saturating_sub(1)..self.us.len().min(k + 3)].iter().any(|at| *at)
    }

    /// Returns true if event `k` came in a dead time's wake: its voltage may have passed before.
    fn is_late(&self, k: usize) -> bool {
        k > 0 && self.gap(k - 1) <= LATE * self.dead_us
    }

    /// The parabola between events `k` and `k + 1` at the share `u`: level, slope and twice the square term,
    /// levels in contrasts and times in gaps. `None` without a third event of the same sign.
    fn parabola(&self, k: usize, u: f64) -> Option<[f64; 3]> {
        let (gap, rise) = (self.gap(k), self.rise(k));
        let typical = |gap: f64| gap < 2.0 * LONGEST_US && gap > 0.0;
        let is_before = k > 0 && self.goes_on(k - 1) && !self.is_late(k - 1);
        let before = is_before.then(|| k - 1).filter(|k| typical(self.gap(*k))).map(|k| {
            let r = self.gap(k) / gap;
            (r * rise - self.rise(k)) / (r * (r + 1.0))
        });
        let is_after = self.goes_on(k + 1) && !self.is_late(k + 2);
        let after = is_after.then_some(k + 1).filter(|k| typical(self.gap(*k))).map(|k| {
            let r = self.gap(k) / gap;
            (self.rise(k) - r * rise) / (r * (r + 1.0))
        });
        let square = match (before, after) {
            (Some(a), Some(b)) => 0.5 * (a + b),
            (Some(a), None) | (None, Some(a)) => a,
            (None, None) => return None,
        };
        let square = square.clamp(-rise, rise);
        Some([rise * u + square * u * (u - 1.0), rise + square * (2.0 * u - 1.0), 2.0 * square])
    }

    /// Returns true if the gaps before and after have the same sign. At the end of a run, a parabola is less
    /// certain.
    fn is_inner(&self, k: usize) -> bool {
        k > 0 && self.goes_on(k - 1) && self.goes_on(k + 1)
    }
}

/// Pixels, events and times that the anchors of a recording depend on.
#[derive(Debug)]
pub(crate) struct AnchorFilter<'a> {
    /// Pixels that are left out.
    pub hot: &'a [bool],
    /// Events that came at a read-out, pixel after pixel.
    pub at_read_out: &'a [bool],
}

/// How the events of a camera follow its light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct EventRule {
    /// By which events are stamped late, us.
    pub delay_us: f64,
    pub dead_us: f64,
    /// True if the reference follows the voltage during a dead time, so that its change is lost.
    pub loses: bool,
}

/// The anchors of a recording, in the order of pixels and frames.
pub(crate) fn anchors(recording: &Recording, filter: &AnchorFilter<'_>, rule: EventRule) -> Vec<Anchor> {
    let trains: &PixelTrains = &recording.trains;
    let mut found = Vec::new();
    let mut first = 0;
    for pixel in 0..trains.pixels() {
        let (us, on) = trains.of(pixel);
        let at_read_out = &filter.at_read_out[first..first + us.len()];
        first += us.len();
        if us.len() >= 3 && !filter.hot[pixel] {
            let walk = Walk { us, on, at_read_out, dead_us: rule.dead_us, loses: rule.loses };
            anchors_of(recording, pixel, &walk, rule.delay_us, &mut found);
        }
    }
    found
}

fn anchors_of(recording: &Recording, pixel: usize, walk: &Walk<'_>, delay_us: f64, found: &mut Vec<Anchor>) {
    let first_us = recording.stamps_us[0];
    let (mut steps, mut next) = ([0.0; 2], 0);
    for (frame, stamp) in recording.stamps_us.iter().enumerate() {
        let at_us = (stamp - first_us) as f64 + delay_us;
        // Up to and with the last event before the frame; what the last one swallows is not over yet.
        while next < walk.us.len() && (walk.us[next] - first_us) as f64 <= at_us {
            steps[walk.side(next)] += 1.0;
            if next > 0 {
                steps[walk.side(next - 1)] += walk.lost(next - 1);
            }
            next += 1;
        }
        if next == 0 || next >= walk.us.len() {
            continue;
        }
        let k = next - 1;
        let gap_us = walk.gap(k);
        let is_short = gap_us <= (DEAD_TIMES * walk.dead_us).max(1.0) || walk.is_late(k);
        if !walk.goes_on(k) || gap_us >= LONGEST_US || is_short || walk.is_disturbed(k) {
            continue;
        }
        let u = (at_us - (walk.us[k] - first_us) as f64) / gap_us;
        let Some([level, slope, bend]) = walk.parabola(k, u) else { continue };
        let sign = if walk.on[k] { 1.0 } else { -1.0 };
        let mut steps = steps;
        steps[walk.side(k)] += level;
        found.push(Anchor {
            pixel,
            grey: recording.grey(frame, pixel),
            steps,
            rate: sign * slope / gap_us,
            bend: sign * bend / (gap_us * gap_us),
            since_us: at_us - delay_us,
            gap_us: if walk.is_inner(k) { gap_us } else { 1.5 * gap_us },
            on: walk.on[k],
        });
    }
}
