//! Checks of frames: one size, ascending stamps, finite values.

use super::SensorError;
use crate::frames::DenseFrame;
use gs2e_image::Size;

/// Latest stamp, 2.3 years. Beyond it, the number of a clock cell would overflow the counter of the
/// draws.
const LAST_STAMP: i64 = 1 << 56;

/// Checks that a frame may follow the one stamped `before`, and counts its values below zero.
pub(super) fn admit_frame(before: Option<i64>, frame: &DenseFrame, size: Size) -> Result<u64, SensorError> {
    check_order(before, frame, size)?;
    // Comparisons with NaN are false, so the count of negative values would pass over it.
    match frame.luminance.pixels().iter().any(|l| !l.is_finite()) {
        true => Err(not_finite(frame)),
        false => Ok(frame.luminance.pixels().iter().filter(|l| **l < 0.0).count() as u64),
    }
}

/// Checks that the size and stamp of a frame allow it to follow the one stamped `before`.
pub(super) fn check_order(before: Option<i64>, frame: &DenseFrame, size: Size) -> Result<(), SensorError> {
    let refuse = |because| Err(SensorError::Frame { frame: frame.index, because });
    let (found, t) = (frame.luminance.size(), frame.t.0);
    if found != size {
        return refuse(format!("it is {found}, the sequence is {size}"));
    }
    match before {
        None if t != 0 => refuse(format!("the first stamp is {t} ns, not 0")),
        Some(before) if t <= before => refuse(format!("its stamp {t} ns is not after {before} ns")),
        _ if t >= LAST_STAMP => refuse(format!("its stamp {t} ns is beyond {LAST_STAMP} ns")),
        _ => Ok(()),
    }
}

/// Names the first pixel with a luminance that is not finite.
pub(super) fn not_finite(frame: &DenseFrame) -> SensorError {
    let (luminance, width) = (frame.luminance.pixels(), frame.luminance.size().width as usize);
    let bad = luminance.iter().position(|l| !l.is_finite()).unwrap_or_default();
    let (x, y, found) = (bad % width, bad / width, luminance[bad]);
    let because = format!("the luminance of pixel ({x}, {y}) is {found}, not a finite number");
    SensorError::Frame { frame: frame.index, because }
}
