//! Brightness of a pixel between two frames: a straight line, or the response of a first-order
//! low-pass filter to one.
//!
//! A filter of rate `a` with output `y` at the start, and with an input that starts at `f` and has
//! slope `m`, returns `y + m t - (a (y - f) + m) t E(a t)` where `E(x) = (1 - e^-x)/x`. The form is
//! exact, without cancellation for small or large `a t`.

/// Brightness as a function of time between two frames.
#[derive(Debug, Clone, Copy)]
pub(super) struct BrightnessCourse {
    from: f64,
    to: f64,
    slope: f64,
    pull: f64,
    rate: f64,
    length: f64,
    /// Slope of the addition (leak), per ns.
    tilt: f64,
}

/// The state of the filter between two frames.
#[derive(Debug, Clone, Copy)]
pub(super) struct FilteredCourse {
    /// Output at the earlier frame.
    pub(super) output: f64,
    /// Input at both frames.
    pub(super) input: [f64; 2],
    /// Rate of the filter, one over its time constant, per ns.
    pub(super) rate: f64,
}

impl BrightnessCourse {
    /// A straight line, `length` ns long.
    pub(super) fn straight_line(from: f64, to: f64, length: f64) -> Self {
        Self { from, to, slope: (to - from) / length, pull: 0.0, rate: 0.0, length, tilt: 0.0 }
    }

    /// The output of the filter over `length` ns.
    pub(super) fn filter_output(filter: &FilteredCourse, length: f64) -> Self {
        let FilteredCourse { output, input: [from, to], rate } = *filter;
        let slope = (to - from) / length;
        let pull = rate * (output - from) + slope;
        let mut course = Self { from: output, to: output, slope, pull, rate, length, tilt: 0.0 };
        course.to = output + course.rise(length);
        course
    }

    /// Adds `more` to the course, evenly over its length.
    pub(super) fn tilted(self, more: f64) -> Self {
        let tilt = more / self.length;
        Self { to: self.to + more, slope: self.slope + tilt, tilt: self.tilt + tilt, ..self }
    }

    /// The part that was added up to `t` ns after the earlier frame. The rest is brightness.
    pub(super) fn added(&self, t: f64) -> f64 {
        self.tilt * t
    }

    pub(super) fn length(&self) -> f64 {
        self.length
    }

    /// The brightness `t` ns after the earlier frame. At the later frame it is exactly the value
    /// given.
    pub(super) fn at(&self, t: f64) -> f64 {
        // The sum may miss `to` by its rounding, and the next course begins at `to`.
        if t >= self.length { self.to } else { self.from + self.rise(t) }
    }

    fn rise(&self, t: f64) -> f64 {
        let x = self.rate * t;
        // The limit of the quotient for small `x`; at 0 it would be 0/0.
        let mean = if x == 0.0 { 1.0 } else { -libm::expm1(-x) / x };
        t * (self.slope - self.pull * mean)
    }

    /// The time between two instants at which the brightness turns around, if there is one.
    pub(super) fn turn(&self) -> Option<f64> {
        // A turn after the start has a logarithm above 0. The comparison, which is false for NaN too, spares
        // the logarithm of almost all pixels.
        let ratio = Some(self.pull / self.slope).filter(|ratio| *ratio > 1.0)?;
        let t = libm::log(ratio) / self.rate;
        (t > 0.0 && t < self.length).then_some(t)
    }

    /// The time at which a monotonic brightness reaches `level`.
    pub(super) fn reaches(&self, level: f64, [mut low, mut high]: [f64; 2]) -> f64 {
        if self.pull == 0.0 {
            // Rounding may leave the stretch that is searched.
            return (self.length * ((level - self.from) / (self.to - self.from))).clamp(low, high);
        }
        let rising = self.at(high) >= self.at(low);
        let mut t = 0.5 * (low + high);
        // Each round halves the bracket or takes a Newton step. Bisection alone needs fewer than
        // 200.
        for _ in 0..200 {
            let error = self.at(t) - level;
            if (error > 0.0) == rising {
                high = t;
            } else {
                low = t;
            }
            let newton = t - error / (self.slope - self.pull * libm::exp(-self.rate * t));
            let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
            if (next - t).abs() <= f64::EPSILON * t.abs() {
                return next;
            }
            t = next;
        }
        t
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_decays_exponentially_and_a_ramp_lags() {
        // A constant input gives f + (y - f) e^-at. After the filter has settled, a ramp lags by
        // m/a.
        let step = BrightnessCourse::filter_output(
            &FilteredCourse { output: 1.0, input: [3.0, 3.0], rate: 2e-6 },
            1e6,
        );
        for t in [0.0, 1.0, 1e3, 3e5, 9e5, 1e6] {
            assert!((step.at(t) - (3.0 - 2.0 * (-2e-6 * t).exp())).abs() < 1e-15, "{t}");
        }
        let ramp = BrightnessCourse::filter_output(
            &FilteredCourse { output: -0.5, input: [0.0, 1.0], rate: 2e-6 },
            1e6,
        );
        for t in [0.0, 1e3, 5e5, 1e6] {
            assert!((ramp.at(t) - (t * 1e-6 - 0.5)).abs() < 1e-15, "{t}");
        }
    }

    #[test]
    fn a_fast_filter_is_none_and_a_slow_one_stays() {
        let filter = |rate| {
            BrightnessCourse::filter_output(&FilteredCourse { output: 0.0, input: [0.0, 1.0], rate }, 1e6)
        };
        assert!((filter(1e3).at(5e5) - 0.5).abs() < 2e-9 && filter(1e-22).at(1e6).abs() < 1e-15);
        assert!((filter(0.0).at(1e6)).abs() < 1e-15);
    }

    #[test]
    fn levels_are_found_on_both_sides_of_the_turn() {
        // The output falls from 1 towards an input that rises.
        let course = BrightnessCourse::filter_output(
            &FilteredCourse { output: 1.0, input: [0.0, 1.0], rate: 5e-6 },
            1e6,
        );
        let turn = course.turn().unwrap();
        assert!(course.at(turn) < course.at(turn - 1.0) && course.at(turn) < course.at(turn + 1.0));
        for (level, within) in [(0.7, [0.0, turn]), (0.6, [turn, 1e6])] {
            let t = course.reaches(level, within);
            assert!(t > within[0] && t < within[1] && (course.at(t) - level).abs() < 1e-14, "{level} {t}");
        }
        assert_eq!(BrightnessCourse::straight_line(0.0, 1.0, 10.0).turn(), None);
        assert!(
            (BrightnessCourse::straight_line(0.0, 1.0, 10.0).reaches(0.25, [0.0, 10.0]) - 2.5).abs() < 1e-15
        );
        assert_eq!(BrightnessCourse::straight_line(1.0, 1.0, 10.0).turn(), None);
    }
}
