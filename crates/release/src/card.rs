//! `README.md` of a release, the dataset card: contents, use, making and terms. Every number in it
//! is computed.

mod conventions;
mod files;
pub mod head;
mod licences;
mod making;
mod scenes;

use super::facts::{FileCounts, ReleaseFacts};
use super::markdown::plain_text;
use super::published::PublishedScene;
use super::scene::TrajectoryPart;
use gs2e_check::Verdict;
use std::fmt::Write as _;

/// Composes the card.
pub(super) fn compose_card(facts: &ReleaseFacts<'_>) -> String {
    let (scenes, info) = (facts.scenes, facts.info);
    let mut text = head::card_head(facts);
    for section in [
        card_introduction(facts),
        files::files_section(facts),
        files::loading_section(facts),
        conventions::conventions_section(facts),
        making::making_section(facts),
        checks_section(scenes),
        held_back_section(facts),
        scenes::splits_section(facts),
        format!("## Limits\n\n{}\n", facts.provenance().limits()),
        licences::licences_section(facts),
        scenes::removal_section(info),
        licences::citation_section(facts),
    ] {
        if !section.is_empty() {
            text.push('\n');
            text.push_str(&section);
        }
    }
    text
}

fn built_trajectories(scenes: &[PublishedScene]) -> impl Iterator<Item = (&PublishedScene, &TrajectoryPart)> {
    scenes.iter().flat_map(|scene| scene.file.trajectories.iter().map(move |part| (scene, part)))
}

fn card_introduction(facts: &ReleaseFacts<'_>) -> String {
    let info = facts.info;
    let mut text = format!("# {} {}\n\n", plain_text(&info.name), plain_text(&info.version));
    if !info.description.is_empty() {
        let _ = writeln!(text, "{}\n", plain_text(&info.description));
    }
    let FileCounts { scenes, trajectories, withheld, .. } = facts.counts();
    let what = match facts.provenance().has_events() {
        true => "Synthetic event-camera streams with exact poses",
        false => "Camera paths with exact poses",
    };
    let _ = writeln!(
        text,
        "{what}: {scenes} scene(s), {trajectories} trajectory(ies), {}. {} `DATASHEET.md` has more.",
        facts.contents(),
        facts.provenance().collection()
    );
    if withheld > 0 {
        let _ = writeln!(
            text,
            "\nThe release has only recipe, poses and reports of {withheld} scene(s): see the licences."
        );
    }
    if facts.taken_down > 0 {
        let _ = writeln!(text, "\n{} scene(s) were removed on request.", facts.taken_down);
    }
    text
}

/// The scenes that are held back, with the reasons; empty for a whole release.
fn held_back_section(facts: &ReleaseFacts<'_>) -> String {
    if facts.held_back.is_empty() {
        return String::new();
    }
    let mut text = String::from(
        "## Held back\n\nThis release is partial. These scenes have recipes, and are not in it:\n\n",
    );
    for scene in facts.held_back {
        let because = plain_text(&scene.reasons().join("; "));
        let _ = writeln!(text, "- {}: {because}", plain_text(&scene.id));
    }
    text
}

fn checks_section(scenes: &[PublishedScene]) -> String {
    let mut text = String::from("## Checks\n\n");
    let findings: Vec<_> = scenes.iter().flat_map(PublishedScene::all_findings).collect();
    let count = |verdict| findings.iter().filter(|f| f.verdict == verdict).count();
    let _ = writeln!(
        text,
        "{} passed, {} warned, {} waived, {} not run. Findings that are not a pass:\n",
        count(Verdict::Pass),
        count(Verdict::Warn),
        count(Verdict::Waived),
        count(Verdict::NotRun)
    );
    for finding in findings.iter().filter(|f| f.verdict != Verdict::Pass) {
        // Names of photos and the reasons for waivers are texts of users.
        let [subject, because] =
            [finding.subject.to_string(), finding.because.clone()].map(|text| plain_text(&text));
        let _ = writeln!(text, "- {} `{}` {subject}: {because}", finding.verdict.name(), finding.check);
    }
    if findings.iter().all(|f| f.verdict == Verdict::Pass) {
        text.push_str("- none\n");
    }
    if scenes.iter().any(|scene| scene.findings.is_some()) {
        text.push_str(PHOTOGRAPHED);
    }
    text
}

/// Place of the findings on photos.
const PHOTOGRAPHED: &str = "
`<scene>/checks.json` has the findings on the capture of a scene from photos, and on its renderings at the poses where \
the photos were taken.
";
