//! Expected bytes of products: by earlier steps of their kind, and by the length of their paths.

use super::Plan;
use super::past::PastCosts;
use crate::stage::trajectory::TrajectoryStage;
use crate::stage::{ExpectedSize, PathLength, Stage as _};

/// Ratio between an earlier size and the expected one from which on the path must have another length.
const UNLIKE: f64 = 2.0;

/// For each step of a plan, the expected bytes of its product, from the resources that it or its kind used
/// before, if they are known. `None` if neither these nor its parameters state a size.
#[must_use]
pub fn expected_bytes(plan: &Plan, past: &[Option<PastCosts>]) -> Vec<Option<f64>> {
    let mut paths: Vec<Option<PathLength>> = Vec::new();
    let mut found = Vec::new();
    for (planned, past) in plan.steps().iter().zip(past) {
        let step = &planned.step;
        // A trajectory that is drawn from another one has a length of its own.
        let inherits = step.stage() != TrajectoryStage::NAME;
        let of_input = || step.inputs().iter().filter(|_| inherits).find_map(|(_, input)| paths[input.0]);
        let path = step.facts().path_length().or_else(of_input);
        found.push(combined(past.as_ref(), path.and_then(|path| step.facts().expected_size(path))));
        paths.push(path);
    }
    found
}

fn combined(past: Option<&PastCosts>, expected: Option<ExpectedSize>) -> Option<f64> {
    let (Some(past), Some(expected)) = (past, expected) else {
        return past.map(|past| past.bytes).or_else(|| expected?.bytes);
    };
    match (expected.pictures, expected.bytes) {
        // Pictures of one kind differ less in size than their estimate does from them.
        (Some(pictures), _) if past.pictures > 0.0 => Some(past.bytes * pictures / past.pictures),
        (None, Some(bytes)) if past.bytes * UNLIKE < bytes || past.bytes > bytes * UNLIKE => Some(bytes),
        _ => Some(past.bytes),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_earlier_size_counts_as_far_as_its_path_was_alike() {
        let past = |bytes, pictures| PastCosts { bytes, pictures, ..PastCosts::default() };
        let expected = |bytes, pictures| ExpectedSize { pictures, bytes, a_pixel: 0.0 };
        let t = |past: Option<PastCosts>, expected, wanted: Option<f64>| {
            assert_eq!(combined(past.as_ref(), expected), wanted);
        };
        t(None, None, None);
        t(Some(past(70.0, 0.0)), None, Some(70.0));
        t(None, Some(expected(Some(90.0), None)), Some(90.0));
        t(None, Some(expected(None, Some(3.0))), None);
        // Pictures of 10 bytes.
        t(Some(past(70.0, 7.0)), Some(expected(Some(900.0), Some(14.0))), Some(140.0));
        t(Some(past(70.0, 7.0)), Some(expected(None, Some(1.0))), Some(10.0));
        // Text, whose lines differ little in length.
        t(Some(past(70.0, 0.0)), Some(expected(Some(90.0), None)), Some(70.0));
        t(Some(past(70.0, 0.0)), Some(expected(Some(9000.0), None)), Some(9000.0));
        t(Some(past(7000.0, 0.0)), Some(expected(Some(90.0), None)), Some(90.0));
    }
}
