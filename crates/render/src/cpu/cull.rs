//! Outcomes of the projection, and their counts for each promise.

use super::activate::PROMISES;
use crate::RenderWork;

/// Outcome of a projection: drawn, or the reason why not. It is as wide as an `f32` lane.
pub(super) type Fate = u32;
/// The Gaussian is drawn.
pub(super) const DRAWN: Fate = 0;
/// See [`RenderWork::behind`].
pub(super) const BEHIND: Fate = 1;
/// See [`RenderWork::degenerate`].
pub(super) const DEGENERATE: Fate = 2;
/// See [`RenderWork::outside`].
pub(super) const OUTSIDE: Fate = 3;

/// Lanes of a block that a promise may see, if there was none: all.
pub(super) const ALL_LANES: u64 = u64::MAX;

/// Numbers of Gaussians by the reason why they are not drawn.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct CullCounts {
    /// As [`RenderWork::behind`].
    pub(super) behind: u64,
    /// As [`RenderWork::degenerate`].
    pub(super) degenerate: u64,
    /// As [`RenderWork::outside`].
    pub(super) outside: u64,
}

impl std::ops::AddAssign for CullCounts {
    fn add_assign(&mut self, o: Self) {
        self.behind += o.behind;
        self.degenerate += o.degenerate;
        self.outside += o.outside;
    }
}

impl CullCounts {
    /// `work` with these counts.
    pub(super) fn within(self, work: RenderWork) -> RenderWork {
        let Self { behind, degenerate, outside } = self;
        RenderWork { behind, degenerate, outside, ..work }
    }
}

/// Counts the culled lanes of a block for each promise. Bit `i` of a promise is that of lane `i`.
#[inline(always)]
pub(super) fn count_culled(fates: &[Fate], promised: [u64; PROMISES], culled: &mut [CullCounts; PROMISES]) {
    if promised == [ALL_LANES; PROMISES] {
        // The usual case. The sums are vector code.
        let count = |fate: Fate| fates.iter().map(|&f| u64::from(f == fate)).sum::<u64>();
        let counts =
            CullCounts { behind: count(BEHIND), degenerate: count(DEGENERATE), outside: count(OUTSIDE) };
        culled.iter_mut().for_each(|sum| *sum += counts);
        return;
    }
    let lanes = |fate: Fate| {
        let bit = |(i, f): (usize, &Fate)| u64::from(*f == fate) << i;
        fates.iter().enumerate().map(bit).fold(0, |all, bit| all | bit)
    };
    let [behind, degenerate, outside] = [BEHIND, DEGENERATE, OUTSIDE].map(lanes);
    for (sum, promised) in culled.iter_mut().zip(promised) {
        let count = |lanes: u64| u64::from((lanes & promised).count_ones());
        *sum += CullCounts { behind: count(behind), degenerate: count(degenerate), outside: count(outside) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_promise_counts_its_own_lanes() {
        // Lane 0 is drawn, 1 and 2 are behind, 3 is degenerate, 4 to 6 are outside.
        let fates = [DRAWN, BEHIND, BEHIND, DEGENERATE, OUTSIDE, OUTSIDE, OUTSIDE];
        let t = |promised: [u64; PROMISES], wanted: [[u64; 3]; PROMISES]| {
            let mut culled = [CullCounts::default(); PROMISES];
            count_culled(&fates, promised, &mut culled);
            let found = culled.map(|counts| [counts.behind, counts.degenerate, counts.outside]);
            assert_eq!(found, wanted, "{promised:?}");
        };
        t([ALL_LANES; 2], [[2, 1, 3]; 2]);
        t([ALL_LANES, 0b101_1011], [[2, 1, 3], [1, 1, 2]]);
        t([0b000_0001, 0b111_1110], [[0; 3], [2, 1, 3]]);
    }
}
