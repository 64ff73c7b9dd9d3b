//! The length of a piecewise curve as a function of its parameter, and the inverse.
//!
//! Lengths come from adaptive 5-point Gauss-Legendre quadrature. The panels on which it settled are kept as the
//! table of the inverse: inside a panel the 5-point rule is accurate by construction, near cusps too, and a cubic
//! Hermite guess with Newton steps inverts it.

use super::spline::Place;
use super::sum::Sum;

/// Panels that every segment starts with.
const PANELS: u32 = 16;
/// A panel settles when one rule over it and two over its halves agree to this share of its length: then the one
/// rule, which the inverse uses, is good to 1e-12, and the two, 2^10 times more accurate on a smooth curve, are kept.
const TOLERANCE: f64 = 1e-12;
/// ... and when the polynomial through the rule's nodes meets the speed at both ends of the panel to this share of the
/// mean speed. The outermost nodes are 5 % away from the ends: a cusp in between would pass unseen. One that is left
/// unseen by this limit is within 5e-7 of the panel's width from its end, and 5e-13 of its length.
const SEEN: f64 = 1e-6;
/// ... or to this share of its segment's length: at a cusp the relative error of the panel that holds it never falls.
const FLOOR: f64 = 1e-14;
/// Halvings of a first panel, at most.
const DEPTH: u32 = 30;
/// Residual of the inverse, in shares of the whole length.
const INVERTED: f64 = 1e-15;
/// Newton steps and bisections, at most: bisection alone exhausts a double.
const ROUNDS: u32 = 60;

/// A curve's speed against its parameter: `|dP/ds|` at a place.
pub trait Pace {
    /// The speed at a place, finite and not negative.
    fn pace(&self, at: Place) -> f64;
}

impl<F: Fn(Place) -> f64> Pace for F {
    fn pace(&self, at: Place) -> f64 {
        self(at)
    }
}

/// Part of a segment with the speeds at the nodes of the 5-point Gauss-Legendre rule over it.
#[derive(Debug, Clone, Copy)]
struct Span {
    segment: usize,
    from: f64,
    to: f64,
    speeds: [f64; 5],
}

impl Span {
    /// Its length by the rule.
    fn length(&self) -> f64 {
        let [a, b, c, d, e] = self.speeds;
        (WEIGHTS[0] * (a + e) + WEIGHTS[1] * (b + d) + WEIGHTS[2] * c) * ((self.to - self.from) / 2.0)
    }

    /// Values at both ends of the polynomial through the nodes.
    fn extrapolated(&self) -> [f64; 2] {
        let last = |speeds: [f64; 5]| speeds.iter().zip(EXTRAPOLATION).map(|(v, w)| v * w).sum();
        let [a, b, c, d, e] = self.speeds;
        [last([e, d, c, b, a]), last([a, b, c, d, e])]
    }
}

/// Part of a segment on which the rule is accurate.
#[derive(Debug, Clone, Copy)]
struct Panel {
    span: Span,
    /// Length of the curve up to here.
    before: f64,
    length: f64,
}

/// The length of a curve, tabulated.
#[derive(Debug)]
pub struct ArcLength<P> {
    pace: P,
    steps: Vec<f64>,
    panels: Vec<Panel>,
    total: f64,
}

impl<P: Pace> ArcLength<P> {
    /// Measures the curve whose segment i is `steps[i] > 0` long in the parameter.
    pub fn measure(steps: &[f64], pace: P) -> Self {
        let mut measured = Self { pace, steps: steps.to_vec(), panels: Vec::new(), total: 0.0 };
        let mut before = Sum::default();
        for segment in 0..steps.len() {
            for (span, length) in measured.settle_segment(segment) {
                measured.panels.push(Panel { span, before: before.value(), length });
                before.add(length);
            }
        }
        measured.total = before.value();
        measured
    }

    /// Length of the whole curve.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.total
    }

    /// The place up to which the curve is `length` long; lengths outside `0..=total` name the ends.
    #[must_use]
    pub fn invert(&self, length: f64) -> Place {
        let Some(last) = self.panels.last() else { return Place { segment: 0, x: 0.0 } };
        if length >= self.total {
            return Place { segment: last.span.segment, x: last.span.to };
        }
        let index = self.panels.partition_point(|p| p.before <= length).saturating_sub(1);
        let panel = &self.panels[index];
        let share = ((length - panel.before) / panel.length).clamp(0.0, 1.0);
        // A panel of length 0 has no inverse; any of its places will do.
        let share = if share.is_nan() { 0.0 } else { share };
        Place { segment: panel.span.segment, x: self.invert_panel(&panel.span, share) }
    }

    /// Length between two places, `a` before `b`, by a quadrature of its own that shares no panel with the table.
    #[must_use]
    pub fn between(&self, a: Place, b: Place) -> f64 {
        if a.segment == b.segment {
            return self.settle(a.segment, a.x, b.x);
        }
        let mut sum = Sum::default();
        sum.add(self.settle(a.segment, a.x, self.steps[a.segment]));
        for segment in a.segment + 1..b.segment {
            self.settle_segment(segment).into_iter().for_each(|(_, length)| sum.add(length));
        }
        sum.add(self.settle(b.segment, 0.0, b.x));
        sum.value()
    }

    fn settle(&self, segment: usize, from: f64, to: f64) -> f64 {
        let mut panels = Vec::new();
        let whole = self.span(segment, from, to);
        self.subdivide(&mut panels, whole, whole.length() * FLOOR, DEPTH);
        Sum::of(panels.into_iter().map(|(_, length)| length))
    }

    /// The panels of a segment and their lengths.
    fn settle_segment(&self, segment: usize) -> Vec<(Span, f64)> {
        let bound = |k: u32| self.steps[segment] * (f64::from(k) / f64::from(PANELS));
        let spans: Vec<Span> = (0..PANELS).map(|k| self.span(segment, bound(k), bound(k + 1))).collect();
        let floor = spans.iter().map(Span::length).sum::<f64>() * FLOOR;
        let mut panels = Vec::with_capacity(spans.len());
        spans.into_iter().for_each(|span| self.subdivide(&mut panels, span, floor, DEPTH));
        panels
    }

    fn subdivide(&self, panels: &mut Vec<(Span, f64)>, whole: Span, floor: f64, depth: u32) {
        let middle = f64::midpoint(whole.from, whole.to);
        let left = self.span(whole.segment, whole.from, middle);
        let right = self.span(whole.segment, middle, whole.to);
        let sum = left.length() + right.length();
        let near = (whole.length() - sum).abs() <= (TOLERANCE * sum).max(floor);
        if depth == 0 || sum <= floor || (near && self.sees_ends(&whole)) {
            panels.push((whole, sum));
            return;
        }
        self.subdivide(panels, left, floor, depth - 1);
        self.subdivide(panels, right, floor, depth - 1);
    }

    fn span(&self, segment: usize, from: f64, to: f64) -> Span {
        let (centre, half) = (f64::midpoint(from, to), (to - from) / 2.0);
        let speeds = NODES.map(|node| self.pace.pace(Place { segment, x: centre + half * node }));
        Span { segment, from, to, speeds }
    }

    /// Whether the polynomial through a span's nodes meets the speeds at its ends.
    fn sees_ends(&self, span: &Span) -> bool {
        let limit = SEEN * span.length() / (span.to - span.from);
        let meets = |x: f64, predicted: f64| {
            let found = self.pace.pace(Place { segment: span.segment, x });
            (predicted - found).abs() <= limit
        };
        let [first, last] = span.extrapolated();
        meets(span.from, first) && meets(span.to, last)
    }

    /// The `x` at which a panel's rule has reached `share` of its length. Both are measured with the same rule, so
    /// that the inverse is continuous over panel borders.
    fn invert_panel(&self, panel: &Span, share: f64) -> f64 {
        let width = panel.to - panel.from;
        let target = panel.length() * share;
        let (mut low, mut high) = (0.0, 1.0);
        let mut u = self.guess(panel, share);
        for _ in 0..ROUNDS {
            let x = panel.from + width * u;
            let residual = self.span(panel.segment, panel.from, x).length() - target;
            if residual.abs() <= INVERTED * self.total {
                break;
            }
            *(if residual > 0.0 { &mut high } else { &mut low }) = u;
            let newton = u - residual / (self.pace.pace(Place { segment: panel.segment, x }) * width);
            u = if newton > low && newton < high { newton } else { f64::midpoint(low, high) };
        }
        panel.from + width * u
    }

    /// Where in a panel, 0 to 1, the length has reached `share`, by cubic Hermite interpolation of the inverse.
    fn guess(&self, panel: &Span, share: f64) -> f64 {
        let mean = panel.length() / (panel.to - panel.from);
        let [first, last] = panel.extrapolated();
        let (a, b) = (mean / first - 1.0, mean / last - 1.0);
        let rest = 1.0 - share;
        let u = share + share * rest * (a * rest - b * share);
        if u > 0.0 && u < 1.0 { u } else { share }
    }
}

/// Nodes of the rule on [-1, 1]: the roots of the Legendre polynomial of degree 5.
const NODES: [f64; 5] =
    [-0.906_179_845_938_664, -0.538_469_310_105_683_1, 0.0, 0.538_469_310_105_683_1, 0.906_179_845_938_664];
/// Weights of the outer, the inner and the middle nodes.
const WEIGHTS: [f64; 3] = [0.236_926_885_056_189_08, 0.478_628_670_499_366_47, 128.0 / 225.0];
/// Weights of the nodes in the value at 1 of the polynomial through them (Lagrange).
const EXTRAPOLATION: [f64; 5] = {
    let mut weights = [1.0; 5];
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A curve of speed `speed(x)` over one segment of length 1.
    fn measure(speed: impl Fn(f64) -> f64) -> ArcLength<impl Pace> {
        ArcLength::measure(&[1.0], move |at: Place| speed(at.x))
    }

    fn relative(got: f64, want: f64) -> f64 {
        (got - want).abs() / want
    }

    #[test]
    fn the_rule_integrates_polynomials_to_degree_nine() {
        for degree in 0..10 {
            let arc = ArcLength::measure(&[2.0], |at: Place| libm::pow(at.x, f64::from(degree)));
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
        // A full stop at c, near the borders of the first panels above all: |x - c| is c^2/2 + (1-c)^2/2 long.
        for k in 0..2000 {
            let c = f64::from(k) / 2000.0 + 1e-5;
            let arc = measure(|x| (x - c).abs());
            let error = relative(arc.total(), c * c / 2.0 + (1.0 - c) * (1.0 - c) / 2.0);
            // What SEEN leaves: 5e-13 of one panel's length.
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
        let arc = ArcLength::measure(&[0.5, 2.0], |_: Place| 3.0);
        assert_eq!(arc.invert(-1.0), Place { segment: 0, x: 0.0 });
        assert_eq!(arc.invert(0.0), Place { segment: 0, x: 0.0 });
        assert_eq!(arc.invert(arc.total()), Place { segment: 1, x: 2.0 });
        assert_eq!(arc.invert(1e9), Place { segment: 1, x: 2.0 });
        assert!((arc.total() - 7.5).abs() < 1e-14);
        let (a, b) = (Place { segment: 0, x: 0.25 }, Place { segment: 1, x: 1.0 });
        assert!((arc.between(a, b) - 3.75).abs() < 1e-14);
    }

    #[test]
    fn a_curve_that_never_moves_has_no_length_and_no_trouble() {
        let arc = ArcLength::measure(&[1.0, 1.0], |_: Place| 0.0);
        assert!(arc.total() == 0.0 && arc.invert(0.0).x.is_finite());
    }
}
