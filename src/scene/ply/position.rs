//! Positions between the file's numbers and 32 bits about an origin.

use glam::DVec3;

/// An origin for positions of 64 bits: the median of each axis, rounded to the nearest 32-bit number, so that it
/// has bits to spare and what is subtracted from it stays exact. Zero where there is no position.
pub(super) fn origin(mut axes: [Vec<f64>; 3]) -> DVec3 {
    DVec3::from_array(axes.each_mut().map(|axis| median(axis).map_or(0.0, round_to_f32)))
}

/// The lower median.
fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len().checked_sub(1)? / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[expect(clippy::cast_possible_truncation, reason = "rounding to 32 bits is what is asked for")]
fn round_to_f32(x: f64) -> f64 {
    let rounded = f64::from(x as f32);
    // `+ 0.0` turns -0 into 0.
    if rounded.is_finite() { rounded + 0.0 } else { x }
}

/// The coordinate `x` about `origin`, in 32 bits that [`absolute`] and this function carry there and back
/// unchanged: bits below those of the sum are dropped at once. Infinite where 32 bits are not enough.
#[expect(clippy::cast_possible_truncation, reason = "rounding to 32 bits is what is asked for")]
pub(super) fn local(x: f64, origin: f64) -> f32 {
    let local = |x: f64| (x - origin) as f32;
    if origin == 0.0 { x as f32 } else { local(absolute(local(x), origin)) }
}

/// The coordinate that stands `local` from `origin`. Without an origin the sign of a zero survives.
pub(super) fn absolute(local: f32, origin: f64) -> f64 {
    if origin == 0.0 { f64::from(local) } else { origin + f64::from(local) }
}
