//! Offset and drift of the clock of the events, from pairs of events.
//!
//! Both events of a pair of neighbours of one pixel lie at the end of a threshold of change. If events are
//! late by `lag`, the frames' change of the logarithm between the two times is therefore
//!
//! ```text
//! d = C_on [the later event is ON] - C_off [it is OFF] + lag (rate_b - rate_a) - leak (t_b - t_a)
//! ```
//!
//! whatever the sensor's thresholds and its leak. Pairs around a turn of brightness, an ON event and then an
//! OFF event, have a large difference of rates, and decide. First, each run of frames is searched for the
//! offset at which most pairs agree, so that a clock of another speed is found as well. Then offset and speed
//! are solved together by least squares. Pairs that differ from their threshold by more than a quarter are
//! left out: one of their events is noise, or there were events between them that are lost.
//!
//! Standard errors are those of the jackknife over quadrants of runs. Pixels with a low-pass filter are late
//! by a time that depends on light and speed. Where a delay explains the pairs poorly, filtered frames are
//! tried as well.

use super::bursts::{FrameBursts, RUNS};
use super::samples::DatasetFrames;
use super::{EventDataset, OpenEvents, for_each_event, jackknife_error};
use gs2e_check::{Finding, Judgement, JudgementResult, Verdict};
use gs2e_event::{EventFileError, Polarity};

/// Largest speed difference of the clocks that is searched for.
const MAX_DRIFT: f64 = 0.04;
/// Number of offsets on each side of the rough one.
const SIDE: i64 = 80;
/// Pairs of a run that the search uses.
const SEARCHED: usize = 2000;
/// Pairs of a run that are kept.
const MAX_PAIRS: usize = 50_000;
/// Minimum number of pairs of a statement.
const MIN_PAIRS: usize = 100;
/// Threshold where no pair of two events of a polarity shows it.
const DEFAULT_THRESHOLD: f64 = 0.2;
/// Largest deviation of a pair from its threshold, as a share of it.
const MAX_DEVIATION: f64 = 0.25;
/// Number of rounds of least squares.
const ROUNDS: usize = 8;
/// Standard errors that a fault needs beyond the limit: one sound statement in 15,000 exceeds them.
const SIGMAS: f64 = 4.0;
/// Standard errors beyond the limit at which a fault is found in 95 % of trials.
const POWER: f64 = 1.645;
/// Mean deviation of pairs above which a delay alone explains the events poorly: sensors without a filter
/// have
/// 0.04 to 0.15, v2e's noisy pixels 0.45 to 0.7.
const POOR: f64 = 0.4;
/// Largest ratio of the deviations under a filter and under a delay.
const AS_WELL: f64 = 1.05;
/// Time constants at white that are tried, as shares of the offset.
const SLOWNESS: [f64; 6] = [0.1, 0.2, 0.3, 0.5, 0.8, 1.2];
/// Frame interval from which on frames are taken for a camera's, us. Such a stamp may be that of the start
/// of an exposure, and its middle up to half an interval later.
const CAMERA_US: f64 = 10_000.0;

/// Two events of a pixel, one after the other.
#[derive(Debug, Clone, Copy)]
struct EventPair {
    times_us: [f64; 2],
    rising: [bool; 2],
    place: usize,
    run: usize,
}

/// A pair with what the frames show at its times.
#[derive(Debug, Clone, Copy)]
struct PairSample {
    pair: EventPair,
    change: f64,
    /// Rate at the later event minus that at the earlier, per us.
    rate: f64,
}

/// Offset of the clocks as a function of time: `offset + drift (t - centre)`, us.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ClockLine {
    offset: f64,
    drift: f64,
    centre: f64,
}

impl ClockLine {
    fn at(&self, t_us: f64) -> f64 {
        self.offset + self.drift * (t_us - self.centre)
    }
}

/// The clock of the events.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct EventClock {
    /// Time of the events minus that of the frames in the middle of the recording, us, and its error.
    pub(super) offset_us: [f64; 2],
    /// Change of the offset per time, and its error.
    pub(super) drift: [f64; 2],
    /// True if pixels behind a low-pass filter explain the events as well as a delay.
    is_slow: bool,
    /// Median change between two ON events, and between two OFF events.
    pub(super) thresholds: [f64; 2],
    line: ClockLine,
    pairs: usize,
}

impl EventClock {
    /// Measures around a rough offset; `None` if too few pairs of events determine the clock.
    pub(super) fn measure(
        events: OpenEvents<'_>,
        bursts: &FrameBursts,
        rough_us: f64,
    ) -> Result<Option<Self>, EventFileError> {
        let Some(reach) = search_reach(bursts) else { return Ok(None) };
        let pairs = collect_pairs(events, bursts, rough_us, reach)?;
        Ok(search_line(&pairs, bursts, rough_us, reach).and_then(|line| solve_clock(&pairs, bursts, line)))
    }

    /// The offset at a time of the events, us.
    pub(super) fn offset_at(&self, t_us: f64) -> f64 {
        self.line.at(t_us)
    }

    /// The findings on offset and speed.
    pub(super) fn findings(&self, dataset: &EventDataset<'_>, frames: &DatasetFrames) -> [Finding; 2] {
        let interval_us = frames.interval_us() as f64;
        let ends = frames.stamps_us.last().zip(frames.stamps_us.first());
        let whole_us = ends.map_or(1, |(last, first)| last - first) as f64;
        let share = if interval_us >= CAMERA_US { 0.5 } else { 0.25 };
        let limit = share * interval_us;
        let [offset, error] = self.offset_us;
        let side = if offset < 0.0 { "earlier" } else { "later" };
        let (size, pairs) = (offset.abs(), self.pairs);
        let because =
            format!("events are {size:.0} +- {error:.0} us {side} than the frames, from {pairs} pairs");
        let of_offset = judge_time(self.offset_us, TimeLimit { value: limit, unit: "us" }, because);
        let [drift, error] = self.drift.map(|value| 100.0 * value);
        let because =
            format!("the clock of the events runs {drift:.3} +- {error:.3} % slower than that of the frames");
        let of_drift = judge_time(self.drift, TimeLimit { value: limit / whole_us, unit: "1" }, because);
        let finding = |statement, judged: JudgementResult| {
            dataset.finding("time_offset", statement, judged.map(|judged| self.explain(judged)))
        };
        [finding("", of_offset), finding("drift", of_drift)]
    }

    /// Adds the cause to a fault. Slow pixels do not count: their lag depends on light and speed.
    fn explain(&self, found: Judgement) -> Judgement {
        let (verdict, cause) = match found.verdict {
            Verdict::Fail if self.is_slow => {
                (Verdict::Warn, ": pixels that are slow in dim light explain the events as well as a delay")
            }
            Verdict::Fail => (Verdict::Fail, ": the clocks differ, or all pixels are slow"),
            verdict => (verdict, ""),
        };
        let detects = found.detects.filter(|_| !self.is_slow);
        Judgement { verdict, because: found.because + cause, detects, ..found }
    }
}

/// A limit on an estimate, without its error.
#[derive(Debug, Clone, Copy)]
struct TimeLimit {
    value: f64,
    unit: &'static str,
}

/// Judges an estimate with its standard error.
fn judge_time([value, error]: [f64; 2], limit: TimeLimit, because: String) -> JudgementResult {
    // An error of several limits could hide any offset.
    if error.is_nan() || error >= 4.0 * limit.value {
        return Err(format!("{because}; this is too uncertain to judge"));
    }
    let most = limit.value + SIGMAS * error;
    let verdict = if value.abs() > most { Verdict::Fail } else { Verdict::Pass };
    // A fault may work against the offset that the stream already has.
    let size = most + value.abs() + POWER * error;
    Ok(Judgement::new(verdict, value, most, limit.unit, because).detecting(size, limit.unit))
}

/// How far from the rough offset is searched, us; `None` without frames.
fn search_reach(bursts: &FrameBursts) -> Option<f64> {
    let last = bursts.runs.len().checked_sub(1)?;
    let whole = bursts.span_us(last)[1] - bursts.span_us(0)[0];
    let mut intervals: Vec<f64> = bursts.runs.iter().map(|run| bursts.length_us(run.start)).collect();
    intervals.sort_by(f64::total_cmp);
    Some((MAX_DRIFT * whole).max(4.0 * intervals[intervals.len() / 2]))
}

/// The pairs whose events lie in a run of frames, or so near that an offset moves them there.
fn collect_pairs(
    events: OpenEvents<'_>,
    bursts: &FrameBursts,
    rough_us: f64,
    reach: f64,
) -> Result<Vec<EventPair>, EventFileError> {
    let places = bursts.places();
    let mut last: Vec<Option<(f64, bool)>> = vec![None; bursts.pixels.len()];
    let mut counts = [0; RUNS];
    let mut pairs = Vec::new();
    for_each_event(events, |event, t_us| {
        let Some(place) = places.of(event) else { return };
        let now = (t_us as f64, event.polarity == Polarity::On);
        // Pairs overlap: an event is the later one of one pair, and the earlier one of the next.
        let Some(before) = last[place].replace(now) else { return };
        let run = bursts.run_at(0.5 * (before.0 + now.0) - rough_us);
        let [start, end] = bursts.span_us(run);
        let is_near = before.0 - rough_us >= start - reach && now.0 - rough_us <= end + reach;
        if is_near && counts[run] < MAX_PAIRS {
            counts[run] += 1;
            pairs.push(EventPair { times_us: [before.0, now.0], rising: [before.1, now.1], place, run });
        }
    })?;
    Ok(pairs)
}

impl EventPair {
    fn middle(&self) -> f64 {
        0.5 * (self.times_us[0] + self.times_us[1])
    }

    /// What the frames show if events are late by `offset`.
    fn sample(self, bursts: &FrameBursts, offset: f64) -> Option<PairSample> {
        let [a, b] = self.times_us.map(|t| bursts.brightness(t - offset, self.place));
        let (a, b) = (a?, b?);
        Some(PairSample { pair: self, change: b.log - a.log, rate: b.rate - a.rate })
    }
}

impl PairSample {
    /// The threshold of the later event minus the change in its direction, as a share.
    fn deviation(&self, [on, off]: [f64; 2]) -> f64 {
        if self.pair.rising[1] { (self.change - on) / on } else { (-self.change - off) / off }
    }
}

fn samples_at(pairs: &[EventPair], bursts: &FrameBursts, line: ClockLine) -> Vec<PairSample> {
    pairs.iter().filter_map(|pair| pair.sample(bursts, line.at(pair.middle()))).collect()
}

/// The median change of pairs of two ON events, and of two OFF events.
fn thresholds(samples: &[PairSample]) -> [f64; 2] {
    [true, false].map(|rising| {
        let signed = |s: &PairSample| if rising { s.change } else { -s.change };
        let alike = samples.iter().filter(|s| s.pair.rising == [rising; 2]);
        // Pairs without a change are noise.
        let mut changes: Vec<f64> =
            alike.map(signed).filter(|change| *change > 0.1 * DEFAULT_THRESHOLD).collect();
        let middle = changes.len() / 2;
        if changes.len() < 20 {
            DEFAULT_THRESHOLD
        } else {
            *changes.select_nth_unstable_by(middle, f64::total_cmp).1
        }
    })
}

/// Mean deviation of the pairs from their threshold, each at most 1.
fn mean_deviation(pairs: &[EventPair], bursts: &FrameBursts, line: ClockLine) -> Option<f64> {
    let samples = samples_at(pairs, bursts, line);
    let both = thresholds(&samples);
    let sum: f64 = samples.iter().map(|sample| sample.deviation(both).abs().min(1.0)).sum();
    (samples.len() >= MIN_PAIRS / 2).then(|| sum / samples.len() as f64)
}

/// The best offset of a run, with its time and how much it is better than the median one.
struct RunOffset {
    t_us: f64,
    offset: f64,
    weight: f64,
}

/// A line through the best offsets of the runs.
fn search_line(pairs: &[EventPair], bursts: &FrameBursts, rough_us: f64, reach: f64) -> Option<ClockLine> {
    let step = (reach / SIDE as f64).max(0.5 * bursts.length_us(0));
    let side = libm::ceil(reach / step);
    let found: Vec<RunOffset> = (0..bursts.runs.len())
        .filter_map(|run| {
            let of_run: Vec<EventPair> = pairs.iter().filter(|p| p.run == run).copied().collect();
            let taken: Vec<EventPair> =
                of_run.iter().step_by(of_run.len().div_ceil(SEARCHED).max(1)).copied().collect();
            let mut offset = rough_us - side * step;
            let mut values = Vec::new();
            while offset <= rough_us + side * step {
                let line = ClockLine { offset, drift: 0.0, centre: 0.0 };
                values.extend(mean_deviation(&taken, bursts, line).map(|value| (value, offset)));
                offset += step;
            }
            values.sort_by(|a, b| a.0.total_cmp(&b.0));
            let (best, offset) = *values.first()?;
            let [start, end] = bursts.span_us(run);
            let weight = values[values.len() / 2].0 - best;
            Some(RunOffset { t_us: 0.5 * (start + end) + offset, offset, weight })
        })
        .collect();
    fit_line(&found, step)
}

/// Least squares with weights that fall for runs far from the line, from their median line on.
fn fit_line(runs: &[RunOffset], step: f64) -> Option<ClockLine> {
    let weight: f64 = runs.iter().map(|run| run.weight).sum();
    let centre = runs.iter().map(|run| run.weight * run.t_us).sum::<f64>() / weight;
    // Start from the median slope of all pairs of runs: the offsets of a fast clock are no outliers.
    let mut slopes: Vec<f64> = Vec::new();
    for (number, a) in runs.iter().enumerate() {
        slopes.extend(runs[number + 1..].iter().map(|b| (b.offset - a.offset) / (b.t_us - a.t_us)));
    }
    slopes.sort_by(f64::total_cmp);
    let drift = slopes.get(slopes.len() / 2).copied().unwrap_or(0.0);
    let mut rests: Vec<f64> = runs.iter().map(|run| run.offset - drift * (run.t_us - centre)).collect();
    rests.sort_by(f64::total_cmp);
    let mut line = ClockLine { offset: *rests.get(rests.len() / 2)?, drift, centre };
    for _ in 0..ROUNDS {
        let (mut w, mut wt, mut wtt, mut wo, mut wto) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for run in runs {
            let far = (run.offset - line.at(run.t_us)) / (2.0 * step);
            let (share, t) = (run.weight / (1.0 + far * far), run.t_us - centre);
            w += share;
            wt += share * t;
            wtt += share * t * t;
            wo += share * run.offset;
            wto += share * t * run.offset;
        }
        let both = w * wtt - wt * wt;
        if both > 0.0 {
            line.drift = (w * wto - wt * wo) / both;
            line.offset = (wo - line.drift * wt) / w;
        }
    }
    (line.offset.is_finite() && line.drift.abs() < 2.0 * MAX_DRIFT).then_some(line)
}

/// Number of unknowns: two thresholds, lag, its change over time, and the leak.
const UNKNOWNS: usize = 5;

/// The sums of least squares of some samples.
#[derive(Debug, Clone, Copy, PartialEq)]
struct NormalSums {
    /// The matrix, with the sums of the values as its last column.
    rows: [[f64; UNKNOWNS + 1]; UNKNOWNS],
}

impl NormalSums {
    const EMPTY: Self = Self { rows: [[0.0; UNKNOWNS + 1]; UNKNOWNS] };

    fn add_sample(&mut self, columns: [f64; UNKNOWNS], value: f64) {
        for (row, factor) in self.rows.iter_mut().zip(columns) {
            for (sum, column) in row.iter_mut().zip(columns.into_iter().chain([value])) {
                *sum += factor * column;
            }
        }
    }

    fn add(&mut self, other: &Self) {
        let all = self.rows.as_flattened_mut().iter_mut();
        all.zip(other.rows.as_flattened()).for_each(|(sum, more)| *sum += more);
    }

    /// Steps of offset (us) and drift, by elimination; not finite if they are not determined.
    fn solve(&self, unit: RowUnit) -> [f64; 2] {
        let mut rows = self.rows;
        for (number, row) in rows.iter_mut().enumerate() {
            // A stream without one of the polarities has no threshold for it; the others are not affected.
            row[number] += 1e-9;
        }
        for pivot in 0..UNKNOWNS {
            let of_pivot = rows[pivot];
            for (number, row) in rows.iter_mut().enumerate() {
                // The matrix is positive definite, so no pivot is 0.
                let factor = if number == pivot { 0.0 } else { row[pivot] / of_pivot[pivot] };
                row.iter_mut().zip(of_pivot).for_each(|(value, other)| *value -= factor * other);
            }
        }
        let found = |unknown: usize| rows[unknown][UNKNOWNS] / rows[unknown][unknown];
        [found(2) * unit.rate, found(3) * unit.rate / unit.time]
    }
}

/// Units in which the columns are of order 1.
#[derive(Debug, Clone, Copy)]
struct RowUnit {
    rate: f64,
    time: f64,
}

/// Offset and drift from a good start.
fn solve_clock(pairs: &[EventPair], bursts: &FrameBursts, start: ClockLine) -> Option<EventClock> {
    let last = bursts.runs.len() - 1;
    let unit = RowUnit { rate: 1e4, time: 0.5 * (bursts.span_us(last)[1] - bursts.span_us(0)[0]) };
    let mut line = start;
    for _ in 0..ROUNDS {
        let blocks = sum_blocks(&sound_samples(pairs, bursts, line), bursts, line, unit);
        let [offset, drift] = total_without(&blocks, usize::MAX).solve(unit);
        line = ClockLine { offset: line.offset + offset, drift: line.drift + drift, ..line };
    }
    let samples = sound_samples(pairs, bursts, line);
    if samples.len() < MIN_PAIRS || !line.offset.is_finite() || !line.drift.is_finite() {
        return None;
    }
    let blocks = sum_blocks(&samples, bursts, line, unit);
    let filled = blocks.iter().enumerate().filter(|(_, block)| **block != NormalSums::EMPTY);
    let used: Vec<usize> = filled.map(|(number, _)| number).collect();
    let error = |which: usize| {
        jackknife_error(used.len(), &|skip| total_without(&blocks, used[skip]).solve(unit)[which])
    };
    Some(EventClock {
        offset_us: [line.offset, error(0)],
        drift: [line.drift, error(1)],
        is_slow: fits_slow_pixels(pairs, bursts, line),
        thresholds: thresholds(&samples),
        line,
        pairs: samples.len(),
    })
}

/// Returns true if the pairs agree poorly with a delay, and as well with pixels behind a low-pass filter
/// whose time constant falls with light.
fn fits_slow_pixels(pairs: &[EventPair], bursts: &FrameBursts, line: ClockLine) -> bool {
    let some: Vec<EventPair> =
        pairs.iter().step_by(pairs.len().div_ceil(2 * SEARCHED).max(1)).copied().collect();
    let Some(delayed) = mean_deviation(&some, bursts, line) else { return false };
    if line.offset <= 0.0 || delayed < POOR {
        return false;
    }
    let at_once = ClockLine { offset: 0.0, drift: 0.0, ..line };
    let slowed = SLOWNESS
        .iter()
        .filter_map(|share| mean_deviation(&some, &bursts.slowed(share * line.offset), at_once));
    slowed.fold(f64::INFINITY, f64::min) <= AS_WELL * delayed
}

/// The samples that agree with their threshold.
fn sound_samples(pairs: &[EventPair], bursts: &FrameBursts, line: ClockLine) -> Vec<PairSample> {
    let samples = samples_at(pairs, bursts, line);
    let both = thresholds(&samples);
    samples.into_iter().filter(|sample| sample.deviation(both).abs() < MAX_DEVIATION).collect()
}

/// The sums of each quadrant of each run.
fn sum_blocks(
    samples: &[PairSample],
    bursts: &FrameBursts,
    line: ClockLine,
    unit: RowUnit,
) -> Vec<NormalSums> {
    let mut blocks = vec![NormalSums::EMPTY; 4 * RUNS];
    for sample in samples {
        let rate = sample.rate * unit.rate;
        let [on, off] = if sample.pair.rising[1] { [1.0, 0.0] } else { [0.0, -1.0] };
        let late = (sample.pair.middle() - line.centre) / unit.time;
        let apart = (sample.pair.times_us[1] - sample.pair.times_us[0]) / unit.rate;
        let block = 4 * sample.pair.run + bursts.quadrant(sample.pair.place);
        blocks[block].add_sample([on, off, rate, rate * late, apart], sample.change);
    }
    blocks
}

fn total_without(blocks: &[NormalSums], skip: usize) -> NormalSums {
    let mut total = NormalSums::EMPTY;
    for (_, block) in blocks.iter().enumerate().filter(|(number, _)| *number != skip) {
        total.add(block);
    }
    total
}
