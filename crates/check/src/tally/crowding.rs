//! Pairs of events of one window that share a cell of the sensor.

use gs2e_image::Size;

/// Number of windows of a stream. They are short, so that an edge moves little within one.
const WINDOWS: i64 = 100;
/// Side of a cell, px. A pixel seldom fires twice in a short window; the pixels along an edge all
/// fire.
const CELL: u32 = 4;

/// Sums over the windows.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CrowdingSums {
    /// Ordered pairs of events that share window and cell.
    pub pairs: f64,
    /// Expected number of these pairs for uniformly distributed events: `N (N - 1) / cells`.
    pub anywhere: f64,
    /// Variance of the pairs for uniformly distributed events: `2 N (N - 1) / cells`, that of
    /// `N^2 / 2` pairs that share a cell with probability `1 / cells` and count twice.
    pub variance: f64,
}

impl CrowdingSums {
    /// The event structural ratio relative to that of a stream without structure; NaN without
    /// events.
    #[must_use]
    pub fn ratio(&self) -> f64 {
        (self.pairs / self.anywhere).sqrt()
    }

    /// Standard deviation of [`CrowdingSums::ratio`] for a stream without structure: half of that
    /// of its square.
    #[must_use]
    pub fn noise(&self) -> f64 {
        0.5 * self.variance.sqrt() / self.anywhere
    }
}

/// Counts the pairs of a stream.
#[derive(Debug)]
pub(super) struct CrowdingCounter {
    end_us: i64,
    columns: usize,
    window: i64,
    events: u64,
    pairs: u64,
    counts: Vec<u32>,
    sums: CrowdingSums,
}

impl CrowdingCounter {
    pub(super) fn new(size: Size, end_us: i64) -> Self {
        let [columns, rows] = [size.width, size.height].map(|side| side.div_ceil(CELL) as usize);
        let (counts, sums) = (vec![0; columns * rows], CrowdingSums::default());
        // A clip of one frame has no duration to divide by.
        Self { end_us: end_us.max(1), columns, window: 0, events: 0, pairs: 0, counts, sums }
    }

    /// Begins with the events of a microsecond.
    pub(super) fn enter(&mut self, t_us: i64) {
        // Events outside of the clip count to its first or last window.
        let window = (t_us * WINDOWS / self.end_us).clamp(0, WINDOWS - 1);
        if window != self.window {
            self.settle();
            self.window = window;
        }
    }

    pub(super) fn see(&mut self, [x, y]: [u16; 2]) {
        let [column, row] = [x, y].map(|v| (u32::from(v) / CELL) as usize);
        let count = &mut self.counts[row * self.columns + column];
        // Ordered pairs: the new event and each earlier one of its cell, both ways.
        self.pairs += 2 * u64::from(*count);
        *count += 1;
        self.events += 1;
    }

    pub(super) fn finish(mut self) -> CrowdingSums {
        self.settle();
        self.sums
    }

    fn settle(&mut self) {
        let (n, cells) = (self.events as f64, self.counts.len() as f64);
        let anywhere = n * (n - 1.0) / cells;
        self.sums.pairs += self.pairs as f64;
        self.sums.anywhere += anywhere;
        self.sums.variance += 2.0 * anywhere;
        (self.events, self.pairs) = (0, 0);
        self.counts.fill(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planted::SplitMixDraws;

    const SIZE: Size = Size { width: 100, height: 80 };

    fn crowding(pixels: impl Iterator<Item = u16>) -> CrowdingSums {
        let mut crowds = CrowdingCounter::new(SIZE, 1000);
        for (i, pixel) in pixels.enumerate() {
            crowds.enter(i as i64 * 1000 / 40_000);
            crowds.see([pixel % 100, pixel / 100]);
        }
        crowds.finish()
    }

    #[test]
    fn events_anywhere_have_no_structure_and_events_on_half_of_the_sensor_have() {
        let mut draws = SplitMixDraws(3);
        let anywhere: Vec<u16> = (0..40_000).map(|_| draws.at(8000)).collect();
        let found = crowding(anywhere.iter().copied());
        let z = (found.ratio() - 1.0) / found.noise();
        println!("ratio {:.4}, z {z:.2}", found.ratio());
        assert!(z.abs() < 4.5);
        // On the upper half, there are twice as many pairs.
        let half = crowding(anywhere.iter().map(|pixel| pixel / 2));
        assert!((half.ratio() - 2f64.sqrt()).abs() < 6.0 * found.noise() * 2f64.sqrt(), "{}", half.ratio());
    }

    #[test]
    fn no_event_has_no_ratio() {
        assert!(crowding(std::iter::empty()).ratio().is_nan());
    }
}
