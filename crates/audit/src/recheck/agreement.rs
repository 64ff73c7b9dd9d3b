//! The agreement of the files of a release, as findings.

use crate::AuditFault;
use crate::contradictions::find_contradictions;
use gs2e_check::{Finding, records};
use gs2e_release::manifest::{ManifestScene, ReleaseManifest};
use gs2e_release::{croissant, index};
use std::collections::BTreeSet;
use std::io;
use std::path::Path;

/// Kinds of files of a trajectory, each with the statement and the files that it names.
const OF_TRAJECTORY: [(&str, &str); 3] = [
    ("poses", "poses.txt, timestamps_us.txt, transforms.json and speed.json"),
    ("events", "the counts, size, order and times of the events"),
    ("pictures", "the pictures, by number, size and form,"),
];
/// The kind of files of a scene.
const OF_SCENE: (&str, &str) = ("description", "scene.json and the steps of manifest.json");
/// Kinds of files at the top of the release.
const OF_RELEASE: [(&str, &str); 3] = [
    ("index", "the rows of index.parquet"),
    ("catalogue", "the statements of croissant.json"),
    ("documents", "card, report, data sheet, loader and licences"),
];

/// Returns one finding per kind of file of the scenes that are `wanted`. The files of the whole
/// release are compared if all scenes are. The files of the pictures in `composed` are known to be what
/// this program writes for them.
///
/// # Errors
/// The folder cannot be listed.
pub(super) fn compare_files(
    dir: &Path,
    manifest: &ReleaseManifest,
    wanted: &dyn Fn(&str) -> bool,
    composed: &BTreeSet<String>,
) -> io::Result<Vec<Finding>> {
    Ok(judge_faults(manifest, wanted, &find_contradictions(dir, manifest, wanted, composed)?))
}

/// The findings on files with these faults.
pub(super) fn judge_faults(
    manifest: &ReleaseManifest,
    wanted: &dyn Fn(&str) -> bool,
    faults: &[AuditFault],
) -> Vec<Finding> {
    let mut findings = Vec::new();
    for scene in manifest.scenes.iter().filter(|scene| wanted(&scene.id)) {
        let own: Vec<&AuditFault> =
            faults.iter().filter(|fault| fault.scene.as_deref() == Some(&scene.id)).collect();
        for trajectory in trajectories(scene) {
            let subject = format!("{}/{trajectory}", scene.id);
            let of_trajectory = OF_TRAJECTORY.iter().map(|(statement, what)| {
                let is_of = |fault: &&AuditFault| place(scene, fault) == (Some(trajectory), *statement);
                finding(&subject, statement, what, own.iter().copied().filter(is_of))
            });
            findings.extend(of_trajectory);
        }
        let is_of = |fault: &&AuditFault| place(scene, fault).0.is_none();
        findings.push(finding(&scene.id, OF_SCENE.0, OF_SCENE.1, own.iter().copied().filter(is_of)));
    }
    if manifest.scenes.iter().all(|scene| wanted(&scene.id)) {
        findings.extend(OF_RELEASE.iter().map(|(statement, what)| {
            let is_of = |fault: &&AuditFault| fault.scene.is_none() && top_statement(fault) == *statement;
            finding(&manifest.name, statement, what, faults.iter().filter(is_of))
        }));
    }
    findings
}

fn finding<'f>(
    subject: &str,
    statement: &str,
    what: &str,
    faults: impl Iterator<Item = &'f AuditFault>,
) -> Finding {
    let sentence = |fault: &AuditFault| match &fault.file {
        Some(file) => format!("{file}: {}", fault.message),
        None => fault.message.clone(),
    };
    records::judge_agreement(subject, statement, what, &faults.map(sentence).collect::<Vec<_>>())
}

/// The trajectories of a scene: the folders of poses that its steps made.
fn trajectories(scene: &ManifestScene) -> impl Iterator<Item = &str> {
    scene.steps.iter().filter_map(|step| step.step.strip_suffix("/trajectory"))
}

/// The trajectory and the kind of file that a fault concerns.
fn place<'s>(scene: &'s ManifestScene, fault: &AuditFault) -> (Option<&'s str>, &'static str) {
    let below = fault.file.as_deref().and_then(|file| file.strip_prefix(&scene.id)?.strip_prefix('/'));
    let found = below.and_then(|file| {
        let of =
            trajectories(scene).filter_map(|name| Some((name, file.strip_prefix(name)?.strip_prefix('/')?)));
        // The cameras of a rig lie below their body.
        of.max_by_key(|(name, _)| name.len())
    });
    match found {
        None => (None, OF_SCENE.0),
        Some((name, file)) if file.starts_with("events") => (Some(name), "events"),
        // The findings that the release carries describe all files of the trajectory.
        Some((_, "checks.json")) => (None, OF_SCENE.0),
        Some((name, file)) if file.contains('/') => (Some(name), "pictures"),
        Some((name, _)) => (Some(name), "poses"),
    }
}

fn top_statement(fault: &AuditFault) -> &'static str {
    match fault.file.as_deref() {
        Some(index::NAME) => "index",
        Some(croissant::NAME) => "catalogue",
        _ => "documents",
    }
}
