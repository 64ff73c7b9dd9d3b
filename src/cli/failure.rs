//! What is told of steps that failed: each at once, and all of them again at the end.

use super::message::{Level, Message};
use super::problem::{FULL, stage_failed, unplanned};
use crate::run::StepError;
use crate::store::record::{Provenance, Record, content};
use crate::store::space::Space;
use crate::store::{Digest, Store, StoreError};
use crate::units::amount;
use std::fs::File;
use std::io::{BufReader, Read};

/// A step and how far the run is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place<'a> {
    pub(super) scene: &'a str,
    pub(super) step: &'a str,
    /// Steps that are finished and kept.
    pub(super) finished: usize,
    pub(super) all: usize,
}

/// What is told of a step that failed.
pub(super) fn failed(at: Place<'_>, error: &StepError, store: &Store) -> Message {
    let Place { scene, step, .. } = at;
    let new = |code, what: String| Message::new(Level::Error, code, what).step(scene, step);
    match error {
        StepError::Plan(error) => unplanned(error),
        StepError::Moved(_) => {
            new("input-moved", format!("{scene}/{step}: {error}")).help("run again when it is at rest")
        }
        StepError::Stage(error) => stage_failed("step-failed", scene, step, error)
            .help("mend it and run the same command: what is finished is kept"),
        StepError::Full { wrote, space, cause } => {
            new("disk-full", full(at, *wrote, space.as_ref())).because(cause).help(FULL)
        }
        StepError::Store(StoreError::Nondeterministic { before, now, replaced }) => {
            let kept =
                if *replaced { "the first was lost, and this takes its place" } else { "the first is kept" };
            unlike(new("nondeterministic", unlike_what(at)), before, now, store)
                .help(format!("{kept}; gs2e why {scene}/{step} shows what it was made from"))
        }
        StepError::Store(error) => new("store", format!("{scene}/{step}: failed {error}")),
    }
}

fn full(at: Place<'_>, wrote: u64, space: Option<&Space>) -> String {
    let Place { scene, step, finished, all } = at;
    let room = space.map_or(String::new(), |space| {
        let kind = if space.kind.is_empty() { String::new() } else { format!(" ({})", space.kind) };
        format!(", {} free on {}{kind}", amount(space.free, "B"), space.mount.display())
    });
    let wrote = amount(wrote, "B");
    format!(
        "no space for {scene}/{step}: wrote {wrote}{room}; {finished} of {all} steps are finished and kept"
    )
}

fn unlike_what(at: Place<'_>) -> String {
    format!("{}/{}: other bytes than before from the same inputs", at.scene, at.step)
}

/// Both sides of a step that is not deterministic, and where they part.
fn unlike(message: Message, before: &Record, now: &Record, store: &Store) -> Message {
    let side = |name: &str, record: &Record| {
        let Provenance { tool, seconds, threads, .. } = &record.provenance;
        let digest = content(&record.outputs);
        format!("{name}: {digest} (gs2e {tool}, {seconds:.1} s, {threads} threads)")
    };
    let message =
        message.detail(format!("key: {}", now.key)).detail(side("before", before)).detail(side("now", now));
    match first_difference(before, now, store) {
        Some(place) => message.detail(format!("first difference: {place}")),
        None => message,
    }
}

/// The first file, by name, that one side lacks or has with other bytes.
fn first_difference(before: &Record, now: &Record, store: &Store) -> Option<String> {
    let find = |record: &Record, name: &str| {
        record.outputs.iter().find(|output| output.name == name).map(|output| output.digest)
    };
    let mut names: Vec<&str> = before.outputs.iter().chain(&now.outputs).map(|o| o.name.as_str()).collect();
    names.sort_unstable();
    let name = names.into_iter().find(|name| find(before, name) != find(now, name))?;
    Some(match (find(before, name), find(now, name)) {
        (Some(before), Some(now)) => match first_offset(store, [before, now]) {
            Ok(offset) => format!("{name} at byte {offset}"),
            Err(e) => format!("{name}, which cannot be read: {e}"),
        },
        (Some(_), None) => format!("{name}, which was not made now"),
        _ => format!("{name}, which was not made before"),
    })
}

/// The offset of the first byte that differs; the length of the shorter one where it is the beginning of the other.
fn first_offset(store: &Store, blobs: [Digest; 2]) -> std::io::Result<u64> {
    let open = |digest: &Digest| File::open(store.path_of(digest)).map(|file| BufReader::new(file).bytes());
    let [mut before, mut now] = [open(&blobs[0])?, open(&blobs[1])?];
    let mut offset = 0;
    loop {
        match (before.next().transpose()?, now.next().transpose()?) {
            (Some(a), Some(b)) if a == b => offset += 1,
            _ => return Ok(offset),
        }
    }
}

/// The steps that failed once more, by scene, each with the command that looks closer. `failed` holds scene, step and
/// message; `options` is what the command needs to find them.
pub(super) fn again(failed: &[(String, String, Message)], options: &str) -> String {
    let mut sorted: Vec<&(String, String, Message)> = failed.iter().collect();
    // Steps of one scene keep the order in which they failed.
    sorted.sort_by(|a, b| a.0.cmp(&b.0));
    let mut lines = vec![format!("failed:")];
    let mut last = None;
    for (scene, step, message) in sorted {
        if last != Some(scene) {
            lines.push(format!(" {scene}"));
        }
        last = Some(scene);
        lines.push(format!("  {}", message.what()));
        lines.push(format!("  look closer: gs2e why {scene}/{step}{options}"));
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_told_with_its_figures() {
        let at = Place { scene: "a/b", step: "base/events", finished: 812, all: 8001 };
        let t = |free, kind: &str, wanted: &str| {
            let space = Space { free, mount: "/data".into(), kind: kind.into() };
            assert_eq!(full(at, 1_210_000_000, Some(&space)), wanted);
        };
        let end = "; 812 of 8001 steps are finished and kept";
        let begin = "no space for a/b/base/events: wrote 1.2 GB, ";
        t(0, "ext4", &format!("{begin}0 B free on /data (ext4){end}"));
        t(52_000, "", &format!("{begin}52.0 kB free on /data{end}"));
        assert_eq!(full(at, 0, None), format!("no space for a/b/base/events: wrote 0 B{end}"));
    }

    #[test]
    fn failures_are_told_again_by_scene() {
        let message = |text: &str| Message::new(Level::Error, "step-failed", text);
        let failed = ["b/x", "a/y", "b/w"].map(|name| {
            let (scene, step) = name.split_once('/').unwrap();
            (scene.to_owned(), step.to_owned(), message(&format!("{name}: failed to please")))
        });
        let wanted = "failed:\n a\n  a/y: failed to please\n  look closer: gs2e why a/y -q\n b\n  b/x: failed \
                      to please\n  look closer: gs2e why b/x -q\n  b/w: failed to please\n  look closer: gs2e \
                      why b/w -q";
        assert_eq!(again(&failed, " -q"), wanted);
    }
}
