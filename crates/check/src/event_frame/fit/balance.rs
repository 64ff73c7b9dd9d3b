//! The drift of all pixels from anchor to anchor, and their events.

use super::floor::FloorCounts;
use super::{AnchorFit, FitSums, in_thresholds};
use crate::alignment::places::{PlaceSums, PlaceWatch};
use crate::completeness::intervals::{AnchoredPixel, ChangeInterval, IntervalWatch, TileSums};
use crate::drift::DriftLaw;
use crate::tally::PixelEvents;
use gs2e_image::Size;
use gs2e_sensor::frames::anchors::AnchorFrames;

/// Largest error of a pixel's drift by the rounding of its frames, in thresholds. A pixel beyond it
/// is left out: its frames do not determine its events.
const MAX_ROUNDING: f64 = 0.5;

/// Follows the drift of all pixels from anchor to anchor.
#[derive(Debug)]
pub(crate) struct DriftBalance<'a> {
    law: DriftLaw,
    anchors: &'a AnchorFrames,
    /// Rates of hot pixels, which are left out; empty if they are unknown.
    hot_hz: &'a [f64],
    first: Vec<f64>,
    /// Error of `first` by the rounding of the first frame.
    first_rounding: Vec<f64>,
    exposure: Vec<f64>,
    /// Variance of each pixel's voltage by noise, with the noisier end of each interval for the
    /// whole interval.
    variance: Vec<f64>,
    /// Deviation of each pixel's voltage by noise after 1 us at the brightness of the latest anchor.
    noise: Vec<f64>,
    /// Expected numbers of events of each pixel's noise floor, and its rates at the latest anchor, per us;
    /// empty without one.
    floor: Vec<FloorCounts>,
    floor_rates: Vec<[f64; 2]>,
    found: FrameComparison,
    /// True for each pixel that must have fired by an anchor until now.
    must_fire: Vec<bool>,
    intervals: IntervalWatch,
    places: PlaceWatch,
}

/// The comparison of a stream with frames.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FrameComparison {
    /// One per anchor after the first; empty without frames.
    pub fits: Vec<AnchorFit>,
    /// `dv - s` of each pixel at the last anchor, in thresholds, or in the largest one that the spread of
    /// thresholds explains; NaN if it is unknown.
    pub residuals: Vec<f32>,
    /// Number of the pixels that the frames changed so much that they must fire, and of those among them
    /// without any event until the last anchor.
    pub must_fire: [u64; 2],
    /// One per pair of neighbouring anchors.
    pub intervals: Vec<ChangeInterval>,
    /// Parts of the sensor, over all intervals.
    pub tiles: Vec<TileSums>,
    /// Correlation of events and changes at other places.
    pub places: PlaceSums,
}

impl FrameComparison {
    /// Largest share of pixels that are left out at an anchor.
    #[must_use]
    pub fn left_out(&self) -> f64 {
        let most = self.fits.iter().map(|fit| fit.unknown).max().unwrap_or(0);
        most as f64 / self.residuals.len().max(1) as f64
    }
}

/// The brightness of all pixels at an anchor, and its neighbours in time.
struct AnchorView<'a> {
    first: &'a [f32],
    before: &'a [f32],
    now: &'a [f32],
    /// Time since the anchor before, us.
    step: f64,
    /// Time since the first anchor, us.
    total: f64,
    leak_error: f64,
    /// Duration to and luminance at the ends of the span whose middle this anchor is.
    span_ends: Option<[(i64, &'a [f32]); 2]>,
}

impl<'a> DriftBalance<'a> {
    /// Starts at the first anchor; `None` if there are fewer than two.
    pub(crate) fn new(
        size: Size,
        law: DriftLaw,
        anchors: &'a AnchorFrames,
        hot_hz: &'a [f64],
    ) -> Option<Self> {
        assert!(anchors.images.iter().all(|image| image.size() == size), "anchors are of the sensor's size");
        let first = anchors.images.first().filter(|_| anchors.images.len() > 1)?;
        let none = || vec![0.0; size.pixels()];
        let of_first = |value: &dyn Fn(f32) -> f64| first.pixels().iter().map(|l| value(*l)).collect();
        let with_floor = if law.has_floor() { first.pixels() } else { &[] };
        Some(Self {
            law,
            anchors,
            hot_hz,
            first: of_first(&|l| law.brightness(l)),
            first_rounding: of_first(&|l| law.rounding_error(l)),
            exposure: none(),
            variance: none(),
            noise: of_first(&|l| law.noise(f64::from(l), 1.0)),
            floor: vec![FloorCounts::default(); with_floor.len()],
            floor_rates: with_floor.iter().map(|l| law.floor_rates(f64::from(*l))).collect(),
            found: FrameComparison { residuals: vec![0.0; size.pixels()], ..FrameComparison::default() },
            must_fire: vec![false; size.pixels()],
            intervals: IntervalWatch::new(size, law, anchors),
            places: PlaceWatch::new(size, law.thresholds),
        })
    }

    /// States the typical speed of the image, px/s.
    pub(crate) fn moves_at(&mut self, px_s: f64) {
        self.intervals.moves_at(px_s);
    }

    /// Stamp of the next anchor; `None` after the last.
    pub(crate) fn next_us(&self) -> Option<i64> {
        self.anchors.stamps_us.get(self.found.fits.len() + 1).copied()
    }

    /// The comparison after the last anchor.
    pub(crate) fn finish(self) -> FrameComparison {
        let (intervals, tiles) = self.intervals.finish();
        FrameComparison { intervals, tiles, places: self.places.finish(), ..self.found }
    }

    /// Evaluates the next anchor.
    pub(crate) fn settle(&mut self, pixels: &[PixelEvents]) {
        // There is one fit per anchor after the first, so the fits count the anchors.
        let number = self.found.fits.len() + 1;
        let view = self.view(number);
        // The noise of the noisiest luminance bounds that of every pixel.
        let slack = 6.0 * self.law.most_noise(view.total) + 2.0 * view.leak_error;
        let t_us = self.anchors.stamps_us[number];
        let mut stock = FitSums::new(&self.law, slack + 5.0 * self.law.between_error(), t_us);
        let is_last = number + 1 == self.anchors.images.len();
        let placed = is_last || view.span_ends.is_some();
        for (i, pixel) in pixels.iter().enumerate() {
            let [on, off] = pixel.counts;
            let change = self.change(&view, i, [on, off]);
            let fitted = stock.add(change, [on, off]);
            let left = fitted.map(|pixel| pixel.left);
            self.must_fire[i] |= fitted.is_some_and(|pixel| pixel.must_fire);
            if let (Some([from, to]), Some(_)) = (view.span_ends, left) {
                let left = stock.mean_left(change, [on, off]);
                let ways = self.ways([(from.0, from.1[i]), (0, view.now[i]), (to.0, to.1[i])]);
                let span = (to.0 - from.0) as f64;
                stock.fit.lag.add(left, ways, span, stock.unequal.even);
            }
            let known = left.is_some().then_some(change.dv);
            let (error, floor) = (change.error, change.floor_since);
            self.intervals.see(i, AnchoredPixel { drift: known, counts: [on, off], error, floor });
            if placed {
                self.places.see(i, known, change.s);
            }
            let scaled = |left| in_thresholds(left, self.law.thresholds, change.unequal);
            self.found.residuals[i] = left.map_or(f32::NAN, scaled);
        }
        self.intervals.settle(number);
        if placed {
            self.places.settle();
        }
        if is_last {
            let mut counted = [0; 2];
            for i in (0..self.must_fire.len()).filter(|i| self.must_fire[*i]) {
                counted[0] += 1;
                counted[1] += u64::from(pixels[i].counts == [0, 0]);
            }
            self.found.must_fire = counted;
        }
        self.found.fits.push(stock.fit());
    }

    fn view(&self, number: usize) -> AnchorView<'a> {
        let AnchorFrames { stamps_us: stamps, images, spans } = self.anchors;
        let of = |i: usize| images[i].pixels();
        let [step, total] = [number - 1, 0].map(|from| (stamps[number] - stamps[from]) as f64);
        let span = spans.iter().find(|[_, middle, _]| *middle == number);
        AnchorView {
            first: of(0),
            before: of(number - 1),
            now: of(number),
            step,
            total,
            leak_error: self.law.leak_error(step, number),
            // A lag needs the drift on both sides of an instant, which only the middle of a span
            // has.
            span_ends: span
                .map(|[from, _, to]| [*from, *to].map(|i| (stamps[i] - stamps[number], images[i].pixels()))),
        }
    }

    /// The change of a pixel since the first anchor.
    fn change(&mut self, view: &AnchorView<'_>, i: usize, counts: [u32; 2]) -> PixelChange {
        let (law, [before, now]) = (&self.law, [view.before[i], view.now[i]]);
        // The trapezoid rule is sufficient: anchors are close together.
        self.exposure[i] += view.step * 0.5 * (f64::from(before.max(0.0)) + f64::from(now.max(0.0)));
        let noise = law.noise(f64::from(now), 1.0);
        let larger = noise.max(std::mem::replace(&mut self.noise[i], noise));
        self.variance[i] += larger * larger * view.step;
        let mut floor_since = [0.0; 2];
        if let Some(floor) = self.floor.get_mut(i) {
            let to = law.floor_rates(f64::from(now));
            let from = std::mem::replace(&mut self.floor_rates[i], to);
            floor_since = [0, 1].map(|side| 0.5 * view.step * (from[side] + to[side]));
            floor.counts.iter_mut().zip(floor_since).for_each(|(all, since)| *all += since);
        }
        // Two logarithms a pixel: those of the first frame are computed once.
        let brightness = law.brightness(now);
        let rounding = self.first_rounding[i] + law.rounding_error_at(now, brightness);
        let unequal = law.spread_error(counts);
        // A uniform error has a standard deviation of its half-width over the root of 3.
        let others = (rounding * rounding / 3.0)
            + law.between_error() * law.between_error()
            + law.receptor_variance(f64::from(now));
        let [a, b] = law.thresholds;
        // `max` would turn an unknown luminance into black.
        let is_hot = self.hot_hz.get(i).is_some_and(|hz| *hz > 0.0);
        let known = !(is_hot || view.first[i].is_nan() || before.is_nan() || now.is_nan());
        let dv = law.drift(brightness - self.first[i], view.total, self.exposure[i]);
        PixelChange {
            dv: if known && rounding <= MAX_ROUNDING * law.least_threshold() { dv } else { f64::NAN },
            s: a * f64::from(counts[0]) - b * f64::from(counts[1]),
            blur: (self.variance[i] + others).sqrt() + view.leak_error,
            rounding,
            error: rounding + unequal,
            unequal,
            floor: self.floor.get(i).copied().unwrap_or_default(),
            floor_since,
            disturbed: law.disturbances(f64::from(now), view.total),
        }
    }

    /// The drift from the first to the second of three luminances, and from there to the third. The
    /// leak by luminance is too small for the use of this rate.
    fn ways(&self, [from, now, to]: [(i64, f32); 3]) -> [f64; 2] {
        let drift = |a: (i64, f32), b: (i64, f32)| {
            let change = self.law.brightness(b.1) - self.law.brightness(a.1);
            // An unknown luminance has no way; `brightness` would take it for black.
            if a.1.is_nan() || b.1.is_nan() {
                f64::NAN
            } else {
                self.law.drift(change, (b.0 - a.0) as f64, 0.0)
            }
        };
        [drift(from, now), drift(now, to)]
    }
}

/// A pixel at an anchor.
#[derive(Debug, Clone, Copy)]
pub(super) struct PixelChange {
    /// Drift since the first anchor; NaN if it is unknown.
    pub(super) dv: f64,
    /// The drift according to the events.
    pub(super) s: f64,
    /// Standard deviation of `dv`.
    pub(super) blur: f64,
    /// Largest error of `dv` by rounded frames.
    pub(super) rounding: f64,
    /// Largest error of `dv - s` by rounded frames and by thresholds that differ.
    pub(super) error: f64,
    /// The part of that by thresholds that differ.
    pub(super) unequal: f64,
    /// Events of the noise floor that are expected since the first anchor.
    pub(super) floor: FloorCounts,
    /// Those events since the previous anchor.
    pub(super) floor_since: [f64; 2],
    /// Expected number of events that move the reference for no reason in the frames, without the
    /// noise floor, which moves none.
    pub(super) disturbed: f64,
}
