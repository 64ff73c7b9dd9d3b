//! Frames whose voltage the events know: those between two events of the same sign.
//!
//! Each event moves the reference of its pixel by one contrast, so the voltage at an event is known from the
//! counts so far, whatever the path of the light was. In between it is a parabola through three events. The
//! frame at this time shows the same light as a grey.

use crate::recording::{PixelTrains, Recording};

/// Longest time between the two events around a frame, us.
const LONGEST_US: f64 = 80_000.0;
/// Shortest such time, in dead times.
const DEAD_TIMES: f64 = 1.5;
/// An event may be late if it follows the one before within this number of dead times.
const LATE: f64 = 1.2;

/// A grey next to the events that led to it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Anchor {
    pub pixel: usize,
    pub grey: f64,
    /// ON and OFF events so far, with the share of the next.
    pub counts: [f64; 2],
    /// The change that a dead time swallows if the reference follows the voltage, in contrasts ON and OFF.
    pub lost: [f64; 2],
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
    /// Whether an event came at the read-out of a frame.
    at_read_out: &'a [bool],
    dead_us: f64,
}

impl Walk<'_> {
    fn gap(&self, k: usize) -> f64 {
        (self.us[k + 1] - self.us[k]) as f64
    }

    /// Returns true if event `k` and the next have the same sign.
    fn goes_on(&self, k: usize) -> bool {
        k + 1 < self.us.len() && self.on[k] == self.on[k + 1]
    }

    /// Change of the voltage in the dead time after event `k`, in contrasts.
    fn swallowed(&self, k: usize) -> f64 {
        if self.dead_us <= 0.0 || !self.goes_on(k) {
            return 0.0;
        }
        self.dead_us / (self.gap(k) - self.dead_us).max(0.2 * self.gap(k)).max(1.0)
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
        let gap = self.gap(k);
        let typical = |g: &f64| *g < 2.0 * LONGEST_US && *g > 0.0;
        let before = (k > 0 && self.goes_on(k - 1) && !self.is_late(k - 1)).then(|| self.gap(k - 1));
        let after = (self.goes_on(k + 1) && !self.is_late(k + 2)).then(|| self.gap(k + 1));
        let before = before.filter(typical).map(|g| g / gap).map(|r| (r - 1.0) / (r * (r + 1.0)));
        let after = after.filter(typical).map(|g| g / gap).map(|r| (1.0 - r) / (r * (r + 1.0)));
        let square = match (before, after) {
            (Some(a), Some(b)) => 0.5 * (a + b),
            (Some(a), None) | (None, Some(a)) => a,
            (None, None) => return None,
        };
        let square = square.clamp(-1.0, 1.0);
        Some([u + square * u * (u - 1.0), 1.0 + square * (2.0 * u - 1.0), 2.0 * square])
    }

    /// Whether both neighbours of the gap have its sign. At the end of a run, a parabola is less certain.
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
    pub dead_us: f64,
}

/// The anchors of a recording whose events are stamped `delay_us` late, in the order of pixels and frames.
pub(crate) fn anchors(recording: &Recording, filter: &AnchorFilter<'_>, delay_us: f64) -> Vec<Anchor> {
    let trains: &PixelTrains = &recording.trains;
    let mut found = Vec::new();
    let mut first = 0;
    for pixel in 0..trains.pixels() {
        let (us, on) = trains.of(pixel);
        let at_read_out = &filter.at_read_out[first..first + us.len()];
        first += us.len();
        if us.len() >= 3 && !filter.hot[pixel] {
            let walk = Walk { us, on, at_read_out, dead_us: filter.dead_us };
            anchors_of(recording, pixel, &walk, delay_us, &mut found);
        }
    }
    found
}

fn anchors_of(recording: &Recording, pixel: usize, walk: &Walk<'_>, delay_us: f64, found: &mut Vec<Anchor>) {
    let first_us = recording.stamps_us[0];
    let (mut counts, mut lost, mut next) = ([0.0; 2], [0.0; 2], 0);
    for (frame, stamp) in recording.stamps_us.iter().enumerate() {
        let at_us = (stamp - first_us) as f64 + delay_us;
        // Up to and with the last event before the frame; what the last one swallows is not over yet.
        while next < walk.us.len() && (walk.us[next] - first_us) as f64 <= at_us {
            let side = usize::from(!walk.on[next]);
            counts[side] += 1.0;
            if next > 0 {
                let side = usize::from(!walk.on[next - 1]);
                lost[side] += walk.swallowed(next - 1);
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
        let (side, sign) = if walk.on[k] { (0, 1.0) } else { (1, -1.0) };
        let (mut counts, mut lost) = (counts, lost);
        counts[side] += level;
        lost[side] += walk.swallowed(k) * level;
        found.push(Anchor {
            pixel,
            grey: recording.grey(frame, pixel),
            counts,
            lost,
            rate: sign * slope / gap_us,
            bend: sign * bend / (gap_us * gap_us),
            since_us: at_us - delay_us,
            gap_us: if walk.is_inner(k) { gap_us } else { 1.5 * gap_us },
            on: walk.on[k],
        });
    }
}
