//! First passages by counting: the barrier, and the time.

use crate::stress::answers::{KnownAnswer, find_answers};
use crate::stress::clips::{Train, by_pixel, ks, make_clip, run_sensor};
use crate::stress::{CaseResult, StressArea, StressCase, StressPoint, WorstPoint};
use gs2e_event::Polarity;
use gs2e_image::Size;
use gs2e_num::seed::{CellDraws, DrawSpace, Seed, SeedCell};
use gs2e_sensor::statistics::interval_law::BarrierExit;
use gs2e_sensor::voltmeter::{Barriers, ClockLeaf, EmitEvents, LeafSpan, VoltmeterModel};
use std::ops::ControlFlow;

/// Allowed number of standard errors of a count: a probability of 6e-5 for each of a dozen counts.
const ERRORS: f64 = 4.0;
/// Number of simulated paths.
const PATHS: u64 = 40_000;
/// Limit of the Kolmogorov-Smirnov distance times the root of the sample size: alpha 1e-4.
const KS_LIMIT: f64 = 2.23;

/// Error of a count in standard errors.
fn share_point(count: u64, n: u64, wanted: f64) -> StressPoint {
    let (found, n) = (count as f64 / n as f64, n as f64);
    StressPoint::scaled_error(found, wanted, (wanted * (1.0 - wanted) / n).sqrt(), ERRORS)
}

/// The first event of a path from `x` to `y` with this variance, between barriers at 1 and -1.
pub(super) fn first_of_leaf([x, y]: [f64; 2], variance: f64, draws: CellDraws) -> Option<Polarity> {
    /// Length of the leaf, ns; any value would do.
    const LENGTH: f64 = 1024.0;
    struct FirstPassage(Option<Polarity>);
    impl EmitEvents for FirstPassage {
        fn event(&mut self, _: f64, polarity: Polarity) -> ControlFlow<()> {
            self.0 = Some(polarity);
            ControlFlow::Break(())
        }
    }
    let barriers = Barriers { up: 1.0, down: 1.0 };
    let mut leaf = ClockLeaf { barriers, variance: variance / LENGTH, draws, time: 0.0 };
    let mut first = FirstPassage(None);
    let _ = leaf.cross(x, LeafSpan { end: y, until: LENGTH }, &mut Vec::new(), &mut first);
    first.0
}

fn path_draws(index: u64) -> CellDraws {
    Seed(11).draws(SeedCell { x: 0, y: 0, level: 0, index }, DrawSpace::Leaf)
}

/// Number of paths with OFF as the first event, among [`PATHS`]. `end` draws the far end of each
/// path.
fn count_off(
    first: &impl Fn([f64; 2], f64, CellDraws) -> Option<Polarity>,
    x: f64,
    variance: f64,
    end: impl Fn(&mut CellDraws) -> f64,
) -> u64 {
    let is_off = |i: &u64| {
        let mut draws = path_draws(*i);
        // The first draw is the end; the path takes the rest of the stream.
        let y = end(&mut draws);
        first([x, y], variance, draws) == Some(Polarity::Off)
    };
    (0..PATHS).filter(is_off).count() as u64
}

/// Share of paths with drift whose first event is OFF. `first` gets the ends of the path, its
/// variance, and draws.
#[must_use]
pub fn first_off(first: impl Fn([f64; 2], f64, CellDraws) -> Option<Polarity>) -> CaseResult {
    let mut worst = WorstPoint::default();
    for KnownAnswer { given, wanted } in find_answers("first-off") {
        let [x, drift, variance] = [given[0], given[1], given[2]];
        let end = |draws: &mut CellDraws| x + drift + variance.sqrt() * draws.normal();
        let count = count_off(&first, x, variance, end);
        worst.see(share_point(count, PATHS, wanted[0]), || format!("x = {x}, mu T = {drift}"));
    }
    worst.found()
}

/// Share of paths between given ends whose first event is OFF.
#[must_use]
pub fn bridge_off(first: impl Fn([f64; 2], f64, CellDraws) -> Option<Polarity>) -> CaseResult {
    let mut worst = WorstPoint::default();
    for KnownAnswer { given, wanted } in find_answers("bridge-off") {
        let [x, y, variance] = [given[0], given[1], given[2]];
        let count = count_off(&first, x, variance, |_| y);
        worst.see(share_point(count, PATHS, wanted[0]), || format!("from {x} to {y}, variance {variance}"));
    }
    worst.found()
}

/// [`first_off`] for a sensor with thresholds as far from 0 as 1 and -1 are from `x`.
pub(super) fn first_off_of_sensor() -> CaseResult {
    const SIZE: Size = Size { width: 250, height: 160 };
    const END: i64 = 1000;
    let mut worst = WorstPoint::default();
    for KnownAnswer { given, wanted } in find_answers("first-off") {
        let [x, drift, variance] = [given[0], given[1], given[2]];
        let end = END as f64;
        let k = [1.0, 1.0, 0.0, drift / end, 0.0, (variance / end).sqrt()];
        let sensor = VoltmeterModel {
            threshold_on: 1.0 - x,
            threshold_off: 1.0 + x,
            ..VoltmeterModel::new(k).without_cap()
        };
        let (events, _) = run_sensor(&sensor, &make_clip(SIZE, &[0, END], |_, _, _| 77.0), 3);
        let pixels = by_pixel(SIZE, &events);
        let off = |train: &&Train| train.first().is_some_and(|event| event.1 == Polarity::Off);
        let count = pixels.iter().filter(off).count() as u64;
        worst.see(share_point(count, pixels.len() as u64, wanted[0]), || format!("x = {x}, mu T = {drift}"));
    }
    worst.found()
}

/// Number of intervals taken from each pixel, from its first frame on.
const TAKEN: usize = 32;
const WATCHED: Size = Size { width: 16, height: 8 };
/// Length of a root cell of the sensor's clock, us: the longest single step without a barrier
/// within reach.
const CELL_US: f64 = (1 << 20) as f64 * 1e-3;

/// The first intervals of pixels of constant brightness, us, each with its polarity. `spread`
/// bounds the squared coefficient of variation.
fn intervals_of(process: BarrierExit, [mean_us, spread]: [f64; 2], seed: u64) -> Vec<(f64, Polarity)> {
    let BarrierExit { drift, variance, up, down } = process;
    let k = [1.0, 1.0, 0.0, drift, 0.0, variance.sqrt()];
    let sensor =
        VoltmeterModel { threshold_on: up, threshold_off: down, ..VoltmeterModel::new(k).without_cap() };
    // 5.5 standard deviations of the number of events more than needed, so that no interval is cut
    // off.
    let watched = mean_us * (TAKEN as f64 + 4.0 + 5.5 * (1.5 * TAKEN as f64 * spread).sqrt());
    #[expect(clippy::cast_possible_truncation, reason = "below the clock's end")]
    let end = watched.ceil() as i64;
    let (events, _) = run_sensor(&sensor, &make_clip(WATCHED, &[0, end], |_, _, _| 77.0), seed);
    let mut intervals = Vec::new();
    for train in by_pixel(WATCHED, &events) {
        let mut before = 0;
        for &(t, polarity) in train.iter().take(TAKEN) {
            intervals.push(((t - before) as f64 * 1e-3, polarity));
            before = t;
        }
    }
    intervals
}

/// The mean interval for equal thresholds of 1, by the hyperbolic tangent.
fn mean_interval(nu: f64, variance: f64) -> f64 {
    if nu > 0.0 { libm::tanh(nu) / (nu * variance) } else { 1.0 / variance }
}

/// KS distance of intervals from the series, for each of these variances per cell of the clock.
fn interval_case(nu: f64, variances: &[f64]) -> CaseResult {
    let mut worst = WorstPoint::default();
    // A seed for each variance keeps the samples independent.
    for (seed, per_cell) in (1..).zip(variances) {
        let variance = per_cell / CELL_US;
        let process = BarrierExit { drift: nu * variance, variance, up: 1.0, down: 1.0 };
        let spread = if nu > 1.5 { 1.0 / nu } else { 2.0 / 3.0 };
        let found = intervals_of(process, [mean_interval(nu, variance), spread], seed);
        let all = WATCHED.pixels() * TAKEN;
        let at = || format!("s^2 T = {per_cell:e}, {all} intervals");
        // A missing interval would be a long one, and its absence would bias the distribution.
        worst.see(StressPoint::exact_count(found.len() as u64, all as u64), at);
        let distance = ks(found.iter().map(|(t, _)| *t).collect(), |t| process.by(t));
        worst.see(StressPoint::absolute_error(distance, 0.0, KS_LIMIT), at);
    }
    worst.found()
}

/// One case per ratio of drift to noise. The rarest events are thousands of cells apart; the most
/// frequent are at least a thousand nanoseconds apart, so that whole nanoseconds do not affect the
/// distance.
pub(super) fn interval_cases<'a>() -> Vec<StressCase<'a>> {
    let case = |words, nu, variances: &'static [f64]| {
        StressCase::new(StressArea::Sensor, words, move || interval_case(nu, variances))
    };
    let unit = "KS sqrt N";
    vec![
        case(
            ["intervals-nu-0", "s^2 T/Th^2 = 1e-3, 1, 50 over a cell T of the clock", unit],
            0.0,
            &[1e-3, 1.0, 50.0],
        ),
        case(["intervals-nu-.1", "the same", unit], 0.1, &[1e-3, 1.0, 50.0]),
        case(["intervals-nu-1", "the same", unit], 1.0, &[1e-3, 1.0, 50.0]),
        case(["intervals-nu-3", "the same", unit], 3.0, &[1e-3, 1.0, 50.0]),
        case(["intervals-nu-10", "s^2 T/Th^2 = 1e-4, 1, 50", unit], 10.0, &[1e-4, 1.0, 50.0]),
        case(["intervals-nu-100", "s^2 T/Th^2 = 1e-5, 1e-3, 1", unit], 100.0, &[1e-5, 1e-3, 1.0]),
        case(["intervals-nu-5500", "s^2 T/Th^2 = 1e-6, 1e-3, 1e-2", unit], 5500.0, &[1e-6, 1e-3, 1e-2]),
    ]
}

/// Small, large and unequal thresholds: polarity and mean interval against their closed forms.
pub(super) fn threshold_cases() -> CaseResult {
    let mut worst = WorstPoint::default();
    for KnownAnswer { given, wanted } in find_answers("renewal") {
        let process = BarrierExit { drift: given[0], variance: given[1], up: given[2], down: given[3] };
        let [on_share, mean] = [wanted[0], wanted[1]];
        // Unequal thresholds spread intervals slightly more.
        let found = intervals_of(process, [mean, 1.0], 5);
        let n = found.len() as f64;
        let on = found.iter().filter(|(_, polarity)| *polarity == Polarity::On).count();
        let [up, down] = [given[2], given[3]];
        let at = |what| move || format!("{what}, A = {up:e}, B = {down:e}");
        worst.see(share_point(on as u64, found.len() as u64, on_share), at("polarity"));
        let average = found.iter().map(|(t, _)| t).sum::<f64>() / n;
        let variance = found.iter().map(|(t, _)| (t - average) * (t - average)).sum::<f64>() / (n - 1.0);
        worst.see(StressPoint::scaled_error(average, mean, (variance / n).sqrt(), ERRORS), at("interval"));
    }
    worst.found()
}
