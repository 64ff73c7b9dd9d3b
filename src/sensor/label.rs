//! What makes an event signal, and what noise, where a recipe asks for labels.
//!
//! Noise is an event that the pixel's brightness did not make:
//! - one of a hot pixel, or of shot noise: it has a source of its own;
//! - one of whose threshold brightness has gone less than half, in the event's direction, since the pixel's level was
//!   last set: by its event before, or at the first frame. The rest was noise of the voltage, or leak.
//!
//! What a hot pixel makes by itself sets no level, so the next event goes by the one before. A threshold that is passed in
//! a dead time, or beyond a cap, does, though there is no event.
//!
//! Of the voltmeter, brightness is `k1 ln(L + k2)`, between frames as the recipe says; of `esim` and `v2e`, what the
//! detector sees without its leak, which for `v2e` is what comes out of the filter. Thresholds are the pixel's own.

use crate::event::Label;

/// The label of an event on whose way of a whole `threshold` brightness has gone this much.
pub(super) fn of(gone: f64, threshold: f64) -> Label {
    if gone < 0.5 * threshold { Label::Noise } else { Label::Signal }
}
