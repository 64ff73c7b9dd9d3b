//! Labels of events, signal or noise, where a recipe asks for them.
//!
//! An event is noise if the brightness of the pixel did not make it:
//! - an event of a hot pixel, or of shot noise, which have their own processes;
//! - an event for which brightness moved less than half the threshold, in the direction of the
//!   event, since the pixel's level was last set by the previous event or the first frame. Noise of
//!   the voltage, or leak, made up the rest.
//!
//! An event of a hot pixel's own process sets no level, so the next event counts from the one
//! before it. A threshold that is crossed in a dead time or beyond a cap sets the level, although
//! there is no event.
//!
//! For the voltmeter, brightness is `k1 ln(L + k2)`, interpolated between frames as in the recipe.
//! For `esim` and `v2e`, it is the input of the detector without leak; for `v2e` that is the output
//! of the filter. Thresholds are the pixel's own.

use gs2e_event::EventLabel;

/// `Signal` if brightness moved by at least half of `threshold` since the level was last set.
pub(super) fn label_of(gone: f64, threshold: f64) -> EventLabel {
    if gone < 0.5 * threshold { EventLabel::Noise } else { EventLabel::Signal }
}
