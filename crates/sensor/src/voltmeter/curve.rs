//! The drift of a pixel between two frames: one family of curves for each kind of interpolation.
//!
//! A curve is four coefficients. The operations needed for every pixel are written for eight pixels
//! at a time; those needed only for pixels with events, for one.

use super::drift::DriftProcess;
use fearless_simd::{Simd, f64x8};

/// Curves of eight pixels.
pub(super) type Wide<S> = [f64x8<S>; 4];
/// The curve of one pixel: four coefficients.
pub(super) type One = [f64; 4];

/// Brightness of eight pixels at two frames.
#[derive(Debug, Clone, Copy)]
pub(super) struct FrameEnds<S: Simd> {
    /// `L + k2` at both frames.
    pub(super) levels: [f64x8<S>; 2],
    /// Change of the logarithm `V = ln(L + k2)`.
    pub(super) step: f64x8<S>,
    /// `dV/dt` at both frames, per ns; only where the interpolation needs it.
    pub(super) slopes: [f64x8<S>; 2],
    /// Inverse of the time between the frames, per ns.
    pub(super) inverse: f64,
}

/// The operations of a family of curves. Times are ns since the earlier frame.
pub(super) trait DriftCurve {
    /// The curve between two frames.
    fn between<S: Simd>(process: &DriftProcess, ends: &FrameEnds<S>) -> Wide<S>;

    /// `L + k2` at `t`.
    fn level<S: Simd>(process: &DriftProcess, ends: &FrameEnds<S>, t: f64) -> f64x8<S>;

    /// The drift since the earlier frame, `D(t) - D(0)`.
    fn rise<S: Simd>(process: &DriftProcess, curve: &Wide<S>, t: f64) -> f64x8<S>;

    /// A bound on `|D''|` over `[from, to]`.
    fn curvature<S: Simd>(curve: &Wide<S>, times: [f64; 2]) -> f64x8<S>;

    /// A bound on the distance between the curve and its chord over `[from, to]`.
    fn bulge_of_one(curve: &One, times: [f64; 2]) -> f64;

    /// [`DriftCurve::rise`] for one pixel.
    fn rise_of_one(curve: &One, t: f64) -> f64;

    /// The slope `D'(t)`.
    fn rate_of_one(curve: &One, t: f64) -> f64;

    /// The times within `(from, to)` at which the drift turns around, in order.
    fn turns_of_one(curve: &One, span: [f64; 2]) -> [Option<f64>; 2];

    /// Returns true if the drift is proportional to time.
    fn is_straight(curve: &One) -> bool;

    /// Returns true if every curve of the process is straight.
    fn are_straight(process: &DriftProcess) -> bool;
}

/// The curve of one pixel, for tests: `L + k2` and the slope of its logarithm at two frames that
/// are `length` ns apart.
#[cfg(test)]
pub(super) fn of_one<C: DriftCurve>(process: &DriftProcess, knots: [[f64; 2]; 2], length: f64) -> One {
    use fearless_simd::{Level, SimdBase as _, dispatch};
    dispatch!(Level::new(), simd => {
        let levels = knots.map(|[level, _]| f64x8::splat(simd, level));
        let slopes = knots.map(|[_, slope]| f64x8::splat(simd, slope));
        let step = gs2e_num::elementary::ln_ratio(levels);
        C::between(process, &FrameEnds { levels, step, slopes, inverse: 1.0 / length }).map(|c| c[5])
    })
}

/// The eight-lane arithmetic of a family applied to one curve, for tests: the rise to `t` and the
/// curvature over `[0, t]`.
#[cfg(test)]
pub(super) fn wide_arithmetic<C: DriftCurve>(process: &DriftProcess, curve: &One, t: f64) -> [f64; 2] {
    use fearless_simd::{Level, SimdBase as _, dispatch};
    dispatch!(Level::new(), simd => {
        let curve = curve.map(|c| f64x8::splat(simd, c));
        [C::rise(process, &curve, t)[3], C::curvature(&curve, [0.0, t])[3]]
    })
}
