//! Frames that a sensor can use: of one size, in order of time, and finite.

use super::SensorError;
use crate::frames::Frame;
use crate::image::Size;

/// Stamps end here, so that the number of a cell of the clock fits the counter of the draws: 2.3 years.
const LAST_STAMP: i64 = 1 << 56;

/// Whether a frame can come after the one stamped `before`; how many of its values are below zero.
pub(super) fn admit(before: Option<i64>, frame: &Frame, size: Size) -> Result<u64, SensorError> {
    let refuse = |because| SensorError::Frame { frame: frame.index, because };
    follows(before, frame, size).map_err(refuse)?;
    let luminance = frame.luminance.pixels();
    if let Some(bad) = luminance.iter().position(|l| !l.is_finite()) {
        let width = size.width as usize;
        let (x, y, found) = (bad % width, bad / width, luminance[bad]);
        return Err(refuse(format!("the luminance of pixel ({x}, {y}) is {found}, not a finite number")));
    }
    Ok(luminance.iter().filter(|l| **l < 0.0).count() as u64)
}

fn follows(before: Option<i64>, frame: &Frame, size: Size) -> Result<(), String> {
    let (found, t) = (frame.luminance.size(), frame.t.0);
    if found != size {
        return Err(format!("it is {found}, the sequence is {size}"));
    }
    match before {
        None if t != 0 => Err(format!("the first stamp is {t} ns, not 0")),
        Some(before) if t <= before => Err(format!("its stamp {t} ns does not follow {before} ns")),
        _ if t >= LAST_STAMP => Err(format!("its stamp {t} ns is beyond {LAST_STAMP} ns")),
        _ => Ok(()),
    }
}
