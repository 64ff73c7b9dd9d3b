//! Programs that recipes name. A recipe may come from a stranger, so none of its programs runs
//! unless the user allows it.

use super::{CommonArgs, ExitKind, UserMessage, VerbError};
use gs2e_build::plan::Plan;
use gs2e_build::plan::assess::{StepAction, StepAssessment};
use gs2e_build::stage::Stage as _;
use gs2e_build::stage::reconstruct::ReconstructStage;
use std::collections::BTreeMap;

/// Maximum number of commands shown; the rest are counted.
const MAX_LISTED: usize = 20;
/// Maximum number of scenes named with a command.
const MAX_SCENES: usize = 3;

/// Refuses a plan with a step that would or may run a program, unless the user allows it. Nothing
/// has run at that point.
pub(super) fn refuse_commands(
    plan: &Plan,
    assessed: &[StepAssessment],
    common: &CommonArgs,
) -> Result<(), VerbError> {
    if common.allow_commands {
        return Ok(());
    }
    // Many scenes usually share one command; each command is shown once, with its scenes.
    let mut scenes: BTreeMap<Vec<String>, Vec<&str>> = BTreeMap::new();
    for (step, _) in plan.steps().iter().zip(assessed).filter(|(_, a)| a.action != StepAction::Keep) {
        let programs = step.step.facts().programs();
        if !programs.is_empty() {
            scenes.entry(programs).or_default().push(plan.scene_of(step));
        }
    }
    if scenes.is_empty() { Ok(()) } else { Err(VerbError::new(ExitKind::Usage, refusal_message(&scenes))) }
}

/// The message about refused commands, each with its scenes.
fn refusal_message(scenes: &BTreeMap<Vec<String>, Vec<&str>>) -> UserMessage {
    let count: usize = scenes.values().map(Vec::len).sum();
    let new = |what: String| UserMessage::error("command-refused", format!("{what}; nothing was run"));
    if let (Some((programs, of)), 1) = (scenes.first_key_value(), count) {
        let what = format!("{}/{STEP} would run a program that the recipe names", of[0]);
        return new(what).step(of[0], STEP).quote(programs).help(HELP);
    }
    let mut message = new(format!("{count} scenes would run programs that their recipes name"));
    for (programs, of) in scenes.iter().take(MAX_LISTED) {
        message = message.detail(format!("for {}", quoted_names(of))).quote(programs);
    }
    if scenes.len() > MAX_LISTED {
        message = message.detail(format!("and {} other commands", scenes.len() - MAX_LISTED));
    }
    message.help(HELP)
}

/// The message about a step that was not allowed to run programs while other steps ran.
pub(super) fn refused_step(scene: &str, step: &str, programs: &[String]) -> UserMessage {
    let what = format!("{scene}/{step} would run a program that the recipe names; it was not run");
    UserMessage::error("command-refused", what).step(scene, step).quote(programs).help(HELP)
}

/// The only step that runs programs.
const STEP: &str = ReconstructStage::NAME;
const HELP: &str = "if you trust it, run the same command with --allow-commands";

fn quoted_names(scenes: &[&str]) -> String {
    let listed = scenes.iter().take(MAX_SCENES).copied().collect::<Vec<_>>().join(", ");
    match scenes.len().saturating_sub(MAX_SCENES) {
        0 => listed,
        more => format!("{listed} and {more} more"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_told_once_each_with_their_scenes() {
        let command = |n: usize| vec![format!("trainer --version {n:02}"), format!("trainer {n:02}")];
        let names: Vec<String> = (0..30).map(|n| format!("s{n}")).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let found = |scenes: &[(usize, &[&str])]| {
            refusal_message(&scenes.iter().map(|(n, of)| (command(*n), of.to_vec())).collect())
                .to_lines()
                .join("\n")
        };
        let wanted = "error: s0/reconstruct would run a program that the recipe names; nothing was run\n   trainer \
                      --version 07\n   trainer 07\nhelp: if you trust it, run the same command with --allow-commands";
        assert_eq!(found(&[(7, &names[..1])]), wanted);
        let several = found(&[(1, &names[..3]), (2, &names[3..9])]);
        assert!(several.starts_with("error: 9 scenes would run programs"), "{several}");
        assert!(several.contains(
            "\n for s0, s1, s2\n   trainer --version 01\n   trainer 01\n for s3, s4, s5 and 3 more\n"
        ));
        let many: Vec<(usize, &[&str])> = (0..25).map(|n| (n, &names[n..=n])).collect();
        let many = found(&many);
        assert_eq!((many.matches("\n for ").count(), many.contains("\n and 5 other commands\n")), (20, true));
    }
}
