//! A limit on the lines that a run prints.

use std::collections::VecDeque;

/// Maximum number of lines within [`SPAN`] seconds.
const LINES: usize = 10;
const SPAN: f64 = 1.0;

/// The times of the last lines.
#[derive(Debug, Default)]
pub(super) struct LinePacing {
    printed: VecDeque<f64>,
}

impl LinePacing {
    /// Returns true if one more line may be shown at `now`, and counts it as shown. Times are in
    /// seconds from an arbitrary origin.
    pub(super) fn admits(&mut self, now: f64) -> bool {
        while self.printed.front().is_some_and(|then| now - then >= SPAN) {
            self.printed.pop_front();
        }
        let admits = self.printed.len() < LINES;
        if admits {
            self.printed.push_back(now);
        }
        admits
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ten_lines_a_second_whatever_comes() {
        let mut pace = LinePacing::default();
        // 8,001 steps that end within four seconds.
        let admitted: Vec<f64> =
            (0..=8000).map(|i| f64::from(i) / 2000.0).filter(|t| pace.admits(*t)).collect();
        assert!(admitted.windows(11).all(|w| w[10] - w[0] >= SPAN), "{admitted:?}");
        assert_eq!(admitted.len(), 41);
        assert_eq!(admitted[..3], [0.0, 0.0005, 0.001], "the first are shown at once");
    }

    #[test]
    fn slow_steps_are_all_shown() {
        let mut pace = LinePacing::default();
        assert!((0..100).all(|i| pace.admits(0.11 * f64::from(i))));
    }
}
