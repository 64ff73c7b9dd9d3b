//! The length of a piecewise curve as a function of its parameter, and the inverse.
//!
//! Lengths come from adaptive 5-point Gauss-Legendre quadrature. The panels on which it settled are kept as the
//! table of the inverse: inside a panel the 5-point rule is accurate by construction, near cusps too, and a cubic
//! Hermite guess with Newton steps inverts it.

use super::spline::Place;
use super::sum::Sum;

/// Panels that every segment starts with.
const PANELS: u32 = 16;
/// A panel settles when one rule over it and two over its halves agree to this share of its length; the halves, 2^10
/// times more accurate on a smooth curve, are kept.
const TOLERANCE: f64 = 1e-10;
/// ... or to this share of its segment's length: at a cusp the relative error of the panel that holds it never falls.
const FLOOR: f64 = 1e-14;
/// Halvings of a first panel, at most.
const DEPTH: u32 = 30;
/// Residual of the inverse, in shares of the whole length.
const INVERTED: f64 = 1e-13;
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

/// Part of a segment on which the 5-point rule is accurate.
#[derive(Debug, Clone, Copy)]
struct Panel {
    segment: usize,
    from: f64,
    to: f64,
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
            for (from, to, length) in measured.settle_segment(segment) {
                measured.panels.push(Panel { segment, from, to, before: before.value(), length });
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
            return Place { segment: last.segment, x: last.to };
        }
        let index = self.panels.partition_point(|p| p.before <= length).saturating_sub(1);
        let panel = &self.panels[index];
        let share = ((length - panel.before) / panel.length).clamp(0.0, 1.0);
        // A panel of length 0 has no inverse; any of its places will do.
        let share = if share.is_nan() { 0.0 } else { share };
        Place { segment: panel.segment, x: self.invert_panel(panel, share) }
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
            self.settle_segment(segment).into_iter().for_each(|(_, _, length)| sum.add(length));
        }
        sum.add(self.settle(b.segment, 0.0, b.x));
        sum.value()
    }

    fn settle(&self, segment: usize, from: f64, to: f64) -> f64 {
        let mut panels = Vec::new();
        let whole = self.gauss(segment, from, to);
        self.subdivide(&mut panels, (segment, from, to), whole, (DEPTH, whole * FLOOR));
        Sum::of(panels.into_iter().map(|(_, _, length)| length))
    }

    fn settle_segment(&self, segment: usize) -> Vec<(f64, f64, f64)> {
        let h = self.steps[segment];
        let bounds: Vec<f64> = (0..=PANELS).map(|k| h * (f64::from(k) / f64::from(PANELS))).collect();
        let rough: Vec<f64> = bounds.windows(2).map(|b| self.gauss(segment, b[0], b[1])).collect();
        let floor = rough.iter().sum::<f64>() * FLOOR;
        let mut panels = Vec::with_capacity(rough.len());
        for (b, whole) in bounds.windows(2).zip(rough) {
            self.subdivide(&mut panels, (segment, b[0], b[1]), whole, (DEPTH, floor));
        }
        panels
    }

    fn subdivide(
        &self,
        out: &mut Vec<(f64, f64, f64)>,
        (segment, from, to): (usize, f64, f64),
        whole: f64,
        (depth, floor): (u32, f64),
    ) {
        let middle = from + (to - from) / 2.0;
        let halves = [self.gauss(segment, from, middle), self.gauss(segment, middle, to)];
        let sum = halves[0] + halves[1];
        let settled = (whole - sum).abs() <= (TOLERANCE * sum).max(floor);
        if settled || depth == 0 {
            out.push((from, to, sum));
            return;
        }
        self.subdivide(out, (segment, from, middle), halves[0], (depth - 1, floor));
        self.subdivide(out, (segment, middle, to), halves[1], (depth - 1, floor));
    }

    /// The 5-point Gauss-Legendre rule over `[from, to]` of a segment.
    fn gauss(&self, segment: usize, from: f64, to: f64) -> f64 {
        let (centre, half) = (f64::midpoint(from, to), (to - from) / 2.0);
        let at = |offset: f64| self.pace.pace(Place { segment, x: centre + half * offset });
        let pair = |k: usize| WEIGHTS[k] * (at(-NODES[k]) + at(NODES[k]));
        (WEIGHTS[0] * at(0.0) + pair(1) + pair(2)) * half
    }

    /// The `x` at which a panel's rule has reached `share` of its length. Both are measured with the same rule, so
    /// that the inverse is continuous over panel borders.
    fn invert_panel(&self, panel: &Panel, share: f64) -> f64 {
        let (segment, width) = (panel.segment, panel.to - panel.from);
        let whole = self.gauss(segment, panel.from, panel.to);
        let target = whole * share;
        let (mut low, mut high) = (0.0, 1.0);
        let mut u = self.guess(panel, whole, share);
        for _ in 0..ROUNDS {
            let x = panel.from + width * u;
            let residual = self.gauss(segment, panel.from, x) - target;
            if residual.abs() <= INVERTED * self.total {
                return x;
            }
            *(if residual > 0.0 { &mut high } else { &mut low }) = u;
            let newton = u - residual / (self.pace.pace(Place { segment, x }) * width);
            u = if newton > low && newton < high { newton } else { f64::midpoint(low, high) };
        }
        panel.from + width * u
    }

    /// Where in a panel, 0 to 1, the length has reached `share`, by cubic Hermite interpolation of the inverse.
    fn guess(&self, panel: &Panel, whole: f64, share: f64) -> f64 {
        let width = panel.to - panel.from;
        let slope = |x: f64| whole / (self.pace.pace(Place { segment: panel.segment, x }) * width);
        let (a, b) = (slope(panel.from) - 1.0, slope(panel.to) - 1.0);
        let rest = 1.0 - share;
        let u = share + share * rest * (a * rest - b * share);
        if u > 0.0 && u < 1.0 { u } else { share }
    }
}

/// Nodes 0 and +-these on [-1, 1]: roots of the Legendre polynomial of degree 5.
const NODES: [f64; 3] = [0.0, 0.538_469_310_105_683_1, 0.906_179_845_938_664];
const WEIGHTS: [f64; 3] = [128.0 / 225.0, 0.478_628_670_499_366_47, 0.236_926_885_056_189_08];
