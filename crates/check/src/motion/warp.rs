//! The events of a short window, in place and moved along the optical flow to the middle of the
//! window.

use gs2e_event::{Event, Polarity};
use gs2e_image::{Image, Size};
use gs2e_num::stats::nearest_ranks;
use gs2e_trajectory::flow::FlowQuantiles;

/// The image motion at an instant.
#[derive(Debug, Clone, PartialEq)]
pub struct FlowAt {
    /// The instant, microseconds after the first frame.
    pub t_us: i64,
    /// px/s; NaN where there is no depth.
    pub px_s: Image<[f32; 2]>,
}

/// Median speed of an image, px/s; `None` without a known speed.
fn median_of(flow: &FlowAt) -> Option<f32> {
    let speeds = flow.px_s.pixels().iter().map(|[u, v]| (u * u + v * v).sqrt()).collect();
    nearest_ranks(speeds, [50]).map(|[speed]| speed)
}

/// Median speed of the image over some instants, px/s; `None` without a known speed.
pub(crate) fn median_speed(flows: &[FlowAt]) -> Option<f64> {
    let speeds = flows.iter().filter_map(median_of).collect();
    nearest_ranks(speeds, [50]).map(|[speed]| f64::from(speed))
}

/// Image motion from 0 to `end_us`, px: the integral of the median speed over the pixels, linear
/// between the instants and constant beyond them. It depends on no rate of frames. `None` if no
/// instant has a pixel with a known flow.
#[must_use]
pub fn total_px(flows: &[FlowAt], end_us: i64) -> Option<f64> {
    let median = |flow: &FlowAt| Some((flow.t_us, f64::from(median_of(flow)?)));
    let medians: Vec<(i64, f64)> = flows.iter().filter_map(median).collect();
    let ends = medians.first().zip(medians.last()).map(|(first, last)| [(0, first.1), (end_us, last.1)])?;
    let all: Vec<(i64, f64)> = ends[..1].iter().chain(&medians).chain(&ends[1..]).copied().collect();
    Some(all.windows(2).map(|w| 0.5 * (w[0].1 + w[1].1) * (w[1].0 - w[0].0) as f64 * 1e-6).sum())
}

/// As [`total_px`]. In a scene that moves by itself, whose depths are left out of the flows, the median
/// motion between two frames counts for every one of `frames`.
#[must_use]
pub fn observed_px(flows: &[FlowAt], end_us: i64, step: Option<FlowQuantiles>, frames: usize) -> Option<f64> {
    let by_steps = || step.map(|step| f64::from(step.median) * frames.saturating_sub(1) as f64);
    total_px(flows, end_us).filter(|px| *px >= 1.0).or_else(by_steps)
}

/// The longest half of a window, us.
const MAX_US: f64 = 15_000.0;
/// Image motion in half a window, px: enough to blur an edge, and small enough for a constant flow.
const HALF_PX: f64 = 4.0;

/// The statistics of a window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WarpSharpness {
    /// Middle of the window, us.
    pub t_us: i64,
    /// Median image motion over the window, px.
    pub moved_px: f64,
    /// Number of events that stayed in the image after the move.
    pub events: u64,
    /// Number of pixels.
    pub pixels: u64,
    /// Variance over pixels of the counts in place, summed over ON and OFF.
    pub in_place: f64,
    /// Variance over pixels of the moved counts, summed over ON and OFF.
    pub moved: f64,
}

impl WarpSharpness {
    /// The gain in contrast from moving the events: a ratio of variances.
    #[must_use]
    pub fn ratio(&self) -> f64 {
        self.moved / self.in_place
    }

    /// Upper bound of the ratio's standard deviation for events without structure. For Poisson
    /// counts of mean `m`, the sample variance over `n` pixels has a relative standard deviation of
    /// `sqrt((2 + 1 / m) / n)`. The sum over ON and OFF reduces it by the root of two; the ratio of
    /// two samples increases it by as much, if they are independent.
    #[must_use]
    pub fn noise(&self) -> f64 {
        let (n, mean) = (self.pixels as f64, self.events as f64 / self.pixels as f64 / 2.0);
        ((2.0 + 1.0 / mean) / n).sqrt()
    }
}

/// The window that is being filled.
#[derive(Debug)]
struct WarpWindow<'a> {
    flow: &'a FlowAt,
    span_us: [i64; 2],
    moved_px: f64,
    events: u64,
    /// ON and OFF, in place.
    in_place: [Vec<u16>; 2],
    /// ON and OFF, moved.
    moved: [Vec<u16>; 2],
}

/// The windows of a stream, one after the other.
#[derive(Debug)]
pub(crate) struct WarpWindows<'a> {
    size: Size,
    end_us: i64,
    /// Windows to come, the next one last.
    waiting: Vec<&'a FlowAt>,
    open: Option<WarpWindow<'a>>,
    done: Vec<WarpSharpness>,
    /// Number of events of the fullest window until now, and its counts in place and moved.
    fullest: Option<(u64, [Vec<u16>; 2])>,
}

impl<'a> WarpWindows<'a> {
    /// Starts before the first event.
    ///
    /// # Panics
    /// A flow has another size.
    pub(crate) fn new(size: Size, end_us: i64, flows: &'a [FlowAt]) -> Self {
        assert!(flows.iter().all(|flow| flow.px_s.size() == size), "flows are of the sensor's size");
        let mut windows = Self {
            size,
            end_us,
            waiting: flows.iter().rev().collect(),
            open: None,
            done: Vec::new(),
            fullest: None,
        };
        windows.open_next(i64::MIN);
        windows
    }

    /// Counts an event. Events must come in order of time.
    pub(crate) fn see(&mut self, event: Event, t_us: i64) {
        // Several windows may have ended since the last event.
        while self.open.as_ref().is_some_and(|window| t_us > window.span_us[1]) {
            self.close();
        }
        if let Some(window) = self.open.as_mut().filter(|window| t_us >= window.span_us[0]) {
            window.see(event, t_us, self.size);
        }
    }

    /// The bits of the values that an event at a pixel meets.
    pub(crate) fn met_by(&self, pixel: usize, t_us: i64) -> u64 {
        let Some(window) = self.open.as_ref().filter(|window| t_us >= window.span_us[0]) else { return 0 };
        let [u, _] = window.flow.px_s.pixels()[pixel];
        u64::from(u.to_bits()) ^ u64::from(window.in_place[0][pixel]) ^ u64::from(window.in_place[1][pixel])
    }

    /// The statistics, and the counts of one window in place and moved.
    pub(crate) fn finish(mut self) -> (Vec<WarpSharpness>, Option<[Vec<u16>; 2]>) {
        while self.open.is_some() {
            self.close();
        }
        (self.done, self.fullest.map(|(_, counts)| counts))
    }

    fn close(&mut self) {
        let Some(window) = self.open.take() else { return };
        let (until, sharpness) = (window.span_us[1], window.sharpness(self.size));
        // The fullest window makes the clearest picture.
        if self.fullest.as_ref().is_none_or(|(events, _)| sharpness.events > *events) {
            let counts = [window.in_place, window.moved].map(|[on, off]| add_counts(on, &off));
            self.fullest = Some((sharpness.events, counts));
        }
        self.done.push(sharpness);
        self.open_next(until);
    }

    /// Opens the next window that begins after the end of the last one: an event is in at most one
    /// window.
    fn open_next(&mut self, after_us: i64) {
        while let Some(flow) = self.waiting.pop() {
            let window = WarpWindow::new(flow, self.size, self.end_us);
            // Without motion, the moved image is the image in place.
            if window.span_us[0] > after_us && window.moved_px > 0.0 {
                self.open = Some(window);
                return;
            }
        }
    }
}

impl<'a> WarpWindow<'a> {
    #[expect(clippy::cast_possible_truncation, reason = "microseconds of a window")]
    fn new(flow: &'a FlowAt, size: Size, end_us: i64) -> Self {
        let speeds = flow.px_s.pixels().iter().map(|[u, v]| (u * u + v * v).sqrt()).collect();
        let median = nearest_ranks(speeds, [50]).map_or(0.0, |[median]| f64::from(median));
        // A median of 0 gives an infinite time, which the longest half cuts.
        let half_us = MAX_US.min(1e6 * HALF_PX / median) as i64;
        let span_us = [(flow.t_us - half_us).max(0), (flow.t_us + half_us).min(end_us)];
        let none = || [vec![0; size.pixels()], vec![0; size.pixels()]];
        let moved_px = median * 1e-6 * (span_us[1] - span_us[0]) as f64;
        Self { flow, span_us, moved_px, events: 0, in_place: none(), moved: none() }
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "places inside of the picture"
    )]
    fn see(&mut self, event: Event, t_us: i64, size: Size) {
        let (x, y) = (usize::from(event.x), usize::from(event.y));
        let (width, height) = (size.width as usize, size.height as usize);
        if x >= width || y >= height {
            return;
        }
        let [u, v] = self.flow.px_s.pixels()[y * width + x];
        let earlier = (self.flow.t_us - t_us) as f32 * 1e-6;
        let (to_x, to_y) = ((x as f32 + u * earlier).round(), (y as f32 + v * earlier).round());
        // NaN is outside. An event that leaves the picture counts in neither image, so that both
        // have the same total.
        if !(to_x >= 0.0 && to_y >= 0.0 && to_x < width as f32 && to_y < height as f32) {
            return;
        }
        let side = usize::from(event.polarity == Polarity::Off);
        self.events += 1;
        for (counts, at) in [
            (&mut self.in_place[side], y * width + x),
            (&mut self.moved[side], to_y as usize * width + to_x as usize),
        ] {
            counts[at] = counts[at].saturating_add(1);
        }
    }

    fn sharpness(&self, size: Size) -> WarpSharpness {
        let of = |counts: &[Vec<u16>; 2]| count_variance(&counts[0]) + count_variance(&counts[1]);
        WarpSharpness {
            t_us: self.flow.t_us,
            moved_px: self.moved_px,
            events: self.events,
            pixels: size.pixels() as u64,
            in_place: of(&self.in_place),
            moved: of(&self.moved),
        }
    }
}

fn add_counts(mut a: Vec<u16>, b: &[u16]) -> Vec<u16> {
    a.iter_mut().zip(b).for_each(|(a, b)| *a = a.saturating_add(*b));
    a
}

/// The variance of counts below 2^16, whose sums are exact.
fn count_variance(counts: &[u16]) -> f64 {
    let sum: u64 = counts.iter().map(|n| u64::from(*n)).sum();
    let squares: u64 = counts.iter().map(|n| u64::from(*n) * u64::from(*n)).sum();
    let n = counts.len() as f64;
    let mean = sum as f64 / n;
    squares as f64 / n - mean * mean
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planted::SplitMixDraws;
    use gs2e_event::EventLabel;
    use gs2e_num::units::Timestamp;

    const SIZE: Size = Size { width: 64, height: 8 };

    fn event(t_us: i64, x: u16, y: u16) -> Event {
        Event { t: Timestamp::from_micros(t_us), x, y, polarity: Polarity::On, label: EventLabel::Signal }
    }

    /// A bar of one column that moves right by a pixel every 500 us makes a column of events at
    /// each pixel that it enters.
    fn bar() -> Vec<Event> {
        (0..32).flat_map(|j| (0..8).map(move |y| event(500 * i64::from(j), 10 + j, y))).collect()
    }

    #[test]
    fn the_motion_is_the_integral_of_the_speed() {
        let flow = |t_us, speed: f32| FlowAt { t_us, px_s: Image::filled(SIZE, [0.6 * speed, -0.8 * speed]) };
        // 10 px/s to 0.25 s, then linear to 30 px/s at 0.75 s, which it keeps to 1 s.
        let flows = [flow(250_000, 10.0), flow(750_000, 30.0)];
        // Speeds are rounded at 6e-8 of themselves.
        assert!((total_px(&flows, 1_000_000).unwrap() - (2.5 + 10.0 + 7.5)).abs() < 1e-5);
        // Instants without a known flow do not count, and no frame rate does.
        let unknown = FlowAt { t_us: 500_000, px_s: Image::filled(SIZE, [f32::NAN; 2]) };
        let step = Some(FlowQuantiles { median: 0.5, p95: 0.5, max: 0.5 });
        let with = [flows[0].clone(), unknown.clone(), flows[1].clone()];
        assert!((observed_px(&with, 1_000_000, step, 7).unwrap() - 20.0).abs() < 1e-5);
        assert_eq!(observed_px(&[unknown], 1_000_000, step, 7), Some(3.0));
    }

    fn found(flow: [f32; 2]) -> WarpSharpness {
        let flows = [FlowAt { t_us: 8000, px_s: Image::filled(SIZE, flow) }];
        let mut windows = WarpWindows::new(SIZE, 16_000, &flows);
        for event in bar() {
            windows.see(event, event.t.floor_micros());
        }
        windows.finish().0[0]
    }

    #[test]
    fn a_moving_bar_becomes_one_column() {
        // 2000 px/s: half of the window is 2000 us, which is 9 columns; the middle is the bar at 8
        // ms.
        let right = found([2000.0, 0.0]);
        assert_eq!((right.events, right.moved_px, right.t_us), (72, 8.0, 8000));
        // In place, each of 72 pixels has one event. Moved, 8 pixels have nine.
        let [p, n] = [72.0 / 512.0, 512.0];
        assert!((right.in_place - (p - p * p)).abs() < 1e-12);
        assert!((right.moved - (8.0 * 81.0 / n - p * p)).abs() < 1e-12);
        assert!(right.ratio() > 10.0);
        // Against the motion, the bar is spread over twice the columns. In this sparse picture its
        // contrast is not lower than in place, but far from the gathered one.
        assert!(found([-2000.0, 0.0]).ratio() < 1.01);
    }

    #[test]
    fn windows_do_not_share_events_and_nothing_moves_without_depth() {
        let flow = |t_us, v: f32| FlowAt { t_us, px_s: Image::filled(SIZE, [v, 0.0]) };
        let flows = [flow(0, 2000.0), flow(1000, 2000.0), flow(9000, 2000.0), flow(12_000, f32::NAN)];
        let mut windows = WarpWindows::new(SIZE, 16_000, &flows);
        for event in bar() {
            windows.see(event, event.t.floor_micros());
        }
        let (found, fullest) = windows.finish();
        assert_eq!(found.iter().map(|s| s.t_us).collect::<Vec<_>>(), [0, 9000]);
        assert_eq!(found.iter().map(|s| s.events).sum::<u64>(), 40 + 72);
        assert_eq!(fullest.unwrap()[0].iter().map(|n| u64::from(*n)).sum::<u64>(), 72);
    }

    #[test]
    fn the_noise_of_the_ratio_is_that_of_events_anywhere() {
        let size = Size { width: 200, height: 100 };
        let flows = [FlowAt { t_us: 10_000, px_s: Image::filled(size, [400.0, 0.0]) }];
        let ratio = |seed: u64| {
            let mut windows = WarpWindows::new(size, 20_000, &flows);
            let mut draws = SplitMixDraws(seed);
            for j in 0..4000i64 {
                let (x, y) = (draws.at(200), draws.at(100));
                let polarity = [Polarity::On, Polarity::Off][draws.below(2)];
                windows.see(Event { polarity, ..event(5 * j, x, y) }, 5 * j);
            }
            windows.finish().0[0]
        };
        let found: Vec<WarpSharpness> = (1..=40).map(ratio).collect();
        let variance = found.iter().map(|s| (s.ratio() - 1.0).powi(2)).sum::<f64>() / 40.0;
        let share = variance.sqrt() / found[0].noise();
        // The sample standard deviation of 40 values varies by 11 %; both counts have the same
        // total.
        assert!((0.25..1.2).contains(&share), "{share}");
    }
}
