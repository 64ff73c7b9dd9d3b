//! Correlation of the events with the change of the frames, in place, at neighbouring pixels, and
//! with the sensor mirrored or turned.

use gs2e_image::Size;
use rayon::prelude::*;

/// Largest shift that is tried, px.
const REACH: i64 = 2;
/// Size of a change, in thresholds, at which it is cut: a few large ones must not decide.
const CUT: f64 = 4.0;

/// A way in which events may be misplaced.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Placement {
    /// Moved by columns and rows.
    Shifted([i64; 2]),
    /// Mirrored in x, mirrored in y, and transposed after that.
    Turned([bool; 3]),
}

impl Placement {
    /// All placements that are tried. The first is the right one.
    fn all() -> Vec<Self> {
        let shifts = -REACH..=REACH;
        let shifts = shifts.clone().flat_map(|dy| shifts.clone().map(move |dx| [dx, dy]));
        let moved = shifts.filter(|shift| *shift != [0, 0]).map(Self::Shifted);
        let turned = (1..8).map(|bits| Self::Turned([bits & 1 != 0, bits & 2 != 0, bits & 4 != 0]));
        std::iter::once(Self::Shifted([0, 0])).chain(moved).chain(turned).collect()
    }

    /// The column and row at which the events of a pixel are found.
    fn of(self, [x, y]: [i64; 2], [width, height]: [i64; 2]) -> [i64; 2] {
        match self {
            Self::Shifted([dx, dy]) => [x + dx, y + dy],
            Self::Turned([mirrored_x, mirrored_y, transposed]) => {
                let x = if mirrored_x { width - 1 - x } else { x };
                let y = if mirrored_y { height - 1 - y } else { y };
                if transposed { [y, x] } else { [x, y] }
            }
        }
    }
}

impl std::fmt::Display for Placement {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let words = match self {
            Self::Shifted([dx, dy]) => return write!(f, "moved by ({dx}, {dy}) px"),
            Self::Turned([false, false, _]) => "transposed",
            Self::Turned([true, false, false]) => "mirrored in x",
            Self::Turned([false, true, false]) => "mirrored in y",
            Self::Turned([true, true, false]) => "turned by 180 degrees",
            Self::Turned([_, _, true]) => "turned by 90 degrees, or mirrored along the other diagonal",
        };
        f.write_str(words)
    }
}

/// Sums over the pixels for one placement.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Moments {
    n: f64,
    events: f64,
    changes: f64,
    events_squared: f64,
    changes_squared: f64,
    products: f64,
}

impl Moments {
    fn add(&mut self, events: f64, change: f64) {
        self.n += 1.0;
        self.events += events;
        self.changes += change;
        self.events_squared += events * events;
        self.changes_squared += change * change;
        self.products += events * change;
    }

    /// The correlation; 0 if one of both does not vary.
    fn correlation(&self) -> f64 {
        // Sums of moments lose digits where the mean is large against the scatter. Both quantities
        // are cut to a few thresholds around 0, so it is not.
        let covariance = self.products - self.events * self.changes / self.n;
        let [events, changes] = [(self.events_squared, self.events), (self.changes_squared, self.changes)]
            .map(|(squares, sum)| squares - sum * sum / self.n);
        let scale = (events * changes).sqrt();
        // Rounding may leave a sum of squares below 0. The scale is then NaN, which is not above 0 either.
        if scale > 0.0 { covariance / scale } else { 0.0 }
    }
}

/// Correlations of all placements.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PlaceSums {
    /// Placement and correlation; the first is in place. Empty without a comparison.
    pub correlations: Vec<(Placement, f64)>,
    /// Pixels with a change of at least a threshold, over all compared instants.
    pub changed: u64,
}

impl PlaceSums {
    /// The correlation in place.
    #[must_use]
    pub fn in_place(&self) -> Option<f64> {
        self.correlations.first().map(|(_, r)| *r)
    }

    /// The correlation at a shift.
    #[must_use]
    pub fn shifted(&self, shift: [i64; 2]) -> Option<f64> {
        let wanted = Placement::Shifted(shift);
        self.correlations.iter().find(|(placement, _)| *placement == wanted).map(|(_, r)| *r)
    }
}

/// Collects the changes and events of the pixels at some instants.
#[derive(Debug)]
pub(crate) struct PlaceWatch {
    size: Size,
    threshold: f64,
    placements: Vec<Placement>,
    moments: Vec<Moments>,
    /// Change of each pixel in thresholds; NaN if it is unknown.
    changes: Vec<f32>,
    /// Change of each pixel by its events, in thresholds.
    by_events: Vec<f32>,
    found: PlaceSums,
}

impl PlaceWatch {
    pub(crate) fn new(size: Size, thresholds: [f64; 2]) -> Self {
        let placements = Placement::all();
        Self {
            size,
            threshold: 0.5 * (thresholds[0] + thresholds[1]),
            moments: vec![Moments::default(); placements.len()],
            placements,
            changes: vec![0.0; size.pixels()],
            by_events: vec![0.0; size.pixels()],
            found: PlaceSums::default(),
        }
    }

    /// Takes a pixel: its drift, if it is known, and its drift by its events.
    #[expect(clippy::cast_possible_truncation, reason = "cut to small numbers")]
    pub(crate) fn see(&mut self, pixel: usize, change: Option<f64>, by_events: f64) {
        let cut = |v: f64| (v / self.threshold).clamp(-CUT, CUT) as f32;
        self.found.changed += u64::from(change.is_some_and(|change| change.abs() >= self.threshold));
        self.changes[pixel] = change.map_or(f32::NAN, cut);
        self.by_events[pixel] = cut(by_events);
    }

    /// Correlates the pixels of this instant.
    #[expect(clippy::cast_sign_loss, clippy::cast_possible_truncation, reason = "a pixel of the sensor")]
    pub(crate) fn settle(&mut self) {
        let [width, height] = [self.size.width, self.size.height].map(i64::from);
        let (changes, by_events) = (&self.changes, &self.by_events);
        // Each placement passes over all pixels, and has its own sums: the number of threads does not change
        // them.
        self.placements.par_iter().zip(&mut self.moments).for_each(|(placement, moments)| {
            let pixels = (0..height).flat_map(|y| (0..width).map(move |x| [x, y]));
            for (at, change) in pixels.zip(changes) {
                let [x, y] = placement.of(at, [width, height]);
                // Pixels that the shift moves off the sensor are left out: counted as zeros, they
                // would favour small shifts.
                let inside = x >= 0 && y >= 0 && x < width && y < height;
                if !change.is_nan() && inside {
                    moments.add(f64::from(by_events[(y * width + x) as usize]), f64::from(*change));
                }
            }
        });
    }

    pub(crate) fn finish(self) -> PlaceSums {
        // Without a compared instant there is no correlation.
        if self.moments[0].n == 0.0 {
            return PlaceSums::default();
        }
        let correlations = self.moments.iter().map(Moments::correlation);
        PlaceSums { correlations: self.placements.into_iter().zip(correlations).collect(), ..self.found }
    }
}
