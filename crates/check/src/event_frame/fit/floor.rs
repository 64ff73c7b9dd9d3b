//! The noise floor of a pixel: random events of both polarities that do not follow the frames. Their
//! expected numbers are known from the light on the pixel, and so is the share of sound pixels that
//! they spoil.

/// Expected numbers of events of the noise floor at a pixel since the first frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct FloorCounts {
    /// ON and OFF events.
    pub(super) counts: [f64; 2],
}

impl FloorCounts {
    /// Mean of `A on - B off` over these events.
    pub(super) fn mean(self, [a, b]: [f64; 2]) -> f64 {
        a * self.counts[0] - b * self.counts[1]
    }

    /// Second and fourth cumulant of `A on - B off`. Counts of Poisson have all cumulants equal.
    pub(super) fn cumulants(self, thresholds: [f64; 2]) -> [f64; 2] {
        let sum = |power: i32| thresholds.iter().zip(self.counts).map(|(t, n)| t.powi(power) * n).sum();
        [sum(2), sum(4)]
    }

    /// Probability that these events move a possible residual beyond `bound`. `along` is 0 for a
    /// rising drift and 1 for a falling one.
    pub(super) fn spoils_residual(self, bound: f64, along: usize, thresholds: [f64; 2]) -> f64 {
        let [on, off] = self.counts;
        if on + off <= 0.0 {
            return 0.0;
        }
        let none = libm::exp(-on - off);
        let [a, b] = thresholds;
        // Residuals lie behind the next event in the direction of the drift, or, where the drift
        // turned, anywhere between both thresholds.
        let straight = if along == 0 { [0.0, a] } else { [-b, 0.0] };
        let beyond = |shift: f64| {
            [straight, [-b, a]].map(|range| share_beyond(range, shift, bound)).into_iter().fold(0.0, f64::max)
        };
        // An ON event says more than the drift, and leaves less. Two events count as beyond.
        let several = (1.0 - none * (1.0 + on + off)).max(0.0);
        none * (on * beyond(-a) + off * beyond(b)) + several
    }

    /// Probability that these events turn the sign of a pixel with a drift of this size. Its residual
    /// is taken as uniform up to the threshold, as it is where the drift goes straight.
    pub(super) fn turns_sign(self, size: f64, along: usize, thresholds: [f64; 2]) -> f64 {
        if self.counts[1 - along] <= 0.0 {
            return 0.0;
        }
        let quarters = [0.125, 0.375, 0.625, 0.875];
        let chance = |place: f64| self.outweighs(size - place * thresholds[along], along, thresholds);
        quarters.into_iter().map(chance).sum::<f64>() / quarters.len() as f64
    }

    /// Probability that these events outweigh others that say `level` in the direction of the
    /// drift. `along` is 0 for a rising drift and 1 for a falling one.
    fn outweighs(self, level: f64, along: usize, thresholds: [f64; 2]) -> f64 {
        let [with, against] = [self.counts[along], self.counts[1 - along]];
        let [forth, back] = [thresholds[along], thresholds[1 - along]];
        let mut of_count = libm::exp(-with);
        let mut chance = 0.0;
        let mut n = 0.0;
        // Beyond six standard deviations next to no pixel is left.
        while n <= with + 6.0 * with.sqrt() + 6.0 {
            // One event at least: without any, the sign is right.
            let least = ((level + forth * n) / back).ceil().max(1.0);
            chance += of_count * at_least(against, least);
            n += 1.0;
            of_count *= with / n;
        }
        chance.min(1.0)
    }
}

/// Share of the uniform law on a range that lies beyond `bound` on either side after a shift.
fn share_beyond([low, high]: [f64; 2], shift: f64, bound: f64) -> f64 {
    let [low, high] = [low + shift, high + shift];
    let inside = (high.min(bound) - low.max(-bound)).max(0.0);
    1.0 - inside / (high - low)
}

/// Probability that a Poisson count of this mean is `least` or more.
fn at_least(mean: f64, least: f64) -> f64 {
    // So far above the mean, the probability is below every digit that matters here.
    if least > mean + 10.0 * mean.sqrt() + 20.0 {
        return 0.0;
    }
    let mut of_count = libm::exp(-mean);
    let mut below = 0.0;
    let mut n = 0.0;
    while n < least {
        below += of_count;
        n += 1.0;
        of_count *= mean / n;
    }
    (1.0 - below).max(0.0)
}

/// A number of pixels that are expected to be spoilt, each with a probability of its own.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SpoiltPixels {
    expected: f64,
    variance: f64,
}

impl SpoiltPixels {
    pub(super) fn add(&mut self, chance: f64) {
        self.expected += chance;
        self.variance += chance * (1.0 - chance);
    }

    /// Expected share of `pixels`.
    #[must_use]
    pub fn share(&self, pixels: u64) -> f64 {
        self.expected / pixels.max(1) as f64
    }

    /// Largest share of `pixels` that chance explains: the expected one and five standard
    /// deviations; exactly 0 without noise.
    #[must_use]
    pub fn most(&self, pixels: u64) -> f64 {
        (self.expected + 5.0 * self.variance.sqrt()) / pixels.max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planted::SplitMixDraws;

    /// A Poisson count by its arrivals: independent of the sums above.
    fn poisson(draws: &mut SplitMixDraws, mean: f64) -> f64 {
        let (mut time, mut count) = (-draws.share().ln(), 0.0);
        while time < mean {
            time -= draws.share().ln();
            count += 1.0;
        }
        count
    }

    #[test]
    fn the_chance_to_outweigh_is_that_of_drawn_counts() {
        let mut draws = SplitMixDraws(3);
        let thresholds = [1.0, 1.907];
        for (counts, level, along) in [
            ([0.3, 0.4], 0.7, 0),
            ([0.3, 0.4], 2.5, 0),
            ([4.0, 5.0], 2.0, 0),
            ([1.0, 0.2], 1.5, 1),
            ([0.01, 0.02], -0.3, 0),
        ] {
            let floor = FloorCounts { counts };
            let trials = 40_000;
            let mut turned = 0u32;
            for _ in 0..trials {
                let [on, off] = counts.map(|mean| poisson(&mut draws, mean));
                let (with, against) = if along == 0 { (on, 1.907 * off) } else { (1.907 * off, on) };
                turned += u32::from(against > 0.0 && level + with - against <= 0.0);
            }
            let (wanted, found) =
                (f64::from(turned) / f64::from(trials), floor.outweighs(level, along, thresholds));
            // Four standard deviations of the drawn share.
            let error = 4.0 * (found.max(1e-4) / f64::from(trials)).sqrt();
            assert!((found - wanted).abs() < error, "{counts:?} {level}: {found} and {wanted}");
        }
    }

    #[test]
    fn a_residual_is_spoilt_as_often_as_that_of_drawn_pixels() {
        let mut draws = SplitMixDraws(4);
        let thresholds = [1.0, 1.907];
        for (counts, bound, along) in [([0.05, 0.08], 2.4, 0), ([0.3, 0.1], 2.2, 1), ([0.0, 0.2], 1.95, 0)] {
            let mut spoilt = 0u32;
            let trials = 40_000;
            for _ in 0..trials {
                let left = if along == 0 { draws.share() } else { -1.907 * draws.share() };
                let [on, off] = counts.map(|mean| poisson(&mut draws, mean));
                spoilt += u32::from((left - on + 1.907 * off).abs() > bound);
            }
            let drawn = f64::from(spoilt) / f64::from(trials);
            let found = FloorCounts { counts }.spoils_residual(bound, along, thresholds);
            // A bound, within four standard deviations of what was drawn, and at most twice that and a
            // hundredth.
            let error = 4.0 * (found / f64::from(trials)).sqrt();
            assert!(drawn <= found + error && found <= 2.0 * drawn + 0.01, "{counts:?}: {found} and {drawn}");
        }
    }

    #[test]
    fn without_a_floor_no_pixel_is_spoilt() {
        let mut spoilt = SpoiltPixels::default();
        spoilt.add(FloorCounts::default().spoils_residual(0.5, 0, [1.0; 2]));
        spoilt.add(FloorCounts::default().turns_sign(0.1, 0, [1.0; 2]));
        assert_eq!(spoilt.most(2).to_bits(), 0.0f64.to_bits());
    }
}
