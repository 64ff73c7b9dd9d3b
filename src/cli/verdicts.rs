//! Findings at the end of a build: counts, and each finding that needs a person's attention.

use super::build::StepOutputs;
use super::{Console, UserMessage, VerbError};
use gs2e_build::artifact::{Artifact, ArtifactFiles, VerdictsRecord};
use gs2e_check::{Finding, Verdict, advice};
use gs2e_store::Store;
use gs2e_store::record::StoredOutput;

/// Maximum number of findings that are shown one by one; a build of many scenes repeats itself.
const MAX_LISTED: usize = 20;

/// The findings on a scene or on one of its trajectories, from the outputs of their step.
pub(super) fn findings_of_step(
    scene: &str,
    step: &str,
    outputs: &[StoredOutput],
    store: &Store,
) -> Result<Vec<Finding>, VerbError> {
    let verdicts = VerdictsRecord::open(&ArtifactFiles::from_outputs(outputs, store))
        .map_err(|e| VerbError::failed("unreadable", format!("failed to {e}")).step(scene, step))?;
    Ok(match step.rsplit_once('/') {
        Some((trajectory, _)) => verdicts.findings_of(scene, trajectory),
        None => verdicts.findings_of_scene(scene),
    })
}

/// Findings on the trajectories and scenes among these steps, and the numbers of others that are known to
/// have passed and not to have run.
pub(super) fn findings_of_steps(
    steps: &[StepOutputs<'_>],
    store: &Store,
) -> Result<(Vec<Finding>, [usize; 2]), VerbError> {
    let (mut findings, mut sound) = (Vec::new(), [0; 2]);
    for StepOutputs { scene, step, outputs, sound: known } in steps {
        match known {
            Some(known) => sound.iter_mut().zip(known).for_each(|(all, known)| *all += known),
            None if VerdictsRecord::is_of(step) => {
                findings.extend(findings_of_step(scene, step, outputs, store)?);
            }
            None => {}
        }
    }
    Ok((findings, sound))
}

/// Number of findings by verdict, as one line. `sound` are further ones that passed and that were not run.
pub(super) fn count_line(findings: &[Finding], sound: [usize; 2]) -> String {
    let verdicts = [Verdict::Pass, Verdict::Warn, Verdict::Fail, Verdict::Waived, Verdict::NotRun];
    let [pass, warn, fail, waived, not_run] =
        verdicts.map(|verdict| findings.iter().filter(|f| f.verdict == verdict).count());
    let [pass, not_run] = [pass + sound[0], not_run + sound[1]];
    format!("{pass} pass, {warn} warn, {fail} fail, {waived} waived, {not_run} not run")
}

/// Says how many findings have each verdict. See [`count_line`].
pub(super) fn report_count(findings: &[Finding], sound: [usize; 2], console: &Console) {
    if !findings.is_empty() || sound != [0; 2] {
        console.note(&format!("checks: {}; `gs2e check` lists them", count_line(findings, sound)));
    }
}

/// Shows each warning, fault and accepted fault, with what to do about it. Returns the
/// number of warnings and faults.
pub(super) fn report_findings(findings: &[Finding], console: &Console) -> usize {
    let rank = |finding: &&Finding| match finding.verdict {
        Verdict::Fail => 0,
        Verdict::Warn => 1,
        _ => 2,
    };
    let mut listed: Vec<&Finding> =
        findings.iter().filter(|f| !matches!(f.verdict, Verdict::Pass | Verdict::NotRun)).collect();
    listed.sort_by_key(rank);
    for (number, finding) in listed.iter().enumerate() {
        let message = to_message(finding);
        console.result(&message.to_json());
        // A quiet build shows failures only.
        if number < MAX_LISTED && (!console.quiet || finding.verdict == Verdict::Fail) {
            console.report_to_people(&message);
        }
    }
    if listed.len() > MAX_LISTED {
        console.note(&format!("and {} more findings", listed.len() - MAX_LISTED));
    }
    listed.iter().filter(|finding| finding.verdict != Verdict::Waived).count()
}

fn to_message(finding: &Finding) -> UserMessage {
    let new = if finding.verdict == Verdict::Fail { UserMessage::error } else { UserMessage::warning };
    let accepted = if finding.verdict == Verdict::Waived { " (waived by the recipe)" } else { "" };
    let Finding { check, subject, because, .. } = finding;
    let message = new("check", format!("{subject}: {check}: {because}{accepted}"));
    let unit = if finding.unit == "1" { String::new() } else { format!(" {}", finding.unit) };
    let value = |value: f64| format!("{}{unit}", short_number(value));
    let limit = finding.limit.map_or_else(String::new, |limit| format!(", limit {}", value(limit)));
    let measured = finding.measured.map(|measured| format!("measured {}{limit}", value(measured)));
    let message = message.details(measured);
    if finding.verdict == Verdict::Waived { message } else { message.help(advice(check)) }
}

/// A number with about four digits.
pub(super) fn short_number(value: f64) -> String {
    if value == 0.0 || (1e-3..1e5).contains(&value.abs()) {
        let text = format!("{value:.4}");
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        format!("{value:.3e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_four_digits() {
        let t = |value, wanted: &str| assert_eq!(short_number(value), wanted);
        t(0.0, "0");
        t(16.374_21, "16.3742");
        t(-0.5, "-0.5");
        t(2.5e-7, "2.500e-7");
        t(1e9, "1.000e9");
    }
}
