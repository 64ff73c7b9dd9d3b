//! A Bezier curve in space with given ends.

use super::least_squares;
use glam::DVec3;

/// The line between both ends plus a deviation from it, over a parameter from 0 to 1.
///
/// Each control point is the sum of a control point of the line and one of the deviation. The first
/// and last of the deviation are zero. A straight path has no deviation, so its curvature is
/// exactly zero.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PinnedBulge {
    start: DVec3,
    chord: DVec3,
    bulge: [BernsteinPolynomial; 3],
}

impl PinnedBulge {
    /// The curve of `degree` from the first to the last of `points` that is nearest to the others
    /// at the parameters `x`, in least squares.
    pub(super) fn fit_points(degree: usize, x: &[f64], points: &[DVec3]) -> Self {
        let last = points.len() - 1;
        let (start, chord) = (points[0], points[last] - points[0]);
        // The pinned control points already meet both ends, so only the points between are fitted.
        let column = |i: usize| x[1..last].iter().map(|x| bernstein_basis(degree, i, *x)).collect();
        let right = (1..last).map(|k| points[k] - (start + chord * x[k])).collect();
        let mut control = vec![DVec3::ZERO; degree + 1];
        control[1..degree]
            .copy_from_slice(&least_squares::solve_columns((1..degree).map(column).collect(), right));
        let slope = control_differences(&control);
        let bend = control_differences(&slope);
        Self {
            start,
            chord,
            bulge: [control, slope, bend].map(|control| BernsteinPolynomial::from_control(&control)),
        }
    }

    pub(super) fn value(&self, x: f64) -> DVec3 {
        self.start + self.chord * x + self.bulge[0].value(x)
    }

    /// The first derivative.
    pub(super) fn slope(&self, x: f64) -> DVec3 {
        self.chord + self.bulge[1].value(x)
    }

    /// The second derivative.
    pub(super) fn bend(&self, x: f64) -> DVec3 {
        self.bulge[2].value(x)
    }
}

/// Control points of the derivative.
fn control_differences(control: &[DVec3]) -> Vec<DVec3> {
    let degree = control.len().saturating_sub(1) as f64;
    control.windows(2).map(|w| (w[1] - w[0]) * degree).collect()
}

/// The Bernstein polynomial `i` of this degree.
fn bernstein_basis(degree: usize, i: usize, x: f64) -> f64 {
    // Not `powi`: its precision may differ between platforms.
    let power = |base: f64, exponent: usize| std::iter::repeat_n(base, exponent).product::<f64>();
    binomial_coefficient(degree, i) * power(x, i) * power(1.0 - x, degree - i)
}

/// Exact for all degrees in use: every partial product is a binomial coefficient.
fn binomial_coefficient(n: usize, k: usize) -> f64 {
    (0..k).fold(1.0, |product, j| product * (n - j) as f64 / (j + 1) as f64)
}

/// A polynomial as its control points times their binomial coefficients. Without control points it
/// is zero.
#[derive(Debug, Clone, PartialEq)]
struct BernsteinPolynomial(Vec<DVec3>);

impl BernsteinPolynomial {
    fn from_control(control: &[DVec3]) -> Self {
        let degree = control.len().saturating_sub(1);
        Self(control.iter().enumerate().map(|(i, point)| *point * binomial_coefficient(degree, i)).collect())
    }

    /// Nested multiplication in `1 - x` with growing powers of `x`: no term cancels another, as in
    /// de Casteljau's algorithm, but in linear time.
    fn value(&self, x: f64) -> DVec3 {
        let (mut sum, mut power) = (DVec3::ZERO, 1.0);
        for coefficient in &self.0 {
            sum = sum * (1.0 - x) + *coefficient * power;
            power *= x;
        }
        sum
    }
}
