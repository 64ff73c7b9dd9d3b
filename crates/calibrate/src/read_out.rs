//! Events that the read-out of frames makes: bursts at one time after each stamp.

use crate::estimate::median;
use crate::recording::Recording;
use serde::Serialize;

/// Width of a bin, us.
const BIN_US: i64 = 100;
/// A burst has this many times the events of a typical bin, and this many standard deviations more.
const TIMES: f64 = 2.5;
const DEVIATIONS: f64 = 8.0;

/// A burst.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReadOut {
    /// `on` or `off`.
    pub polarity: &'static str,
    /// First and last time after the stamp of a frame, us.
    pub after_stamp_us: [i64; 2],
    /// Share of the events of this sign that are in excess there.
    pub share: f64,
}

/// The bursts of both signs.
pub(crate) fn read_out_bursts(recording: &Recording) -> Vec<ReadOut> {
    [(true, "on"), (false, "off")].into_iter().flat_map(|(on, name)| bursts(recording, on, name)).collect()
}

/// Whether a time lies in a burst of either sign: what rises at a read-out falls after it.
#[must_use]
pub fn is_at_read_out(us: i64, stamps_us: &[i64], bursts: &[ReadOut]) -> bool {
    if bursts.is_empty() {
        return false;
    }
    let before = stamps_us.partition_point(|stamp| *stamp <= us).checked_sub(1).map(|k| us - stamps_us[k]);
    before.is_some_and(|after| {
        bursts.iter().any(|burst| (burst.after_stamp_us[0]..burst.after_stamp_us[1]).contains(&after))
    })
}

fn bursts(recording: &Recording, on: bool, polarity: &'static str) -> Vec<ReadOut> {
    let stamps = &recording.stamps_us;
    let mut gaps: Vec<f64> = stamps.windows(2).map(|p| (p[1] - p[0]) as f64).collect();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a time between two frames")]
    let bins = (median(&mut gaps) as usize / 100).min(100_000);
    if bins < 20 {
        return Vec::new();
    }
    let mut counts = vec![0.0_f64; bins];
    for (us, _) in recording.trains.all().filter(|(_, sign)| *sign == on) {
        let frame = stamps.partition_point(|stamp| *stamp <= us);
        let Some(before) = frame.checked_sub(1).map(|k| stamps[k]) else { continue };
        let bin = usize::try_from((us - before) / BIN_US).unwrap_or(usize::MAX);
        if bin < bins && frame < stamps.len() {
            counts[bin] += 1.0;
        }
    }
    let typical = median(&mut counts.clone()).max(1.0);
    let all: f64 = counts.iter().sum();
    let is_high = |count: f64| count > TIMES * typical && count > typical + DEVIATIONS * typical.sqrt();
    let mut found: Vec<ReadOut> = Vec::new();
    for (bin, count) in counts.iter().enumerate().filter(|(_, count)| is_high(**count)) {
        let from = BIN_US * i64::try_from(bin).unwrap_or(0);
        let share = (count - typical) / all;
        match found.last_mut().filter(|last| last.after_stamp_us[1] == from) {
            Some(last) => {
                last.after_stamp_us[1] += BIN_US;
                last.share += share;
            }
            None => found.push(ReadOut { polarity, after_stamp_us: [from, from + BIN_US], share }),
        }
    }
    found.retain(|burst| burst.share > 0.003);
    found
}
