//! The pieces into which the filter cuts the time between two frames.
//!
//! The law behind the filter takes the output for a cubic between the ends of a piece. An exponential `e^-x`,
//! with `x` the time in time constants, differs from this cubic by at most `w^4 e^-x / 384` over a piece of
//! width `w` from `x` on. The pieces of a leg keep this below `STEP^4 / 384` of the first amplitude: they
//! grow as `STEP e^(x/4)`, so twenty reach any time.
//!
//! Two stages answer with `x e^-x` too, whose fourth derivative grows to `x - 4` times `e^-x`. Their pieces
//! are smaller, and grow as `e^(x/5)`: `(x - 4) e^(-x/5)` is below its value of 4 at `x = 0`.
//!
//! Where the rate depends on the light, a pixel of a share `q` of the largest rate has widths `q w` and times
//! `q x`. The width is the smallest over all `q`: `STEP e^(x/4)` up to `x = 4`, then `STEP e x/4` up to `x =
//! 4/q` of the smallest `q`, then `STEP e^(q x/4) / q`. The pieces depend on the settings and on the frames'
//! stamps alone, so a crop has those of the whole image.

/// Largest width of the first piece in time constants, with one stage and with two: an error of 1e-5.
const STEP: [f64; 2] = [0.25, 0.175];
/// Time constants in which the width grows by a factor of `e`.
const GROWTH: [f64; 2] = [4.0, 5.0];

/// The rule for the pieces of a leg.
#[derive(Debug, Clone, Copy)]
pub(super) struct CutRule {
    /// Largest rate of a stage at any light, per ns.
    fastest: f64,
    /// Smallest rate as a share of it.
    slowest: f64,
    step: f64,
    growth: f64,
}

impl CutRule {
    /// The rule for stages with rates within these limits, per ns.
    pub(super) fn new([slowest, fastest]: [f64; 2], order: u32) -> Self {
        let stages = usize::from(order > 1);
        Self { fastest, slowest: slowest / fastest, step: STEP[stages], growth: GROWTH[stages] }
    }

    /// The ends of the pieces of a leg, ns since its start; the last is `length`.
    #[expect(clippy::cast_possible_truncation, reason = "ends lie within the leg")]
    pub(super) fn cuts(&self, length: i64) -> Vec<i64> {
        let whole = self.fastest * length as f64;
        let mut ends = Vec::new();
        // Short legs are cut evenly, because the rule would leave a sliver at the end.
        let mut width = if whole < 1.0 { whole / (whole / self.step).ceil() } else { self.step };
        let mut x = width;
        // A sum of rounded widths may end just before the leg does.
        while x < whole * (1.0 - 1e-9) {
            let end = (x / self.fastest) as i64;
            if end > ends.last().copied().unwrap_or(0) && end < length {
                ends.push(end);
            }
            if whole >= 1.0 {
                width = self.width(x);
            }
            x += width;
        }
        ends.push(length);
        ends
    }

    /// Width of a piece that begins `x` after the frame.
    fn width(&self, x: f64) -> f64 {
        // The share whose bound is the smallest.
        let share = (self.growth / x).clamp(self.slowest, 1.0);
        self.step * libm::exp((share * x / self.growth).min(700.0)) / share
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest error of a cubic over the pieces, for a rate and the fourth derivative of the answer.
    fn worst(cuts: &[i64], rate: f64, fourth: impl Fn(f64) -> f64) -> f64 {
        let mut start = 0.0;
        let mut worst = 0.0f64;
        for end in cuts.iter().map(|end| *end as f64 * rate) {
            worst = worst.max((end - start).powi(4) * fourth(start) / 384.0);
            start = end;
        }
        worst
    }

    #[test]
    fn an_answer_is_a_cubic_on_every_piece() {
        for slowest in [1.0, 0.3, 0.01, 1e-4] {
            let [one, two] = [1, 2].map(|order| CutRule::new([slowest * 1e-6, 1e-6], order));
            for length in [1i64, 1000, 240_000, 1_000_000, 5_000_000, 100_000_000, 3_600_000_000_000] {
                let [one, two] = [one, two].map(|rule| rule.cuts(length));
                for cuts in [&one, &two] {
                    assert!(cuts.is_sorted_by(|a, b| a < b) && cuts[0] > 0 && cuts.last() == Some(&length));
                }
                // 20 for one rate, and a growth of 17 % each for the times between `4` and `4/q`.
                let most = 21.0 + 6.5 * libm::log(1.0 / slowest);
                assert!(one.len() as f64 <= most && two.len() as f64 <= 2.0 * most, "{slowest} {length}");
                for i in 0..=20 {
                    let rate = libm::pow(slowest, f64::from(i) / 20.0) * 1e-6;
                    // Ends are rounded to ns.
                    assert!(worst(&one, rate, |x| libm::exp(-x)) < 1.03e-5, "{slowest} {length} {rate}");
                    // A piece has its largest value at its start, or a little after it where that is small.
                    let fourth = |x: f64| (x - 4.0).abs().max(1.0) * libm::exp(-x);
                    assert!(worst(&two, rate, fourth) < 1.03e-5, "{slowest} {length} {rate}");
                }
            }
        }
    }

    #[test]
    fn short_legs_are_cut_evenly() {
        let rule = CutRule::new([1e-6, 1e-6], 1);
        assert_eq!(rule.cuts(250_000), [250_000]);
        assert_eq!(rule.cuts(500_000), [250_000, 500_000]);
        assert_eq!(rule.cuts(600_000), [200_000, 400_000, 600_000]);
        // Cuts that fall on one nanosecond are one.
        assert_eq!(CutRule::new([1.0, 1.0], 1).cuts(2), [1, 2]);
    }
}
