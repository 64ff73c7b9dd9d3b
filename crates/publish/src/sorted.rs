//! Scenes of a release by whether they may be in it.

use super::ReleaseError;
use super::compose::JudgedScene;
use gs2e_check::{Finding, Verdict};
use gs2e_release::built::{BuiltScene, GatherError};
use gs2e_release::held_back::HeldBackScene;

/// The scenes that are built, and those that are not, which only a partial release may lack.
pub(super) fn part_unbuilt<'a>(
    gathered: impl Iterator<Item = Result<BuiltScene<'a>, GatherError>>,
    partial: bool,
) -> Result<(Vec<BuiltScene<'a>>, Vec<HeldBackScene>), GatherError> {
    let (mut built, mut unbuilt) = (Vec::new(), Vec::new());
    for scene in gathered {
        match scene {
            Ok(scene) => built.push(scene),
            Err(GatherError::NotBuilt { scene: id, step }) if partial => {
                unbuilt.push(HeldBackScene { id, checks: Vec::new(), unbuilt: Some(step) });
            }
            Err(error) => return Err(error),
        }
    }
    Ok((built, unbuilt))
}

/// The scenes of a release, and those that are held back, sorted by id.
pub(super) struct SortedScenes<'a> {
    pub(super) sound: Vec<JudgedScene<'a>>,
    pub(super) held_back: Vec<HeldBackScene>,
}

impl<'a> SortedScenes<'a> {
    /// Sorts scenes by their findings. If the release is not `partial`, or nothing is sound, a
    /// scene to hold back is an error.
    pub(super) fn sort(
        judged: Vec<JudgedScene<'a>>,
        unbuilt: Vec<HeldBackScene>,
        partial: bool,
    ) -> Result<Self, ReleaseError> {
        let (mut sound, mut held_back) = (Vec::new(), unbuilt);
        for judged in judged {
            let checks = failed_checks(&judged.scene);
            if checks.is_empty() {
                sound.push(judged);
            } else {
                let id = judged.scene.recipe.scene.clone();
                held_back.push(HeldBackScene { id, checks, unbuilt: None });
            }
        }
        held_back.sort_by(|a, b| a.id.cmp(&b.id));
        if held_back.is_empty() || (partial && !sound.is_empty()) {
            return Ok(Self { sound, held_back });
        }
        Err(refusal(held_back, sound.len()))
    }
}

fn failed_checks(scene: &BuiltScene<'_>) -> Vec<Finding> {
    scene.findings().filter(|finding| finding.verdict == Verdict::Fail).cloned().collect()
}

fn refusal(held_back: Vec<HeldBackScene>, sound: usize) -> ReleaseError {
    let unbuilt = held_back.iter().find_map(|scene| Some((scene.id.clone(), scene.unbuilt.clone()?)));
    let failed: Vec<Finding> = held_back.into_iter().flat_map(|scene| scene.checks).collect();
    match unbuilt {
        Some((scene, step)) if failed.is_empty() => GatherError::NotBuilt { scene, step }.into(),
        _ => ReleaseError::Checks { failed, sound },
    }
}

/// The number of failed checks, with the first of them: `1 check failed (recon_psnr of lab/a)`.
pub(super) fn failure_line(failed: &[Finding]) -> String {
    const NAMED: usize = 3;
    let mut named: Vec<String> = Vec::new();
    for finding in failed {
        let name = format!("{} of {}", finding.check, finding.subject.place);
        // A check may make several statements on a subject.
        if !named.contains(&name) {
            named.push(name);
        }
    }
    let noun = if named.len() == 1 { "check" } else { "checks" };
    let more = match named.len().saturating_sub(NAMED) {
        0 => String::new(),
        more => format!(", and {more} more"),
    };
    format!("{} {noun} failed ({}{more})", named.len(), named[..named.len().min(NAMED)].join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_check::FindingSubject;

    #[test]
    fn a_failure_names_checks_and_scenes_once() {
        let finding = |check: &str, place: &str, statement: &str| Finding {
            check: check.into(),
            subject: FindingSubject::new(place, statement),
            verdict: Verdict::Fail,
            measured: None,
            limit: None,
            unit: "1".into(),
            because: String::new(),
            detects: None,
        };
        let one = [finding("polarity", "lab/a", "x"), finding("polarity", "lab/a", "y")];
        assert_eq!(failure_line(&one), "1 check failed (polarity of lab/a)");
        let many = ["a", "b", "c", "d", "e"].map(|place| finding("motion", place, ""));
        assert_eq!(
            failure_line(&many),
            "5 checks failed (motion of a, motion of b, motion of c, and 2 more)"
        );
    }
}
