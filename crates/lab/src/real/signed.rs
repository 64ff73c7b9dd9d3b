//! Signed windows: events of 20 ms are summed with their sign per pixel, blurred by a Gaussian of 1 px, and
//! correlated with those of the recording, at every delay of the recording.
//!
//! A blur that mirrors the border is its own transpose, so the product of two blurred pictures is the sum of
//! one over the other blurred twice. With this, one blur of a simulated window serves all delays: each
//! recorded event adds a number of its own, and a delay moves the ends of the sum.

use super::blur::PictureBlur;
use super::events::{CountedEvent, PackedEvents};
use gs2e_image::Size;
use std::ops::RangeInclusive;
use std::rc::Rc;

/// Length of a window, us.
const WINDOW_US: i64 = 20_000;
/// From one window to the next, us, in recordings of up to 5 s.
const EVERY_US: i64 = 50_000;
/// Windows of a longer recording, spread over it.
const MOST_WINDOWS: i64 = 100;
/// Largest delay that is tried, us, early or late.
const LARGEST_DELAY_US: i64 = 30_000;
/// Distance of the delays that are tried, us.
const STEP_US: i64 = 100;
/// Distance of the delays at which the recorded windows are blurred, us. The variance in between is a
/// straight line.
const VARIANCE_STEP_US: i64 = 2500;
/// Steps around the best of these delays that are tried with the variance there.
const REFINED: [usize; 4] = [10, 5, 2, 1];

/// The windows of a recording.
#[derive(Debug)]
pub(super) struct SignedWindows {
    events: Rc<PackedEvents>,
    blur: PictureBlur,
    pixels: usize,
    /// Begin of each window at delay 0.
    starts: Vec<i64>,
    largest_us: i64,
    /// Variance of the blurred picture of each window at every step of delays, times the pixels.
    variances: Vec<Vec<f64>>,
}

/// The best delay, and the correlation there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct WindowScore {
    pub(super) ncc: f64,
    /// Recorded events behind simulated ones; `None` if the best delay is the largest that was tried.
    pub(super) delay_us: Option<i64>,
}

impl SignedWindows {
    pub(super) fn new(events: Rc<PackedEvents>, size: Size, span_us: &RangeInclusive<i64>) -> Self {
        let (first, last) = (*span_us.start(), *span_us.end());
        // Windows at the largest delay have to lie in a short recording too.
        let largest_us = LARGEST_DELAY_US.min((last - first) / 4) / VARIANCE_STEP_US * VARIANCE_STEP_US;
        let room_us = last - first - WINDOW_US - 2 * largest_us;
        let every_us = EVERY_US.max(room_us / MOST_WINDOWS);
        let count = if room_us < 0 { 0 } else { room_us / every_us + 1 };
        let starts = (0..count).map(|k| first + largest_us + k * every_us).collect();
        let (blur, pixels) = (PictureBlur::new(size), size.pixels());
        let mut windows = Self { events, blur, pixels, starts, largest_us, variances: Vec::new() };
        windows.variances = windows.starts.iter().map(|start| windows.variances_of(*start)).collect();
        windows
    }

    fn variances_of(&self, start: i64) -> Vec<f64> {
        let steps = -self.largest_us / VARIANCE_STEP_US..=self.largest_us / VARIANCE_STEP_US;
        steps.map(|step| self.variance_at(start + step * VARIANCE_STEP_US)).collect()
    }

    /// Variance of the blurred picture of the recorded events from a time on, times the pixels.
    fn variance_at(&self, from: i64) -> f64 {
        let mut picture = vec![0.0; self.pixels];
        let mut sum = 0.0;
        for event in self.events.between(from, from + WINDOW_US) {
            picture[event.pixel] += f64::from(event.sign());
            sum += f64::from(event.sign());
        }
        let squares: f64 = self.blur.apply(&picture).iter().map(|v| v * v).sum();
        squares - sum * sum / self.pixels as f64
    }

    /// Variance of a recorded window at the delay of index `i`, nearly: a mask makes it jump.
    fn variance(&self, window: usize, i: usize) -> f64 {
        let variances = &self.variances[window];
        let place = i as f64 * STEP_US as f64 / VARIANCE_STEP_US as f64;
        let low = i * to_index(STEP_US) / to_index(VARIANCE_STEP_US);
        let high = (low + 1).min(variances.len() - 1);
        let share = place - low as f64;
        variances[low] * (1.0 - share) + variances[high] * share
    }

    /// Number of delays that are tried.
    fn delays(&self) -> usize {
        to_index(2 * self.largest_us / STEP_US) + 1
    }

    /// The products of a simulated picture with the recorded window at each delay, by the deviation of the
    /// simulated picture.
    fn products(&self, window: usize, picture: &[f64]) -> Vec<f64> {
        let twice = self.blur.apply(&self.blur.apply(picture));
        let n = self.pixels as f64;
        let sum: f64 = picture.iter().sum();
        let variance = picture.iter().zip(&twice).map(|(a, b)| a * b).sum::<f64>() - sum * sum / n;
        let from = self.starts[window] - self.largest_us;
        let to = self.starts[window] + WINDOW_US + self.largest_us;
        // Sums over the events before each step: of the picture at their pixels, and of their signs.
        let mut before = vec![[0.0; 2]; to_index((to - from) / STEP_US) + 1];
        for event in self.events.between(from, to) {
            let sign = f64::from(event.sign());
            let place = &mut before[to_index((event.us - from) / STEP_US) + 1];
            place[0] += sign * twice[event.pixel];
            place[1] += sign;
        }
        for i in 1..before.len() {
            let [a, b] = before[i - 1];
            before[i][0] += a;
            before[i][1] += b;
        }
        let length = to_index(WINDOW_US / STEP_US);
        let product = |i: usize| {
            let [cross, signs] = [0, 1].map(|of| before[i + length][of] - before[i][of]);
            if variance > 0.0 { (cross - sum * signs / n) / variance.sqrt() } else { 0.0 }
        };
        (0..self.delays()).map(product).collect()
    }

    /// Index of the delay at which the correlations sum up to most, and this sum.
    fn best(&self, products: &[(usize, Vec<f64>)]) -> (usize, f64) {
        let sum = |i: usize, variance: &dyn Fn(usize) -> f64| {
            let all = products.iter().map(|(window, products)| {
                let variance = variance(*window);
                if variance > 0.0 { products[i] / variance.sqrt() } else { 0.0 }
            });
            (i, all.sum::<f64>())
        };
        let near = (0..self.delays()).map(|i| sum(i, &|window| self.variance(window, i)));
        let middle = self.delays() / 2;
        let start = near.fold((middle, 0.0), |best, found| if found.1 > best.1 { found } else { best }).0;
        // The straight line between two blurred delays moves a flat maximum.
        let exact = |i: usize| sum(i, &|window| self.variance_at(self.starts[window] + self.delay_us(i)));
        let mut best = exact(start);
        for step in REFINED {
            loop {
                let next = [best.0.checked_sub(step), Some(best.0 + step)].into_iter().flatten();
                let next = next.filter(|i| *i < self.delays()).map(exact).max_by(|a, b| a.1.total_cmp(&b.1));
                match next {
                    Some(next) if next.1 > best.1 => best = next,
                    _ => break,
                }
            }
        }
        best
    }

    fn delay_us(&self, i: usize) -> i64 {
        i64::try_from(i).expect("there are few delays") * STEP_US - self.largest_us
    }
}

/// A simulated stream beside the windows of the recording.
#[derive(Debug)]
pub(super) struct WindowMatch {
    windows: Rc<SignedWindows>,
    /// The window that is open, or comes next.
    open: usize,
    picture: Vec<f64>,
    has_events: bool,
    /// The windows with events, and the products with the recording at each delay.
    products: Vec<(usize, Vec<f64>)>,
}

impl WindowMatch {
    pub(super) fn new(windows: Rc<SignedWindows>) -> Self {
        let picture = vec![0.0; windows.pixels];
        Self { windows, open: 0, picture, has_events: false, products: Vec::new() }
    }

    /// Takes an event, which is not before the last one.
    pub(super) fn take(&mut self, event: CountedEvent) {
        while self.windows.starts.get(self.open).is_some_and(|start| event.us >= start + WINDOW_US) {
            self.close();
        }
        if self.windows.starts.get(self.open).is_some_and(|start| event.us >= *start) {
            self.picture[event.pixel] += f64::from(event.sign());
            self.has_events = true;
        }
    }

    fn close(&mut self) {
        if self.has_events {
            self.products.push((self.open, self.windows.products(self.open, &self.picture)));
            self.picture.fill(0.0);
            self.has_events = false;
        }
        self.open += 1;
    }

    /// The best delay; `None` if the recording has no windows with events.
    pub(super) fn finish(mut self) -> Option<WindowScore> {
        self.close();
        // A window in which the recording is silent says nothing. One where only the sensor is silent counts.
        let is_seen = |variances: &&Vec<f64>| variances.iter().any(|variance| *variance > 0.0);
        let seen = self.windows.variances.iter().filter(is_seen).count();
        let (best, score) = self.windows.best(&self.products);
        let is_inside = best > 0 && best + 1 < self.windows.delays() && score > 0.0;
        let delay_us = self.windows.delay_us(best);
        (seen > 0).then(|| WindowScore { ncc: score / seen as f64, delay_us: is_inside.then_some(delay_us) })
    }
}

fn to_index(steps: i64) -> usize {
    usize::try_from(steps).expect("times within a window")
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_num::seed::{DrawSpace, Seed, SeedCell};

    const SIZE: Size = Size { width: 12, height: 9 };
    const SPAN_US: i64 = 400_000;

    /// An edge that moves by a pixel in 10 ms, with jitter and noise.
    fn events(seed: u64) -> Vec<CountedEvent> {
        let mut draws = Seed(seed).draws(SeedCell { x: 0, y: 0, level: 0, index: 0 }, DrawSpace::Choice);
        let mut uniform = |end: i64| {
            #[expect(clippy::cast_possible_truncation, reason = "below the end")]
            let draw = (draws.uniform() * end as f64) as i64;
            draw
        };
        let mut all: Vec<CountedEvent> = (0..1500)
            .map(|k| {
                let us = uniform(SPAN_US);
                let noise = k % 5 == 0;
                let x = if noise { uniform(12) } else { (us + uniform(8000)) / 10_000 % 12 };
                let is_on = if noise { uniform(2) == 0 } else { us / 120_000 % 2 == 0 };
                CountedEvent { us, pixel: to_index(12 * uniform(9) + x), is_on }
            })
            .collect();
        all.sort_by_key(|event| event.us);
        all
    }

    fn matched(recorded: &[CountedEvent], made: &[CountedEvent]) -> WindowScore {
        let mut packed = PackedEvents::default();
        recorded.iter().for_each(|event| packed.push(*event));
        let windows = Rc::new(SignedWindows::new(Rc::new(packed), SIZE, &(0..=SPAN_US)));
        let mut found = WindowMatch::new(windows);
        made.iter().for_each(|event| found.take(*event));
        found.finish().unwrap()
    }

    #[test]
    fn a_planted_delay_is_found() {
        let made = events(7);
        for delay_us in [-12_300, -200, 0, 100, 6700, 25_000] {
            let shifted = made.iter().map(|event| CountedEvent { us: event.us + delay_us, ..*event });
            let recorded: Vec<CountedEvent> = shifted.collect();
            let found = matched(&recorded, &made);
            assert_eq!(found.delay_us, Some(delay_us));
            assert!((found.ncc - 1.0).abs() < 1e-9, "{delay_us}: {found:?}");
        }
        // Another draw of the same edge has the same time, but for what jitter leaves open.
        let found = matched(&events(8), &made);
        assert!(found.delay_us.unwrap().abs() < 4000 && (0.8..0.97).contains(&found.ncc), "{found:?}");
    }

    /// The correlation of the blurred pictures by its definition, at no delay.
    #[test]
    fn correlations_are_those_of_blurred_pictures() {
        let (recorded, made) = (events(3), events(4));
        let mut packed = PackedEvents::default();
        recorded.iter().for_each(|event| packed.push(*event));
        let windows = Rc::new(SignedWindows::new(Rc::new(packed), SIZE, &(0..=SPAN_US)));
        let blurred = |events: &[CountedEvent], start: i64| {
            let mut picture = vec![0.0; SIZE.pixels()];
            let within = events.iter().filter(|event| (start..start + WINDOW_US).contains(&event.us));
            within.for_each(|event| picture[event.pixel] += f64::from(event.sign()));
            let picture = PictureBlur::new(SIZE).apply(&picture);
            let mean = picture.iter().sum::<f64>() / picture.len() as f64;
            picture.into_iter().map(|v| v - mean).collect::<Vec<f64>>()
        };
        let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mut wanted = 0.0;
        for start in &windows.starts {
            let [a, b] = [&recorded, &made].map(|events| blurred(events, *start));
            wanted += product(&a, &b) / (product(&a, &a) * product(&b, &b)).sqrt();
        }
        let mut found = WindowMatch::new(Rc::clone(&windows));
        made.iter().for_each(|event| found.take(*event));
        found.close();
        let correlation = |(window, products): &(usize, Vec<f64>)| {
            products[products.len() / 2] / windows.variance_at(windows.starts[*window]).sqrt()
        };
        let sum: f64 = found.products.iter().map(correlation).sum();
        assert!(windows.starts.len() > 5 && (sum - wanted).abs() < 1e-9, "{sum} {wanted}");
    }

    #[test]
    fn silence_has_no_delay() {
        let made = events(7);
        let found = matched(&made, &[]);
        assert!(found.delay_us.is_none() && found.ncc.abs() < 1e-12, "{found:?}");
        let windows = Rc::new(SignedWindows::new(Rc::default(), SIZE, &(0..=SPAN_US)));
        assert_eq!(WindowMatch::new(windows).finish(), None);
        // A recording shorter than a window has none.
        let windows = SignedWindows::new(Rc::default(), SIZE, &(0..=15_000));
        assert!(windows.starts.is_empty());
    }
}
