//! Times around the stamps of frames that do not count.

use std::ops::RangeInclusive;

/// The times from one to before another, relative to each stamp.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct StampMask {
    /// Strictly increasing.
    stamps_us: Vec<i64>,
    from_us: i64,
    to_us: i64,
}

impl StampMask {
    /// A mask from `from_us` to before `to_us` after each of the stamps, which increase strictly. Nothing is
    /// masked if the first is not before the second.
    #[must_use]
    pub fn new(stamps_us: Vec<i64>, [from_us, to_us]: [i64; 2]) -> Self {
        Self { stamps_us, from_us, to_us }
    }

    /// Whether a time does not count.
    #[must_use]
    pub fn contains(&self, us: i64) -> bool {
        // A stamp masks the time if it is at most `us - from` and above `us - to`.
        let below = |end: i64| self.stamps_us.partition_point(|stamp| *stamp <= end);
        below(us.saturating_sub(self.from_us)) > below(us.saturating_sub(self.to_us))
    }

    /// Length of a window without what is masked, seconds.
    #[must_use]
    pub fn seconds_of(&self, window_us: &RangeInclusive<i64>) -> f64 {
        let (first, last) = (*window_us.start(), *window_us.end());
        let (mut masked, mut until) = (0, first);
        for stamp in &self.stamps_us {
            // Masks of neighbouring stamps may overlap.
            let from = stamp.saturating_add(self.from_us).clamp(until, last.max(until));
            let to = stamp.saturating_add(self.to_us).clamp(from, last.max(from));
            masked += to - from;
            until = to;
        }
        (last - first - masked) as f64 * 1e-6
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_around_stamps_are_masked() {
        let mask = StampMask::new(vec![1000, 2000, 2010], [-100, 50]);
        let masked: Vec<i64> = (0..3000).filter(|us| mask.contains(*us)).collect();
        let wanted: Vec<i64> = (900..1050).chain(1900..2060).collect();
        assert_eq!(masked, wanted);
        let seconds = |window| (1e6 * mask.seconds_of(&window)).round();
        for (window, kept) in
            [(0..=3000, 2690.0), (950..=1950, 850.0), (1000..=1040, 0.0), (100..=600, 500.0)]
        {
            assert!((seconds(window.clone()) - kept).abs() < 1e-9, "{window:?}");
        }
        let none = StampMask::default();
        assert!(!none.contains(1000) && (none.seconds_of(&(0..=3000)) - 3e-3).abs() < 1e-12);
    }
}
