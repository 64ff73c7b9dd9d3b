//! The profile of a stream: events per pixel, share of ON events, and the intervals between the
//! events of a pixel. Memory does not grow with the number of events.

use super::events::CountedEvent;
use super::light::PixelLight;
use super::mask::StampMask;
use gs2e_event::{Event, EventSink, Polarity};
use gs2e_image::Size;
use std::ops::RangeInclusive;
use std::rc::Rc;

/// Bins per doubling of an interval: a distance of distributions is known to the share of one bin.
const BINS_PER_OCTAVE: f64 = 32.0;
/// Bins from half a microsecond to about 13 days.
const BINS: usize = 41 * 32;
/// Length of an interval that files show as 0 us.
const SHORTEST_US: f64 = 0.5;

/// Intervals between consecutive events of a pixel, of all pixels together.
#[derive(Debug, Clone)]
pub struct IntervalProfile {
    /// Number of intervals by length, in bins of equal width on a logarithmic axis.
    bins: Vec<u64>,
    count: u64,
    sum: f64,
    sum_inverse: f64,
    sum_ln: f64,
}

impl Default for IntervalProfile {
    fn default() -> Self {
        Self { bins: vec![0; BINS], count: 0, sum: 0.0, sum_inverse: 0.0, sum_ln: 0.0 }
    }
}

impl IntervalProfile {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the logarithm of a length of at least the shortest"
    )]
    fn add(&mut self, us: i64) {
        let us = (us as f64).max(SHORTEST_US);
        let ln = libm::log(us);
        // Bins of equal width in the logarithm: intervals span microseconds to minutes.
        let bin = BINS_PER_OCTAVE * (ln - libm::log(SHORTEST_US)) / std::f64::consts::LN_2;
        self.bins[(bin as usize).min(BINS - 1)] += 1;
        self.count += 1;
        self.sum += us;
        // The likelihood of an inverse Gaussian needs three sums only, so no interval is kept.
        self.sum_inverse += 1.0 / us;
        self.sum_ln += ln;
    }

    /// Number of intervals.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Mean interval, us; `None` without intervals.
    #[must_use]
    pub fn mean_us(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / self.count as f64)
    }

    /// The distribution function at the upper end of each bin: length in us, share of intervals.
    pub fn distribution(&self) -> impl Iterator<Item = (f64, f64)> {
        let mut below = 0;
        self.bins.iter().enumerate().map(move |(bin, count)| {
            below += count;
            let us = SHORTEST_US * libm::exp2((bin + 1) as f64 / BINS_PER_OCTAVE);
            (us, below as f64 / self.count.max(1) as f64)
        })
    }

    /// Kolmogorov-Smirnov distance to another distribution; 1 if one of them has no intervals, 0 if
    /// both have none.
    #[must_use]
    pub fn distance(&self, other: &Self) -> f64 {
        // Two empty profiles are alike; an empty one is as far from any other as can be.
        if self.count == 0 || other.count == 0 {
            return if self.count == other.count { 0.0 } else { 1.0 };
        }
        let both = self.distribution().zip(other.distribution());
        both.map(|((_, a), (_, b))| (a - b).abs()).fold(0.0, f64::max)
    }

    /// The inverse-Gaussian law of largest likelihood (Tweedie, Annals of Mathematical Statistics
    /// 28, 1957); `None` without two different intervals.
    #[must_use]
    pub fn inverse_gaussian(&self) -> Option<InverseGaussian> {
        let n = self.count as f64;
        let mean = self.mean_us()?;
        let excess = self.sum_inverse / n - 1.0 / mean;
        // Equal intervals leave the difference at the rounding of its terms.
        (excess > 1e-12 / mean).then(|| InverseGaussian { mean, shape: 1.0 / excess })
    }

    /// Mean logarithm of the density of these intervals under a law; `None` without intervals.
    #[must_use]
    pub fn mean_ln_density(&self, law: InverseGaussian) -> Option<f64> {
        let n = self.count as f64;
        let InverseGaussian { mean, shape } = law;
        // The exponent is -shape (x - mean)^2 / (2 mean^2 x), and its mean follows from the sums.
        let square = self.mean_us()? / (mean * mean) - 2.0 / mean + self.sum_inverse / n;
        let front = 0.5 * libm::log(shape / (2.0 * std::f64::consts::PI)) - 1.5 * self.sum_ln / n;
        Some(front - 0.5 * shape * square)
    }
}

/// An inverse-Gaussian law, the first passage of a Brownian motion with drift.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InverseGaussian {
    /// Mean, us.
    pub mean: f64,
    /// Shape, us.
    pub shape: f64,
}

/// The profile of a stream in a window of time.
#[derive(Debug, Clone)]
pub struct StreamProfile {
    size: Size,
    /// First and last microsecond that counts.
    window_us: RangeInclusive<i64>,
    /// Added to the times of the stream.
    shift_us: i64,
    /// Times that do not count.
    mask: Rc<StampMask>,
    /// Events of each pixel, and ON events of each.
    counts: Vec<u32>,
    on_counts: Vec<u32>,
    /// Time of the last event of each pixel; `i64::MIN` before the first.
    last_us: Vec<i64>,
    on: u64,
    events: u64,
    /// Events outside the window or the picture.
    outside: u64,
    /// Events of the window that are masked.
    masked: u64,
    intervals: IntervalProfile,
}

/// The events of some pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PixelRates {
    /// Events per pixel; `None` without pixels.
    pub(super) per_pixel: Option<f64>,
    /// Share of ON events; `None` without events.
    pub(super) on_share: Option<f64>,
}

impl StreamProfile {
    /// A profile of the events with times in the window after `shift_us` is added.
    #[must_use]
    pub fn new(size: Size, window_us: RangeInclusive<i64>, shift_us: i64) -> Self {
        Self {
            size,
            window_us,
            shift_us,
            mask: Rc::default(),
            counts: vec![0; size.pixels()],
            on_counts: vec![0; size.pixels()],
            last_us: vec![i64::MIN; size.pixels()],
            on: 0,
            events: 0,
            outside: 0,
            masked: 0,
            intervals: IntervalProfile::default(),
        }
    }

    /// The profile without what a mask covers, before the first event.
    #[must_use]
    pub fn masked_by(self, mask: Rc<StampMask>) -> Self {
        Self { mask, ..self }
    }

    /// A profile without events of the same time and pixels, with another shift.
    #[must_use]
    pub(super) fn emptied(&self, shift_us: i64) -> Self {
        Self::new(self.size, self.window_us.clone(), shift_us).masked_by(Rc::clone(&self.mask))
    }

    /// Counts these events.
    pub fn take(&mut self, events: &[Event]) {
        for event in events {
            self.count(event);
        }
    }

    /// Counts an event, and returns it with its time in the window if it counts.
    pub(super) fn count(&mut self, event: &Event) -> Option<CountedEvent> {
        let us = event.t.floor_micros().saturating_add(self.shift_us);
        let (x, y) = (u32::from(event.x), u32::from(event.y));
        if !self.window_us.contains(&us) || x >= self.size.width || y >= self.size.height {
            self.outside += 1;
            return None;
        }
        if self.mask.contains(us) {
            self.masked += 1;
            return None;
        }
        let pixel = (y * self.size.width + x) as usize;
        self.counts[pixel] = self.counts[pixel].saturating_add(1);
        self.events += 1;
        let is_on = event.polarity == Polarity::On;
        self.on_counts[pixel] = self.on_counts[pixel].saturating_add(u32::from(is_on));
        self.on += u64::from(is_on);
        let before = std::mem::replace(&mut self.last_us[pixel], us);
        if before != i64::MIN {
            self.intervals.add(us - before);
        }
        Some(CountedEvent { us, pixel, is_on })
    }

    /// Length of the window without what is masked, seconds.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        self.mask.seconds_of(&self.window_us)
    }

    /// First and last microsecond of the window.
    #[must_use]
    pub(super) fn window_us(&self) -> &RangeInclusive<i64> {
        &self.window_us
    }

    /// Size of the picture.
    #[must_use]
    pub fn size(&self) -> Size {
        self.size
    }

    /// Number of events.
    #[must_use]
    pub fn events(&self) -> u64 {
        self.events
    }

    /// Number of events outside the window or the picture.
    #[must_use]
    pub fn outside(&self) -> u64 {
        self.outside
    }

    /// Number of events in the window that the mask leaves out.
    #[must_use]
    pub fn masked(&self) -> u64 {
        self.masked
    }

    /// The events of the pixels with this light.
    #[must_use]
    pub(super) fn rates_of(&self, lights: &[PixelLight], light: PixelLight) -> PixelRates {
        let these =
            lights.iter().zip(self.counts.iter().zip(&self.on_counts)).filter(|(of, _)| **of == light);
        let (mut pixels, mut events, mut on) = (0_u64, 0_u64, 0_u64);
        for (_, (count, on_count)) in these {
            pixels += 1;
            events += u64::from(*count);
            on += u64::from(*on_count);
        }
        PixelRates {
            per_pixel: (pixels > 0).then(|| events as f64 / pixels as f64),
            on_share: (events > 0).then(|| on as f64 / events as f64),
        }
    }

    /// Share of ON events; `None` without events.
    #[must_use]
    pub fn on_share(&self) -> Option<f64> {
        (self.events > 0).then(|| self.on as f64 / self.events as f64)
    }

    /// Events per pixel.
    #[must_use]
    pub fn per_pixel(&self) -> f64 {
        self.events as f64 / self.size.pixels() as f64
    }

    /// The intervals between events.
    #[must_use]
    pub fn intervals(&self) -> &IntervalProfile {
        &self.intervals
    }

    /// Pearson's correlation of the numbers of events of the pixels; `None` if they are alike in one of both.
    #[must_use]
    pub(super) fn count_correlation(&self, other: &Self) -> Option<f64> {
        let n = self.counts.len() as f64;
        let [a, b] = [self, other].map(Self::per_pixel);
        let mut sums = [0.0; 3];
        for (x, y) in self.counts.iter().zip(&other.counts) {
            let (x, y) = (f64::from(*x) - a, f64::from(*y) - b);
            [x * y, x * x, y * y].iter().zip(&mut sums).for_each(|(v, sum)| *sum += v / n);
        }
        (sums[1] > 0.0 && sums[2] > 0.0).then(|| sums[0] / (sums[1] * sums[2]).sqrt())
    }

    /// Kolmogorov-Smirnov distance of the numbers of events over the pixels.
    #[must_use]
    pub(crate) fn count_distance(&self, other: &Self) -> f64 {
        let [mut a, mut b] = [self.counts.clone(), other.counts.clone()];
        a.sort_unstable();
        b.sort_unstable();
        let share = |sorted: &[u32], n: u32| sorted.partition_point(|m| *m <= n) as f64 / sorted.len() as f64;
        let mut all: Vec<u32> = a.iter().chain(&b).copied().collect();
        all.sort_unstable();
        all.dedup();
        all.into_iter().map(|n| (share(&a, n) - share(&b, n)).abs()).fold(0.0, f64::max)
    }
}

impl EventSink for StreamProfile {
    /// Never fails.
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        self.take(events);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_event::EventLabel;
    use gs2e_num::seed::{DrawSpace, Seed, SeedCell};
    use gs2e_num::units::Timestamp;

    fn event(us: i64, x: u16, polarity: Polarity) -> Event {
        Event { t: Timestamp(1000 * us), x, y: 0, polarity, label: EventLabel::Signal }
    }

    #[test]
    fn events_are_counted_in_the_window_and_the_picture() {
        let mut profile = StreamProfile::new(Size { width: 2, height: 1 }, 100..=200, 50);
        let (on, off) = (Polarity::On, Polarity::Off);
        let events = [event(49, 0, on), event(50, 0, on), event(60, 1, off), event(150, 0, off)];
        profile.append(&events).unwrap();
        profile.append(&[event(151, 0, on), event(60, 2, on)]).unwrap();
        assert_eq!((profile.events(), profile.outside()), (3, 3));
        assert!((profile.on_share().unwrap() - 1.0 / 3.0).abs() < 1e-15);
        assert_eq!((profile.intervals().count(), profile.intervals().mean_us()), (1, Some(100.0)));
    }

    /// Passage times of a Brownian motion, by the method of Michael, Schucany and Haas (1976).
    fn passages(mean: f64, shape: f64) -> IntervalProfile {
        let mut draws = Seed(11).draws(SeedCell { x: 0, y: 0, level: 0, index: 0 }, DrawSpace::Choice);
        let mut profile = IntervalProfile::default();
        for _ in 0..40_000 {
            let y = draws.normal().powi(2);
            let root = (4.0 * mean * shape * y + (mean * y).powi(2)).sqrt();
            let x = mean + mean * mean * y / (2.0 * shape) - mean / (2.0 * shape) * root;
            let x = if draws.uniform() <= mean / (mean + x) { x } else { mean * mean / x };
            #[expect(clippy::cast_possible_truncation, reason = "some thousand microseconds")]
            profile.add(x.round() as i64);
        }
        profile
    }

    #[test]
    fn the_law_of_first_passages_is_found_again() {
        let found = passages(5000.0, 9000.0);
        let law = found.inverse_gaussian().unwrap();
        // Standard errors: sqrt(mean^3 / (shape n)) = 18.6 and shape sqrt(2 / n) = 64.
        assert!((law.mean - 5000.0).abs() < 5.0 * 18.6, "{law:?}");
        assert!((law.shape - 9000.0).abs() < 5.0 * 64.0, "{law:?}");
        // The fit has the largest likelihood.
        let own = found.mean_ln_density(law).unwrap();
        for (mean, shape) in [(1.05, 1.0), (0.95, 1.0), (1.0, 1.05), (1.0, 0.95)] {
            let other = InverseGaussian { mean: mean * law.mean, shape: shape * law.shape };
            assert!(found.mean_ln_density(other).unwrap() < own);
        }
        // A numerical sum of the density times its logarithm is the same mean.
        let density = |x: f64| {
            let e = -law.shape * (x - law.mean).powi(2) / (2.0 * law.mean * law.mean * x);
            (law.shape / (2.0 * std::f64::consts::PI * x.powi(3))).sqrt() * e.exp()
        };
        let cells = (1..200_000).map(|i| density(f64::from(i))).filter(|p| *p > 0.0);
        let entropy: f64 = cells.map(|p| p * p.ln()).sum();
        // The logarithm has a standard deviation of about 1 and 40,000 draws.
        assert!((entropy - own).abs() < 0.03, "{entropy} {own}");
    }

    #[test]
    fn distances_are_those_of_the_distributions() {
        let mut uniform = [IntervalProfile::default(), IntervalProfile::default()];
        // 1 to 1000 us and 1 to 2000 us: at 1000 us the shares are 1 and 1/2. One bin is 2.2 % wide.
        (1..=1000).for_each(|us| uniform[0].add(us));
        (1..=2000).for_each(|us| uniform[1].add(us));
        assert!((uniform[0].distance(&uniform[1]) - 0.5).abs() < 0.022);
        assert_eq!(uniform[0].distance(&uniform[0]).to_bits(), 0.0f64.to_bits());
        assert_eq!(uniform[0].distance(&IntervalProfile::default()).to_bits(), 1.0f64.to_bits());
        let mut equal = IntervalProfile::default();
        (0..5).for_each(|_| equal.add(300));
        assert_eq!(equal.inverse_gaussian(), None);
    }
}
