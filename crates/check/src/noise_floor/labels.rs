//! Labels of events against the noise that the sensor states. A gate, from the files of a release.
//!
//! - A pixel that is hot makes as many noise events as its rate gives, with the scatter of a count. The rates
//!   of a recipe are known by its seed. A dead time takes some of them, so up to 30 % may be missing.
//! - At the other pixels, noise makes at most the number of events that thresholds, leak, voltage noise and
//!   floor allow. Twice that number may be labelled so, and one event in twenty: brightness that turns before
//!   it has moved by half of a threshold leaves the rest to noise.
//! - A pixel that sees no change has noise events only. One in ten may be a signal, where a still pixel has
//!   moved by a tenth of a threshold.
//!
//! Each number has an allowance of five standard deviations, and is judged from a hundred events on. The
//! statement is the worst of the three, as a share of its limit: it finds labels that are inverted, or all
//! equal. A readout of limited rate loses events of unknown labels, so nothing is stated there.

use crate::TrajectorySubject;
use crate::subject::{Judgement, JudgementResult, LimitSide};
use crate::tally::LabelCounts;

/// Largest share of the events of hot pixels without the label of noise.
const MISSING: f64 = 0.3;
/// Factor of the expected noise, and share of other events, that may have the label of noise.
const EXCESS: f64 = 2.0;
const STRAY: f64 = 0.05;
/// Largest share of the events of still pixels with the label of a signal.
const STILL: f64 = 0.1;
/// Minimum number of events for a share.
const MIN_EVENTS: f64 = 100.0;
const DEVIATIONS: f64 = 5.0;

/// A share of wrong labels: the words, the share, its limit, and the number of events.
struct WrongShare {
    what: &'static str,
    share: f64,
    limit: f64,
    of: f64,
}

impl WrongShare {
    fn new(what: &'static str, wrong: f64, of: f64, limit: f64) -> Self {
        Self { what, share: wrong / of, limit: limit + DEVIATIONS / of.sqrt(), of }
    }

    fn fault(&self) -> f64 {
        self.share / self.limit
    }
}

fn shares(counts: &LabelCounts) -> [WrongShare; 3] {
    let count = |number: u64| number as f64;
    let others = count(counts.others[0] + counts.others[1]);
    let stray = EXCESS * counts.most_noise / others + STRAY;
    [
        WrongShare::new(
            "of the events that hot pixels make lack the label of noise",
            (counts.expected_hot - count(counts.hot[0])).max(0.0),
            counts.expected_hot,
            MISSING,
        ),
        WrongShare::new(
            "of the events of other pixels have the label of noise",
            count(counts.others[0]),
            others,
            stray,
        ),
        WrongShare::new(
            "of the events of pixels without a change have the label of a signal",
            count(counts.still[1]),
            count(counts.still[0] + counts.still[1]),
            STILL,
        ),
    ]
}

/// The statement on the labels; `None` if the events have none, or are compared by other means.
pub(super) fn judge_labels(subject: &TrajectorySubject<'_>) -> Option<JudgementResult> {
    let counts = subject.tally?.labels.as_ref()?;
    if subject.sensor.is_some_and(|sensor| sensor.readout().is_some()) {
        let because = "not applicable behind a readout of limited rate: it loses events of unknown labels";
        return Some(Err(because.to_owned()));
    }
    let enough = shares(counts).into_iter().filter(|share| share.of >= MIN_EVENTS);
    let Some(worst) = enough.max_by(|a, b| a.fault().total_cmp(&b.fault())) else {
        return Some(Err(format!("fewer than {MIN_EVENTS} events have a known label")));
    };
    let limit = LimitSide::gate(worst.limit);
    let because =
        format!("{:.4} {}; at most {:.4} of {:.0} may", worst.share, worst.what, worst.limit, worst.of);
    Some(Ok(Judgement::at_most(worst.share, limit, "1", because)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The words of the worst share, if it is beyond its limit.
    fn fault(counts: &LabelCounts) -> Option<&'static str> {
        let shares = shares(counts).into_iter().filter(|share| share.of >= MIN_EVENTS && share.fault() > 1.0);
        shares
            .max_by(|a, b| a.fault().total_cmp(&b.fault()))
            .map(|worst| worst.what.split(' ').nth(4).unwrap())
    }

    #[test]
    fn labels_that_are_inverted_or_all_equal_are_found() {
        let sound = LabelCounts {
            hot: [410, 30],
            still: [0, 0],
            others: [3, 9000],
            expected_hot: 400.0,
            most_noise: 0.0,
        };
        assert_eq!(fault(&sound), None);
        let turned = |[a, b]: [u64; 2]| [b, a];
        let LabelCounts { hot, others, .. } = sound;
        assert_eq!(fault(&LabelCounts { hot: turned(hot), others: turned(others), ..sound }), Some("other"));
        assert_eq!(fault(&LabelCounts { hot: [0, 440], others: [0, 9003], ..sound }), Some("hot"));
        let noisy = LabelCounts { still: [300, 5], others: [900, 9000], most_noise: 600.0, ..sound };
        assert_eq!(fault(&noisy), None);
        assert_eq!(
            fault(&LabelCounts { still: [0, 305], others: [0, 9900], expected_hot: 0.0, ..noisy }),
            Some("pixels")
        );
    }
}
