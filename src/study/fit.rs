//! The law `e = C h^p + f` through errors at several steps (`numerics.md` 3.4): `p` is the order of a method, `f` what no
//! finer step removes.

use serde::Serialize;

/// Orders that are looked for: nothing here converges faster than a cubic, and slower than the first order is no
/// convergence.
const ORDERS: [f64; 2] = [1.0, 4.0];
/// Orders that are tried before the best is narrowed down.
const TRIED: u32 = 61;
/// Halvings of what is left between the neighbours of the best: the order is then known to 1e-9.
const NARROWINGS: u32 = 50;

/// Constants of the law.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Fit {
    /// Error a step of one unit makes, without the floor; at least 0.
    pub c: f64,
    /// Order, 1 to 4.
    pub p: f64,
    /// Error that is left at every step; at least 0.
    pub f: f64,
}

impl Fit {
    /// The law through points `(step, error)`, both above 0, so that the sum of squared errors relative to each point's is
    /// least. `None` of fewer than three, which leave a constant open.
    #[must_use]
    pub fn through(points: &[(f64, f64)]) -> Option<Self> {
        let sound = points.iter().all(|(h, e)| *h > 0.0 && *e > 0.0 && h.is_finite() && e.is_finite());
        if points.len() < 3 || !sound {
            return None;
        }
        // Steps in units of the largest: powers of small ones would leave the range of what can be solved.
        let unit = points.iter().map(|(h, _)| *h).fold(0.0, f64::max);
        let scaled: Vec<(f64, f64)> = points.iter().map(|(h, e)| (h / unit, *e)).collect();
        let [low, high] = ORDERS;
        let spacing = (high - low) / f64::from(TRIED - 1);
        let tried = (0..TRIED).map(|k| low + f64::from(k) * spacing);
        let least = |a: f64, b: f64| if residual(&scaled, b) < residual(&scaled, a) { b } else { a };
        let best = tried.reduce(least).unwrap_or(low);
        let p = narrowed(&scaled, [(best - spacing).max(low), (best + spacing).min(high)]);
        let [c, f] = at_order(&scaled, p);
        Some(Self { c: c / libm::pow(unit, p), p, f })
    }

    /// The error at a step.
    #[must_use]
    pub fn error(&self, step: f64) -> f64 {
        self.c * libm::pow(step, self.p) + self.f
    }
}

/// The order by which errors fall between the two finest steps of points `(step, error)`. Where it is 1/2, what is left
/// are jumps: each is missed in the one interval that holds it, and the share of intervals that hold one goes with `h`, so
/// that the root of the mean square goes with `h^(1/2)`. The floor of [`Fit`] is then that of the steps that were tried.
#[must_use]
pub fn last_order(points: &[(f64, f64)]) -> Option<f64> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let [(fine, low), (coarse, high), ..] = sorted[..] else { return None };
    let order = libm::log(high / low) / libm::log(coarse / fine);
    order.is_finite().then_some(order)
}

/// The order of least residual between two, by thirds.
fn narrowed(points: &[(f64, f64)], [mut low, mut high]: [f64; 2]) -> f64 {
    for _ in 0..NARROWINGS {
        let third = (high - low) / 3.0;
        let [a, b] = [low + third, high - third];
        if residual(points, a) <= residual(points, b) { high = b } else { low = a }
    }
    f64::midpoint(low, high)
}

fn residual(points: &[(f64, f64)], p: f64) -> f64 {
    let [c, f] = at_order(points, p);
    points.iter().map(|(h, e)| (c * libm::pow(*h, p) + f) / e - 1.0).map(|r| r * r).sum()
}

/// `C` and `f` of least relative residual at an order, neither below 0.
fn at_order(points: &[(f64, f64)], p: f64) -> [f64; 2] {
    // Least squares of a x + b y = 1 with x = h^p / e, y = 1 / e.
    let mut sums = [0.0; 5];
    for (h, e) in points {
        let (x, y) = (libm::pow(*h, p) / e, 1.0 / e);
        for (sum, term) in sums.iter_mut().zip([x * x, x * y, y * y, x, y]) {
            *sum += term;
        }
    }
    let [xx, xy, yy, x, y] = sums;
    let determinant = xx * yy - xy * xy;
    let (c, f) = ((x * yy - y * xy) / determinant, (y * xx - x * xy) / determinant);
    match (c >= 0.0, f >= 0.0) {
        (true, true) => [c, f],
        // Where both are not, or cannot be told apart, one constant alone.
        (true, false) => [x / xx, 0.0],
        _ => [0.0, y / yy],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn planted(c: f64, p: f64, f: f64, steps: &[f64]) -> Vec<(f64, f64)> {
        steps.iter().map(|h| (*h, c * libm::pow(*h, p) + f)).collect()
    }

    #[test]
    fn planted_laws_are_found() {
        for (c, p, f) in [(2.0, 2.0, 0.015), (700.0, 3.3, 0.0), (0.4, 1.0, 0.1), (5e6, 4.0, 1e-4)] {
            let points = planted(c, p, f, &[1.0 / 300.0, 1.0 / 600.0, 1.0 / 1200.0, 1.0 / 2400.0]);
            let found = Fit::through(&points).unwrap();
            for (h, e) in points {
                // The order is known to 1e-9, and to the root of what rounding leaves of the squares.
                assert!((found.error(h) / e - 1.0).abs() < 1e-6, "{found:?} {c} {p} {f}");
            }
            assert!((found.p - p).abs() < 1e-3, "{found:?}, planted {p}");
            assert!((found.f - f).abs() < 1e-3 * f + 1e-7, "{found:?}, planted {f}");
        }
    }

    #[test]
    fn constants_stay_in_their_range() {
        // Faster than the fourth order: the floor may not go below 0 to make up for it.
        let fast = Fit::through(&planted(1.0, 6.0, 0.0, &[1.0, 0.5, 0.25])).unwrap();
        assert!(fast.f >= 0.0 && fast.p <= 4.0 && fast.c >= 0.0, "{fast:?}");
        // Errors that grow as steps shrink have no order: they are floor alone.
        let flat = Fit::through(&[(1.0, 1.0), (0.5, 1.1), (0.25, 1.2)]).unwrap();
        assert!(flat.c.abs() < 1e-12 && (1.0..1.2).contains(&flat.f), "{flat:?}");
    }

    #[test]
    fn too_little_is_no_law() {
        assert_eq!(Fit::through(&[(1.0, 1.0), (0.5, 0.5)]), None);
        assert_eq!(Fit::through(&[(1.0, 1.0), (0.5, 0.5), (0.25, 0.0)]), None);
        assert_eq!(last_order(&[(1.0, 1.0)]), None);
    }

    /// Twenty intervals of a path hold a jump by 1, half of which its middle misses: halving the step halves the
    /// share of intervals with a jump.
    #[test]
    fn jumps_are_of_order_one_half() {
        let rms = |intervals: f64| (0.25 * 20.0 / intervals).sqrt();
        let points = [(1.0, rms(1000.0)), (0.5, rms(2000.0)), (0.25, rms(4000.0))];
        assert!((last_order(&points).unwrap() - 0.5).abs() < 1e-12);
        let smooth = last_order(&planted(3.0, 2.0, 0.0, &[1.0, 0.5, 0.25])).unwrap();
        assert!((smooth - 2.0).abs() < 1e-12);
    }
}
