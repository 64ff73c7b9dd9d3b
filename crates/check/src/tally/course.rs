//! Events of each polarity by time.

use gs2e_num::units::Hertz;

/// Shortest bin, us.
const BIN_US: i64 = 1000;
/// Maximum number of bins: the end is a claim of a file.
const MOST: i64 = 1 << 22;

/// Numbers of events in bins of equal length, from the first stamp to the last.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EventCourse {
    /// Length of a bin, us: a millisecond, or the interval of the frames if that is longer.
    pub bin_us: i64,
    /// ON and OFF events of each bin.
    pub bins: Vec<[u32; 2]>,
}

impl EventCourse {
    /// Bins from 0 to `end_us`, without events.
    #[expect(clippy::cast_possible_truncation, reason = "an interval of time, saturating")]
    #[expect(clippy::cast_sign_loss, reason = "at most MOST")]
    pub(super) fn new(rate: Hertz, end_us: i64) -> Self {
        let interval = (1e6 / rate.to_f64()).ceil() as i64;
        let bin_us = BIN_US.max(interval).max(end_us / MOST + 1);
        // The last bin ends with the stamps, or it is left out: a part of a bin has fewer events.
        Self { bin_us, bins: vec![[0; 2]; (end_us / bin_us).max(0) as usize] }
    }

    /// Counts ON and OFF events of a microsecond.
    pub(super) fn count(&mut self, t_us: i64, events: [u32; 2]) {
        let bin = usize::try_from(t_us.div_euclid(self.bin_us)).ok();
        if let Some(bin) = bin.and_then(|bin| self.bins.get_mut(bin)) {
            bin.iter_mut().zip(events).for_each(|(all, new)| *all += new);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rate(text: &str) -> Hertz {
        Hertz(text.parse().unwrap())
    }

    #[test]
    fn events_are_counted_by_millisecond_and_polarity() {
        let mut course = EventCourse::new(rate("2400"), 2500);
        let (on, off) = ([1, 0], [0, 1]);
        [(-1, on), (0, on), (999, off), (1000, off), (2400, on)]
            .into_iter()
            .for_each(|(t_us, events)| course.count(t_us, events));
        assert_eq!(course, EventCourse { bin_us: 1000, bins: vec![[1, 1], [0, 1]] });
    }

    #[test]
    fn slow_frames_and_long_streams_have_longer_bins() {
        assert_eq!(EventCourse::new(rate("30"), 1_000_000).bin_us, 33_334);
        assert!(EventCourse::new(rate("2400"), i64::MAX).bins.len() <= 1 << 22);
        assert_eq!(EventCourse::new(rate("2400"), 0).bins.len(), 0);
    }
}
