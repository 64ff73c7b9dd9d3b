//! `README.md` of a release, the dataset card: contents, use, making and terms. Every number in it
//! is computed.

mod files;

use super::facts::{FileCounts, ReleaseFacts, breaks_line, plain_text};
use super::published::PublishedScene;
use super::scene::{TrajectoryPart, TrajectoryStatistics};
use crate::check::Verdict;
use crate::escape::{self, quoted};
use crate::image::Size;
use crate::licence::{LicenceObligation, Redistributability};
use crate::recipe::{ReleaseInfo, SplitUnit};
use crate::sensor::SensorChoice;
use crate::sensor::voltmeter::BetweenFrames;
use std::collections::BTreeSet;
use std::fmt::Write as _;

/// Composes the card.
pub(super) fn compose_card(facts: &ReleaseFacts<'_>) -> String {
    let (scenes, info) = (facts.scenes, facts.info);
    let mut text = card_head(facts);
    for section in [
        card_introduction(facts),
        files::files_section(facts),
        files::loading_section(facts),
        conventions_section(facts),
        making_section(facts),
        checks_section(scenes),
        splits_section(facts),
        format!("## Limits\n\n{}\n", facts.provenance().limits()),
        licences_section(facts),
        removal_section(info),
        citation_section(facts),
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

/// Front matter of the card, in the form that dataset hubs read.
fn card_head(facts: &ReleaseFacts<'_>) -> String {
    let (info, licence) = (facts.info, facts.licence);
    let mut text = String::from("---\nlanguage: en\n");
    // Hubs know few licences by name. An expression is given as another licence with a link.
    let _ = writeln!(
        text,
        "license: other\nlicense_name: {}\nlicense_link: LICENSES",
        quoted(&licence.expression)
    );
    let _ = writeln!(text, "pretty_name: {}", quoted(&info.name));
    let rows = facts.counts().trajectories;
    // The names that dataset hubs know.
    let size = [(1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K")];
    let size = size.iter().find(|(limit, _)| rows < *limit).map_or("100K<n<1M", |(_, name)| name);
    let _ = writeln!(text, "size_categories: [{}]", quoted(size));
    text.push_str(match facts.provenance().has_events() {
        true => "tags: [event-camera, 3d-gaussian-splatting, synthetic]\n",
        false => "tags: [3d-gaussian-splatting, synthetic]\n",
    });
    let _ = writeln!(text, "configs: [{{ config_name: index, data_files: {} }}]", super::index::NAME);
    if licence.gated {
        text.push_str(&gate_prompt(facts));
    }
    text.push_str("---\n");
    text
}

/// Questions to receivers before they get access, in the form that hubs read: name and affiliation,
/// and a promise for each obligation of the terms.
fn gate_prompt(facts: &ReleaseFacts<'_>) -> String {
    let mut text = String::from(
        "extra_gated_heading: \"Terms of the upstream datasets\"\n\
         extra_gated_prompt: \"To get access, accept the upstream terms in LICENSES.\"\n\
         extra_gated_fields:\n  Name: text\n  Affiliation: text\n  \
         \"I have read and accept the terms in LICENSES\": checkbox\n",
    );
    let asked = [
        (LicenceObligation::NonCommercial, "I do not use it commercially"),
        (LicenceObligation::NoRedistribution, "I do not redistribute any part of it"),
        (LicenceObligation::DeletionOnRequest, "I delete data about a person on request"),
    ];
    let obligations = facts.obligations();
    for (_, promise) in asked.iter().filter(|(obligation, _)| obligations.contains(obligation)) {
        let _ = writeln!(text, "  \"{promise}\": checkbox");
    }
    text
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

/// Number of scenes in each split; empty if there are no splits.
fn splits_section(facts: &ReleaseFacts<'_>) -> String {
    let Some(rule) = &facts.info.splits else { return String::new() };
    let by = match rule.by {
        SplitUnit::Capture => "capture",
        SplitUnit::Object => "object",
    };
    let counts: Vec<String> =
        facts.splits().iter().map(|(name, count)| format!("`{name}` {count}")).collect();
    format!(
        "## Splits\n\nBy {by}, never by trajectory; number of scenes: {}. `index.parquet` and each `scene.json` name the \
         `split`. No photo and no scene file is in two splits.\n",
        counts.join(", ")
    )
}

/// Contact for requests to remove a scene.
fn removal_section(info: &ReleaseInfo) -> String {
    let whom = match &info.contact {
        Some(contact) => format!("Write to {}", plain_text(contact)),
        None if info.url == ReleaseInfo::default().url => "No contact is stated".to_owned(),
        None => format!("No contact is stated; the publisher's page is {}", plain_text(&info.url)),
    };
    format!("## Removal of scenes\n\n{whom}. Later versions do not contain a scene that was taken down.\n")
}

const CONVENTIONS: &str = "\
## Conventions

Times are integer microseconds from the first pose. Camera axes are those of OpenCV: x right, y down, z forward; only \
`transforms.json` has those of OpenGL (y up, z back). The centre of pixel (i, j) is (i+0.5, j+0.5). Lengths are in the \
unit of the source.
";

/// Conventions of events.
const EVENT_CONVENTIONS: &str = "
Polarity 1 is brighter, 0 is darker. Brightness is display-encoded (sRGB) luminance, 0.299 R + 0.587 G + 0.114 B, on \
the grey scale 0..255.
";

/// Meaning of labels, for streams that have them.
const LABELS: &str = "\
`events/label`, where a stream has it, is 1 for signal and 0 for noise. An event is noise if it comes from a hot pixel or from shot \
noise, or if the brightness moved by less than half a threshold in the event's direction since the \
previous event of the pixel.
";

/// Conventions for reading the numbers, and the sensors that see another brightness than the
/// others.
fn conventions_section(facts: &ReleaseFacts<'_>) -> String {
    let scenes = facts.scenes;
    let mut text = CONVENTIONS.to_owned();
    if facts.provenance().has_events() {
        text.push_str(EVENT_CONVENTIONS);
    }
    let streams = built_trajectories(scenes).flat_map(|(scene, part)| scene.streams(part));
    if streams.into_iter().any(|(_, sensor)| sensor.as_model().labels()) {
        text.push_str(LABELS);
    }
    let sensors = scenes.iter().flat_map(|scene| scene.recipe.sensors.iter().map(move |each| (scene, each)));
    let others: Vec<String> = sensors
        .map(|(scene, (name, sensor))| (scene.recipe.scene.clone(), name, sensor.as_model().front_end()))
        .filter(|(.., front_end)| !front_end.is_plain())
        .map(|(scene, name, front_end)| match name {
            Some(name) => format!("| {scene} | {name} | {front_end} |\n"),
            None => format!("| {scene} | | {front_end} |\n"),
        })
        .collect();
    if !others.is_empty() {
        let head = "| scene | sensor | brightness |\n|---|---|---|\n";
        let _ = write!(
            text,
            "These sensors use a different brightness on the same scale:\n\n{head}{}",
            others.concat()
        );
    }
    text
}

/// Ways in which paths of each kind are made.
const PATHS: [(&str, &str); 4] = [
    ("refine", "captured poses, smoothed"),
    ("novel", "key poses drawn from another trajectory, joined by a curve"),
    ("orbit", "a circle about a point, which the camera looks at"),
    ("keyframes", "poses given by hand, joined by a curve"),
];

fn making_section(facts: &ReleaseFacts<'_>) -> String {
    let scenes = facts.scenes;
    let kinds: Vec<&str> = built_trajectories(scenes).map(|(_, part)| part.kind.as_str()).collect();
    let mut text = String::from("## How it was made\n\nEach path is one of these:\n\n");
    for (kind, what) in PATHS.iter().filter(|(kind, _)| kinds.contains(kind)) {
        let _ = writeln!(text, "- `{kind}`: {what}");
    }
    text.push_str(
        "\nThe length of a path combines rotation and translation; poses are sampled at the prescribed speed. Seeds and all parameters \
         are in `scene.json`.\n",
    );
    text.push_str(&sensors_made(scenes));
    text.push_str(
        "\n| scene / trajectory | source | path | Gaussians | size | poses | ms | events | ev/px/s | ON share | contrast ON, OFF |\n\
         |---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for row in built_trajectories(scenes).flat_map(|(scene, part)| stream_rows(scene, part)) {
        let _ = writeln!(text, "{row}");
    }
    text
}

/// One item per kind of sensor: its model, what it compares, and its interpolation between frames.
fn sensors_made(scenes: &[PublishedScene]) -> String {
    let mut items = BTreeSet::new();
    for (scene, part) in built_trajectories(scenes) {
        for (_, sensor) in scene.streams(part) {
            let between = between_words(sensor);
            // A rate of no meaning would be refused by the recipe, which the release holds.
            let screened = sensor.screen(scene.recipe.rate);
            let quantity =
                screened.map_or_else(|_| "brightness".to_owned(), |found| found.quantity.to_owned());
            items.insert(format!(
                "- `{}`: compares `{quantity}`; {between} interpolation between frames\n",
                sensor.name()
            ));
        }
    }
    match items.is_empty() {
        true => String::new(),
        false => format!(
            "\nEach frame was rendered and passed to the sensor:\n\n{}",
            Vec::from_iter(items).concat()
        ),
    }
}

/// Interpolation of brightness between frames by a sensor.
fn between_words(sensor: &SensorChoice) -> &'static str {
    match sensor.between() {
        BetweenFrames::Linear => "linear",
        BetweenFrames::Catmull => "cubic (Catmull-Rom)",
        BetweenFrames::Hermite => "cubic (Hermite, with rendered rates of change)",
    }
}

/// One row per stream, or one row for a trajectory without a stream.
fn stream_rows(scene: &PublishedScene, part: &TrajectoryPart) -> Vec<String> {
    let camera = &scene.file.camera;
    let size = Size { width: camera.width, height: camera.height };
    let gaussians = scene.file.reconstruction.as_ref().map(|it| it.gaussians.to_string());
    let row = |name: &str, counted: &str| {
        format!(
            "| {}/{}{name} | {} | {} | {} | {size} | {} | {:.1} | {counted} |",
            scene.file.id,
            part.name,
            scene.file.source.kind,
            part.kind,
            gaussians.as_deref().unwrap_or("-"),
            part.poses,
            part.duration_us as f64 * 1e-3,
        )
    };
    let counted = |name: Option<&str>, sensor: &SensorChoice, statistics: &TrajectoryStatistics| {
        let (events, on) = (statistics.events.unwrap_or(0), statistics.on.unwrap_or(0));
        let pixel_seconds = size.pixels() as f64 * part.duration_us as f64 * 1e-6;
        // A stream without events or duration has no rate and no share.
        let ratio = |of: f64, to: f64| if to > 0.0 { format!("{:.3}", of / to) } else { "-".to_owned() };
        let (rate, share) = (ratio(events as f64, pixel_seconds), ratio(on as f64, events as f64));
        let (on, off) = sensor.as_model().contrast();
        let name = name.map_or_else(String::new, |name| format!("/{name}"));
        row(&name, &format!("{events} | {rate} | {share} | {on:.4}, {off:.4}"))
    };
    let streams = scene.streams(part).into_iter().map(|(name, sensor)| {
        let named = name.and_then(|name| part.sensors.get(name));
        counted(name, sensor, named.map_or(&part.statistics, |named| &named.statistics))
    });
    let rows: Vec<String> = streams.collect();
    if rows.is_empty() { vec![row("", "- | - | - | -")] } else { rows }
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
        let [subject, because] = [&finding.subject, &finding.because].map(|text| plain_text(text));
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

/// Limits of the data.
fn licences_section(facts: &ReleaseFacts<'_>) -> String {
    let mut text =
        format!("## Licence\n\nThe whole: `{}`. Texts are in `LICENSES/`.\n\n", facts.licence.expression);
    for scene in facts.scenes {
        let holder =
            scene.recipe.licence.as_ref().map_or_else(|| "not stated".into(), |l| plain_text(&l.holder));
        let passing = match &scene.licence.passing {
            Redistributability::Free => String::new(),
            Redistributability::Allowed(because) => {
                format!("; redistributed, because: {}", plain_text(because))
            }
            Redistributability::Withheld => "; only recipe, poses and reports".to_owned(),
        };
        let (id, terms) = (&scene.recipe.scene, &scene.licence.expression);
        let _ = writeln!(text, "- {id}: `{terms}`, holder: {holder}{passing}");
    }
    for grant in facts.grants() {
        let _ = writeln!(text, "- {grant}");
    }
    let named: Vec<String> = facts.attributions().into_iter().map(plain_text).collect();
    if !named.is_empty() {
        let _ = writeln!(text, "\nAttribution: {}.", named.join("; "));
    }
    let ledger = facts.ledger();
    if !ledger.is_empty() {
        let trained = if facts.trained().is_some() { TRAINED } else { "" };
        let _ = writeln!(text, "\n{PROGRAMS}{trained}\n\n{ledger}");
        // The ledger ends its last line itself, so there is an empty line too many.
        text.truncate(text.trim_end().len());
        text.push('\n');
    }
    text
}

/// Introduction of the table of terms.
const PROGRAMS: &str = "Known terms. The terms of datasets are binding; the terms of programs do not bind a scene by themselves.";

/// Open question of the table of terms, if scenes were trained.
const TRAINED: &str = " The licence of 3D Gaussian Splatting does not state if it applies to renderings of scenes that \
    were trained with it.";

fn citation_section(facts: &ReleaseFacts<'_>) -> String {
    let info = facts.info;
    let mut text = String::from("## Citation\n\n");
    if !info.cite_as.is_empty() {
        // As code, so that nothing in it is markup.
        for line in info.cite_as.trim_end().replace("\r\n", "\n").split(breaks_line) {
            let _ = writeln!(text, "    {}", escape::line(&line.trim_end().replace('\t', "    ")));
        }
        text.push('\n');
    }
    text.push_str("The pipeline follows GS2E (arXiv 2505.15287)");
    for (name, publication) in facts.provenance().models() {
        let _ = write!(text, "; a sensor model follows {name} ({publication})");
    }
    text.push_str(".\n");
    text
}
