//! The error law `e^2 = (C h^p)^2 + J h`, fitted to errors at several steps. `p` is the order of a
//! method, `J` the effect of jumps.
//!
//! A jump of the image, such as two Gaussians that swap, is missed in the one interval that
//! contains it. The share of intervals with a jump is proportional to `h`, and so is the mean
//! square error. Halving the step does not halve this error, and no step removes it.

use serde::{Deserialize, Serialize};

/// Range of orders. Nothing here converges faster than a cubic, and below the first order there is
/// no convergence.
const ORDERS: [f64; 2] = [1.0, 4.0];
/// Number of orders that are tried before the best is refined.
const TRIED: u32 = 61;
/// Number of refinements between the neighbours of the best order, which is then known to 1e-9.
const NARROWINGS: u32 = 50;

/// Constants of the law. For errors that are all 0, it is the law without error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ErrorLaw {
    /// Error of a step of one unit without jumps; at least 0.
    pub c: f64,
    /// Order, 1 to 4.
    pub p: f64,
    /// Squared error of a step of one unit from jumps; at least 0.
    pub jumps: f64,
}

impl ErrorLaw {
    /// The law through points `(step, error)` with the least sum of squared relative deviations of
    /// the squared error. `None` for fewer than three points, which do not determine the constants;
    /// if a step is not above 0; or if some errors are 0 and others not.
    #[must_use]
    pub fn fit_points(points: &[(f64, f64)]) -> Option<Self> {
        let steps = points.iter().all(|(h, _)| *h > 0.0 && h.is_finite());
        if points.len() < 3 || !steps {
            return None;
        }
        if points.iter().all(|(_, e)| *e == 0.0) {
            return Some(Self { c: 0.0, p: ORDERS[0], jumps: 0.0 });
        }
        if !points.iter().all(|(_, e)| *e > 0.0 && e.is_finite()) {
            return None;
        }
        // In units of the largest step: powers of small steps would leave the range of what can be
        // solved.
        let unit = points.iter().map(|(h, _)| *h).fold(0.0, f64::max);
        let scaled: Vec<(f64, f64)> = points.iter().map(|(h, e)| (h / unit, e * e)).collect();
        let [low, high] = ORDERS;
        let spacing = (high - low) / f64::from(TRIED - 1);
        // Many orders first: ternary search needs a single minimum between its ends.
        let tried = (0..TRIED).map(|k| low + f64::from(k) * spacing);
        let least =
            |a: f64, b: f64| if order_residual(&scaled, b) < order_residual(&scaled, a) { b } else { a };
        let best = tried.reduce(least).unwrap_or(low);
        let p = narrow_order(&scaled, [(best - spacing).max(low), (best + spacing).min(high)]);
        let [square, jumps] = at_order(&scaled, p);
        // Back in the caller's unit of steps.
        Some(Self { c: square.sqrt() / libm::pow(unit, p), p, jumps: jumps / unit })
    }

    /// The error at a step.
    #[must_use]
    pub fn error(&self, step: f64) -> f64 {
        let smooth = self.c * libm::pow(step, self.p);
        (smooth * smooth + self.jumps * step).sqrt()
    }

    /// The share of the squared error at a step that comes from jumps; 0 without error.
    pub(crate) fn share_of_jumps(&self, step: f64) -> f64 {
        let error = self.error(step);
        if error > 0.0 { self.jumps * step / (error * error) } else { 0.0 }
    }

    /// The local order at a step: the power of the step to which the error is proportional there.
    #[must_use]
    pub fn order(&self, step: f64) -> f64 {
        let jumps = self.share_of_jumps(step);
        // The squared error of jumps is proportional to the step, so the error has order 1/2.
        jumps * 0.5 + (1.0 - jumps) * self.p
    }

    /// The largest step within bounds with at most this error; `None` if the smallest step has
    /// more.
    #[must_use]
    pub fn step(&self, error: f64, [least, most]: [f64; 2]) -> Option<f64> {
        if self.error(least) > error {
            return None;
        }
        if self.error(most) <= error {
            return Some(most);
        }
        let (mut low, mut high) = (least, most);
        for _ in 0..60 {
            // The middle by ratio, because the error is about a power of the step.
            let middle = (low * high).sqrt();
            if self.error(middle) <= error { low = middle } else { high = middle }
        }
        Some(low)
    }
}

/// The order of least residual between two orders, by ternary search.
fn narrow_order(points: &[(f64, f64)], [mut low, mut high]: [f64; 2]) -> f64 {
    for _ in 0..NARROWINGS {
        let third = (high - low) / 3.0;
        let [a, b] = [low + third, high - third];
        if order_residual(points, a) <= order_residual(points, b) { high = b } else { low = a }
    }
    f64::midpoint(low, high)
}

/// Points `(step, squared error)`.
fn order_residual(points: &[(f64, f64)], p: f64) -> f64 {
    let [square, jumps] = at_order(points, p);
    let law = |h: f64| square * libm::pow(h, 2.0 * p) + jumps * h;
    points.iter().map(|(h, e)| law(*h) / e - 1.0).map(|r| r * r).sum()
}

/// `C^2` and `J` of the least relative residual at an order, neither below 0.
fn at_order(points: &[(f64, f64)], p: f64) -> [f64; 2] {
    // Least squares of a x + b y = 1 with x = h^2p / e^2, y = h / e^2.
    let mut sums = [0.0; 5];
    for (h, e) in points {
        let (x, y) = (libm::pow(*h, 2.0 * p) / e, h / e);
        for (sum, term) in sums.iter_mut().zip([x * x, x * y, y * y, x, y]) {
            *sum += term;
        }
    }
    let [xx, xy, yy, x, y] = sums;
    let determinant = xx * yy - xy * xy;
    let (square, jumps) = ((x * yy - y * xy) / determinant, (y * xx - x * xy) / determinant);
    // Collinear terms make the determinant 0 and the constants NaN, which fails both comparisons.
    match (square >= 0.0, jumps >= 0.0) {
        (true, true) => [square, jumps],
        // If one is negative, or both cannot be distinguished, one constant alone.
        (true, false) => [x / xx, 0.0],
        _ => [0.0, y / yy],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn planted(c: f64, p: f64, jumps: f64, steps: &[f64]) -> Vec<(f64, f64)> {
        steps.iter().map(|h| (*h, libm::hypot(c * libm::pow(*h, p), (jumps * h).sqrt()))).collect()
    }

    #[test]
    fn planted_laws_are_found() {
        let steps = [9.0, 3.0, 1.0, 1.0 / 3.0, 1.0 / 9.0];
        for (c, p, jumps) in [(0.02, 2.0, 1e-4), (0.001, 3.3, 0.0), (0.4, 1.0, 1e-3), (1e-4, 4.0, 1e-6)] {
            let points = planted(c, p, jumps, &steps);
            let found = ErrorLaw::fit_points(&points).unwrap();
            for (h, e) in points {
                // The order is known to 1e-9, and to the root of the rounding of the squares.
                assert!((found.error(h) / e - 1.0).abs() < 1e-6, "{found:?} {c} {p} {jumps}");
            }
            assert!((found.p - p).abs() < 1e-3, "{found:?}, planted {p}");
            assert!((found.jumps - jumps).abs() < 1e-3 * jumps + 1e-12, "{found:?}, planted {jumps}");
        }
    }

    #[test]
    fn constants_stay_in_their_range() {
        // Faster than the fourth order: jumps must not become negative to compensate for it.
        let fast = ErrorLaw::fit_points(&planted(1.0, 6.0, 0.0, &[1.0, 0.5, 0.25])).unwrap();
        assert!(fast.jumps >= 0.0 && fast.p <= 4.0 && fast.c >= 0.0, "{fast:?}");
        // Errors that do not shrink with the step have no order: they are attributed to jumps.
        let flat = ErrorLaw::fit_points(&[(1.0, 1.0), (0.5, 1.0), (0.25, 1.0)]).unwrap();
        assert!(flat.c.abs() < 1e-12 && flat.jumps > 0.5, "{flat:?}");
        let none = ErrorLaw::fit_points(&[(1.0, 0.0), (0.5, 0.0), (0.25, 0.0)]).unwrap();
        assert_eq!((none.error(7.0), none.share_of_jumps(7.0)), (0.0, 0.0));
    }

    #[test]
    fn too_little_is_no_law() {
        assert_eq!(ErrorLaw::fit_points(&[(1.0, 1.0), (0.5, 0.5)]), None);
        assert_eq!(ErrorLaw::fit_points(&[(1.0, 1.0), (0.5, 0.5), (0.25, 0.0)]), None);
        assert_eq!(ErrorLaw::fit_points(&[(1.0, 1.0), (0.5, 0.5), (0.0, 0.2)]), None);
    }

    /// Twenty intervals of a path contain a jump of 1, and the middle misses half of it.
    #[test]
    fn jumps_are_of_order_one_half() {
        let rms = |intervals: f64| (0.25 * 20.0 / intervals).sqrt();
        let law = ErrorLaw::fit_points(&[1000.0, 2000.0, 4000.0].map(|n| (1.0 / n, rms(n)))).unwrap();
        assert!((law.jumps - 5.0).abs() < 1e-9 && law.c.abs() < 1e-6, "{law:?}");
        assert!((law.order(1e-3) - 0.5).abs() < 1e-6 && (law.share_of_jumps(1e-3) - 1.0).abs() < 1e-6);
        let smooth = ErrorLaw { c: 1.0, p: 3.0, jumps: 0.0 };
        assert!((smooth.order(0.1) - 3.0).abs() < 1e-12);
    }

    #[test]
    fn the_step_for_an_error_is_the_largest() {
        let law = ErrorLaw { c: 0.02, p: 2.0, jumps: 1e-4 };
        let step = law.step(0.03, [0.1, 9.0]).unwrap();
        assert!((law.error(step) - 0.03).abs() < 1e-12 && law.error(step * 1.0001) > 0.03);
        assert_eq!(law.step(1e-4, [0.1, 9.0]), None);
        assert_eq!(law.step(100.0, [0.1, 9.0]), Some(9.0));
    }
}
