//! The grid on which the stamps of a stream lie, from their remainders.
//!
//! Distinct times are counted by their remainders of two moduli, whose divisors are the candidates:
//! powers of two, and the products of 2 and 5 up to 10,000 us. On a grid of `g` us, one remainder
//! of `g` has all stamps; without one, it has 1 of `g`. The limit is halfway. Other grids, such as
//! 3 us, are found by the greatest common divisor of all differences.

/// Moduli whose divisors are tried.
const MODULI: [u64; 2] = [1 << 14, 10_000];

/// The grid of a stream's stamps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StampGrid {
    /// Number of distinct times.
    pub stamps: u64,
    /// Step of the coarsest grid on which most of them lie, us; 1 without a grid.
    pub step_us: u64,
    /// Share of the times that lie on it.
    pub share: f64,
}

/// Counts distinct times, which come in order.
#[derive(Debug)]
pub(crate) struct GridCounter {
    stamps: u64,
    first_us: Option<i64>,
    last_us: i64,
    common: u64,
    remainders: [Vec<u64>; 2],
}

impl GridCounter {
    pub(crate) fn new() -> Self {
        let remainders = [0, 1].map(|i| vec![0; usize::try_from(MODULI[i]).expect("a small modulus")]);
        Self { stamps: 0, first_us: None, last_us: i64::MIN, common: 0, remainders }
    }

    /// Counts the time of an event; repeated times count once.
    #[expect(clippy::cast_possible_truncation, reason = "a remainder of a small modulus")]
    pub(crate) fn see(&mut self, t_us: i64) {
        if t_us == self.last_us && self.stamps > 0 {
            return;
        }
        self.last_us = t_us;
        let first = *self.first_us.get_or_insert(t_us);
        self.stamps += 1;
        self.common = divisor_of_both(self.common, t_us.abs_diff(first));
        for (modulus, counts) in MODULI.iter().zip(&mut self.remainders) {
            counts[t_us.rem_euclid(*modulus as i64).unsigned_abs() as usize] += 1;
        }
    }

    pub(crate) fn finish(&self) -> StampGrid {
        let none = StampGrid { stamps: self.stamps, step_us: 1, share: 1.0 };
        // All times, on a grid of any step.
        if self.stamps > 1 && self.common > 1 {
            return StampGrid { step_us: self.common, ..none };
        }
        let of = |(modulus, counts): (&u64, &Vec<u64>)| {
            let mut steps = (2..=*modulus).rev().filter(|step| modulus % step == 0);
            steps.find_map(|step| self.on_grid(counts, step))
        };
        let found = MODULI.iter().zip(&self.remainders).filter_map(of);
        found.max_by_key(|grid| grid.step_us).unwrap_or(none)
    }

    /// The grid of this step, if most stamps lie on it.
    fn on_grid(&self, counts: &[u64], step: u64) -> Option<StampGrid> {
        let classes = usize::try_from(step).expect("a divisor of a small modulus");
        let of = |class: usize| counts.iter().skip(class).step_by(classes).sum::<u64>();
        let most = (0..classes).map(of).max().unwrap_or(0);
        let share = most as f64 / self.stamps.max(1) as f64;
        let limit = f64::midpoint(1.0, 1.0 / step as f64);
        (share > limit).then_some(StampGrid { stamps: self.stamps, step_us: step, share })
    }
}

/// The greatest common divisor; that of 0 and a number is the number.
fn divisor_of_both(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { divisor_of_both(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planted::SplitMixDraws;

    fn grid(times: impl Iterator<Item = i64>) -> StampGrid {
        let mut times: Vec<i64> = times.collect();
        times.sort_unstable();
        let mut counter = GridCounter::new();
        times.into_iter().for_each(|t| counter.see(t));
        counter.finish()
    }

    fn draws(n: usize, seed: u64) -> impl Iterator<Item = i64> {
        let mut draws = SplitMixDraws(seed);
        (0..n).map(move |_| i64::try_from(draws.below(50_000)).unwrap())
    }

    #[test]
    fn rounded_times_lie_on_their_grid() {
        for step in [2, 3, 5, 8, 10, 100, 128, 250, 417, 1000] {
            let rounded = grid(draws(3000, 1).map(|t| t / step * step));
            assert_eq!(rounded.step_us, step.unsigned_abs(), "{rounded:?}");
            // A shift does not hide a grid.
            assert_eq!(grid(draws(3000, 1).map(|t| t / step * step + 7)).step_us, step.unsigned_abs());
        }
    }

    #[test]
    fn a_few_other_times_do_not_hide_a_grid() {
        let mixed = draws(3000, 1).enumerate().map(|(i, t)| if i % 20 == 0 { t } else { t / 100 * 100 });
        let found = grid(mixed);
        assert_eq!(found.step_us, 100, "{found:?}");
        assert!(found.share > 0.6, "{found:?}");
    }

    #[test]
    fn times_of_single_microseconds_have_no_grid() {
        for seed in 1..40 {
            let found = grid(draws(200, seed));
            assert_eq!(found.step_us, 1, "{found:?}");
        }
    }
}
