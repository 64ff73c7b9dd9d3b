//! The last lines of a build, and its exit code.

use crate::cli::{Console, ExitKind, UserMessage};
use gs2e_build::run::RunSummary;
use gs2e_store::EvictedFiles;

fn last_line(summary: &RunSummary, seconds: f64) -> String {
    let RunSummary { made, twice, adopted, kept, failures, unreached, interrupted, .. } = summary;
    if *interrupted {
        let finished = made + adopted + kept;
        let all = finished + failures.len() + unreached;
        return format!(
            "interrupted: {finished} of {all} steps are finished and kept; run the same command to continue"
        );
    }
    let noun = if *made == 1 { "step" } else { "steps" };
    let mut text = format!("{made} {noun} built, {kept} reused, {} failed", failures.len());
    if *adopted > 0 {
        text.push_str(&format!(", {adopted} from the shared store"));
    }
    if *twice > 0 {
        text.push_str(&format!(", {twice} built by another machine at the same time"));
    }
    if *unreached > 0 {
        text.push_str(&format!(", {unreached} not reached"));
    }
    format!("{text}; {seconds:.2} s")
}

/// Says how many files made room, if the size of the store has a bound.
pub(super) fn report_evicted(evicted: EvictedFiles, console: &Console) {
    let EvictedFiles { files, bytes } = evicted;
    if files > 0 {
        let size = bytes as f64 * 1e-6;
        console.note(&format!("{files} files ({size:.1} MB) made room: the shared store has them"));
    }
}

/// Prints the last line, and for programs the interruption of a run.
pub(in crate::cli) fn report_end(summary: &RunSummary, seconds: f64, console: &Console) {
    let line = last_line(summary, seconds);
    if summary.interrupted {
        console.result(&UserMessage::error("interrupted", line.as_str()).to_json());
    }
    if summary.confirmed > 0 {
        console.note(&format!("{} steps of the shared store rerun, each with its bytes", summary.confirmed));
    }
    if summary.rechecked > 0 {
        console.note(&format!("{} steps rerun, each with the recorded bytes", summary.rechecked));
    }
    console.note(&line);
}

pub(in crate::cli) fn exit_kind(summary: &RunSummary) -> ExitKind {
    // An interrupted run may have failures too; the interrupt decides.
    if summary.interrupted {
        ExitKind::Interrupted
    } else if summary.failures.is_empty() {
        ExitKind::Done
    } else {
        ExitKind::Failed
    }
}
