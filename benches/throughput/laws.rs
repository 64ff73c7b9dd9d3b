//! Growth of run time with the size of the work: an exponent and a fixed part.
//!
//! Two laws are fitted to the same points, because one alone misleads. `t = c x^p` gives the power
//! with which the total grows; `t = a + b x` gives the share `a` that is paid once. A linear
//! program with a fixed cost has `p < 1`.

use serde::Serialize;

/// Both laws, fitted to points `(size, time)`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct GrowthLaws {
    /// `p` of `c x^p`, by least squares of logarithms.
    pub(crate) exponent: f64,
    /// Standard error of the exponent, from the deviations of the points.
    pub(crate) standard_error: f64,
    /// `a` of `a + b x`, in the unit of time, by least squares of relative errors. Negative if time
    /// grows faster than proportionally.
    pub(crate) fixed: f64,
    /// `b`, per unit of size.
    pub(crate) marginal: f64,
    /// Largest deviation of a point from `a + b x`, as a share of its time.
    pub(crate) worst: f64,
}

impl GrowthLaws {
    /// Fits at least three points of different sizes, all finite and above 0; `None` for others.
    pub(crate) fn fit_points(points: &[(f64, f64)]) -> Option<Self> {
        let sound = points.iter().all(|(x, t)| [x, t].iter().all(|v| **v > 0.0 && v.is_finite()));
        if points.len() < 3 || !sound {
            return None;
        }
        let logarithms: Vec<(f64, f64)> =
            points.iter().map(|(x, t)| (libm::log(*x), libm::log(*t))).collect();
        let (exponent, standard_error) = fit_slope(&logarithms)?;
        let [fixed, marginal] = fit_line(points);
        let off = |(x, t): &(f64, f64)| ((fixed + marginal * x) / t - 1.0).abs();
        Some(Self {
            exponent,
            standard_error,
            fixed,
            marginal,
            worst: points.iter().map(off).fold(0.0, f64::max),
        })
    }

    /// The fixed share of the time at a size, according to `a + b x`.
    pub(crate) fn fixed_share(&self, size: f64) -> f64 {
        self.fixed / (self.fixed + self.marginal * size)
    }
}

/// Slope of the line through points, and its standard error; `None` if all points have one
/// abscissa.
pub(crate) fn fit_slope(points: &[(f64, f64)]) -> Option<(f64, f64)> {
    let count = points.len() as f64;
    let [x, y] = points.iter().fold([0.0; 2], |[x, y], point| [x + point.0 / count, y + point.1 / count]);
    let sum =
        |of: &dyn Fn(f64, f64) -> f64| points.iter().map(|point| of(point.0 - x, point.1 - y)).sum::<f64>();
    let (xx, xy) = (sum(&|dx, _| dx * dx), sum(&|dx, dy| dx * dy));
    let slope = xy / xx;
    // Mean and slope are fitted, which leaves `count - 2` degrees of freedom.
    let residual = sum(&|dx, dy| (dy - slope * dx) * (dy - slope * dx));
    (xx > 0.0).then(|| (slope, (residual / (count - 2.0) / xx).sqrt()))
}

/// `a` and `b` with the least sum of `((a + b x)/t - 1)^2`.
fn fit_line(points: &[(f64, f64)]) -> [f64; 2] {
    let mut sums = [0.0; 5];
    for (x, t) in points {
        // Division by the time makes the errors relative, so that large sizes do not outweigh small
        // ones.
        let (u, v) = (1.0 / t, x / t);
        for (sum, term) in sums.iter_mut().zip([u * u, u * v, v * v, u, v]) {
            *sum += term;
        }
    }
    let [uu, uv, vv, u, v] = sums;
    let determinant = uu * vv - uv * uv;
    [(u * vv - v * uv) / determinant, (v * uu - u * uv) / determinant]
}
