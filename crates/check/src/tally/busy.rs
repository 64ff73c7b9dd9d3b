//! Distribution of events over the pixels.

/// Standard deviations above the mean, and multiples of the count that all but one pixel in a
/// thousand have, beyond which a pixel is hot.
const DEVIATIONS: f64 = 5.0;
const MULTIPLE: f64 = 5.0;

/// Statistics of the events per pixel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BusyPixels {
    /// Mean.
    pub mean: f64,
    /// Number of events above which a pixel is hot.
    pub bound: u32,
    /// Number of hot pixels.
    pub hot: u64,
    /// Number of events of the busiest pixel.
    pub most: u32,
}

impl BusyPixels {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "counts, rounded down")]
    pub(super) fn from_counts(mut counts: Vec<u32>) -> Self {
        let Some(most) = counts.iter().copied().max() else { return Self::default() };
        let n = counts.len() as f64;
        let mean = counts.iter().map(|n| f64::from(*n)).sum::<f64>() / n;
        let variance =
            counts.iter().map(|n| (f64::from(*n) - mean) * (f64::from(*n) - mean)).sum::<f64>() / n;
        // The count that all but one in a thousand pixels do not exceed. It is at least one, so
        // that single events of a sparse stream are not hot.
        let at = counts.len() - 1 - counts.len() / 1000;
        let (_, quantile, _) = counts.select_nth_unstable(at);
        let quantile = f64::from((*quantile).max(1));
        let bound = (mean + DEVIATIONS * variance.sqrt()).max(MULTIPLE * quantile) as u32;
        let hot = counts.iter().filter(|n| **n > bound).count() as u64;
        Self { mean, bound, hot, most }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_far_above_all_others_is_hot() {
        let mut counts: Vec<u32> = (0..10_000).map(|i| i % 11).collect();
        let found = BusyPixels::from_counts(counts.clone());
        assert_eq!((found.hot, found.most, found.bound), (0, 10, 50));
        counts[77] = 51;
        counts[78] = 50;
        assert_eq!(
            (BusyPixels::from_counts(counts.clone()).hot, BusyPixels::from_counts(counts).most),
            (1, 51)
        );
    }

    #[test]
    fn single_events_of_a_sparse_stream_are_not_hot() {
        let mut counts = vec![0; 10_000];
        counts[..5].fill(1);
        assert_eq!(BusyPixels::from_counts(counts).hot, 0);
        assert_eq!(BusyPixels::from_counts(Vec::new()), BusyPixels::default());
    }
}
