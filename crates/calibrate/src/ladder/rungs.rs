//! The ladder itself, for a person to look at.

use super::{BLACK, DARKEST, LAG, Ladder};
use serde::Serialize;

/// Highest rung of the ladder.
const RUNGS: usize = 8;

/// Neighbouring anchors with one change of the counts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Rung {
    /// Change of the ON events less the OFF events, with the shares of the next event.
    pub net: i32,
    /// Mean change of the logarithm of the grey, with the lag taken out.
    pub ln: f64,
    /// Its standard error.
    pub se: f64,
    /// Number of pairs.
    pub pairs: usize,
}

impl Ladder<'_> {
    /// The ladder: changes of the logarithm of the grey against changes of the counts.
    pub(super) fn rungs(&self) -> Vec<Rung> {
        let mut sums = vec![[0.0_f64; 3]; 2 * RUNGS + 1];
        for stretch in self.stretches.iter().filter(|s| s.used) {
            for k in stretch.first + 1..stretch.last {
                let [a, b] = [k - 1, k].map(|k| &self.anchors[k]);
                let greys = [a, b].map(|anchor| anchor.grey - self.value[BLACK]);
                if greys.iter().any(|grey| *grey < 2.0 * DARKEST) {
                    continue;
                }
                let net = (b.steps[0] - b.steps[1]) - (a.steps[0] - a.steps[1]);
                let lead = |k: usize| {
                    let anchor = &self.anchors[k];
                    let share = self.lag_share(self.expected[k]);
                    self.value[LAG] * share * self.contrast(anchor, &stretch.own) * anchor.rate
                };
                let ln = libm::log(greys[1] / greys[0]) - lead(k) + lead(k - 1);
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "within the ladder"
                )]
                let place = (net.round() + RUNGS as f64).clamp(0.0, 2.0 * RUNGS as f64) as usize;
                if net.abs() < RUNGS as f64 {
                    [1.0, ln, ln * ln].iter().zip(&mut sums[place]).for_each(|(v, sum)| *sum += v);
                }
            }
        }
        let rung = |(place, [n, sum, square]): (usize, [f64; 3])| {
            let mean = sum / n;
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count")]
            let pairs = n as usize;
            let net = i32::try_from(place).unwrap_or(0) - i32::try_from(RUNGS).unwrap_or(0);
            (n > 9.0).then(|| Rung {
                net,
                ln: mean,
                se: ((square / n - mean * mean).max(0.0) / n).sqrt(),
                pairs,
            })
        };
        sums.into_iter().enumerate().filter_map(rung).collect()
    }
}
