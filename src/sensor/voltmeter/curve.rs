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

/// Eight pixels at two frames.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ends<S: Simd> {
    /// `L + k2`.
    pub(super) levels: [f64x8<S>; 2],
    /// What its logarithm `V` changes by.
    pub(super) step: f64x8<S>,
    /// `dV/dt`, per ns, where the interpolation goes by it.
    pub(super) slopes: [f64x8<S>; 2],
    /// One over the time between the frames, per ns.
    pub(super) inverse: f64,
}

/// What a family of curves can do. Times are ns since the earlier frame.
pub(super) trait Curve {
    /// Between two frames.
    fn between<S: Simd>(process: &Process, ends: &Ends<S>) -> Wide<S>;

    /// `L + k2` at `t`.
    fn level<S: Simd>(process: &Process, ends: &Ends<S>, t: f64) -> f64x8<S>;

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

    /// Whether every curve of the process is straight.
    fn are_straight(process: &Process) -> bool;
}

/// The curve of one pixel, for tests: `L + k2` and the slope of its logarithm at two frames, `length` ns apart.
#[cfg(test)]
pub(super) fn of_one<C: Curve>(process: &Process, knots: [[f64; 2]; 2], length: f64) -> One {
    use fearless_simd::{Level, SimdBase as _, dispatch};
    dispatch!(Level::new(), simd => {
        let levels = knots.map(|[level, _]| f64x8::splat(simd, level));
        let slopes = knots.map(|[_, slope]| f64x8::splat(simd, slope));
        let step = crate::elementary::ln_ratio(levels);
        C::between(process, &Ends { levels, step, slopes, inverse: 1.0 / length }).map(|c| c[5])
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
