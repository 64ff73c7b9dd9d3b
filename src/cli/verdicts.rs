//! Findings at the end of a build: counts, and each finding that needs a person's attention.

use super::console::Console;
use super::message::{MessageLevel, UserMessage};
use super::problem::VerbError;
use gs2e_build::artifact::{Artifact, ArtifactFiles, VerdictsRecord};
use gs2e_build::plan::Plan;
use gs2e_build::plan::survey::SettledScene;
use gs2e_build::run::RunSummary;
use gs2e_build::stage::{checks, scene_checks};
use gs2e_check::{Finding, Verdict, advice};
use gs2e_store::Store;
use gs2e_store::record::StoredOutput;

/// Maximum number of findings that are shown one by one; a build of many scenes repeats itself.
const MAX_SHOWN: usize = 20;

/// The findings on a scene or on one of its trajectories, from the outputs of their step.
pub(super) fn findings_of_step(
    (scene, step): (&str, &str),
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

/// Findings on the trajectories and scenes that a run made or kept.
pub(super) fn findings_of_run(
    plan: &Plan,
    summary: &RunSummary,
    store: &Store,
) -> Result<Vec<Finding>, VerbError> {
    let mut findings = Vec::new();
    for (id, product) in &summary.products {
        let step = &plan.steps()[id.0];
        if [checks::NAME, scene_checks::NAME].contains(&step.step.stage()) {
            findings.extend(findings_of_step((plan.scene_of(step), &step.name), &product.outputs, store)?);
        }
    }
    Ok(findings)
}

/// Findings on scenes that were up to date without a plan.
pub(super) fn findings_of_settled(
    settled: &[SettledScene],
    store: &Store,
) -> Result<Vec<Finding>, VerbError> {
    let mut findings = Vec::new();
    for scene in settled {
        for step in &scene.steps {
            // The steps of both stages are named after them.
            if step.name == scene_checks::NAME || step.name.ends_with("/checks") {
                findings.extend(findings_of_step((&scene.scene, &step.name), &step.outputs, store)?);
            }
        }
    }
    Ok(findings)
}

/// Number of findings by verdict, as one line.
pub(super) fn count_line(findings: &[Finding]) -> String {
    let count = |verdict| findings.iter().filter(|f| f.verdict == verdict).count();
    format!(
        "{} pass, {} warn, {} fail, {} waived, {} not run",
        count(Verdict::Pass),
        count(Verdict::Warn),
        count(Verdict::Fail),
        count(Verdict::Waived),
        count(Verdict::NotRun)
    )
}

/// Says how many findings have each verdict.
pub(super) fn tell_count(findings: &[Finding], console: &Console) {
    if !findings.is_empty() {
        console.say(&format!("checks: {}; `gs2e check` lists them", count_line(findings)));
    }
}

/// Shows each warning, fault and accepted fault, with what to do about it. Returns the
/// number of warnings and faults.
pub(super) fn show_findings(findings: &[Finding], console: &Console) -> usize {
    if findings.is_empty() {
        return 0;
    }
    let rank = |finding: &&Finding| match finding.verdict {
        Verdict::Fail => 0,
        Verdict::Warn => 1,
        _ => 2,
    };
    let mut shown: Vec<&Finding> =
        findings.iter().filter(|f| !matches!(f.verdict, Verdict::Pass | Verdict::NotRun)).collect();
    shown.sort_by_key(rank);
    for (number, finding) in shown.iter().enumerate() {
        let message = to_message(finding);
        if console.json {
            console.result(&message.to_json());
        }
        // A quiet build shows failures only.
        if number < MAX_SHOWN && (!console.quiet || finding.verdict == Verdict::Fail) {
            console.show(&message);
        }
    }
    if shown.len() > MAX_SHOWN {
        console.say(&format!("and {} more findings", shown.len() - MAX_SHOWN));
    }
    shown.iter().filter(|finding| finding.verdict != Verdict::Waived).count()
}

fn to_message(finding: &Finding) -> UserMessage {
    let level = if finding.verdict == Verdict::Fail { MessageLevel::Error } else { MessageLevel::Warning };
    let accepted = if finding.verdict == Verdict::Waived { " (waived by the recipe)" } else { "" };
    let Finding { check, subject, because, .. } = finding;
    let message = UserMessage::new(level, "check", format!("{subject}: {check}: {because}{accepted}"));
    let unit = if finding.unit == "1" { String::new() } else { format!(" {}", finding.unit) };
    let value = |value: f64| format!("{}{unit}", short_number(value));
    let message = match (finding.measured, finding.limit) {
        (Some(measured), Some(limit)) => {
            message.detail(format!("measured {}, limit {}", value(measured), value(limit)))
        }
        (Some(measured), None) => message.detail(format!("measured {}", value(measured))),
        _ => message,
    };
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
