//! The length of a piecewise curve as a function of its parameter, and the inverse.
//!
//! ```text
//! segment     |--------------------------------------------------|
//! panels      |------------|------------|------------|-----|-----|   halved where inaccurate
//! halves      |-----|------|-----|------|-----|------|--|--|--|--|
//! one half    x  o     o      o     o  x     o: Gauss nodes    x: ends
//! ```
//!
//! Lengths come from adaptive 5-point Gauss-Legendre quadrature. A panel is accepted when the rule
//! over it agrees with the sum of the rules over its halves; the halves are then kept.
//!
//! Only the length before each segment is stored. An [`ArcWalk`] along the curve rebuilds the
//! panels of the segment that it is in, so a path of millions of segments needs memory for their
//! lengths alone.
//!
//! To invert the length, the speed on a half panel is replaced by the polynomial of degree 6
//! through seven values: five at the nodes, which the quadrature has computed already, and two at
//! the ends. Its integral is inverted by Newton's method, which then evaluates polynomials only,
//! never the curve.
//!
//! # Examples
//!
//! ```
//! use gs2e_num::se3::arc_length::ArcLength;
//! use gs2e_num::se3::spline::CurvePlace;
//!
//! // With the speed 2x, the length up to x is x^2.
//! let length = ArcLength::measure_curve(&[3.0], |at: CurvePlace| 2.0 * at.x);
//! assert!((length.total() - 9.0).abs() < 1e-9);
//! assert!((length.invert(4.0).x - 2.0).abs() < 1e-9);
//! // A walk finds the places of growing lengths.
//! let mut walk = length.walk();
//! let places = [1.0, 4.0, 9.0].map(|to| walk.to(to).x);
//! assert!(places.iter().zip([1.0, 2.0, 3.0]).all(|(found, x)| (found - x).abs() < 1e-9));
//! ```

use super::series::power_sum;
use super::spline::CurvePlace;
use super::sum::NeumaierSum;

/// Number of panels with which every segment starts.
const PANELS: usize = 4;
/// Maximum difference, relative to the panel's length, between one rule over a panel and two over
/// its halves. The two are kept; they are 2^10 times more accurate on a smooth curve. A speed that
/// passes this test has its nearest singularity about four panel widths away, and the polynomial of
/// a half then misses less than 1e-10 of its variation.
const TOLERANCE: f64 = 1e-13;
/// Maximum difference, relative to the mean speed, between the polynomial through the nodes and the
/// speed at the ends of the panel. The outermost nodes are 5 % away from the ends, so the first
/// test does not notice a cusp in between. A cusp that this test misses is within 5e-7 of the
/// panel's width from its end, and costs 5e-13 of its length.
const MAX_MISFIT: f64 = 1e-6;
/// Replaces [`MAX_MISFIT`] where the speed at an end is positive but below `MAX_MISFIT` of the mean. A curve
/// that passes so close to a stop bends inside the panel, and its length up to a place would be
/// wrong by 1e-11 of the panel's length.
const MAX_MISFIT_AT_A_STOP: f64 = 1e-9;
/// Error, relative to the segment's length, below which a panel is always accepted. At a cusp the
/// relative error of the panel that contains it never falls.
const FLOOR: f64 = 1e-14;
/// Maximum number of halvings of a first panel.
const DEPTH: u32 = 30;
/// Length of the last Newton step, in half panels. Newton's method converges quadratically, so the
/// next step would be about 1e-16 long.
const SHORT: f64 = 1e-8;
/// Maximum number of Newton steps and bisections. Bisection alone exhausts the bits of a double in
/// fewer.
const ROUNDS: u32 = 60;

/// A curve's speed against its parameter: `|dP/ds|` at a place.
pub trait CurveSpeed {
    /// The speed at a place, finite and not negative.
    fn pace(&self, at: CurvePlace) -> f64;
}

impl<F: Fn(CurvePlace) -> f64> CurveSpeed for F {
    fn pace(&self, at: CurvePlace) -> f64 {
        self(at)
    }
}

/// Part of a segment with the speeds at the nodes of the 5-point Gauss-Legendre rule over it.
#[derive(Debug, Clone, Copy)]
struct SegmentSpan {
    segment: usize,
    from: f64,
    to: f64,
    speeds: [f64; 5],
}

impl SegmentSpan {
    /// The length of the span by the rule.
    fn length(&self) -> f64 {
        let [a, b, c, d, e] = self.speeds;
        (WEIGHTS[0] * (a + e) + WEIGHTS[1] * (b + d) + WEIGHTS[2] * c) * ((self.to - self.from) / 2.0)
    }

    /// The polynomial through the nodes, evaluated at both ends.
    fn extrapolated(&self) -> [f64; 2] {
        // The nodes are symmetric: reversed speeds give the value at -1 with the weights for the end at 1.
        let last = |speeds: [f64; 5]| speeds.iter().zip(EXTRAPOLATION).map(|(v, w)| v * w).sum();
        let [a, b, c, d, e] = self.speeds;
        [last([e, d, c, b, a]), last([a, b, c, d, e])]
    }
}

/// The length of a curve.
#[derive(Debug)]
pub struct ArcLength<P> {
    pace: P,
    steps: Vec<f64>,
    /// Length before each segment, then the length of the whole curve.
    before: Vec<f64>,
}

impl<P: CurveSpeed> ArcLength<P> {
    /// Measures a curve. Segment `i` covers `steps[i] > 0` of the parameter.
    pub fn measure_curve(steps: &[f64], pace: P) -> Self {
        let mut measured = Self { pace, steps: steps.to_vec(), before: Vec::with_capacity(steps.len() + 1) };
        // One buffer of panels serves all segments, and only lengths are kept. The sum is
        // compensated, because a path of a million segments would otherwise lose digits to its
        // length.
        let (mut sum, mut halves) = (NeumaierSum::default(), Vec::new());
        measured.before.push(0.0);
        for segment in 0..steps.len() {
            measured.subdivide_segment(segment, &mut halves);
            halves.iter().for_each(|half| sum.add(half.length()));
            measured.before.push(sum.value());
        }
        measured
    }

    /// Length of the whole curve.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.before[self.steps.len()]
    }

    /// The curve's speed at a place.
    #[must_use]
    pub fn pace(&self, at: CurvePlace) -> f64 {
        self.pace.pace(at)
    }

    /// The place at which the curve has reached `length`. Lengths outside `0..=total` give the
    /// ends. For many lengths in growing order, a [`ArcWalk`] is faster.
    #[must_use]
    pub fn invert(&self, length: f64) -> CurvePlace {
        self.walk().to(length)
    }

    /// A walk along the curve from its start.
    #[must_use]
    pub fn walk(&self) -> ArcWalk<'_, P> {
        ArcWalk { arc: self, segment: None, halves: Vec::new(), before: Vec::new(), panel: None }
    }

    /// The length between two places, `a` before `b`. The quadrature is independent: it shares no
    /// panel with a walk.
    #[must_use]
    pub fn between(&self, a: CurvePlace, b: CurvePlace) -> f64 {
        if a.segment == b.segment {
            return self.integrate_span(a.segment, a.x, b.x);
        }
        let mut sum = NeumaierSum::default();
        sum.add(self.integrate_span(a.segment, a.x, self.steps[a.segment]));
        let mut halves = Vec::new();
        for segment in a.segment + 1..b.segment {
            self.subdivide_segment(segment, &mut halves);
            halves.iter().for_each(|half| sum.add(half.length()));
        }
        sum.add(self.integrate_span(b.segment, 0.0, b.x));
        sum.value()
    }

    fn integrate_span(&self, segment: usize, from: f64, to: f64) -> f64 {
        let mut halves = Vec::new();
        let whole = self.span(segment, from, to);
        // The floor is relative to this part and not to its segment, so a short part keeps its digits.
        self.subdivide(&mut halves, whole, whole.length() * FLOOR, DEPTH);
        NeumaierSum::sum_of(halves.iter().map(SegmentSpan::length))
    }

    /// The halves of a segment's panels, in order.
    fn subdivide_segment(&self, segment: usize, halves: &mut Vec<SegmentSpan>) {
        let bound = |k: usize| self.steps[segment] * (k as f64 / PANELS as f64);
        let spans: [SegmentSpan; PANELS] =
            std::array::from_fn(|k| self.span(segment, bound(k), bound(k + 1)));
        // The floor needs only the size of the segment, which four rules give well enough.
        let floor = spans.iter().map(SegmentSpan::length).sum::<f64>() * FLOOR;
        halves.clear();
        spans.into_iter().for_each(|span| self.subdivide(halves, span, floor, DEPTH));
    }

    fn subdivide(&self, halves: &mut Vec<SegmentSpan>, whole: SegmentSpan, floor: f64, depth: u32) {
        let middle = f64::midpoint(whole.from, whole.to);
        let left = self.span(whole.segment, whole.from, middle);
        let right = self.span(whole.segment, middle, whole.to);
        let sum = left.length() + right.length();
        // `sum <= floor` ends the search at a stop, where a relative test on almost nothing would
        // never pass.
        let near = (whole.length() - sum).abs() <= (TOLERANCE * sum).max(floor);
        // `sees_ends` evaluates the curve twice more, so it is asked last.
        if depth == 0 || sum <= floor || (near && self.sees_ends(&whole)) {
            halves.extend([left, right]);
            return;
        }
        // Each half becomes the whole of the next level, with the speeds that it has already.
        self.subdivide(halves, left, floor, depth - 1);
        self.subdivide(halves, right, floor, depth - 1);
    }

    fn span(&self, segment: usize, from: f64, to: f64) -> SegmentSpan {
        let (centre, half) = (f64::midpoint(from, to), (to - from) / 2.0);
        let speeds = NODES.map(|node| self.pace.pace(CurvePlace { segment, x: centre + half * node }));
        SegmentSpan { segment, from, to, speeds }
    }

    /// Returns true if the polynomial through a span's nodes predicts the speeds at both ends.
    fn sees_ends(&self, span: &SegmentSpan) -> bool {
        let mean = span.length() / (span.to - span.from);
        let meets = |x: f64, predicted: f64| {
            let found = self.pace.pace(CurvePlace { segment: span.segment, x });
            let share =
                if found > 0.0 && found < MAX_MISFIT * mean { MAX_MISFIT_AT_A_STOP } else { MAX_MISFIT };
            (predicted - found).abs() <= share * mean
        };
        let [first, last] = span.extrapolated();
        meets(span.from, first) && meets(span.to, last)
    }
}

/// Half of a panel, ready to be inverted.
#[derive(Debug, Clone, Copy)]
struct HalfPanel {
    from: f64,
    width: f64,
    /// Length of the curve up to the panel's start.
    before: f64,
    length: f64,
    /// Speed divided by its mean, as the coefficients of a polynomial in `w` from -1 to 1.
    speed: [f64; 7],
    /// Integral of `speed` from -1 to `w`.
    integral: [f64; 8],
    /// Integral of `speed` from -1 to 1.
    whole: f64,
    /// Inverse speed at both ends, minus 1.
    bends: [f64; 2],
}

impl HalfPanel {
    /// Fits the polynomial to a span. The two values at the ends make it continuous over panel
    /// borders.
    fn new<P: CurveSpeed>(span: &SegmentSpan, pace: &P, before: f64) -> Self {
        let length = span.length();
        let at = |x: f64| pace.pace(CurvePlace { segment: span.segment, x });
        let [a, b, c, d, e] = span.speeds;
        let mean = length / (span.to - span.from);
        let values = [at(span.from), a, b, c, d, e, at(span.to)].map(|speed| speed / mean - 1.0);
        let mut speed = INTERPOLATION.map(|row| row.iter().zip(values).map(|(w, v)| w * v).sum::<f64>());
        // The fit is of the deviation from the mean, so that a constant speed is reproduced without
        // rounding.
        speed[0] += 1.0;
        let mut integral = [0.0; 8];
        for (k, c) in speed.iter().enumerate() {
            integral[k + 1] = c / (k + 1) as f64;
        }
        integral[0] = -power_sum(-1.0, &integral);
        let whole = power_sum(1.0, &integral);
        let bends = [values[0], values[6]].map(|v| 1.0 / (1.0 + v) - 1.0);
        Self { from: span.from, width: span.to - span.from, before, length, speed, integral, whole, bends }
    }

    /// The place in the segment at which the panel has reached `share` of its length. Part and
    /// whole are measured with the same polynomial, so the inverse is continuous over panel
    /// borders.
    fn invert(&self, share: f64) -> f64 {
        let target = self.whole * share;
        // The integral grows with `w`, so the sign of the residual says on which side the root
        // lies.
        let (mut low, mut high) = (-1.0, 1.0);
        let mut w = self.guess(share);
        for _ in 0..ROUNDS {
            let residual = power_sum(w, &self.integral) - target;
            // The bracket makes the iteration safe where the polynomial is flat and Newton's step
            // leaves it.
            *(if residual > 0.0 { &mut high } else { &mut low }) = w;
            // Where the speed is 0, `newton` is infinite or NaN. Both comparisons below are then false, and
            // the bracket is halved.
            let newton = w - residual / power_sum(w, &self.speed);
            // The slack lets a root at an end of the panel pass, which rounding may put just outside of it.
            if (newton - w).abs() < SHORT && newton >= low - SHORT && newton <= high + SHORT {
                w = newton.clamp(-1.0, 1.0);
                break;
            }
            // A step that leaves the bracket is replaced by its middle.
            w = if newton > low && newton < high { newton } else { f64::midpoint(low, high) };
        }
        self.from + self.width * (0.5 + 0.5 * w)
    }

    /// A first guess of `w` for `share`, by cubic Hermite interpolation of the inverse.
    fn guess(&self, share: f64) -> f64 {
        // The inverse has the slopes `1 + a` and `1 + b` at its ends, and the cubic has the same.
        let ([a, b], rest) = (self.bends, 1.0 - share);
        // At a stop a bend is infinite, and the cubic is NaN or far off. The linear guess is always
        // inside.
        let u = share + share * rest * (a * rest - b * share);
        if u > 0.0 && u < 1.0 { 2.0 * u - 1.0 } else { 2.0 * share - 1.0 }
    }
}

/// A walk along a curve that finds places for growing lengths. Going back is possible but slow.
#[derive(Debug)]
pub struct ArcWalk<'a, P> {
    arc: &'a ArcLength<P>,
    /// The present segment.
    segment: Option<usize>,
    /// Half panels of the present segment.
    halves: Vec<SegmentSpan>,
    /// Length of the curve before each half panel.
    before: Vec<f64>,
    /// The half panel of the last place, with its index.
    panel: Option<(usize, HalfPanel)>,
}

impl<P: CurveSpeed> ArcWalk<'_, P> {
    /// The place at which the curve has reached `length`. Lengths outside `0..=total` give the
    /// ends.
    pub fn to(&mut self, length: f64) -> CurvePlace {
        let segments = self.arc.steps.len();
        if segments == 0 {
            return CurvePlace { segment: 0, x: 0.0 };
        }
        // Answered first, so that rounding cannot place the end in a segment by itself.
        if length >= self.arc.total() {
            let last = segments - 1;
            return CurvePlace { segment: last, x: self.arc.steps[last] };
        }
        let near = self.segment.unwrap_or(0);
        // Without the total, which starts no segment.
        let segment = index_of(&self.arc.before[..segments], near, length);
        if self.segment != Some(segment) {
            self.enter(segment);
        }
        self.find_panel(length);
        let Some((_, panel)) = &self.panel else { return CurvePlace { segment, x: 0.0 } };
        let share = ((length - panel.before) / panel.length).clamp(0.0, 1.0);
        // A panel of length 0 has no inverse. All its places are the same point of the curve.
        let x = if share.is_nan() { panel.from } else { panel.invert(share) };
        CurvePlace { segment, x }
    }

    /// The length from `from` to `to`, where `to` is the place found last. Inside one half panel a
    /// single rule over the part is accurate, because it is accurate over the whole half. Elsewhere
    /// this is [`ArcLength::between`].
    pub fn since(&self, from: CurvePlace, to: CurvePlace) -> f64 {
        let inside = |panel: &HalfPanel| panel.from <= from.x && to.x <= panel.from + panel.width;
        match &self.panel {
            Some((_, panel)) if from.segment == to.segment && inside(panel) => {
                self.arc.span(to.segment, from.x, to.x).length()
            }
            _ => self.arc.between(from, to),
        }
    }

    fn enter(&mut self, segment: usize) {
        self.arc.subdivide_segment(segment, &mut self.halves);
        self.before.clear();
        let mut sum = NeumaierSum::default();
        for half in &self.halves {
            // As in `measure_curve`, so that the last half ends where the next segment begins.
            self.before.push(self.arc.before[segment] + sum.value());
            sum.add(half.length());
        }
        (self.segment, self.panel) = (Some(segment), None);
    }

    /// Selects the half panel of the present segment that contains `length`.
    fn find_panel(&mut self, length: f64) {
        let at_hand = self.panel.as_ref().map(|(k, _)| *k);
        let k = index_of(&self.before, at_hand.unwrap_or(0), length);
        if at_hand != Some(k) {
            self.panel = Some((k, HalfPanel::new(&self.halves[k], &self.arc.pace, self.before[k])));
        }
    }
}

/// Index of the last of the ascending `starts` that is at most `at`, or 0. Tries `near` and its
/// successor first, since lengths grow slowly.
fn index_of(starts: &[f64], near: usize, at: f64) -> usize {
    let holds = |k: &usize| {
        let next = starts.get(k + 1);
        starts.get(*k).is_some_and(|start| *start <= at) && next.is_none_or(|next| at < *next)
    };
    let found = [near, near + 1].into_iter().find(holds);
    found.unwrap_or_else(|| starts.partition_point(|start| *start <= at).saturating_sub(1))
}

/// Nodes of the rule on [-1, 1]: the roots of the Legendre polynomial of degree 5.
const NODES: [f64; 5] =
    [-0.906_179_845_938_664, -0.538_469_310_105_683_1, 0.0, 0.538_469_310_105_683_1, 0.906_179_845_938_664];
/// Weights of the outer, the inner and the middle nodes.
const WEIGHTS: [f64; 3] = [0.236_926_885_056_189_08, 0.478_628_670_499_366_47, 128.0 / 225.0];
/// Weights of the nodes in the value at 1 of the polynomial through them (Lagrange).
const EXTRAPOLATION: [f64; 5] = {
    let mut weights = [1.0; 5];
    // `while`, because constants have no `for`.
    let mut i = 0;
    while i < 5 {
        let mut j = 0;
        while j < 5 {
            if i != j {
                weights[i] *= (1.0 - NODES[j]) / (NODES[i] - NODES[j]);
            }
            j += 1;
        }
        i += 1;
    }
    weights
};

/// Places at which the polynomial of a half takes its values: both ends, and the nodes.
const PLACES: [f64; 7] = [-1.0, NODES[0], NODES[1], NODES[2], NODES[3], NODES[4], 1.0];
/// `INTERPOLATION[k][i]`: the coefficient of `w^k` in the polynomial that is 1 at place i and 0 at
/// the others (Lagrange).
const INTERPOLATION: [[f64; 7]; 7] = {
    let mut rows = [[0.0; 7]; 7];
    let mut i = 0;
    while i < 7 {
        // The product of the factors (w - p_j) / (p_i - p_j), one at a time.
        let mut product = [0.0; 7];
        product[0] = 1.0;
        let mut j = 0;
        while j < 7 {
            if i != j {
                let scale = 1.0 / (PLACES[i] - PLACES[j]);
                let mut k = 6;
                while k > 0 {
                    product[k] = (product[k - 1] - PLACES[j] * product[k]) * scale;
                    k -= 1;
                }
                product[0] *= -PLACES[j] * scale;
            }
            j += 1;
        }
        let mut k = 0;
        while k < 7 {
            rows[k][i] = product[k];
            k += 1;
        }
        i += 1;
    }
    rows
};

#[cfg(test)]
mod tests {
    use super::*;

    /// A curve of speed `speed(x)` over one segment of length 1.
    fn measure(speed: impl Fn(f64) -> f64) -> ArcLength<impl CurveSpeed> {
        ArcLength::measure_curve(&[1.0], move |at: CurvePlace| speed(at.x))
    }

    fn relative(got: f64, want: f64) -> f64 {
        (got - want).abs() / want
    }

    #[test]
    fn the_rule_integrates_polynomials_to_degree_nine() {
        for degree in 0..10 {
            let arc = ArcLength::measure_curve(&[2.0], |at: CurvePlace| libm::pow(at.x, f64::from(degree)));
            let whole = arc.span(0, 0.0, 2.0);
            let exact = libm::pow(2.0, f64::from(degree + 1)) / f64::from(degree + 1);
            // Weights and nodes carry one rounding each.
            assert!(relative(whole.length(), exact) < 2e-15, "{degree}");
            // Through five nodes a polynomial of degree four is met exactly.
            let meets = (whole.extrapolated()[1] - libm::pow(2.0, f64::from(degree))).abs() < 1e-13 * 512.0;
            assert_eq!(meets, degree < 5, "{degree}");
        }
    }

    #[test]
    fn stops_are_found_wherever_they_are() {
        // A full stop at c, near the borders of the first panels above all: |x - c| is c^2/2 +
        // (1-c)^2/2 long.
        for k in 0..2000 {
            let c = f64::from(k) / 2000.0 + 1e-5;
            let arc = measure(|x| (x - c).abs());
            let error = relative(arc.total(), c * c / 2.0 + (1.0 - c) * (1.0 - c) / 2.0);
            // What MAX_MISFIT leaves: 5e-13 of one panel's length.
            assert!(error < 1e-12, "{c}: {error:e}");
        }
    }

    #[test]
    fn the_inverse_passes_through_a_stop() {
        // Speed 2|x - 1/3|: length x(2/3 - x) before the stop, 1/9 + (x - 1/3)^2 after it.
        let arc = measure(|x| 2.0 * (x - 1.0 / 3.0).abs());
        for k in 0..=1000 {
            let share = f64::from(k) / 1000.0;
            let place = arc.invert(share * arc.total());
            let d = place.x - 1.0 / 3.0;
            let length = 1.0 / 9.0 + d * d.abs();
            assert!((length - share * 5.0 / 9.0).abs() < 1e-12, "{share}: {place:?}");
        }
    }

    #[test]
    fn a_speed_ratio_of_fifty_inside_a_segment_costs_no_digits() {
        // Speed 1 + 49 / (1 + (40 (x - 0.4))^2), whose length is an arctangent.
        let arc = measure(|x| 1.0 + 49.0 / (1.0 + (40.0 * (x - 0.4)) * (40.0 * (x - 0.4))));
        let exact = |x: f64| x + 49.0 / 40.0 * (libm::atan(40.0 * (x - 0.4)) + libm::atan(16.0));
        assert!(relative(arc.total(), exact(1.0)) < 1e-14);
        for k in 0..=1000 {
            let length = f64::from(k) / 1000.0 * arc.total();
            assert!((exact(arc.invert(length).x) - length).abs() < 1e-12 * arc.total());
        }
    }

    #[test]
    fn lengths_outside_the_curve_name_its_ends() {
        let arc = ArcLength::measure_curve(&[0.5, 2.0], |_: CurvePlace| 3.0);
        assert_eq!(arc.invert(-1.0), CurvePlace { segment: 0, x: 0.0 });
        assert_eq!(arc.invert(0.0), CurvePlace { segment: 0, x: 0.0 });
        assert_eq!(arc.invert(arc.total()), CurvePlace { segment: 1, x: 2.0 });
        assert_eq!(arc.invert(1e9), CurvePlace { segment: 1, x: 2.0 });
        assert!((arc.total() - 7.5).abs() < 1e-14);
        let (a, b) = (CurvePlace { segment: 0, x: 0.25 }, CurvePlace { segment: 1, x: 1.0 });
        assert!((arc.between(a, b) - 3.75).abs() < 1e-14);
    }

    #[test]
    fn a_curve_that_never_moves_has_no_length_and_no_trouble() {
        let arc = ArcLength::measure_curve(&[1.0, 1.0], |_: CurvePlace| 0.0);
        assert!(arc.total() == 0.0 && arc.invert(0.0).x.is_finite());
    }
}
