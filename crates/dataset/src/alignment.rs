//! Correlation of events and frames over the time offset between them.
//!
//! Over a span of frames, the brightness of a pixel changes by `d` in the logarithm, and its ON events
//! exceed its OFF events by `s`. Whatever happens in between, `s` follows `d` to within one event, if
//! the span of the events is that of the frames. The correlation of `s` and `d` over pixels and spans
//! is measured at shifts of a quarter of a span. Its highest value shows whether the two belong
//! together; the frames in all eight orientations, and reversed polarity, are tried too.
//!
//! Its place is the offset of the clocks only roughly: a pixel's event comes at the end of a threshold
//! of change, so that `s` is late. `clock` refines it.

use super::samples::{DatasetFrames, SampleDecode};
use super::{OpenEvents, for_each_event};
use gs2e_check::{Judgement, Verdict};
use gs2e_event::{EventFileError, Polarity};
use gs2e_image::Size;

/// Number of shifts on each side of the middle.
const SIDE: i64 = 20;
/// Shifts are this part of a span apart.
const STEP: f64 = 0.25;
/// Correlation below which events and frames have little in common.
const MIN_CORRELATION: f64 = 0.2;
/// By how much the correlation of changed frames must exceed that of the frames as they are.
const MARGIN: f64 = 0.1;

/// Change of the logarithm that makes an event in every usual sensor.
const STRONG: f64 = 0.5;
/// Number of strong changes from which on events have to follow the frames.
const MIN_STRONG: usize = 500;

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
    /// Number of samples of the frames with a strong change.
    strong: usize,
}

/// A change of the frames: mirrored in x, then in y, then with x and y swapped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Orientation {
    in_x: bool,
    in_y: bool,
    swapped: bool,
}

/// The frames as they are.
const UNCHANGED: Orientation = Orientation { in_x: false, in_y: false, swapped: false };

/// All orientations: the name, and the name with reversed polarity.
const ORIENTATIONS: [(Orientation, &str, &str); 8] = [
    (UNCHANGED, "nothing is changed", "polarity is reversed"),
    (
        Orientation { in_x: true, ..UNCHANGED },
        "the frames are mirrored left to right",
        "the frames are mirrored left to right and polarity is reversed",
    ),
    (
        Orientation { in_y: true, ..UNCHANGED },
        "the frames are mirrored top to bottom",
        "the frames are mirrored top to bottom and polarity is reversed",
    ),
    (
        Orientation { in_x: true, in_y: true, swapped: false },
        "the frames are turned by 180 degrees",
        "the frames are turned by 180 degrees and polarity is reversed",
    ),
    (
        Orientation { swapped: true, ..UNCHANGED },
        "x and y are swapped",
        "x and y are swapped and polarity is reversed",
    ),
    (
        Orientation { in_x: true, in_y: false, swapped: true },
        "the frames are turned by 90 degrees to the left",
        "the frames are turned by 90 degrees to the left and polarity is reversed",
    ),
    (
        Orientation { in_x: false, in_y: true, swapped: true },
        "the frames are turned by 90 degrees to the right",
        "the frames are turned by 90 degrees to the right and polarity is reversed",
    ),
    (
        Orientation { in_x: true, in_y: true, swapped: true },
        "x and y are swapped and the frames are turned by 180 degrees",
        "x and y are swapped, the frames are turned by 180 degrees, and polarity is reversed",
    ),
];

impl Orientation {
    /// The pixel of a sensor that sees a pixel of frames in this orientation; `None` if it has none.
    fn sensor_pixel(self, pixel: usize, frames: Size, sensor: Size) -> Option<usize> {
        let (width, height) = (frames.width as usize, frames.height as usize);
        let (x, y) = (pixel % width, pixel / width);
        let (x, y) = (if self.in_x { width - 1 - x } else { x }, if self.in_y { height - 1 - y } else { y });
        let (x, y) = if self.swapped { (y, x) } else { (x, y) };
        let (columns, rows) = (sensor.width as usize, sensor.height as usize);
        (x < columns && y < rows).then_some(y * columns + x)
    }
}

/// The pixels of a sensor that some orientation needs.
struct SensorCells {
    sensor: Size,
    /// Number of the cell of each pixel of the sensor.
    of_pixel: Vec<Option<usize>>,
    count: usize,
}

impl SensorCells {
    fn new(frames: &DatasetFrames, sensor: Size) -> Self {
        let mut cells = Self { sensor, of_pixel: vec![None; sensor.pixels()], count: 0 };
        for (orientation, ..) in ORIENTATIONS {
            for pixel in &frames.pixels {
                if let Some(at) = orientation.sensor_pixel(*pixel, frames.size, sensor) {
                    cells.of_pixel[at].get_or_insert_with(|| {
                        cells.count += 1;
                        cells.count - 1
                    });
                }
            }
        }
        cells
    }

    /// The cell of each place of the frames.
    fn of_places(&self, frames: &DatasetFrames, orientation: Orientation) -> Vec<Option<usize>> {
        let cell =
            |pixel: &usize| self.of_pixel[orientation.sensor_pixel(*pixel, frames.size, self.sensor)?];
        frames.pixels.iter().map(cell).collect()
    }
}

impl Alignment {
    /// Measures in one pass over the events of a sensor of this size.
    ///
    /// # Errors
    /// The events cannot be read.
    pub fn measure(
        events: OpenEvents<'_>,
        frames: &DatasetFrames,
        sensor: Size,
    ) -> Result<Self, EventFileError> {
        let spans = frames.spans();
        let span_us = spans.first().map_or(1, |[from, to]| frames.stamps_us[*to] - frames.stamps_us[*from]);
        // A quarter of a span: the correlation falls to half at about half a span, so no peak lies
        // between two shifts.
        let step = (span_us as f64 * STEP).max(1.0);
        let shifts: Vec<f64> = (-SIDE..=SIDE).map(|k| k as f64 * step).collect();
        let cells = SensorCells::new(frames, sensor);
        let counts = count_at_shifts(events, frames, &cells, &shifts)?;
        // Every change is tried at all shifts, because wrong data may have a wrong clock as well.
        let highest = |values: &[f64], sign: f64| {
            let signed = values.iter().map(|value| sign * value).zip(&shifts);
            signed.max_by(|a, b| a.0.total_cmp(&b.0)).map_or((0.0, 0.0), |(v, shift)| (v, *shift))
        };
        let changes: Vec<Vec<Option<f64>>> = spans
            .iter()
            .map(|span| {
                let places = 0..frames.pixels.len();
                places.map(|place| frames.change(*span, place, SampleDecode::Encoded)).collect()
            })
            .collect();
        let curve_of = |orientation: Orientation| -> Vec<f64> {
            let of_places = cells.of_places(frames, orientation);
            counts.iter().map(|spans_at| correlate(&changes, spans_at, &of_places)).collect()
        };
        // Frames of another shape than the sensor can only fit with x and y swapped.
        let as_is = if sensor == frames.size { curve_of(UNCHANGED) } else { vec![0.0; shifts.len()] };
        let best = highest(&as_is, 1.0);
        let mut changed: Option<(&'static str, f64)> = None;
        for (orientation, name, reversed) in ORIENTATIONS {
            if sensor != frames.size && !orientation.swapped {
                continue;
            }
            let curve = curve_of(orientation);
            for (name, is_reversed) in [(name, false), (reversed, true)] {
                let found = highest(&curve, if is_reversed { -1.0 } else { 1.0 }).0;
                let is_change = is_reversed || orientation != UNCHANGED;
                if is_change && changed.is_none_or(|(_, value)| found > value) {
                    changed = Some((name, found));
                }
            }
        }
        let changed = changed.filter(|(_, value)| *value >= MIN_CORRELATION && *value > best.0 + MARGIN);
        let points = shifts.iter().copied().zip(as_is).collect();
        let strong = frames.count_changes(STRONG);
        Ok(Self { curve: AlignmentCurve { points }, best, changed, strong })
    }

    /// The rough offset, if events and frames belong together.
    #[must_use]
    pub(crate) fn rough_offset(&self) -> Option<f64> {
        (self.best.0 >= MIN_CORRELATION && self.changed.is_none()).then_some(self.best.1)
    }

    /// The verdict on the correlation.
    pub(super) fn judge(&self) -> Judgement {
        let highest = self.best.0;
        let follow = format!("events follow the change of the frames with a correlation of {highest:.2}");
        let (verdict, because) = match self.changed {
            Some((change, found)) => (Verdict::Fail, format!("{follow}, and of {found:.2} if {change}")),
            None if highest >= MIN_CORRELATION => (Verdict::Pass, follow),
            // Where little changes, noise may outnumber the events of the change.
            None => (
                if self.strong >= MIN_STRONG { Verdict::Fail } else { Verdict::Warn },
                format!("{follow} at best, at any time offset and in any orientation"),
            ),
        };
        Judgement::new(verdict, highest, MIN_CORRELATION, "1", because)
    }
}

/// The correlation of the counts with the changes, by span and place. The places have these cells.
fn correlate(changes: &[Vec<Option<f64>>], counts: &[Vec<i32>], cells: &[Option<usize>]) -> f64 {
    let (mut n, mut d, mut s, mut dd, mut ss, mut ds) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for (changes, counts) in changes.iter().zip(counts) {
        for (cell, change) in cells.iter().zip(changes) {
            let (Some(cell), Some(change)) = (cell, change) else { continue };
            let count = f64::from(counts[*cell]);
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

/// ON minus OFF events of each cell over each span, by shift, span and cell.
fn count_at_shifts(
    events: OpenEvents<'_>,
    frames: &DatasetFrames,
    cells: &SensorCells,
    shifts_us: &[f64],
) -> Result<Vec<Vec<Vec<i32>>>, EventFileError> {
    let spans = frames.spans();
    // The instants at which the counts are noted: (time, shift, span, end).
    let mut instants: Vec<(f64, usize, usize, usize)> = Vec::new();
    for (shift, by) in shifts_us.iter().enumerate() {
        for (number, span) in spans.iter().enumerate() {
            for (end, frame) in span.iter().enumerate() {
                instants.push((frames.stamps_us[*frame] as f64 + by, shift, number, end));
            }
        }
    }
    // In order of time, one pass over the events serves every shift and span.
    instants.sort_by(|a, b| a.0.total_cmp(&b.0));
    let none = vec![0; cells.count];
    let mut counts = vec![vec![none.clone(); spans.len()]; shifts_us.len()];
    let (mut now, mut next) = (none, 0);
    let mut note = |next: &mut usize, until: f64, now: &[i32]| {
        // Strictly before: an event at the time of a frame belongs to the span that ends there, as in
        // `response`.
        while let Some((_, shift, span, end)) = instants.get(*next).filter(|instant| instant.0 < until) {
            // The count at the end of a span minus that at its begin.
            let sign = if *end == 0 { -1 } else { 1 };
            for (count, now) in counts[*shift][*span].iter_mut().zip(now) {
                *count += sign * now;
            }
            *next += 1;
        }
    };
    let width = cells.sensor.width as usize;
    for_each_event(events, |event, t_us| {
        note(&mut next, t_us as f64, &now);
        let (x, y) = (usize::from(event.x), usize::from(event.y));
        let cell = if x < width { cells.of_pixel.get(y * width + x).copied().flatten() } else { None };
        if let Some(cell) = cell {
            now[cell] += if event.polarity == Polarity::On { 1 } else { -1 };
        }
    })?;
    note(&mut next, f64::INFINITY, &now);
    Ok(counts)
}
