//! Interpolation error of brightness between frames: the error of the signal, before any event.

use gs2e_sampling::between::{BetweenKnot, interpolated_value};
use gs2e_sensor::frames::DenseFrame;
use gs2e_sensor::voltmeter::BetweenFrames;
use rayon::prelude::*;
use std::collections::VecDeque;
use std::sync::Arc;

/// `V = ln(L + k2)` of a frame and its rate of change, if the frame has it.
#[derive(Debug)]
pub(super) struct FrameVoltage {
    seconds: f64,
    v: Vec<f64>,
    rate: Vec<f64>,
}

impl FrameVoltage {
    pub(super) fn new(frame: &DenseFrame, k2: f64) -> Self {
        let luminance = frame.luminance.pixels();
        let level = |l: &f32| f64::from(l.max(0.0)) + k2;
        let v = luminance.par_iter().map(|l| libm::log(level(l))).collect();
        let rate = frame.rate.as_ref().map_or_else(Vec::new, |rate| {
            // The derivative of `ln(L + k2)`.
            rate.pixels().iter().zip(luminance).map(|(rate, l)| f64::from(*rate) / level(l)).collect()
        });
        Self { seconds: frame.t.seconds(), v, rate }
    }

    fn knot(&self, i: usize) -> BetweenKnot {
        BetweenKnot { seconds: self.seconds, v: self.v[i], slope: self.rate.get(i).copied().unwrap_or(0.0) }
    }
}

/// The intervals of one grid. Each is evaluated at its middle, after the frame that follows it has
/// arrived.
#[derive(Debug)]
pub(super) struct IntervalVoltages {
    between: Vec<BetweenFrames>,
    /// The frame before an interval, its two ends, and the frame after it.
    window: [Option<Arc<FrameVoltage>>; 4],
    middles: VecDeque<Arc<FrameVoltage>>,
    /// Sums of squares by method.
    sums: Vec<f64>,
    count: usize,
}

impl IntervalVoltages {
    pub(super) fn new(between: &[BetweenFrames]) -> Self {
        let sums = vec![0.0; between.len()];
        let (window, middles) = (Default::default(), VecDeque::new());
        Self { between: between.to_vec(), window, middles, sums, count: 0 }
    }

    /// A frame of the grid.
    pub(super) fn node(&mut self, voltage: &Arc<FrameVoltage>) {
        self.shift(Some(voltage.clone()));
    }

    /// The frame in the middle of the interval that begins at the last node.
    pub(super) fn middle(&mut self, voltage: &Arc<FrameVoltage>) {
        self.middles.push_back(voltage.clone());
    }

    /// Root mean square over pixels and intervals, by method.
    pub(super) fn finish(mut self) -> Vec<f64> {
        // The last interval has no frame after it.
        self.shift(None);
        let count = self.count.max(1) as f64;
        self.sums.iter().map(|sum| (sum / count).sqrt()).collect()
    }

    fn shift(&mut self, after: Option<Arc<FrameVoltage>>) {
        self.window.rotate_left(1);
        self.window[3] = after;
        // An interval is complete once the frame after it, or the end, is known.
        let [before, Some(from), Some(to), after] = &self.window else { return };
        let Some(middle) = self.middles.pop_front() else { return };
        for (sum, between) in self.sums.iter_mut().zip(&self.between) {
            // The squares are summed in order, because the sum of a parallel reduction depends on
            // the threads.
            let squares: Vec<f64> = (0..from.v.len())
                .into_par_iter()
                .map(|i| {
                    let outer =
                        [before, after].map(|voltage| voltage.as_ref().map(|voltage| voltage.knot(i)));
                    interpolated_value(*between, outer, [from.knot(i), to.knot(i)], middle.seconds)
                        - middle.v[i]
                })
                .map(|error| error * error)
                .collect();
            *sum += squares.iter().sum::<f64>();
        }
        self.count += from.v.len();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_image::{Image, Size};
    use gs2e_num::units::Timestamp;

    const K2: f64 = 20.0;
    const ALL: [BetweenFrames; 3] = [BetweenFrames::Linear, BetweenFrames::Catmull, BetweenFrames::Hermite];

    /// One pixel with `V` and slope as functions of time, sampled at these microseconds, with
    /// middles between them.
    #[expect(clippy::cast_possible_truncation, reason = "frames are f32")]
    fn rms(times_us: &[i64], signal: impl Fn(f64) -> (f64, f64)) -> Vec<f64> {
        let voltage = |t: i64| {
            let (v, slope) = signal(t as f64 * 1e-6);
            let level = libm::exp(v);
            let one = |value: f64| Image::filled(Size { width: 1, height: 1 }, value as f32);
            let frame = DenseFrame {
                index: 0,
                t: Timestamp::from_micros(t),
                luminance: one(level - K2),
                rate: Some(one(level * slope)),
            };
            Arc::new(FrameVoltage::new(&frame, K2))
        };
        let mut voltages = IntervalVoltages::new(&ALL);
        for pair in times_us.windows(2) {
            voltages.node(&voltage(pair[0]));
            voltages.middle(&voltage(i64::midpoint(pair[0], pair[1])));
        }
        voltages.node(&voltage(*times_us.last().unwrap()));
        voltages.finish()
    }

    /// Frames are f32 at about 100 grey: `V` has an error of 1e2 * 6e-8 / 120.
    const ROUNDING: f64 = 2e-7;

    #[test]
    fn a_parabola_misses_a_line_by_h_squared_over_eight_of_its_bend() {
        // Even steps of 2 ms: linear has an error of h^2/8 * 2q at each middle. Both cubics contain
        // the parabola, except Catmull in its one-sided end intervals, where the slope has an error
        // of q h and the middle of q h^2/8.
        let (q, h) = (2000.0, 2e-3);
        let found = rms(&[0, 2000, 4000, 6000, 8000], |t| (4.5 + q * t * t - 8.0 * t, 2.0 * q * t - 8.0));
        let line = q * h * h / 4.0;
        let catmull = (0.5f64).sqrt() * q * h * h / 8.0;
        for (found, wanted) in found.iter().zip([line, catmull, 0.0]) {
            assert!((found - wanted).abs() < ROUNDING, "{found} {wanted}");
        }
    }

    #[test]
    fn a_cubic_is_a_hermite_curves_own_at_uneven_steps() {
        let cubic = |t: f64| (4.5 + 1e5 * t * t * t - 40.0 * t, 3e5 * t * t - 40.0);
        let [linear, catmull, hermite] = rms(&[0, 1000, 4000, 5000, 9000, 10_000], cubic)[..] else {
            panic!()
        };
        assert!(hermite < ROUNDING && linear > 1e-3 && catmull < linear, "{linear} {catmull} {hermite}");
    }
}
