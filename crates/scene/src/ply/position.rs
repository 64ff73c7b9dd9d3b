//! Conversion of positions between the file's numbers and 32 bits relative to an origin.

use glam::DVec3;
use gs2e_num::stats::lower_median;

/// An origin for positions of 64 bits: the median of each axis, rounded to the nearest 32-bit
/// number, so that subtracting it is exact. Zero without positions.
pub(super) fn median_origin(mut axes: [Vec<f64>; 3]) -> DVec3 {
    DVec3::from_array(axes.each_mut().map(|axis| lower_median(axis).map_or(0.0, round_to_f32)))
}

#[expect(clippy::cast_possible_truncation, reason = "rounding to 32 bits is what is asked for")]
fn round_to_f32(x: f64) -> f64 {
    let rounded = f64::from(x as f32);
    // `+ 0.0` turns -0 into 0.
    if rounded.is_finite() { rounded + 0.0 } else { x }
}

/// The coordinate `x` relative to `origin`, in 32 bits. [`to_absolute`] and this function convert
/// it back and forth without change: bits below those of the sum are dropped at once. Infinite if
/// 32 bits are not sufficient.
#[expect(clippy::cast_possible_truncation, reason = "rounding to 32 bits is what is asked for")]
pub(super) fn to_local(x: f64, origin: f64) -> f32 {
    let local = |x: f64| (x - origin) as f32;
    if origin == 0.0 { x as f32 } else { local(to_absolute(local(x), origin)) }
}

/// The coordinate at `local` from `origin`. With a zero origin, the sign of a zero is kept.
pub(super) fn to_absolute(local: f32, origin: f64) -> f64 {
    if origin == 0.0 { f64::from(local) } else { origin + f64::from(local) }
}
