//! The drift of a pixel between two frames: one family of curves for each way to interpolate.
//!
//! A curve is four coefficients. What every pixel asks of it is written for eight pixels at a time; what only pixels
//! with events ask, for one.

use super::drift::Process;
use fearless_simd::{Simd, f64x8};

/// Curves of eight pixels.
pub(super) type Wide<S> = [f64x8<S>; 4];
/// The curve of one pixel.
pub(super) type One = [f64; 4];

/// Eight pixels at a frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Knot<S: Simd> {
    /// `L + k2`.
    pub(super) level: f64x8<S>,
    /// Its logarithm, `V`.
    pub(super) log: f64x8<S>,
    /// `dV/dt`, per ns, where the interpolation goes by it.
    pub(super) slope: f64x8<S>,
}

/// What a family of curves can do. Times are ns since the earlier frame.
pub(super) trait Curve {
    /// Between frames `1/inverse` ns apart.
    fn between<S: Simd>(process: &Process, knots: [Knot<S>; 2], inverse: f64) -> Wide<S>;

    /// `L + k2` at `t`.
    fn level<S: Simd>(process: &Process, knots: [Knot<S>; 2], inverse: f64, t: f64) -> f64x8<S>;

    /// `D(t) - D(0)`.
    fn rise<S: Simd>(process: &Process, curve: &Wide<S>, t: f64) -> f64x8<S>;

    /// A bound on `|D''|` over `[from, to]`.
    fn curvature<S: Simd>(curve: &Wide<S>, times: [f64; 2]) -> f64x8<S>;

    /// A bound on the distance of the curve from its chord over `[from, to]`.
    fn bulge_of_one(curve: &One, times: [f64; 2]) -> f64;

    /// [`Curve::rise`] of one pixel.
    fn rise_of_one(curve: &One, t: f64) -> f64;

    /// `D'(t)`.
    fn rate_of_one(curve: &One, t: f64) -> f64;

    /// The times in order within `(from, to)` at which the drift turns around.
    fn turns_of_one(curve: &One, span: [f64; 2]) -> [Option<f64>; 2];

    /// Whether the drift is proportional to the time.
    fn is_straight(curve: &One) -> bool;
}

/// The curve of one pixel, for tests: `L + k2`, its logarithm and the slope of that at two frames, `length` ns apart.
#[cfg(test)]
pub(super) fn of_one<C: Curve>(process: &Process, knots: [[f64; 3]; 2], length: f64) -> One {
    use fearless_simd::{Level, SimdBase as _, dispatch};
    dispatch!(Level::new(), simd => {
        let knots = knots.map(|[level, log, slope]| {
            let [level, log, slope] = [level, log, slope].map(|v| f64x8::splat(simd, v));
            Knot { level, log, slope }
        });
        C::between(process, knots, 1.0 / length).map(|c| c[5])
    })
}

/// What a family's arithmetic for eight pixels gives for one, for tests: the rise to `t` and the curvature over `[0, t]`.
#[cfg(test)]
pub(super) fn wide<C: Curve>(process: &Process, curve: &One, t: f64) -> [f64; 2] {
    use fearless_simd::{Level, SimdBase as _, dispatch};
    dispatch!(Level::new(), simd => {
        let curve = curve.map(|c| f64x8::splat(simd, c));
        [C::rise(process, &curve, t)[3], C::curvature(&curve, [0.0, t])[3]]
    })
}
