//! Cells with the photoreceptor's noise that one uniform number decides.
//!
//! The bridge of the noise between known ends is a Brownian one in the clock `r = e^(2 theta t)`, divided by
//! `e^(theta t)`. A straight line in that clock is a curve
//!
//! ```text
//! l(t) = (l0 sinh(theta (h - t)) + l1 sinh(theta t)) / sinh(theta h)
//! ```
//!
//! in time, and the bridge touches it with probability `exp(-a g / V)`, `V = s^2 sinh(theta h)`, where `a`
//! and `g` are the distances of its ends from those of the line (reflection principle). The line of a barrier
//! stays in front of it: of the barrier as the noise alone sees it, less the distance that the drift strays
//! from its chord, less the reach of the Brownian motion around its own. So
//!
//! 1. a path that does not touch the line does not touch the barrier, and one uniform number decides that;
//! 2. a path that does is followed from the first touch on ([`SpanWalk`]), whose time has a closed form
//!    (`bridge.rs`). Before it there is no event.
//!
//! The law is that of the tree: only the order of the questions differs. Both lines have a number in common,
//! which is right as long as no path touches both. Cells where one might, and those whose number would be
//! large, are split.
//!
//! **Line and barrier.** Where the barrier is at `c0` and `c1` at the ends, the line through these points
//! lies in front of its chord while both are above 0, because `l'' = theta^2 l`. Otherwise it strays behind
//! by at most `|c| (1 - 1/cosh z)`, `c` the lower of both and `z = theta h / 2`. A line that is lower by `m`
//! at both ends is so by at least `m / cosh z` everywhere. Hence the margins `|c| (cosh z - 1)` and `m cosh
//! z`.

use super::bridge::{BarrierSide, Barriers, LiveBarriers, NEGLIGIBLE, WideBarriers, touch_time};
use super::curve::DriftCurve;
use super::leaf::{ClockLeaf, EmitEvents, LeafSpan};
use super::receptor;
use super::tree::STRAIGHT;
use super::window::TimeStep;
use fearless_simd::{Simd, SimdBase as _, SimdFloat as _, f64x8};
use gs2e_num::elementary::{exp_eight, mask_bits};
use gs2e_num::seed::CellDraws;
use std::ops::ControlFlow;

/// Smallest product `a g / V` of a line that decides, a little above `ln 2`: the bound on the probability
/// that one of both is touched, twice that of the likelier, is then below 1.
const DECIDED: f64 = 0.7;
/// Product `a g / V` from which the bound is below the step of the numbers of root cells: `ln(2 * 4096)`, and
/// a little more.
const NEAR: f64 = 9.02;
/// Smallest margin in front of a barrier, in units of `sqrt(V)`. It covers how far drift usually strays, so
/// the line is the same for every frame rate.
const LEAST_MARGIN: f64 = 1.0 / 256.0;
/// Bits of the mantissa.
const MANTISSA: u64 = (1 << 52) - 1;

/// What a cell has of the photoreceptor's noise, of one pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct ReceptorCell {
    /// `theta`, per ns.
    pub(super) rate: f64,
    /// Standard deviation, in thresholds.
    pub(super) deviation: f64,
    /// Voltages at both ends.
    pub(super) ends: [f64; 2],
}

/// The lines of both barriers over a cell, as distances from the ends of the noise.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct BarrierLines {
    /// Distances `a` and `g` from the line of the upper barrier, and from that of the lower one.
    distances: [[f64; 2]; 2],
    /// `V`.
    spread: f64,
}

/// [`BarrierLines`] of eight pixels, and where they decide.
#[derive(Debug, Clone, Copy)]
pub(super) struct WideLines<S: Simd> {
    distances: [[f64x8<S>; 2]; 2],
    spread: f64x8<S>,
    /// Bits of the pixels that may touch a line, with a probability of `e^-40`.
    pub(super) live: u64,
    /// Bits of the pixels that one number decides.
    pub(super) decided: u64,
    /// Bits of the pixels whose bound may be above the step of [`receptor::SPARE_UNIT`].
    near: u64,
}

/// Functions of the length of a cell in units of `1 / theta`.
#[derive(Debug, Clone, Copy)]
pub(super) struct CellShape {
    /// `cosh z`.
    cosh: f64,
    /// `1 / cosh z`.
    inverse: f64,
    /// `cosh z - 1`.
    bend: f64,
    /// `sinh 2z` and its root.
    sinh: f64,
    root: f64,
}

/// [`CellShape`] of eight pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct WideShape<S: Simd> {
    cosh: f64x8<S>,
    inverse: f64x8<S>,
    bend: f64x8<S>,
    sinh: f64x8<S>,
    root: f64x8<S>,
}

impl CellShape {
    /// The shape of a cell after which `decay = e^(-2z)` of the noise is left.
    pub(super) fn new(decay: f64) -> Self {
        let root = decay.sqrt();
        let half = 0.5 / root;
        let cosh = (decay + 1.0) * half;
        let sinh = (1.0 - decay * decay) / (decay * 2.0);
        Self { cosh, inverse: 1.0 / cosh, bend: (1.0 - root) * (1.0 - root) * half, sinh, root: sinh.sqrt() }
    }
}

impl<S: Simd> WideShape<S> {
    /// [`CellShape::new`] for eight pixels.
    #[inline(always)]
    pub(super) fn new(decay: f64x8<S>) -> Self {
        let root = decay.sqrt();
        let half = 0.5 / root;
        let cosh = (decay + 1.0) * half;
        let sinh = (1.0 - decay * decay) / (decay * 2.0);
        Self { cosh, inverse: 1.0 / cosh, bend: (1.0 - root) * (1.0 - root) * half, sinh, root: sinh.sqrt() }
    }

    /// The same shape for all eight.
    #[inline(always)]
    pub(super) fn splat(simd: S, shape: &CellShape) -> Self {
        Self {
            cosh: f64x8::splat(simd, shape.cosh),
            inverse: f64x8::splat(simd, shape.inverse),
            bend: f64x8::splat(simd, shape.bend),
            sinh: f64x8::splat(simd, shape.sinh),
            root: f64x8::splat(simd, shape.root),
        }
    }
}

/// Eight pixels in a cell.
#[derive(Clone, Copy)]
pub(super) struct WideCell<S: Simd> {
    pub(super) shape: WideShape<S>,
    /// Standard deviation of the noise.
    pub(super) deviation: f64x8<S>,
    /// The noise at both ends.
    pub(super) ends: [f64x8<S>; 2],
    /// The voltage at both ends.
    pub(super) voltage: [f64x8<S>; 2],
    /// Distance of the drift from its chord.
    pub(super) straying: f64x8<S>,
    /// Reach of the Brownian motion around its chord: [`motion_reach`] times sigma.
    pub(super) motion: f64x8<S>,
}

/// A Brownian motion of unit variance per ns strays farther from its chord over `length` ns with a
/// probability below `2 e^-40`.
pub(super) fn motion_reach(length: f64) -> f64 {
    (0.5 * NEGLIGIBLE * length).sqrt()
}

impl<S: Simd> WideCell<S> {
    /// The lines of the barriers.
    #[inline(always)]
    pub(super) fn lines(&self, barriers: WideBarriers<S>) -> WideLines<S> {
        let Self { deviation, ends: [from, to], voltage: [x, y], .. } = *self;
        let WideShape { cosh, inverse, bend, sinh, root } = self.shape;
        let zero = f64x8::splat(x.simd, 0.0);
        let spread = deviation * deviation * sinh;
        // The next power of two: frames that cut the same drift otherwise do not move the line.
        let straying = f64x8::from_bits((self.straying.to_bits() + MANTISSA) & !MANTISSA);
        let margin = (straying.max(deviation * root * LEAST_MARGIN) + self.motion) * cosh;
        let [up, down] = [[barriers.up - x, barriers.up - y], [barriers.down + x, barriers.down + y]];
        let behind_up = margin - (from + up[0]).min(to + up[1]).min(zero) * bend;
        let behind_down = margin - (down[0] - from).min(down[1] - to).min(zero) * bend;
        let [a, g] = [up[0] - behind_up, up[1] - behind_up];
        let [b, f] = [down[0] - behind_down, down[1] - behind_down];
        let between = (barriers.up + barriers.down - behind_up - behind_down) * inverse;
        let (upper, lower) = (a * g, b * f);
        // One line, and from it the other.
        let both = (upper + between * f).min(lower + between * g);
        let nearest = a.min(g).min(b.min(f));
        let least = upper.min(lower);
        let quiet = nearest.simd_gt(0.0) & least.simd_ge(spread * NEGLIGIBLE);
        let decided = nearest.min(between).simd_gt(0.0)
            & both.simd_gt(spread * NEGLIGIBLE)
            & least.simd_ge(spread * DECIDED);
        let live = !mask_bits(quiet) & 0xff;
        let near = mask_bits(least.simd_lt(spread * NEAR));
        WideLines { distances: [[a, g], [b, f]], spread, live, decided: mask_bits(decided), near }
    }
}

impl<S: Simd> WideLines<S> {
    /// Bounds on the probability that a line is touched.
    #[inline(always)]
    pub(super) fn bound(&self) -> f64x8<S> {
        let [[a, g], [b, f]] = self.distances;
        exp_eight((a * g).min(b * f) / -self.spread) * 2.0
    }

    /// Bits of the decided pixels that may touch a line, where `known` are the upper 12 bits of their
    /// numbers.
    #[inline(always)]
    pub(super) fn open(&self, known: f64x8<S>) -> u64 {
        let close = self.decided & (self.near | mask_bits(known.simd_le(0.0)));
        // An exponential, which few cells need.
        if close == 0 { 0 } else { close & mask_bits(known.simd_lt(self.bound())) }
    }

    /// The lines of one of the pixels.
    #[inline(always)]
    pub(super) fn of(&self, lane: usize) -> BarrierLines {
        let [[a, g], [b, f]] = self.distances;
        BarrierLines { distances: [[a[lane], g[lane]], [b[lane], f[lane]]], spread: self.spread[lane] }
    }
}

impl BarrierLines {
    /// The lines over a span with the voltages `x` and `y` at its ends; `None` if one number does not decide.
    /// This is [`WideCell::lines`] for one pixel.
    fn new(
        span: &PathSpan,
        [x, y]: [f64; 2],
        Barriers { up, down }: Barriers,
        [straying, motion]: [f64; 2],
    ) -> Option<Self> {
        let PathSpan { from, to, rate, deviation } = *span;
        let (from, to) = (from.noise, to.noise);
        let CellShape { cosh, inverse, bend, sinh, root } = CellShape::new(libm::exp(-rate * span.length()));
        let spread = deviation * deviation * sinh;
        let straying = f64::from_bits((straying.to_bits() + MANTISSA) & !MANTISSA);
        let margin = (straying.max(deviation * root * LEAST_MARGIN) + motion) * cosh;
        let ([up_x, up_y], [down_x, down_y]) = ([up - x, up - y], [down + x, down + y]);
        let behind_up = margin - (from + up_x).min(to + up_y).min(0.0) * bend;
        let behind_down = margin - (down_x - from).min(down_y - to).min(0.0) * bend;
        let distances = [[up_x - behind_up, up_y - behind_up], [down_x - behind_down, down_y - behind_down]];
        let between = (up + down - behind_up - behind_down) * inverse;
        let [[a, g], [b, f]] = distances;
        let both = (a * g + between * f).min(b * f + between * g);
        let inside = a.min(g).min(b.min(f)).min(between) > 0.0;
        let decided = inside && both > spread * NEGLIGIBLE && (a * g).min(b * f) >= spread * DECIDED;
        decided.then_some(Self { distances, spread })
    }

    /// The line that is touched, if any, by a number between 0 and 1.
    fn touched(&self, number: f64) -> Option<BarrierSide> {
        let [up, down] = self.distances.map(|[a, g]| libm::exp(a * g / -self.spread));
        if number < up {
            return Some(BarrierSide::Up);
        }
        (number < up + down).then_some(BarrierSide::Down)
    }

    /// The first touch of a line: ns since the start of the span, and the noise then.
    fn touch(&self, span: &PathSpan, side: BarrierSide, draws: &mut CellDraws) -> [f64; 2] {
        let PathSpan { from, to, rate, deviation } = *span;
        let (from, to, length) = (from.noise, to.noise, span.length());
        let (sign, [a, g]) = match side {
            BarrierSide::Up => (1.0, self.distances[0]),
            BarrierSide::Down => (-1.0, self.distances[1]),
        };
        // In the clock of the Brownian motion, from 1 at the start, all is times `e^(theta t)`.
        let clock = libm::expm1(2.0 * rate * length);
        let stretch = (1.0 + clock).sqrt();
        let (z, u) = (draws.normal(), draws.uniform());
        let share = touch_time(a, g * stretch, deviation * deviation * clock, z, u);
        let time = (libm::log1p(share * clock) / (2.0 * rate)).min(length);
        let line = (from + sign * a) * (1.0 - share) + (to + sign * g) * stretch * share;
        [time, line / (1.0 + share * clock).sqrt()]
    }
}

/// A cell in which a line may be touched.
#[derive(Debug, Clone, Copy)]
pub(super) struct TouchedCell {
    pub(super) member: usize,
    pub(super) lines: BarrierLines,
    pub(super) cell: ReceptorCell,
    /// The number that decides is the first of these, and the second times the first draw of the cell.
    pub(super) number: [f64; 2],
    /// Increment of the Brownian motion over the cell.
    pub(super) increment: f64,
    /// Drift at both ends.
    pub(super) drift: [f64; 2],
}

/// Where a path is.
#[derive(Debug, Clone, Copy)]
struct PathPoint {
    /// ns since the window's start.
    time: f64,
    /// Noise of the photoreceptor.
    noise: f64,
    /// The Brownian motion.
    motion: f64,
    drift: f64,
}

/// A path between two points, and `theta` and the standard deviation of its noise.
#[derive(Debug, Clone, Copy)]
struct PathSpan {
    from: PathPoint,
    to: PathPoint,
    rate: f64,
    deviation: f64,
}

/// One pixel on its way through a cell, from the first touch of a line on.
#[derive(Debug)]
pub(super) struct SpanWalk<'a> {
    pub(super) window: &'a TimeStep<'a>,
    /// The legs' pieces of the pixel.
    pub(super) pieces: &'a [[f64; 5]],
    pub(super) sigma: f64,
    pub(super) curvature: f64,
    /// The thresholds, the draws, and what else a leaf needs.
    pub(super) leaf: ClockLeaf,
    /// Number of leaves visited and of spans split.
    pub(super) visited: [u64; 2],
}

/// Working memory of [`SpanWalk::cross`].
#[derive(Debug, Default)]
pub(super) struct SpanStacks {
    /// Ends of spans, the nearest last.
    ends: Vec<PathPoint>,
    leaf: Vec<LeafSpan>,
}

impl SpanWalk<'_> {
    /// Moves the voltage from `x` across the cell, and returns the voltage at its end.
    pub(super) fn cross<C: DriftCurve>(
        &mut self,
        mut x: f64,
        touched: &TouchedCell,
        [begin, until]: [f64; 2],
        stacks: &mut SpanStacks,
        emit: &mut impl EmitEvents,
    ) -> ControlFlow<(), f64> {
        let TouchedCell { lines, cell, number: [known, unit], increment, drift, .. } = *touched;
        let mut here = PathPoint { time: begin, noise: cell.ends[0], motion: 0.0, drift: drift[0] };
        let SpanStacks { ends, leaf: leaf_spans } = stacks;
        ends.clear();
        ends.push(PathPoint { time: until, noise: cell.ends[1], motion: increment, drift: drift[1] });
        let side = lines.touched(known + unit * self.leaf.draws.uniform());
        let mut fate = side.map_or(SpanFate::Passes, |side| SpanFate::Touches(lines, side));
        while let Some(next) = ends.pop() {
            let span = PathSpan { from: here, to: next, rate: cell.rate, deviation: cell.deviation };
            match fate {
                SpanFate::Passes => (x, here) = (x + self.rise(&span), next),
                SpanFate::Leaf => {
                    self.visited[0] += 1;
                    let whole = LeafSpan { end: x + self.rise(&span), until: next.time };
                    self.leaf.variance = self.sigma * self.sigma + span.variance();
                    self.leaf.time = here.time;
                    x = self.leaf.cross(x, whole, leaf_spans, emit)?;
                    here = next;
                }
                SpanFate::Touches(lines, side) => {
                    let to = self.first_touch::<C>(&span, &lines, side);
                    x += self.rise(&PathSpan { to, ..span });
                    here = to;
                    ends.push(next);
                }
                SpanFate::Splits(after) => {
                    self.visited[1] += 1;
                    ends.extend([next, self.between::<C>(&span, after)]);
                }
            }
            if let Some(&to) = ends.last() {
                let span = PathSpan { from: here, to, ..span };
                fate = self.judge::<C>(&span, x);
            }
        }
        ControlFlow::Continue(x)
    }

    /// Change of the voltage over a span.
    fn rise(&self, PathSpan { from, to, .. }: &PathSpan) -> f64 {
        (to.drift - from.drift) + self.sigma * (to.motion - from.motion) + (to.noise - from.noise)
    }

    /// What happens in a span to a path with the voltage `x` at its start.
    fn judge<C: DriftCurve>(&mut self, span: &PathSpan, x: f64) -> SpanFate {
        let (length, y, Barriers { up, down }) = (span.length(), x + self.rise(span), self.leaf.barriers);
        if length <= 0.0 {
            return SpanFate::Passes;
        }
        let straying = self.straying::<C>([span.from.time, span.to.time]);
        let motion = self.sigma * self.sigma * length;
        let reach = straying + span.bow();
        let near = Barriers { up: up - reach, down: down - reach };
        if near.live(x, y, motion + span.variance() * length) == LiveBarriers::Neither {
            return SpanFate::Passes;
        }
        // Below one nanosecond nothing is resolved.
        let is_short = span.rate * length <= receptor::SHORT && length <= receptor::LONGEST;
        if length <= 1.0 || (is_short && straying <= STRAIGHT) {
            return SpanFate::Leaf;
        }
        let motion = self.sigma * motion_reach(length);
        if let Some(lines) = BarrierLines::new(span, [x, y], self.leaf.barriers, [straying, motion]) {
            let side = lines.touched(self.leaf.draws.uniform());
            return side.map_or(SpanFate::Passes, |side| SpanFate::Touches(lines, side));
        }
        // A path that begins at a barrier touches it soon, if at all. A little less than the longest leaf, so
        // that rounding does not decide whether it is one.
        let short = 0.875 * (receptor::SHORT / span.rate).min(receptor::LONGEST);
        let begins_nearer = (up - x).min(down + x) < (up - y).min(down + y);
        SpanFate::Splits(if begins_nearer && 2.0 * short < length { short } else { 0.5 * length })
    }

    /// The point at which a line is touched for the first time.
    fn first_touch<C: DriftCurve>(
        &mut self,
        span: &PathSpan,
        lines: &BarrierLines,
        side: BarrierSide,
    ) -> PathPoint {
        let [after, noise] = lines.touch(span, side, &mut self.leaf.draws);
        self.point::<C>(span, after, noise)
    }

    /// A point of the path `after` ns.
    fn between<C: DriftCurve>(&mut self, span: &PathSpan, after: f64) -> PathPoint {
        // A Brownian bridge in the clock from 1 at the start to `clock + 1` at the end.
        let [clock, now] = [span.length(), after].map(|t| libm::expm1(2.0 * span.rate * t));
        let share = now / clock;
        let mean = span.from.noise * (1.0 - share) + span.to.noise * (1.0 + clock).sqrt() * share;
        let scatter = span.deviation * (now * (1.0 - share)).sqrt();
        let noise = (mean + scatter * self.leaf.draws.normal()) / (1.0 + now).sqrt();
        self.point::<C>(span, after, noise)
    }

    /// The point of a path `after` ns, where the noise is known.
    fn point<C: DriftCurve>(&mut self, span: &PathSpan, after: f64, noise: f64) -> PathPoint {
        let PathSpan { from, to, .. } = span;
        let (length, time) = (span.length(), from.time + after);
        let mut motion = from.motion;
        if self.sigma > 0.0 {
            let share = after / length;
            // A Brownian bridge between known ends.
            motion += (to.motion - from.motion) * share
                + (share * (length - after)).max(0.0).sqrt() * self.leaf.draws.normal();
        }
        PathPoint { time, noise, motion, drift: self.drift::<C>(time) }
    }

    /// The drift at a time.
    fn drift<C: DriftCurve>(&self, time: f64) -> f64 {
        let at = self.window.leg_at(time);
        let [start, curve @ ..] = &self.pieces[at];
        start + C::rise_of_one(curve, time - self.window.legs[at].stamp)
    }

    /// A bound on the distance between the drift and its chord.
    fn straying<C: DriftCurve>(&self, span: [f64; 2]) -> f64 {
        let [from, to] = span;
        let quick = self.curvature * ((to - from) * (to - from) * 0.125);
        let whole = self.window.leg_at(from) == self.window.leg_at(to.next_down());
        // No curve differs from its chord by more than 2.03 times that.
        if whole && quick * 2.1 <= STRAIGHT {
            return quick;
        }
        self.window.straying::<C>(self.pieces, span)
    }
}

/// What happens to a path in a span.
#[derive(Debug, Clone, Copy)]
enum SpanFate {
    /// It touches no barrier.
    Passes,
    /// Its first passages have a closed form.
    Leaf,
    /// It touches the line of a barrier.
    Touches(BarrierLines, BarrierSide),
    /// It is split after this time, ns.
    Splits(f64),
}

impl PathSpan {
    /// ns.
    fn length(&self) -> f64 {
        self.to.time - self.from.time
    }

    /// Variance of the noise per ns of a short piece.
    fn variance(&self) -> f64 {
        self.rate * self.deviation * self.deviation * 2.0
    }

    /// [`receptor::bow`] for one pixel.
    fn bow(&self) -> f64 {
        let turns = self.rate * self.length();
        (turns * turns * 0.125).min(1.0) * self.from.noise.abs().max(self.to.noise.abs())
    }
}

#[cfg(test)]
mod tests;
