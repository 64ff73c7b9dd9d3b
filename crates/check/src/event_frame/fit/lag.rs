//! Delay of events against frames, measured from pixels with steady drift.
//!
//! If the voltage of a pixel rises steadily by more than a threshold on both sides of an instant,
//! its residual `dv - s` is uniform between 0 and the threshold: half of it on average, for any
//! speed. Events with a delay of `lag` leave `rate lag` more. Over pixels of many rates, rising and
//! falling, the slope of the residual against the rate is therefore the lag. (The maximum of the
//! correlation between counts and changes is itself late where edges are only one or two thresholds
//! high, because their single event comes at the end.)

/// Minimum drift on both sides of the instant, in thresholds.
const MIN_WAY: f64 = 1.0;
/// Largest ratio of the two drifts.
const MAX_UNEVEN: f64 = 3.0;

/// Sums over the pixels with steady drift.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LagSums {
    /// Number of pixels.
    pub pixels: u64,
    rates: f64,
    squares: f64,
    left: f64,
    left_squares: f64,
    products: f64,
}

impl LagSums {
    /// Adds a pixel with the residual `left` at an instant, and with the drifts `ways` before and
    /// after it in `span` microseconds.
    pub(super) fn add(&mut self, left: f64, ways: [f64; 2], span: f64, thresholds: [f64; 2]) {
        let threshold = if ways[0] > 0.0 { thresholds[0] } else { thresholds[1] };
        let [small, large] = [ways[0].abs().min(ways[1].abs()), ways[0].abs().max(ways[1].abs())];
        // NaN fails these comparisons, so it is never steady.
        let steady = ways[0] * ways[1] > 0.0 && small > MIN_WAY * threshold && large < MAX_UNEVEN * small;
        // An impossible residual, for example of a hot pixel, would outweigh the rest.
        if !steady || left.abs() > 8.0 * threshold {
            return;
        }
        let rate = (ways[0] + ways[1]) / span;
        // The mean residual of events without a delay.
        let left = left - (0.5 * threshold).copysign(rate);
        self.pixels += 1;
        self.rates += rate;
        self.squares += rate * rate;
        self.left += left;
        self.left_squares += left * left;
        self.products += rate * left;
    }

    /// The lag over all spans, us, and its standard deviation; `None` without pixels. Each span has
    /// its own mean residual, which covers voltages that start anywhere.
    #[must_use]
    pub(crate) fn pooled_lag(spans: impl Iterator<Item = Self>) -> Option<[f64; 2]> {
        let (mut pixels, mut squares, mut products, mut left_squares) = (0.0, 0.0, 0.0, 0.0);
        for Self { pixels: n, rates, squares: s, left, left_squares: l, products: p } in spans {
            // A single pixel has no deviation from its span's mean.
            if n > 1 {
                let n = n as f64;
                pixels += n;
                squares += s - rates * rates / n;
                products += p - rates * left / n;
                left_squares += l - left * left / n;
            }
        }
        if squares <= 0.0 || pixels <= 2.0 {
            return None;
        }
        let lag = products / squares;
        // Rounding may leave a sum of squares slightly below 0.
        let rest = (left_squares - lag * products).max(0.0) / (pixels - 2.0);
        Some([lag, (rest / squares).sqrt()])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ramps of many rates, up and down, with events delayed by `late` us. Residuals are found by
    /// counting.
    fn ramps(late: f64, start: f64) -> [f64; 2] {
        let (span, mut lag) = (2000.0, LagSums::default());
        for i in 0..4000 {
            let share = f64::from(i) * 0.618_033_988_749_895 % 1.0;
            let rate = (2.5 + 6.0 * share) / span * if i % 2 == 0 { 1.0 } else { -1.0 };
            // The drift before the span differs from pixel to pixel.
            let before = 20.0 * (f64::from(i) * 0.754_877_666_246_693 % 1.0);
            let dv = rate * span / 2.0 + before.copysign(rate);
            let s = (dv - rate * late).trunc();
            lag.add(dv - s + start, [rate * span / 2.0; 2], span, [1.0, 1.0]);
        }
        LagSums::pooled_lag(std::iter::once(lag)).unwrap()
    }

    #[test]
    fn the_lag_of_ramps_is_found() {
        for late in [0.0, 40.0, -100.0, 417.0] {
            for start in [0.0, 0.4] {
                let [lag, deviation] = ramps(late, start);
                assert!((lag - late).abs() < 5.0 * deviation, "{late}: {lag} +- {deviation}");
                assert!(deviation < 3.0, "{deviation}");
            }
        }
    }

    #[test]
    fn pixels_that_turn_or_hardly_move_tell_nothing() {
        let mut lag = LagSums::default();
        for ways in [[2.0, -2.0], [0.5, 0.5], [1.1, 5.0], [0.0, 0.0], [f64::NAN, 2.0]] {
            lag.add(0.3, ways, 100.0, [1.0, 1.0]);
        }
        assert_eq!(lag.pixels, 0);
        assert_eq!(LagSums::pooled_lag([lag].into_iter()), None);
    }
}
