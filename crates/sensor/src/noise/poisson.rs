//! Random events: a Poisson process with a rate that may follow the brightness.
//!
//! The process is drawn by exposure: the integral of the rate between two events is exponential
//! with mean 1. The events therefore do not depend on how frames divide the time, as long as the
//! rate stays the same function of time.

use super::PixelSite;
use gs2e_num::seed::DrawSpace;

/// The process of one pixel, as the exposure that is left until its next event.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PoissonTrain {
    left: f64,
    /// Index of the next event, from 1.
    next: u64,
}

/// A rate between two instants, in events per ns, linear from the first to the second.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LinearRate {
    pub(crate) ends: [f64; 2],
    /// Time between the instants, ns.
    pub(crate) length: f64,
}

impl LinearRate {
    /// Integral of the rate from the first instant to `t`.
    fn exposure(&self, t: f64) -> f64 {
        let [from, to] = self.ends;
        t * (from + 0.5 * (to - from) * (t / self.length))
    }

    /// The time at which the exposure since `start` reaches `left`.
    fn reached(&self, start: f64, left: f64) -> f64 {
        let [from, to] = self.ends;
        let slope = (to - from) / self.length;
        let here = from + slope * start;
        // The smaller root of `slope/2 d^2 + here d = left`, in the form without cancellation.
        start + 2.0 * left / (here + (here * here + 2.0 * slope * left).max(0.0).sqrt())
    }
}

impl PoissonTrain {
    /// The process from its start.
    pub(crate) fn new(site: PixelSite, space: DrawSpace) -> Self {
        let mut train = Self { left: 0.0, next: 0 };
        train.wait(site, space);
        train
    }

    /// A process without events.
    pub(crate) fn silent() -> Self {
        Self { left: f64::INFINITY, next: 0 }
    }

    /// Returns true if there are no events.
    pub(crate) fn is_silent(&self) -> bool {
        self.left == f64::INFINITY
    }

    /// Moves from `start` to the next event. If that lies after the second instant, moves to the
    /// second instant and returns no event.
    pub(crate) fn advance(&mut self, rates: &LinearRate, start: f64) -> Option<f64> {
        if self.is_silent() {
            return None;
        }
        let ahead = rates.exposure(rates.length) - rates.exposure(start);
        if self.left > ahead {
            self.left -= ahead;
            return None;
        }
        // Rounding may place the event just outside the stretch in which it was found.
        Some(rates.reached(start, self.left).clamp(start, rates.length))
    }

    /// Time from the previous event to the next at a constant rate, events per ns; `None` if there
    /// is no next event.
    pub(crate) fn gap(&self, rate: f64) -> Option<f64> {
        (self.left < f64::INFINITY && rate > 0.0).then(|| self.left / rate)
    }

    /// Starts the wait for the next event. Returns a uniform draw that belongs to the event that
    /// has just happened.
    pub(crate) fn wait(&mut self, site: PixelSite, space: DrawSpace) -> f64 {
        let mut happened = site.draws(space, self.next);
        // The first draw of this index was spent on the time of the event.
        happened.uniform();
        self.next += 1;
        self.left = -libm::log(site.draws(space, self.next).uniform());
        happened.uniform()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_num::seed::{Seed, ks};
    use gs2e_testing::rival;

    fn site(x: u16) -> PixelSite {
        PixelSite { seed: Seed(3), x, y: 9 }
    }

    /// Event times of one pixel, simulated in steps of `step` ns up to `end`, at the rate
    /// `rate(t)`.
    fn times(x: u16, end: f64, step: f64, rate: impl Fn(f64) -> f64) -> Vec<f64> {
        let mut train = PoissonTrain::new(site(x), DrawSpace::Shot);
        let (mut times, mut from) = (Vec::new(), 0.0);
        while from < end {
            let rates = LinearRate { ends: [rate(from), rate(from + step)], length: step };
            let mut start = 0.0;
            while let Some(t) = train.advance(&rates, start) {
                times.push(from + t);
                train.wait(site(x), DrawSpace::Shot);
                start = t;
            }
            from += step;
        }
        times
    }

    #[test]
    fn gaps_are_exponential() {
        let mut gaps = Vec::new();
        for x in 0..200 {
            let times = times(x, 1e6, 1e6, |_| 2e-4);
            // 200 events are expected, with a standard deviation of 14: the first 100 of each pixel
            // are not censored.
            gaps.push(times[0]);
            gaps.extend(times[..100].windows(2).map(|pair| pair[1] - pair[0]));
        }
        let law = |rate: f64| move |gap: f64| -(-rate * gap).exp_m1();
        let [found, defect] = [2e-4, 2.1e-4].map(|rate| ks::scaled_distance(gaps.clone(), law(rate)));
        println!("KS {found:.2}, of a rate 5 % off {defect:.2} (alpha 1e-4: 2.23)");
        assert!(found < 2.23 && defect > 2.23);
    }

    #[test]
    fn gaps_are_distributed_as_those_of_rand_distr() {
        const RATE: f64 = 2e-4;
        let gap = |x: u16| PoissonTrain::new(site(x), DrawSpace::Shot).gap(RATE).unwrap();
        let ours: Vec<f64> = (0..u16::try_from(rival::N).unwrap()).map(gap).collect();
        rival::compare("exponential", &ours, &rival::theirs(&rand_distr::Exp::new(RATE).unwrap()), |t| {
            1.1 * t
        });
    }

    #[test]
    fn counts_are_distributed_as_those_of_rand_distr() {
        for mean in [0.5, 3.0, 20.0, 100.0] {
            // In two steps, of which the second continues the exposure that the first has left.
            let count = |x: u16| times(x, 1e6, 5e5, |_| mean * 1e-6).len() as f64;
            let ours: Vec<f64> = (0..u16::try_from(rival::N).unwrap()).map(count).collect();
            let theirs = rival::theirs(&rand_distr::Poisson::new(mean).unwrap());
            // One event of every count of 1, 5, 9, … is lost.
            let defect = |n: f64| if (n % 4.0 - 1.0).abs() < 0.5 { n - 1.0 } else { n };
            rival::compare(&format!("Poisson {mean}"), &ours, &theirs, defect);
        }
    }

    #[test]
    fn steps_do_not_show_where_the_rate_is_linear() {
        let rate = |t: f64| 1e-4 + 3e-10 * t;
        let whole = times(1, 1e6, 1e6, rate);
        for step in [1e5, 3125.0] {
            let cut = times(1, 1e6, step, rate);
            assert_eq!(whole.len(), cut.len());
            // The exposure reaches 250, where rounding is 3e-14 per step. The rate is at least
            // 1e-4.
            assert!(whole.iter().zip(&cut).all(|(a, b)| (a - b).abs() < 1e-6));
        }
    }

    #[test]
    fn a_rate_that_falls_to_nothing_makes_no_event_after_it() {
        let rates = LinearRate { ends: [1e-3, 0.0], length: 1e6 };
        let mut train = PoissonTrain::new(site(7), DrawSpace::Hot);
        let mut start = 0.0;
        let mut count = 0;
        while let Some(t) = train.advance(&rates, start) {
            assert!(t >= start && t <= 1e6);
            train.wait(site(7), DrawSpace::Hot);
            (start, count) = (t, count + 1);
        }
        // Poisson with mean 500.
        assert!((400..600).contains(&count), "{count}");
        assert_eq!(PoissonTrain::silent().advance(&rates, 0.0), None);
    }
}
