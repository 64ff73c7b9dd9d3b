//! Draws of a training: pure functions of the seed and the place where they are used, so a resumed
//! training draws what an uninterrupted one draws.

use gs2e_num::seed::{CellDraws, DrawSpace, Seed, SeedCell};

/// Purposes, as columns of the cells.
const ORDER: u16 = 0;
const PLACEMENT: u16 = 1;
const START: u16 = 2;

/// All draws of a training.
#[derive(Debug, Clone, Copy)]
pub(super) struct TrainingDraws {
    seed: Seed,
    /// Iteration of a placement.
    iteration: u32,
}

impl TrainingDraws {
    pub(super) fn new(seed: Seed) -> Self {
        Self { seed, iteration: 0 }
    }

    fn cell(&self, purpose: u16, index: u64) -> CellDraws {
        self.seed.draws(SeedCell { x: purpose, y: 0, level: 0, index }, DrawSpace::Choice)
    }

    /// The draws of the placement after an iteration.
    pub(super) fn placement(&self, iteration: u32) -> Self {
        Self { iteration, ..*self }
    }

    /// The draw of a Gaussian in a placement, strictly between 0 and 1.
    pub(super) fn of_gaussian(&self, i: usize) -> f64 {
        // 24 bits for the Gaussian and 32 for the iteration fill the 56 bits of an index.
        let index = u64::from(self.iteration) << 24 | (i as u64 & ((1 << 24) - 1));
        self.cell(PLACEMENT, index).uniform()
    }

    /// The draws of the start.
    pub(super) fn start(&self, index: u64) -> CellDraws {
        self.cell(START, index)
    }

    /// The view of an iteration: every round shows each of `views` views once.
    pub(super) fn view(&self, iteration: u32, views: usize) -> usize {
        let (round, place) = (iteration as usize / views, iteration as usize % views);
        let mut draws = self.cell(ORDER, round as u64);
        let mut order: Vec<usize> = (0..views).collect();
        // Fisher and Yates, as far as the place.
        for i in 0..=place {
            order.swap(i, i + draws.index(views - i));
        }
        order[place]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_round_shows_each_view_once() {
        let draws = TrainingDraws::new(Seed(3));
        let mut orders = Vec::new();
        for round in 0..20 {
            let order: Vec<usize> = (0..9).map(|i| draws.view(9 * round + i, 9)).collect();
            let mut sorted = order.clone();
            sorted.sort_unstable();
            assert_eq!(sorted, (0..9).collect::<Vec<_>>());
            orders.push(order);
        }
        orders.sort();
        orders.dedup();
        // 20 of 362,880 orders: two equal ones have a chance of 1 in 1,900.
        assert_eq!(orders.len(), 20);
    }
}
