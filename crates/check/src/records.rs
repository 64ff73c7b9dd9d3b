//! Files of a release that say the same thing agree. A gate, which applies to a release only.
//!
//! Poses, time stamps, transforms and speeds follow from each other; counts, durations and
//! intrinsics are stated in several files; the index, the catalogue entry, card and report repeat
//! them; a blurred frame is the mean of the sharp frames of its exposure. A file that was edited
//! without the others contradicts them, even if all sums were computed again.

pub mod exposure;
pub mod inertial;
pub mod objects;

use super::subject::{Judgement, LimitSide};
use super::{Finding, Verdict};
use exposure::ExposureMismatch;

/// Name of the check.
pub const NAME: &str = "records";

/// Largest share of the values of a blurred frame beyond their bound, where the frames between the
/// kept ones are unknown.
const BLUR_SHARE: f64 = 0.01;

/// The finding on files of one kind: their faults, one sentence each. `what` names the files.
#[must_use]
pub fn judge_agreement(subject: &str, statement: &str, what: &str, faults: &[String]) -> Finding {
    let because = match faults {
        [] => format!("{what} agree with the other files"),
        [fault] => fault.clone(),
        [fault, others @ ..] => format!("{fault}; and {} more faults of this kind", others.len()),
    };
    Judgement::none_of(faults.len() as f64, "faults", because).finding(subject, NAME, statement)
}

/// The finding on the blurred frames of a trajectory: the worst of those that were compared.
#[must_use]
pub fn judge_blur(subject: &str, compared: &[(usize, ExposureMismatch)]) -> Finding {
    let worst = compared.iter().max_by(|a, b| a.1.share.total_cmp(&b.1.share));
    let Some((pose, mismatch)) = worst else {
        return blur_not_compared(subject, "no exposure has all of its frames in the release");
    };
    // A mean of kept frames is exact to rounding at every value.
    let limit = LimitSide::gate(if mismatch.is_exact { 0.0 } else { BLUR_SHARE });
    let because = format!(
        "a share of {:.4} of the values of blur/{pose:06}.png, the worst of {}, differs from the mean of its sharp \
         frames by more than {}; the largest difference is {:.2} steps of 8 bits",
        mismatch.share,
        compared.len(),
        if mismatch.is_exact { "rounding" } else { "rounding and the motion between them" },
        mismatch.worst
    );
    Judgement::at_most(mismatch.share, limit, "1", because).finding(subject, NAME, "blur")
}

/// The finding on blurred frames that could not be compared.
#[must_use]
pub fn blur_not_compared(subject: &str, because: &str) -> Finding {
    Judgement::not_run(because).finding(subject, NAME, "blur")
}

/// The finding on a release without scenes.
#[must_use]
pub fn no_scenes(release: &str) -> Finding {
    let because = "manifest.json lists no scene, so there is nothing to check".to_owned();
    Judgement::without_value(Verdict::Fail, "1", because).finding(release, NAME, "scenes")
}
