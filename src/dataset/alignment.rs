//! Correlation of events and frames over the time offset between them.
//!
//! Over a span of frames, the brightness of a pixel changes by `d` in the logarithm, and its ON events
//! exceed its OFF events by `s`. Whatever happens in between, `s` follows `d` to within one event, if
//! the span of the events is that of the frames. The correlation of `s` and `d` over pixels and spans
//! is measured at shifts of a quarter of a span. Its highest value shows whether the two belong
//! together; mirrored frames and reversed polarity are tried too.
//!
//! Its place is the offset of the clocks only roughly: a pixel's event comes at the end of a threshold
//! of change, so that `s` is late. [`super::response`] refines it.

use super::samples::{DatasetFrames, SampleDecode};
use super::{EventDataset, OpenEvents, for_each_event, measured_finding};
use crate::check::{Finding, Verdict};
use crate::event::{EventFileError, Polarity};

/// Number of shifts on each side of the middle.
const SIDE: i64 = 20;
/// Shifts are this part of a span apart.
const STEP: f64 = 0.25;
/// Correlation below which events and frames have little in common.
const MIN_CORRELATION: f64 = 0.2;
/// By how much the correlation of changed frames must exceed that of the frames as they are.
const MARGIN: f64 = 0.1;

/// Correlation over shifts.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct AlignmentCurve {
    /// Shift of the events against the frames in microseconds, and the correlation there; sorted.
    pub points: Vec<(f64, f64)>,
}

/// The result of the comparison.
#[derive(Debug, Clone, PartialEq)]
pub struct Alignment {
    /// The correlation over all shifts.
    pub curve: AlignmentCurve,
    /// Highest correlation, and its shift, us.
    pub best: (f64, f64),
    /// A change of the frames or events under which the correlation is higher.
    pub changed: Option<(&'static str, f64)>,
}

/// Changes of the data: name, mirrored in x, mirrored in y, sign of the events.
const CHANGES: [(&str, bool, bool, f64); 7] = [
    ("the frames are mirrored left to right", true, false, 1.0),
    ("the frames are mirrored top to bottom", false, true, 1.0),
    ("the frames are turned by 180 degrees", true, true, 1.0),
    ("polarity is reversed", false, false, -1.0),
    ("the frames are mirrored left to right and polarity is reversed", true, false, -1.0),
    ("the frames are mirrored top to bottom and polarity is reversed", false, true, -1.0),
    ("the frames are turned by 180 degrees and polarity is reversed", true, true, -1.0),
];

impl Alignment {
    /// Measures in one pass over the events.
    ///
    /// # Errors
    /// The events cannot be read.
    pub fn measure(events: OpenEvents<'_>, frames: &DatasetFrames) -> Result<Self, EventFileError> {
        let spans = frames.spans();
        let span_us = spans.first().map_or(1, |[from, to]| frames.stamps_us[*to] - frames.stamps_us[*from]);
        // A quarter of a span: the correlation falls to half at about half a span, so no peak lies
        // between two shifts.
        let step = (span_us as f64 * STEP).max(1.0);
        let shifts: Vec<f64> = (-SIDE..=SIDE).map(|k| k as f64 * step).collect();
        let counts = count_at_shifts(events, frames, &spans, &shifts)?;
        // Every change is tried at all shifts, because wrong data may have a wrong clock as well.
        let highest = |mirror: [bool; 2], sign: f64| {
            let values = counts.iter().map(|spans_at| sign * correlate(frames, &spans, spans_at, mirror));
            values
                .zip(&shifts)
                .max_by(|a, b| a.0.total_cmp(&b.0))
                .map_or((0.0, 0.0), |(v, shift)| (v, *shift))
        };
        let best = highest([false; 2], 1.0);
        let changed = CHANGES.iter().map(|(name, x, y, sign)| (*name, highest([*x, *y], *sign).0));
        let changed = changed.max_by(|a, b| a.1.total_cmp(&b.1));
        let changed = changed.filter(|(_, value)| *value >= MIN_CORRELATION && *value > best.0 + MARGIN);
        let points = shifts.iter().zip(&counts);
        let points = points.map(|(shift, at)| (*shift, correlate(frames, &spans, at, [false; 2]))).collect();
        Ok(Self { curve: AlignmentCurve { points }, best, changed })
    }

    /// The rough offset, if events and frames belong together.
    #[must_use]
    pub fn rough_offset(&self) -> Option<f64> {
        (self.best.0 >= MIN_CORRELATION && self.changed.is_none()).then_some(self.best.1)
    }

    /// The finding on the correlation.
    pub(super) fn finding(&self, dataset: &EventDataset<'_>) -> Finding {
        let highest = self.best.0;
        let follow = format!("events follow the change of the frames with a correlation of {highest:.2}");
        let (verdict, because) = match self.changed {
            Some((change, found)) => (Verdict::Fail, format!("{follow}, and of {found:.2} if {change}")),
            None if highest >= MIN_CORRELATION => (Verdict::Pass, follow),
            None => (Verdict::Warn, format!("{follow} at any time offset that was tried")),
        };
        let measured = (Some(highest), Some(MIN_CORRELATION), "1");
        measured_finding(dataset, ("event_frame", "correlation"), verdict, measured, because)
    }
}

/// The correlation of the counts with the change of the frames, which may be mirrored.
fn correlate(
    frames: &DatasetFrames,
    spans: &[[usize; 2]],
    counts: &[Vec<i32>],
    [in_x, in_y]: [bool; 2],
) -> f64 {
    let (width, height) = (frames.size.width as usize, frames.size.height as usize);
    let mirrored = |pixel: usize| {
        let (x, y) = (pixel % width, pixel / width);
        let (x, y) = (if in_x { width - 1 - x } else { x }, if in_y { height - 1 - y } else { y });
        frames.pixels.binary_search(&(y * width + x)).expect("mirror images are among the pixels")
    };
    let places: Vec<usize> = frames.pixels.iter().map(|pixel| mirrored(*pixel)).collect();
    let (mut n, mut d, mut s, mut dd, mut ss, mut ds) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for (span, counts) in spans.iter().zip(counts) {
        for (place, count) in places.iter().zip(counts) {
            let Some(change) = frames.change(*span, *place, SampleDecode::Encoded) else { continue };
            let count = f64::from(*count);
            n += 1.0;
            d += change;
            s += count;
            dd += change * change;
            ss += count * count;
            ds += change * count;
        }
    }
    let both = (dd - d * d / n) * (ss - s * s / n);
    // Where one of the two does not vary, nothing follows the other. NaN is not above 0.
    if both > 0.0 { (ds - d * s / n) / both.sqrt() } else { 0.0 }
}

/// ON minus OFF events of each pixel over each span, by shift, span and place.
fn count_at_shifts(
    events: OpenEvents<'_>,
    frames: &DatasetFrames,
    spans: &[[usize; 2]],
    shifts_us: &[f64],
) -> Result<Vec<Vec<Vec<i32>>>, EventFileError> {
    // The instants at which the counts are noted: (time, shift, span, end).
    let mut instants: Vec<(f64, usize, usize, usize)> = Vec::new();
    for (shift, by) in shifts_us.iter().enumerate() {
        for (number, span) in spans.iter().enumerate() {
            for (end, frame) in span.iter().enumerate() {
                instants.push((frames.stamps_us[*frame] as f64 + by, shift, number, end));
            }
        }
    }
    instants.sort_by(|a, b| a.0.total_cmp(&b.0));
    let none = vec![0; frames.pixels.len()];
    let mut counts = vec![vec![none.clone(); spans.len()]; shifts_us.len()];
    let (mut now, mut next, places) = (none, 0, frames.places());
    let mut note = |next: &mut usize, until: f64, now: &[i32]| {
        while let Some((_, shift, span, end)) = instants.get(*next).filter(|instant| instant.0 < until) {
            // The count at the end of a span minus that at its begin.
            let sign = if *end == 0 { -1 } else { 1 };
            for (count, now) in counts[*shift][*span].iter_mut().zip(now) {
                *count += sign * now;
            }
            *next += 1;
        }
    };
    let width = frames.size.width as usize;
    for_each_event(events, |event, t_us| {
        note(&mut next, t_us as f64, &now);
        let (x, y) = (usize::from(event.x), usize::from(event.y));
        let place = if x < width { places.get(y * width + x).copied().flatten() } else { None };
        if let Some(place) = place {
            now[place] += if event.polarity == Polarity::On { 1 } else { -1 };
        }
    })?;
    note(&mut next, f64::INFINITY, &now);
    Ok(counts)
}
