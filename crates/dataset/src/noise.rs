//! Noise among the events, from frames of the same pixels.
//!
//! Two numbers bound the rate of noise, events per pixel and time, if noise falls on all pixels alike:
//!
//! - **contrary events**: where brightness rises steadily, an OFF event is noise, and the other way round.
//!   Half of the noise has the wrong polarity, so their rate is half of that of the noise.
//! - **events of still pixels**, whose brightness stays within a quarter of a threshold.
//!
//! The smaller one counts: real pixels have more noise at moving edges than elsewhere, and still pixels may
//! see a slow change. The share of contrary events among those of steady pixels shows wrong polarities too.

use super::bursts::{FrameBursts, RUNS};
use super::clock::EventClock;
use super::{EventDataset, OpenEvents, for_each_event, jackknife_error};
use gs2e_check::{Finding, Judgement, JudgementResult, Verdict};
use gs2e_event::{EventFileError, Polarity};

/// Distances of the frames that show whether a pixel is steady or still.
const LADDER: [usize; 7] = [1, 2, 4, 8, 16, 32, 64];
/// Smallest change on both sides of a steady interval, thresholds.
const STEADY: f64 = 0.75;
/// Largest ratio of the changes before and after it.
const MAX_UNEVEN: f64 = 3.0;
/// Largest range of a still pixel, thresholds.
const STILL: f64 = 0.25;
/// Minimum number of events of steady pixels.
const MIN_EVENTS: f64 = 200.0;
/// Share of noise that fails, and that warns. Recordings of real cameras with frames have 1 to 5 %.
const MAX_NOISE: [f64; 2] = [0.3, 0.15];
/// Share of contrary events that fails: real pixels have 5 to 12 %, by the read-out of frames, and noise of a
/// tenth of all events makes up to 15 % where little else happens.
const MAX_CONTRARY: f64 = 0.25;
/// Standard errors beyond a limit that a fault needs, and for a probability of 95 %.
const SIGMAS: [f64; 2] = [4.0, 1.645];

/// What the frames show of a pixel around an interval.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PixelState {
    Rising,
    Falling,
    Still,
    Other,
}

/// Counts of one quadrant of one run.
#[derive(Debug, Clone, Copy, Default)]
struct StateCounts {
    /// Events, and time of all pixels together (us), of steady pixels.
    steady: [f64; 2],
    /// Events of steady pixels with the wrong polarity.
    contrary: f64,
    /// Events and time of still pixels.
    still: [f64; 2],
}

/// The noise of a stream.
#[derive(Debug, Clone)]
pub(super) struct StreamNoise {
    blocks: Vec<StateCounts>,
    /// Events per pixel and us of the whole stream.
    rate: f64,
}

impl StreamNoise {
    /// Counts the events of a stream with `rate` events per pixel and us.
    pub(super) fn measure(
        events: OpenEvents<'_>,
        bursts: &FrameBursts,
        clock: &EventClock,
        rate: f64,
    ) -> Result<Self, EventFileError> {
        let states = find_states(bursts, clock.thresholds);
        let mut blocks = vec![StateCounts::default(); 4 * RUNS];
        for (run, intervals) in bursts.runs.iter().enumerate() {
            for interval in intervals.clone() {
                let length = bursts.length_us(interval);
                for (place, state) in states[interval].iter().enumerate() {
                    blocks[4 * run + bursts.quadrant(place)].pass(*state, length);
                }
            }
        }
        let places = bursts.places();
        for_each_event(events, |event, t_us| {
            let Some(place) = places.of(event) else { return };
            let t = t_us as f64 - clock.offset_at(t_us as f64);
            let state = bursts.interval_at(t).and_then(|interval| states[interval].get(place));
            let Some(state) = state else { return };
            let block = &mut blocks[4 * bursts.run_at(t) + bursts.quadrant(place)];
            block.count(*state, event.polarity == Polarity::On);
        })?;
        Ok(Self { blocks, rate })
    }

    /// The findings: the share of noise, and that of contrary events.
    pub(super) fn findings(&self, dataset: &EventDataset<'_>) -> [Finding; 2] {
        [
            dataset.finding("noise_floor", "share", self.judge_share()),
            dataset.finding("polarity", "contrary", self.judge_contrary()),
        ]
    }

    fn require_steady(&self) -> Result<(), String> {
        let steady = self.sum(usize::MAX).steady[0];
        if steady < MIN_EVENTS {
            return Err(format!("only {steady:.0} events lie where brightness changes steadily"));
        }
        Ok(())
    }

    fn judge_share(&self) -> JudgementResult {
        self.require_steady()?;
        let by_contrary = self.estimate(&|sum| 2.0 * sum.contrary / sum.steady[1] / self.rate);
        let by_still = self.estimate(&|sum| sum.still[0] / sum.still[1] / self.rate);
        // Without a still pixel the share by still pixels is NaN, and `min` returns the other.
        let [share, error] = if by_still[0] < by_contrary[0] { by_still } else { by_contrary };
        let share = share.min(1.0);
        let [most, some] = MAX_NOISE.map(|limit| limit + SIGMAS[0] * error);
        let verdict = match share {
            share if share > most => Verdict::Fail,
            share if share > some => Verdict::Warn,
            _ => Verdict::Pass,
        };
        let because = format!(
            "about {:.1} +- {:.1} % of the events are noise: their number does not follow the change of the frames",
            100.0 * share,
            100.0 * error
        );
        let judged = Judgement::new(verdict, share, most, "1", because);
        Ok(detecting(judged, most + SIGMAS[1] * error))
    }

    fn judge_contrary(&self) -> JudgementResult {
        self.require_steady()?;
        let [share, error] = self.estimate(&|sum| sum.contrary / sum.steady[0]);
        let most = MAX_CONTRARY + SIGMAS[0] * error;
        let verdict = if share > most { Verdict::Fail } else { Verdict::Pass };
        let because = format!(
            "{:.1} +- {:.1} % of the events where brightness changes steadily have the wrong polarity",
            100.0 * share,
            100.0 * error
        );
        let judged = Judgement::new(verdict, share, most, "1", because);
        Ok(detecting(judged, most + SIGMAS[1] * error))
    }

    /// A statistic of all blocks, with its standard error.
    fn estimate(&self, of: &dyn Fn(&StateCounts) -> f64) -> [f64; 2] {
        let used: Vec<usize> =
            (0..self.blocks.len()).filter(|block| self.blocks[*block].steady[1] > 0.0).collect();
        [of(&self.sum(usize::MAX)), jackknife_error(used.len(), &|skip| of(&self.sum(used[skip])))]
    }

    fn sum(&self, skip: usize) -> StateCounts {
        let mut sum = StateCounts::default();
        for (_, block) in self.blocks.iter().enumerate().filter(|(number, _)| *number != skip) {
            sum.contrary += block.contrary;
            for (of, value) in [(&mut sum.steady, block.steady), (&mut sum.still, block.still)] {
                of[0] += value[0];
                of[1] += value[1];
            }
        }
        sum
    }
}

impl StateCounts {
    fn pass(&mut self, state: PixelState, length_us: f64) {
        match state {
            PixelState::Rising | PixelState::Falling => self.steady[1] += length_us,
            PixelState::Still => self.still[1] += length_us,
            PixelState::Other => {}
        }
    }

    fn count(&mut self, state: PixelState, is_on: bool) {
        match state {
            PixelState::Rising | PixelState::Falling => {
                self.steady[0] += 1.0;
                self.contrary += f64::from(is_on != (state == PixelState::Rising));
            }
            PixelState::Still => self.still[0] += 1.0,
            PixelState::Other => {}
        }
    }
}

fn detecting(judged: Judgement, size: f64) -> Judgement {
    // A share above 1 does not exist: the stream is too short for a statement.
    if size < 1.0 { judged.detecting(size, "1") } else { judged }
}

/// The state of each pixel, by interval; empty for intervals of no run.
fn find_states(bursts: &FrameBursts, thresholds: [f64; 2]) -> Vec<Vec<PixelState>> {
    let mut states = vec![Vec::new(); bursts.frames()];
    for interval in bursts.runs.iter().flat_map(Clone::clone) {
        let places = 0..bursts.pixels.len();
        states[interval] = places.map(|place| find_state(bursts, interval, place, thresholds)).collect();
    }
    states
}

/// The state of a pixel from the frames around an interval.
fn find_state(bursts: &FrameBursts, interval: usize, place: usize, thresholds: [f64; 2]) -> PixelState {
    let log = |frame: usize| bursts.log(frame, place);
    let (Some(from), Some(to)) = (log(interval), log(interval + 1)) else { return PixelState::Other };
    let (mut low, mut high) = (from.min(to), from.max(to));
    let mut seen = 0;
    for step in LADDER {
        let before = interval.checked_sub(step).and_then(log);
        let after = log(interval + 1 + step);
        for log in [before, after].into_iter().flatten() {
            (low, high) = (low.min(log), high.max(log));
        }
        seen += usize::from(before.is_some() && after.is_some());
        let (Some(before), Some(after)) = (before, after) else { continue };
        let [first, second] = [from - before, after - to];
        let threshold = if first > 0.0 { thresholds[0] } else { thresholds[1] };
        let [small, large] = [first.abs().min(second.abs()), first.abs().max(second.abs())];
        // The interval itself must not go back either: frames of 8 bits do by a rounding.
        let is_along = (to - from) * first >= -0.1 * threshold * first.abs();
        if first * second > 0.0 && small > STEADY * threshold && large < MAX_UNEVEN * small && is_along {
            return if first > 0.0 { PixelState::Rising } else { PixelState::Falling };
        }
    }
    let is_still = high - low < STILL * thresholds[0].min(thresholds[1]) && seen >= 3;
    if is_still { PixelState::Still } else { PixelState::Other }
}
