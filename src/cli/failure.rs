//! Messages about failed steps: each is printed at once, and all are printed again at the end.

use super::problem::{FULL, stage_failed, unplanned_message};
use super::{UserMessage, commands};
use gs2e_build::run::StepError;
use gs2e_build::stage::StageError;
use gs2e_files::programs::ProgramFailure;
use gs2e_num::units::format_amount;
use gs2e_store::record::{StepProvenance, StepRecord, content_digest};
use gs2e_store::space::DiskSpace;
use gs2e_store::{OutputMismatch, SharedMismatch, StoreError};

/// A step, and the progress of the run.
#[derive(Debug, Clone, Copy)]
pub(super) struct StepPlace<'a> {
    pub(super) scene: &'a str,
    pub(super) step: &'a str,
    /// Number of steps that are finished and kept.
    pub(super) finished: usize,
    pub(super) all: usize,
}

/// The message about a failed step.
pub(super) fn failure_message(at: StepPlace<'_>, error: &StepError) -> UserMessage {
    let StepPlace { scene, step, .. } = at;
    let new = |code, what: String| UserMessage::error(code, what).step(scene, step);
    match error {
        StepError::Plan(error) => unplanned_message(error),
        StepError::Moved(_) => new("input-moved", format!("{scene}/{step}: {error}"))
            .help("run again when the file no longer changes"),
        StepError::Stage(StageError::Refused { programs }) => commands::refused_step(scene, step, programs),
        StepError::Stage(StageError::Program(error)) => command_failed(scene, step, error),
        StepError::Stage(error) => stage_failed("step-failed", scene, step, error)
            .help("fix it and run the same command: finished steps are kept"),
        StepError::Full { wrote, space, cause } => {
            new("disk-full", disk_full(at, *wrote, space.as_ref())).because(cause).help(FULL)
        }
        StepError::Store(StoreError::Nondeterministic(sides)) => {
            let what = format!("{scene}/{step}: the same inputs produced different bytes");
            let lost = if sides.replaced { "was lost, the new one is kept" } else { "is kept" };
            mismatch_message(new("nondeterministic", what), sides)
                .help(format!("the first output {lost}; gs2e why {scene}/{step} shows the inputs"))
        }
        StepError::Store(StoreError::SharedMismatch(sides)) => {
            shared_mismatch(new("nondeterministic", format!("{scene}/{step}: {sides}")), sides)
        }
        StepError::Store(error) => new("store", format!("{scene}/{step}: failed {error}")),
    }
}

/// A record of the shared store that this machine contradicts.
fn shared_mismatch(message: UserMessage, sides: &SharedMismatch) -> UserMessage {
    let StepProvenance { tool, seconds, threads, .. } = &sides.first.provenance;
    message
        .detail(format!("record: {} (gs2e {tool}, {seconds:.1} s, {threads} threads)", sides.record()))
        .help(
            "build --recheck 1 on a third machine shows which of them is wrong; if it is the record, delete that \
             file and run the same command",
        )
}

/// The message about a program that a step ran: how it ended, and its last lines.
fn command_failed(scene: &str, step: &str, error: &ProgramFailure) -> UserMessage {
    let ProgramFailure { program, command, how, last, log } = error;
    let what = format!("{scene}/{step}: {program} failed: {how}");
    let printed = if last.is_empty() { "it printed nothing" } else { "its last output:" };
    let message = UserMessage::error("command-failed", what).step(scene, step).path(log);
    let message = message.detail(format!("command: {command}")).detail(printed).quote(last);
    message.help("the file above has its full output; finished steps are kept")
}

fn disk_full(at: StepPlace<'_>, wrote: u64, space: Option<&DiskSpace>) -> String {
    let StepPlace { scene, step, finished, all } = at;
    let room = space.map_or(String::new(), |space| {
        let kind = if space.kind.is_empty() { String::new() } else { format!(" ({})", space.kind) };
        format!(", {} free on {}{kind}", format_amount(space.free, "B"), space.mount.display())
    });
    let wrote = format_amount(wrote, "B");
    format!(
        "no space for {scene}/{step}: wrote {wrote}{room}; {finished} of {all} steps are finished and kept"
    )
}

/// Both sides of a step that is not deterministic, and the first difference.
fn mismatch_message(message: UserMessage, sides: &OutputMismatch) -> UserMessage {
    let side = |name: &str, record: &StepRecord| {
        let StepProvenance { tool, seconds, threads, .. } = &record.provenance;
        let digest = content_digest(&record.outputs);
        let plural = if *threads == 1 { "" } else { "s" };
        format!("{name}: {digest} (gs2e {tool}, {seconds:.1} s, {threads} thread{plural})")
    };
    let message = message
        .detail(format!("key: {}", sides.now.key))
        .detail(side("before", &sides.before))
        .detail(side("now", &sides.now));
    message.details(sides.first.iter().map(|place| format!("first difference: {place}")))
}

/// The lines about the failed steps at the end, by scene, each with the command that explains the
/// step. `options` are the options with which the command finds the recipes and the store.
pub(super) fn retry_commands(failed: &[UserMessage], options: &str) -> Vec<String> {
    let mut sorted: Vec<(&str, &str, &str)> = failed.iter().map(UserMessage::step_and_what).collect();
    // The sort is stable: steps of one scene keep the order in which they failed.
    sorted.sort_by_key(|(scene, ..)| *scene);
    let mut lines = vec!["failed:".to_owned()];
    for of_scene in sorted.chunk_by(|a, b| a.0 == b.0) {
        lines.push(format!(" {}", of_scene[0].0));
        for (scene, step, what) in of_scene {
            lines.push(format!("  {what}"));
            lines.push(format!("  for details: gs2e why {scene}/{step}{options}"));
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_store::{Digest, Key};

    #[test]
    fn a_full_disk_is_told_with_its_figures() {
        let at = StepPlace { scene: "a/b", step: "base/events", finished: 812, all: 8001 };
        let t = |free, kind: &str, wanted: &str| {
            let space = DiskSpace { free, mount: "/data".into(), kind: kind.into() };
            assert_eq!(disk_full(at, 1_210_000_000, Some(&space)), wanted);
        };
        let end = "; 812 of 8001 steps are finished and kept";
        let begin = "no space for a/b/base/events: wrote 1.2 GB, ";
        t(0, "ext4", &format!("{begin}0 B free on /data (ext4){end}"));
        t(52_000, "", &format!("{begin}52.0 kB free on /data{end}"));
        assert_eq!(disk_full(at, 0, None), format!("no space for a/b/base/events: wrote 0 B{end}"));
    }

    #[test]
    fn a_step_that_is_not_deterministic_is_told_with_both_sides() {
        let key = Key(Digest::of_bytes(b"key"));
        let record = |tool: &str, seconds, threads| {
            let provenance =
                StepProvenance { tool: tool.into(), seconds, threads, ..StepProvenance::default() };
            StepRecord::new(key, "events", Vec::new(), provenance)
        };
        let (before, now) = (record("0.1.0", 3.06, 8), record("0.2.0", 2.0, 1));
        let none = content_digest(&[]);
        let sides =
            OutputMismatch { before, now, replaced: false, first: Some("events.h5 at byte 7".into()) };
        let at = StepPlace { scene: "a", step: "base/events", finished: 0, all: 1 };
        let wanted = format!(
            "error: a/base/events: the same inputs produced different bytes\n key: {key}\n before: {none} \
             (gs2e 0.1.0, 3.1 s, 8 threads)\n now: {none} (gs2e 0.2.0, 2.0 s, 1 thread)\n first difference: \
             events.h5 at byte 7\nhelp: the first output is kept; gs2e why a/base/events shows the \
             inputs"
        );
        let error = StepError::Store(StoreError::Nondeterministic(Box::new(sides)));
        assert_eq!(failure_message(at, &error).to_lines().join("\n"), wanted);
    }

    #[test]
    fn failures_are_told_again_by_scene() {
        let message = |text: &str| UserMessage::error("step-failed", text);
        let failed = ["b/x", "a/y", "b/w"].map(|name| {
            let (scene, step) = name.split_once('/').unwrap();
            message(&format!("{name}: failed to please")).step(scene, step)
        });
        let wanted = "failed:\n a\n  a/y: failed to please\n  for details: gs2e why a/y -q\n b\n  b/x: failed \
                      to please\n  for details: gs2e why b/x -q\n  b/w: failed to please\n  for details: gs2e \
                      why b/w -q";
        assert_eq!(retry_commands(&failed, " -q").join("\n"), wanted);
    }
}
