//! The interpolating C2 cubic spline through points, with not-a-knot ends.
//!
//! A place is a segment and the distance from its start, never an absolute parameter. A long path
//! therefore loses no digits to its length.
//!
//! # Examples
//!
//! ```
//! use glam::DVec3;
//! use gs2e_num::se3::spline::CubicSpline;
//!
//! // Three points give their parabola, here y = x^2.
//! let points = [0.0, 1.0, 2.0].map(|x| DVec3::new(x, x * x, 0.0));
//! let spline = CubicSpline::not_a_knot(&[1.0, 1.0], &points);
//! // The second segment starts at x = 1, so 0.5 in it is x = 1.5.
//! let segment = spline.segment(1);
//! assert!(segment.value(0.5).distance(DVec3::new(1.5, 2.25, 0.0)) < 1e-12);
//! assert!(segment.slope(0.5).distance(DVec3::new(1.0, 3.0, 0.0)) < 1e-12);
//! assert!(segment.bend(0.5).distance(DVec3::new(0.0, 2.0, 0.0)) < 1e-12);
//! ```

use glam::DVec3;

/// A place on a piecewise curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurvePlace {
    /// Index of the segment, from 0.
    pub segment: usize,
    /// Parameter since the segment's start, from 0 to its length.
    pub x: f64,
}

/// Coefficients of `c[0] + c[1] x + c[2] x^2 + c[3] x^3` on one segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CubicSegment {
    c: [DVec3; 4],
}

impl CubicSegment {
    /// The cubic on `[0, h]` with the given values and derivatives at both ends (Hermite).
    ///
    /// The end derivatives are taken relative to the mean slope, so that a straight line has
    /// exactly zero curvature.
    #[must_use]
    pub fn from_hermite(h: f64, ends: [DVec3; 2], slopes: [DVec3; 2]) -> Self {
        let chord = (ends[1] - ends[0]) / h;
        let (a, b) = (slopes[0] - chord, slopes[1] - chord);
        Self { c: [ends[0], slopes[0], -(a * 2.0 + b) / h, (a + b) / h / h] }
    }

    /// The value at `x`.
    #[must_use]
    #[inline]
    pub fn value(&self, x: f64) -> DVec3 {
        self.c[0] + (self.c[1] + (self.c[2] + self.c[3] * x) * x) * x
    }

    /// The first derivative at `x`.
    #[must_use]
    #[inline]
    pub fn slope(&self, x: f64) -> DVec3 {
        self.c[1] + (self.c[2] * 2.0 + self.c[3] * (3.0 * x)) * x
    }

    /// The second derivative at `x`.
    #[must_use]
    pub fn bend(&self, x: f64) -> DVec3 {
        self.c[2] * 2.0 + self.c[3] * (6.0 * x)
    }
}

/// A C2 cubic spline through points.
#[derive(Debug, Clone, PartialEq)]
pub struct CubicSpline {
    segments: Vec<CubicSegment>,
}

impl CubicSpline {
    /// The spline through `points`, with `steps[i] > 0` as the length of the parameter from point i
    /// to point i+1.
    ///
    /// The ends are not-a-knot: the first two segments are one cubic, and so are the last two.
    /// Three points give their parabola, two their line. (de Boor, "A Practical Guide to Splines",
    /// chapter IV.)
    ///
    /// # Panics
    /// There are fewer than two points, or their number is not one more than that of steps.
    #[must_use]
    pub fn not_a_knot(steps: &[f64], points: &[DVec3]) -> Self {
        assert!(
            points.len() >= 2 && steps.len() + 1 == points.len(),
            "a spline needs a step between any two points"
        );
        let chords: Vec<DVec3> =
            steps.iter().zip(points.windows(2)).map(|(h, p)| (p[1] - p[0]) / *h).collect();
        // Not-a-knot ends need three segments. With fewer, the curve has fewer parameters.
        let slopes = match chords.len() {
            1 => vec![chords[0]; 2],
            2 => parabola_slopes(steps, &chords),
            _ => spline_slopes(steps, &chords),
        };
        let segments = (0..steps.len())
            .map(|i| {
                CubicSegment::from_hermite(steps[i], [points[i], points[i + 1]], [slopes[i], slopes[i + 1]])
            })
            .collect();
        Self { segments }
    }

    /// The cubic of a segment.
    #[must_use]
    #[inline]
    pub fn segment(&self, segment: usize) -> &CubicSegment {
        &self.segments[segment]
    }
}

fn parabola_slopes(steps: &[f64], chords: &[DVec3]) -> Vec<DVec3> {
    let bend = (chords[1] - chords[0]) / (steps[0] + steps[1]);
    vec![chords[0] - bend * steps[0], chords[0] + bend * steps[0], chords[1] + bend * steps[1]]
}

/// One row of a tridiagonal system for the slopes.
struct TridiagonalRow {
    below: f64,
    diagonal: f64,
    above: f64,
    right: DVec3,
}

/// Slopes at the points. Rows 1..n-1 make the second derivative continuous; rows 0 and n make the
/// third derivative continuous at the second and the last but one point.
fn spline_slopes(h: &[f64], d: &[DVec3]) -> Vec<DVec3> {
    let n = h.len();
    // Equal third derivatives relate three slopes. The third is eliminated with the next row, so the matrix
    // stays tridiagonal.
    let end = |h0: f64, h1: f64, d0: DVec3, d1: DVec3| {
        (d0 * (h1 * (h0 + 2.0 * (h0 + h1))) + d1 * (h0 * h0)) / (h0 + h1)
    };
    let mut rows = Vec::with_capacity(n + 1);
    rows.push(TridiagonalRow {
        below: 0.0,
        diagonal: h[1],
        above: h[0] + h[1],
        right: end(h[0], h[1], d[0], d[1]),
    });
    rows.extend((1..n).map(|i| TridiagonalRow {
        below: h[i],
        diagonal: 2.0 * (h[i - 1] + h[i]),
        above: h[i - 1],
        right: (d[i - 1] * h[i] + d[i] * h[i - 1]) * 3.0,
    }));
    // The last row is the first row of the reversed curve.
    let (a, b) = (h[n - 1], h[n - 2]);
    rows.push(TridiagonalRow { below: a + b, diagonal: b, above: 0.0, right: end(a, b, d[n - 1], d[n - 2]) });
    solve_tridiagonal(rows)
}

/// Elimination without pivoting. Row 0 has a positive pivot. Every inner pivot keeps at least half
/// its diagonal, and the last one stays positive.
fn solve_tridiagonal(mut rows: Vec<TridiagonalRow>) -> Vec<DVec3> {
    for i in 1..rows.len() {
        let factor = rows[i].below / rows[i - 1].diagonal;
        rows[i].diagonal -= factor * rows[i - 1].above;
        let carried = rows[i - 1].right * factor;
        rows[i].right -= carried;
    }
    let mut x = vec![DVec3::ZERO; rows.len()];
    for i in (0..rows.len()).rev() {
        let above = x.get(i + 1).map_or(DVec3::ZERO, |next| *next * rows[i].above);
        x[i] = (rows[i].right - above) / rows[i].diagonal;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEPS: [f64; 6] = [0.5, 1.0, 3.0, 0.125, 2.0, 0.75];

    fn knots(n: usize) -> Vec<f64> {
        (0..=n).map(|i| STEPS[..i].iter().sum()).collect()
    }

    /// Not-a-knot splines reproduce every polynomial up to their degree.
    fn check_reproduces(segments: usize, f: impl Fn(f64) -> DVec3) {
        let s = knots(segments);
        let points: Vec<DVec3> = s.iter().map(|s| f(*s)).collect();
        let spline = CubicSpline::not_a_knot(&STEPS[..segments], &points);
        for (i, start) in s[..segments].iter().enumerate() {
            for x in [0.0, 0.3 * STEPS[i], STEPS[i]] {
                let error = (spline.segment(i).value(x) - f(start + x)).length();
                // Values up to 400 in doubles, after one elimination.
                assert!(error < 1e-12, "{segments} {i} {x}: {error}");
            }
        }
    }

    #[test]
    fn polynomials_are_reproduced() {
        let line = |s: f64| DVec3::new(1.0 - 2.0 * s, 3.0, s);
        let parabola = |s: f64| line(s) + DVec3::new(s * s, -0.5 * s * s, 0.0);
        let cubic = |s: f64| parabola(s) + DVec3::new(0.25, -1.0, 0.5) * (s * s * s);
        check_reproduces(1, line);
        check_reproduces(2, parabola);
        for segments in 3..=6 {
            check_reproduces(segments, cubic);
        }
    }

    #[test]
    fn joints_are_twice_differentiable_and_the_outer_ones_thrice() {
        let points: Vec<DVec3> =
            (0..7u8).map(|i| DVec3::new(f64::from(i * i % 5), f64::from(i % 3), 1.0)).collect();
        let spline = CubicSpline::not_a_knot(&STEPS, &points);
        for (i, h) in STEPS[..5].iter().copied().enumerate() {
            let (left, right) = (spline.segment(i), spline.segment(i + 1));
            assert!((left.value(h) - right.value(0.0)).length() < 1e-13);
            assert!((left.slope(h) - right.slope(0.0)).length() < 1e-12);
            assert!((left.bend(h) - right.bend(0.0)).length() < 1e-10, "{i}");
            let third = (left.c[3] - right.c[3]).length();
            assert_eq!(third < 1e-10, i == 0 || i == 4, "{i} {third}");
        }
    }
}
