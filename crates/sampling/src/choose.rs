//! The cheapest frames that meet a tolerance: a pilot at some places of the path, and a check at
//! others.

use super::flow::{PathFlow, SHORTEST_US};
use super::law::ErrorLaw;
use super::measure::{MeasuredIntervals, PathViewer, SampledInterval, SensorScale, measure_intervals};
use super::{BetweenCandidate, ErrorTolerance, SamplingChoice};
use gs2e_image::Size;
use gs2e_num::seed::{CellDraws, DrawSpace, Seed, SeedCell};
use gs2e_render::sample::TileSample;
use gs2e_sensor::voltmeter::BetweenFrames;
use std::ops::AddAssign;
use std::sync::Arc;

/// Cost of a frame with rates divided by that of a frame without, as measured with the CPU
/// renderer.
const RATED_COST: f64 = 1.4;
/// Number of steps that the pilot tries. Each is a third of the previous one, so that their
/// stencils share frames.
const STEPS: i32 = 5;
const RATIO: f64 = 3.0;
/// Length of the longest step, px; a sixth of the path if that is less.
const LONGEST_PX: f64 = 9.0;
const LONGEST_SHARE: f64 = 1.0 / 6.0;
/// Range of ratios between neighbouring steps that count as a ratio of 3; flow and rounding change
/// it a little.
const ALIKE: f64 = 0.02;
/// Places of the pilot: one per this many steps between poses, within these bounds.
const STEPS_A_PLACE: usize = 100;
const PLACES: [usize; 2] = [3, 8];
/// Errors up to this many tolerances enter the fit of the law, but at least this many steps.
const FAR: f64 = 10.0;
const MIN_POINTS: usize = 3;
/// Share of the tolerance that the predicted error may use.
const MARGIN: f64 = 0.8;
/// Number of intervals on which the choice is checked, and the 95 % point of Student's t with one
/// degree of freedom less.
const HELD_OUT: usize = 12;
const STUDENT_95: f64 = 1.795_885;
/// Maximum number of refinements of a failed choice.
const REFINEMENTS: u32 = 3;
/// Target of a refinement, and its smallest and largest factor.
const AIM: f64 = 0.9;
const FINER: [f64; 2] = [0.25, 0.8];

/// The reason why no frames meet a tolerance.
#[derive(Debug, thiserror::Error)]
pub enum ChooseError<E: std::error::Error + 'static> {
    /// A frame cannot be rendered.
    #[error(transparent)]
    View(E),
    /// The path is too short for a pilot.
    #[error("the path is too short to choose a step: remove tolerance and set a rate")]
    Short,
    /// The error of every method is too large at the finest step that was tried.
    #[error(
        "the tolerance of {wanted} thresholds cannot be met here: {} with steps of {:.2} px has an error of {:.4}, \
         {:.0} % of its square from jumps of the renderer; a tolerance of {:.4} can be met{advice}",
        best.between.name(), best.finest_px, best.finest, 100.0 * best.jumps, best.finest / MARGIN
    )]
    Below {
        /// The tolerance.
        wanted: f64,
        /// The method with the smallest error.
        best: Box<BetweenCandidate>,
        /// A suggestion as a clause, or an empty text.
        advice: &'static str,
    },
    /// The choice fails its check.
    #[error(
        "the tolerance of {wanted} thresholds is not met: {} with steps of {step_px:.3} px has an error of {achieved:.4} on held-out intervals, \
         more than the pilot predicted",
        between.name()
    )]
    Missed {
        /// The tolerance.
        wanted: f64,
        /// The last measured error, thresholds.
        achieved: f64,
        /// The method.
        between: BetweenFrames,
        /// The step.
        step_px: f64,
    },
}

/// The inputs of a choice.
#[derive(Debug, Clone, Copy)]
pub struct ChoiceQuestion<'a> {
    /// The tolerance.
    pub tolerance: ErrorTolerance,
    /// The image motion along the path.
    pub flow: &'a PathFlow,
    /// Size of the frames.
    pub size: Size,
    /// Number of steps between poses of the path.
    pub intervals: usize,
    /// The sensors.
    pub scales: &'a [SensorScale],
    /// The methods that all sensors support.
    pub between: &'a [BetweenFrames],
    /// The seed of the places.
    pub seed: Seed,
    /// A suggestion to reduce the error from jumps, as a clause, or an empty text.
    pub advice: &'static str,
}

impl ChoiceQuestion<'_> {
    /// The cheapest frames that meet the tolerance, according to a pilot and to a check at other
    /// places.
    ///
    /// # Errors
    /// A frame cannot be rendered, or no frames meet the tolerance.
    pub fn answer<V: PathViewer<Error: std::error::Error + 'static>>(
        &self,
        viewer: &mut V,
    ) -> Result<(SamplingChoice, Vec<i64>), ChooseError<V::Error>> {
        let wanted = self.tolerance.rms;
        let (candidates, mut cost_so_far) = self.pilot(viewer)?;
        let cost = |c: &BetweenCandidate| c.frames.map(|n| n as f64 * cost_of_frame(c.between));
        let cheapest = candidates.iter().filter_map(|c| Some((c, cost(c)?, c.step_px?)));
        let Some((best, _, mut step_px)) = cheapest.min_by(|a, b| a.1.total_cmp(&b.1)) else {
            let best = candidates.into_iter().min_by(|a, b| a.finest.total_cmp(&b.finest));
            let best = Box::new(best.ok_or(ChooseError::Short)?);
            // The advice is against jumps, so it is given only if most of the squared error comes
            // from them.
            let advice = if best.jumps > 0.5 { self.advice } else { "" };
            return Err(ChooseError::Below { wanted, best, advice });
        };
        let (between, law) = (best.between, best.law);
        for refinements in 0..=REFINEMENTS {
            let moments = self.flow.steps(step_px);
            let checked = self.check(viewer, &moments, between)?;
            cost_so_far += checked.cost;
            if checked.bound <= wanted {
                let chosen = SamplingChoice {
                    tolerance: wanted,
                    between,
                    step_px,
                    frames: moments.len(),
                    predicted: law.error(step_px),
                    achieved: checked.rms,
                    bound_95: checked.bound,
                    held_out: checked.intervals,
                    refinements,
                    pilot_frames: cost_so_far.frames,
                    pilot_share: cost_so_far.share(self.size),
                    candidates,
                };
                return Ok((chosen, moments));
            }
            if refinements == REFINEMENTS {
                let achieved = checked.rms;
                return Err(ChooseError::Missed { wanted, achieved, between, step_px });
            }
            // By the order at this step, the error becomes the target after this factor if the law
            // holds.
            let less = libm::pow(AIM * wanted / checked.bound, 1.0 / law.order(step_px));
            step_px *= less.clamp(FINER[0], FINER[1]);
        }
        unreachable!("the last refinement is accepted or refused")
    }

    /// The requirement of each method by the law of its errors at some places, and the cost.
    fn pilot<V: PathViewer<Error: std::error::Error + 'static>>(
        &self,
        viewer: &mut V,
    ) -> Result<(Vec<BetweenCandidate>, PilotCost), ChooseError<V::Error>> {
        let longest = LONGEST_PX.min(LONGEST_SHARE * self.flow.total_px());
        if longest <= 0.0 {
            // Nothing moves: every method is exact, and the smallest number of steps is sufficient.
            let frames = self.flow.steps(LONGEST_PX).len();
            let still = self
                .between
                .iter()
                .map(|between| BetweenCandidate::without_motion(*between, LONGEST_PX, frames));
            return Ok((still.collect(), PilotCost::default()));
        }
        let steps: Vec<f64> = (0..STEPS).map(|k| longest / libm::pow(RATIO, f64::from(k))).collect();
        let mut tried: Vec<(usize, SampledInterval)> = Vec::new();
        let places = self.places();
        for (sample, place) in places.iter().enumerate() {
            tried.extend(self.stencils(*place, sample, &steps));
        }
        let samples = self.samples(PILOT_TILES, places.len());
        let intervals: Vec<SampledInterval> = tried.iter().map(|(_, interval)| *interval).collect();
        let measured = measure_intervals(viewer, self.scales, &intervals, &samples, self.between)
            .map_err(ChooseError::View)?;
        let mut candidates = Vec::new();
        for (method, between) in self.between.iter().enumerate() {
            // The root of the mean over places, for each step measured somewhere.
            let points = steps.iter().enumerate().filter_map(|(number, px)| {
                let squares = tried.iter().zip(&measured.squares).filter(|((k, _), _)| *k == number);
                let squares: Vec<f64> = squares.map(|(_, squares)| squares[method]).collect();
                let mean = squares.iter().sum::<f64>() / squares.len() as f64;
                (!squares.is_empty()).then(|| (*px, mean.sqrt()))
            });
            candidates.extend(self.candidate(*between, points.collect()));
        }
        if candidates.is_empty() {
            Err(ChooseError::Short)
        } else {
            Ok((candidates, PilotCost::of(&measured)))
        }
    }

    /// A method by its errors at steps in px, the longest first; `None` if there are too few.
    fn candidate(&self, between: BetweenFrames, mut points: Vec<(f64, f64)>) -> Option<BetweenCandidate> {
        // A step with a smaller error than a finer one owes it to chance.
        for k in (1..points.len()).rev() {
            points[k - 1].1 = points[k - 1].1.max(points[k].1);
        }
        // The longest steps come first and have the largest errors, so the far ones are a prefix.
        let near = points.iter().take_while(|(_, e)| *e > FAR * self.tolerance.rms).count();
        // The law has three constants, so the last three points stay even where they are far.
        let law = ErrorLaw::fit_points(&points[near.min(points.len().saturating_sub(MIN_POINTS))..])?;
        let (finest_px, _) = *points.last()?;
        let step_px = law.step(MARGIN * self.tolerance.rms, [finest_px, points[0].0]);
        Some(BetweenCandidate {
            between,
            law,
            finest_px,
            finest: law.error(finest_px),
            jumps: law.share_of_jumps(step_px.unwrap_or(finest_px)),
            step_px,
            frames: step_px.map(|px| self.flow.steps(px).len()),
        })
    }

    /// The moments of the pilot, us: near the start, in the fastest part, and drawn from equal
    /// shares of the path.
    fn places(&self) -> Vec<f64> {
        let count = (self.intervals / STEPS_A_PLACE).clamp(PLACES[0], PLACES[1]);
        let mut draws = self.draws(PILOT);
        let drawn = (0..count - 2).map(|k| (k as f64 + draws.uniform()) / (count - 2) as f64);
        let drawn: Vec<f64> = drawn.map(|share| self.flow.past_us(share)).collect();
        [0.0, self.flow.fastest_us()].into_iter().chain(drawn).collect()
    }

    /// The intervals around a place with this image motion, for all steps for which the path is
    /// long enough, with the index of the step. The finest come first, so that frames are released
    /// early.
    fn stencils(&self, place: f64, sample: usize, steps: &[f64]) -> Vec<(usize, SampledInterval)> {
        let end = self.flow.end_us();
        // If the longest step does not fit around the place, the place moves.
        // Its stencil reaches 1.5 steps to both sides.
        let room = 1.5 * self.flow.length_about(place, steps[0]);
        let place = if 2.0 * room < end as f64 { place.clamp(room, end as f64 - room) } else { place };
        #[expect(clippy::cast_possible_truncation, reason = "a path ends within 2^53 us")]
        let (center, mut found, mut shorter) = (place as i64, Vec::new(), None);
        for (number, px) in steps.iter().enumerate().rev() {
            let wanted = self.flow.length_about(place, *px);
            // Three times the shorter step where that is close enough: the outer frames of the
            // shorter stencil are then the inner ones of the longer.
            let tripled = shorter.map(|h: i64| 3 * h).filter(|h| (*h as f64 / wanted - 1.0).abs() < ALIKE);
            // Even otherwise, so that half a step is in whole microseconds.
            #[expect(clippy::cast_possible_truncation, reason = "a path ends within 2^53 us")]
            let h = tripled.unwrap_or(2 * (wanted / 2.0 + 0.5) as i64);
            if h < SHORTEST_US {
                continue;
            }
            shorter = Some(h);
            let [before, from, to, after] = [-3, -1, 1, 3].map(|k| center + k * h / 2);
            if before >= 0 && after <= end {
                let outer = [Some(before), Some(after)];
                found.push((number, SampledInterval { ends: [from, to], outer, sample }));
            }
        }
        found
    }

    fn draws(&self, index: u64) -> CellDraws {
        self.seed.draws(SeedCell { x: 0, y: 0, level: 0, index }, DrawSpace::Choice)
    }

    /// Samples of the frames' pixels, a new one each.
    fn samples(&self, index: u64, count: usize) -> Vec<Arc<TileSample>> {
        let mut draws = self.draws(index);
        (0..count).map(|_| Arc::new(TileSample::spread(self.size, || draws.uniform()))).collect()
    }

    /// The error of a choice on some of its own intervals.
    fn check<V: PathViewer<Error: std::error::Error + 'static>>(
        &self,
        viewer: &mut V,
        moments: &[i64],
        between: BetweenFrames,
    ) -> Result<ChoiceCheck, ChooseError<V::Error>> {
        let all = moments.len() - 1;
        let count = all.min(HELD_OUT);
        let mut draws = self.draws(CHECK);
        let intervals: Vec<SampledInterval> = (0..count)
            .map(|k| {
                // One interval from each of `count` equal shares of the path.
                #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below `all`")]
                let j = ((k as f64 + draws.uniform()) * all as f64 / count as f64) as usize;
                let outer = [j.checked_sub(1), Some(j + 2)].map(|j| moments.get(j?).copied());
                SampledInterval { ends: [moments[j], moments[j + 1]], outer, sample: k }
            })
            .collect();
        let samples = self.samples(CHECK_TILES, count);
        let measured = measure_intervals(viewer, self.scales, &intervals, &samples, &[between])
            .map_err(ChooseError::View)?;
        let squares: Vec<f64> = measured.squares.iter().map(|squares| squares[0]).collect();
        let is_whole = measured.pixels == measured.frames * self.size.pixels();
        Ok(ChoiceCheck::from_squares(&squares, count == all && is_whole, PilotCost::of(&measured)))
    }
}

/// Indices of the draws: the places of the pilot, the intervals of the check, and the tiles of both.
const PILOT: u64 = 1;
const CHECK: u64 = 2;
const PILOT_TILES: u64 = 3;
const CHECK_TILES: u64 = 4;

fn cost_of_frame(between: BetweenFrames) -> f64 {
    if between == BetweenFrames::Hermite { RATED_COST } else { 1.0 }
}

/// Frames that were rendered for a choice.
#[derive(Debug, Clone, Copy, Default)]
struct PilotCost {
    frames: usize,
    /// Number of pixels that were read.
    pixels: usize,
}

impl PilotCost {
    fn of(measured: &MeasuredIntervals) -> Self {
        Self { frames: measured.frames, pixels: measured.pixels }
    }

    /// The mean share of the pixels of a frame that were read; 1 without frames.
    fn share(self, size: Size) -> f64 {
        if self.frames == 0 { 1.0 } else { self.pixels as f64 / (self.frames * size.pixels()) as f64 }
    }
}

impl AddAssign for PilotCost {
    fn add_assign(&mut self, other: Self) {
        self.frames += other.frames;
        self.pixels += other.pixels;
    }
}

/// The result of a check.
struct ChoiceCheck {
    rms: f64,
    /// Upper bound, with 95 % confidence, of the error over all intervals.
    bound: f64,
    intervals: usize,
    cost: PilotCost,
}

impl ChoiceCheck {
    /// The bound from squared errors. If all pixels of `all` intervals were measured, there is no
    /// uncertainty.
    fn from_squares(squares: &[f64], all: bool, cost: PilotCost) -> Self {
        let n = squares.len() as f64;
        let mean = squares.iter().sum::<f64>() / n;
        let variance = squares.iter().map(|s| (s - mean) * (s - mean)).sum::<f64>() / (n - 1.0).max(1.0);
        let doubt = if all { 0.0 } else { STUDENT_95 * (variance / n).sqrt() };
        Self { rms: mean.sqrt(), bound: (mean + doubt).sqrt(), intervals: squares.len(), cost }
    }
}

#[cfg(test)]
mod tests {
    use super::super::PilotMethod;
    use super::super::measure::planted::{K2, Planted};
    use super::*;
    use gs2e_image::Size;

    const SIZE: Size = Size { width: 16, height: 8 };
    const ALL: [BetweenFrames; 3] = [BetweenFrames::Linear, BetweenFrames::Catmull, BetweenFrames::Hermite];
    const SCALE: SensorScale = SensorScale { front_end: 0, k2: K2, thresholds: 5.0 };
    /// Amplitude of the planted waves, and radians per px of motion.
    const A: f64 = 0.5;
    const K: f64 = 0.2;
    /// Image motion per second, px.
    const PX_S: f64 = 400.0;

    /// Waves that pass: every pixel has another phase.
    fn waves(i: usize, t: f64) -> (f64, f64) {
        let phase = K * PX_S * t + i as f64 * std::f64::consts::TAU / SIZE.pixels() as f64;
        (4.0 + A * libm::sin(phase), A * K * PX_S * libm::cos(phase))
    }

    fn flow() -> PathFlow {
        PathFlow::planted(vec![PX_S; 100], 500_000)
    }

    fn question<'a>(rms: f64, flow: &'a PathFlow, between: &'a [BetweenFrames]) -> ChoiceQuestion<'a> {
        let tolerance = ErrorTolerance { rms, between: None, pilot: PilotMethod::default() };
        let advice = "; try something else";
        ChoiceQuestion {
            tolerance,
            flow,
            size: SIZE,
            intervals: 400,
            scales: &[SCALE],
            between,
            seed: Seed(7),
            advice,
        }
    }

    /// At the middle of a step of `h` px, the chord of a sine misses `1 - cos(K h / 2)` of it. Over
    /// all phases, the root mean square of a sine is its amplitude divided by the root of 2.
    fn missed_by_a_line(h: f64) -> f64 {
        5.0 * A / std::f64::consts::SQRT_2 * (1.0 - libm::cos(K * h / 2.0))
    }

    #[test]
    fn a_line_needs_the_step_that_its_error_says() {
        let flow = flow();
        let question = question(0.03, &flow, &ALL[..1]);
        let (chosen, moments) = question.answer(&mut Planted::new(SIZE, waves)).unwrap();
        // Four fifths of the tolerance. The law is a power of h where the truth is a cosine, and
        // steps are whole microseconds.
        assert!((missed_by_a_line(chosen.step_px) / 0.024 - 1.0).abs() < 0.01, "{chosen:?}");
        // One of the last two steps, which are shorter, may be among the twelve.
        assert!((chosen.achieved / 0.024 - 1.0).abs() < 0.05 && chosen.bound_95 <= 0.03, "{chosen:?}");
        assert_eq!((chosen.frames, chosen.refinements), (moments.len(), 0));
        let px = PX_S * 1e-6 * (moments[1] - moments[0]) as f64;
        assert!((px / chosen.step_px - 1.0).abs() < 1e-3, "{px} {chosen:?}");
        assert_eq!((moments[0], *moments.last().unwrap()), (0, 500_000));
    }

    #[test]
    fn the_cheapest_method_that_meets_it_is_taken() {
        let flow = flow();
        let question = question(0.003, &flow, &ALL);
        let (chosen, _) = question.answer(&mut Planted::new(SIZE, waves)).unwrap();
        let cost = |c: &BetweenCandidate| c.frames.unwrap() as f64 * cost_of_frame(c.between);
        let least = chosen.candidates.iter().map(cost).fold(f64::INFINITY, f64::min);
        let own = chosen.candidates.iter().find(|c| c.between == chosen.between).unwrap();
        assert!((cost(own) - least).abs() < 1e-9 && chosen.between == BetweenFrames::Hermite, "{chosen:?}");
        assert!(chosen.bound_95 <= 0.003 && chosen.candidates.len() == 3);
        // Orders of the three methods on a smooth signal.
        for (candidate, order) in chosen.candidates.iter().zip([2.0, 4.0, 4.0]) {
            assert!((candidate.law.p - order).abs() < 0.15, "{candidate:?}");
        }
    }

    /// Waves, and pixels that jump back and forth by 0.1 every 0.75 px of motion.
    fn jumping(i: usize, t: f64) -> (f64, f64) {
        let (v, slope) = waves(i, t);
        let way = PX_S * t / 0.75 + i as f64 * 0.37;
        (v + if libm::fmod(way, 2.0) < 1.0 { 0.1 } else { 0.0 }, slope)
    }

    #[test]
    fn what_jumps_leave_is_refused_with_what_can_be_reached() {
        let flow = flow();
        let asked = question(0.003, &flow, &ALL);
        let Err(ChooseError::Below { wanted, best, advice }) = asked.answer(&mut Planted::new(SIZE, jumping))
        else {
            panic!("it should have been refused")
        };
        // At steps of 1/9 px, a seventh of the pixels jump within one step, by half a threshold,
        // and the middle misses half of that.
        let jumps = (0.25 * 0.25 * (1.0 / 9.0) / 0.75_f64).sqrt();
        assert!((best.finest / jumps - 1.0).abs() < 0.3, "{best:?} {jumps}");
        assert_eq!((wanted, advice), (0.003, "; try something else"));
        assert!(best.jumps > 0.9);
        let message = asked.answer(&mut Planted::new(SIZE, jumping)).unwrap_err().to_string();
        assert!(message.starts_with("the tolerance of 0.003 thresholds cannot be met here:"), "{message}");
        assert!(message.ends_with("can be met; try something else"), "{message}");
    }

    /// Waves of half the length, in a part of the path without a place of the pilot.
    #[test]
    fn a_choice_that_fails_elsewhere_is_made_finer() {
        let flow = flow();
        let question = question(0.03, &flow, &ALL[..1]);
        let places = question.places();
        let calm = |t: f64| places.iter().any(|place| (place - 1e6 * t).abs() < 30_000.0);
        let signal = |i: usize, t: f64| if calm(t) { waves(i, t) } else { waves(i, 2.0 * t) };
        let (chosen, _) = question.answer(&mut Planted::new(SIZE, signal)).unwrap();
        assert!(chosen.refinements > 0 && chosen.bound_95 <= 0.03, "{chosen:?}");
        assert!(missed_by_a_line(2.0 * chosen.step_px) < 0.03, "{chosen:?}");
    }

    #[test]
    fn a_picture_that_stands_still_needs_the_fewest_frames() {
        let still = PathFlow::planted(vec![0.0; 64], 90_000);
        let question = question(0.001, &still, &ALL);
        let mut viewer = Planted::new(SIZE, |i, _| (4.0 + 0.01 * i as f64, 0.0));
        let (chosen, moments) = question.answer(&mut viewer).unwrap();
        assert_eq!((chosen.between, moments.len()), (BetweenFrames::Linear, 9));
        assert!(chosen.achieved < 1e-5);
    }

    #[test]
    fn the_bound_is_students() {
        let squares: Vec<f64> = (0..12).map(|k| 1.0 + 0.1 * f64::from(k)).collect();
        let checked = ChoiceCheck::from_squares(&squares, false, PilotCost::default());
        // Mean 1.55, variance 0.13: 1.55 + 1.795885 sqrt(0.13 / 12).
        assert!((checked.rms - 1.55_f64.sqrt()).abs() < 1e-12);
        assert!((checked.bound * checked.bound - 1.736_922).abs() < 1e-6, "{}", checked.bound);
        let all = ChoiceCheck::from_squares(&squares, true, PilotCost::default());
        assert!((all.bound - all.rms).abs() < 1e-15);
    }
}
