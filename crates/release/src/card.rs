//! `README.md` of a release, the dataset card: contents, use, making and terms. Every number in it
//! is computed.

mod conventions;
mod files;
pub mod head;
mod making;

use super::facts::ReleaseFacts;
use super::markdown::{self, breaks_line, markup, plain_text};
use super::published::PublishedScene;
use super::scene::TrajectoryPart;
use gs2e_check::Verdict;
use gs2e_files::escape;
use gs2e_recipe::ReleaseInfo;
use gs2e_source::licence::Redistributability;
use minijinja::{Value, context};

/// Composes the card.
pub(super) fn compose_card(facts: &ReleaseFacts<'_>) -> String {
    let scenes = facts.scenes;
    let values = context! {
        ..head::head_values(facts), ..files::files_values(facts), ..conventions::conventions_values(scenes),
        ..making::making_values(scenes), ..checks_values(scenes), ..terms_values(facts), ..facts.values(),
    };
    markdown::render(include_str!("templates/card.md.jinja"), values)
}

fn built_trajectories(scenes: &[PublishedScene]) -> impl Iterator<Item = (&PublishedScene, &TrajectoryPart)> {
    scenes.iter().flat_map(|scene| scene.file.trajectories.iter().map(move |part| (scene, part)))
}

fn checks_values(scenes: &[PublishedScene]) -> Value {
    let findings: Vec<_> = scenes.iter().flat_map(PublishedScene::all_findings).collect();
    let count = |verdict| findings.iter().filter(|f| f.verdict == verdict).count();
    // Names of photos and the reasons for waivers are texts of users.
    let faults = findings.iter().filter(|f| f.verdict != Verdict::Pass).map(|f| {
        [markup(f.verdict.name()), markup(&f.check), f.subject.to_string().into(), Value::from(&f.because)]
    });
    context! {
        passed => count(Verdict::Pass), warned => count(Verdict::Warn), waived => count(Verdict::Waived),
        not_run => count(Verdict::NotRun), findings => faults.collect::<Value>(),
        photographed => scenes.iter().any(|scene| scene.findings.is_some()),
    }
}

/// The terms of each scene, the publisher and the citation.
fn terms_values(facts: &ReleaseFacts<'_>) -> Value {
    let info = facts.info;
    let licences = facts.scenes.iter().map(|scene| {
        let holder = scene.recipe.licence.as_ref().map_or("not stated", |licence| &licence.holder);
        let because = match &scene.licence.passing {
            Redistributability::Allowed(because) => Some(because),
            Redistributability::Free | Redistributability::Withheld => None,
        };
        context! {
            scene => markup(&scene.recipe.scene), terms => markup(&scene.licence.expression), holder,
            because, is_withheld => scene.is_withheld(),
        }
    });
    let named: Vec<String> = facts.attributions().into_iter().map(plain_text).collect();
    let cited = info.cite_as.trim_end().replace("\r\n", "\n");
    let line = |line: &str| markup(escape::line(&line.trim_end().replace('\t', "    ")));
    let citation: Vec<Value> =
        if cited.is_empty() { Vec::new() } else { cited.split(breaks_line).map(line).collect() };
    context! {
        licences => licences.collect::<Value>(), attributions => markup(named.join("; ")),
        trained_elsewhere => facts.trained_elsewhere(), citation, description => &info.description,
        url => Some(&info.url).filter(|url| **url != ReleaseInfo::default().url),
    }
}
