//! Sound releases of many kinds, checked from their files: no check may fail, and the release and its check
//! must agree in every verdict. Warnings are printed, since some are true: frames far apart, and Gaussians
//! near the camera.
//!
//! Each release varies the sensor, the path, the size, the sampling, the rules of rendering, the outputs,
//! and what else is in the scene: objects, a rig with inertial data, lamps, a lens. The table shows for each
//! statement how often it passed, and the extremes of its measured value, so that a limit can be compared
//! with what sound trees show.

use crate::command::{Outcome, program, root, say};
use crate::options::Options;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// Sensors. Each of them makes events in these scenes.
const SENSORS: [(&str, &str); 25] = [
    ("dvs346", "sensor: { voltmeter: { preset: dvs346 } }"),
    ("esim", "sensor: { esim: {} }"),
    ("v2e", "sensor: { v2e: { preset: clean } }"),
    ("sensitive", "sensor: { voltmeter: { preset: dvs346, threshold: { on: 0.5, off: 0.5 } } }"),
    ("noisy-v2e", "sensor: { v2e: { preset: noisy } }"),
    ("uneven", "sensor: { voltmeter: { preset: dvs346, threshold: { on: 0.6, off: 0.9 } } }"),
    ("stationary", "sensor: { voltmeter: { preset: dvs346, initial: stationary } }"),
    ("dvs240", "sensor: { voltmeter: { preset: dvs240 } }"),
    ("linear", "sensor: { esim: { intensity: linear, threshold: { on: 0.05, off: 0.05 } } }"),
    ("spread", "sensor: { voltmeter: { preset: dvs346, threshold: { on: 0.8, off: 0.8, spread: 0.08 } } }"),
    ("dead-time", "sensor: { esim: { refractory: { period_us: 300 } } }"),
    ("unfiltered", "sensor: { v2e: { preset: noisy, cutoff: 0 } }"),
    ("official", "sensor: { voltmeter: { preset: dvs346, law: official } }"),
    ("hot", "sensor: { voltmeter: { preset: dvs346, hot_pixels: { share: 0.001, rate: 5000 } } }"),
    ("esim-eps", "sensor: { esim: { eps: 0.05, threshold: { on: 0.15, off: 0.2 } } }"),
    ("esim-spread", "sensor: { esim: { threshold: { on: 0.2, off: 0.2, spread: 0.03 } } }"),
    (
        "linear-light",
        "sensor: { voltmeter: { preset: dvs346, front_end: { decode: srgb, luminance: rec709 } } }",
    ),
    ("exposed", "sensor: { esim: { front_end: { exposure: 2, range: { min: 4, max: 255 } } } }"),
    ("dull", "sensor: { voltmeter: { preset: dvs346, threshold: { on: 1.4, off: 1.2 } } }"),
    ("two", "sensors: { a: { voltmeter: { preset: dvs346 } }, b: { v2e: { preset: clean } } }"),
    ("usual", "sensor: { voltmeter: {} }"),
    ("dim", "sensor: { voltmeter: { front_end: { lux: 5 } } }"),
    ("evk4", "sensor: { voltmeter: { preset: evk4 } }"),
    ("davis346", "sensor: { voltmeter: { preset: davis346 } }"),
    ("ideal-evk4", "sensor: { voltmeter: { preset: evk4, refractory: { period_us: 0 } } }"),
];

const PATHS: [(&str, &str); 6] = [
    ("smooth", "{ name: base, refine: { window: 2, factor: 6 } }"),
    (
        "unsteady",
        "{ name: base, refine: { window: 2, factor: 6 }, speed: { function: \"0.25*sin(t) + 1.1\" } }",
    ),
    ("corners", "{ name: base, refine: { window: 2, factor: 6, curve: slerp-lerp } }"),
    (
        "orbit",
        "{ name: base, orbit: { centre: [0.12, -0.56, 0.12], from: [-0.3, -1.7, -4], up: [0, -1, 0], arc: 10, frames: 80 } }",
    ),
    ("faster", "{ name: base, refine: { window: 1, factor: 6 }, speed: { function: \"1 + 2*t\" } }"),
    (
        "novel",
        "{ name: base, refine: { window: 2, factor: 5 } }, { name: mini, novel: { groups: 1, keyframes: 5, frames: 70 } }",
    ),
];

const SIZES: [&str; 5] = [
    "{ width: 200, height: 150 }",
    "{ width: 240, height: 136 }",
    "{ width: 128, height: 128 }",
    "{ width: 320, height: 180 }",
    "{ width: 173, height: 91 }",
];

const SAMPLINGS: [&str; 5] = [
    "{ rate: 2400 }",
    "{ rate: 1000 }",
    "{ rate: 240 }",
    "{ tolerance: 0.1 }",
    "{ rate: 2400, tolerance: 0.05 }",
];

const OUTPUTS: [&str; 6] = [
    "outputs: [events, sharp, blur, depth, flow]\ndepth: { every: 4 }\nflow: { every: 4 }\nblur: { frames: 5, subframes: literal }",
    "outputs: [events, sharp]",
    "outputs: [events, sharp, depth]\nsharp: { every: 2 }\ndepth: { every: 3 }",
    "outputs: [events, sharp, blur, flow]\nflow: { every: 8 }\nblur: { frames: 7 }",
    "outputs: [events, sharp, depth, flow]\nsharp: { every: 8 }\ndepth: { every: 8 }\nflow: { every: 8 }",
    "outputs: [events, sharp]\nsharp: { every: 24 }",
];

const RENDER: [&str; 4] = [
    "{ rules: official }",
    "{ rules: soft }",
    "{ rules: exact, antialiased: true }",
    "{ rules: official, background: [0.5, 0.4, 0.9] }",
];

const ARCS: [&str; 4] = ["8", "4", "12", "16"];

/// What else is in the scene; `OUTPUTS` is replaced by all outputs that it allows.
const OTHERS: [(&str, &str); 7] = [
    ("", ""),
    ("", ""),
    (
        "-objects",
        "objects:\n  - { name: orange, select: { sphere: { centre: [0.32, -0.66, -0.04], radius: 0.24 } }, path: { straight: { velocity: [2, -1, 0], spin: [0, 0, 200] } } }\noutputs: [events, sharp, depth, flow, segmentation]\ndepth: { every: 2 }\nflow: { every: 2 }",
    ),
    ("", ""),
    (
        "-rig",
        "rig:\n  cameras:\n    - { name: left }\n    - { name: right, extrinsic: { position: [0.1, 0.01, 0], rotation: [0, 0.02, 0, 0.9998] } }\n  stereo: [[left, right]]\nscale: { metres_per_unit: 0.5 }\nimu: { rate: 1000, up: [0, -1, 0] }\noutputs: [events, sharp, depth, disparity, imu]\nsharp: { every: 2 }\ndepth: { every: 4 }",
    ),
    (
        "-lamp",
        "lights: { flicker: { hz: 100, depth: 0.2 } }\noutputs: [events, sharp, depth]\ndepth: { every: 4 }",
    ),
    (
        "-objects-sparse",
        "objects:\n  - { name: board, select: { box: { low: [-1.5, -0.6, -1], high: [-0.35, 0.3, 1] } }, path: { orbit: { centre: [0, 0, 0], axis: [0, 1, 0], degrees_per_second: 60 } } }\noutputs: [events, sharp, segmentation]\nsharp: { every: 4 }",
    ),
];

/// Name and recipe of a release.
fn recipe(i: usize) -> (String, String) {
    // The lists have different lengths, so the combinations differ for a long time.
    let (sensor_name, sensor) = SENSORS[i % SENSORS.len()];
    let (path_name, path) = PATHS[(i + i / 20) % PATHS.len()];
    let of = |list: &[&'static str], salt: usize| list[(i * salt + i / 7) % list.len()];
    let (other_name, other) = OTHERS[(i + i / 25) % OTHERS.len()];
    // Inertial data of a path with corners are refused.
    let (path_name, path) = if other_name == "-rig" { PATHS[0] } else { (path_name, path) };
    // Frames must resolve a lamp.
    let sampling = if other_name == "-lamp" { SAMPLINGS[0] } else { of(&SAMPLINGS, 1) };
    // Only voltmeters choose their own frames.
    let chooses = sensor.matches("voltmeter").count() == 1
        && !sensor.contains("official")
        && !sensor.contains("sensors");
    let sampling = if chooses || !sampling.contains("tolerance") { sampling } else { SAMPLINGS[1] };
    let outputs = if other.contains("outputs") { "" } else { of(&OUTPUTS, 1) };
    let name = format!("{i:03}-{sensor_name}-{path_name}{other_name}");
    let text = format!(
        "version: 1\nscene: sound/{name}\nseed: {i}\n\
         source: {{ procedural: {{ kind: still-life, gaussians: {}, views: 12, arc: {}, seed: {i} }} }}\n\
         camera: {}\ntrajectories: [{path}]\nsampling: {sampling}\nrender: {}\n{sensor}\n{outputs}\n{other}\n",
        4000 + 3000 * (i % 4),
        of(&ARCS, 3),
        of(&SIZES, 2),
        of(&RENDER, 3),
    );
    (name, text)
}

/// Counts and extremes of one statement.
#[derive(Default)]
struct Statement {
    verdicts: BTreeMap<String, usize>,
    extent: Option<[f64; 2]>,
}

/// Makes and checks releases: `--scenes N` (60), `--first N` (0), `--program FILE` (built in release
/// mode).
pub(crate) fn run(args: &[String]) -> Outcome {
    let options = Options(args);
    let (scenes, first) = (options.number("--scenes", 60)?, options.number("--first", 0)?);
    let gs2e = options.program(&[])?;
    let folder = root().join("target/sound");
    let (mut table, mut warnings, mut failures, mut disagreements) = (BTreeMap::new(), 0, 0, 0);
    for i in first..first + scenes {
        let (name, text) = recipe(i);
        let found = checked(&gs2e, &folder, &text)?;
        if let Some(because) = &found.disagrees {
            disagreements += 1;
            say(&format!("{name}: {because}"));
        }
        for line in found.findings.lines().filter(|line| line.contains("\"check\":\"")) {
            let [check, subject, verdict, because] =
                ["check", "subject", "verdict", "because"].map(|key| field(line, key));
            let part = subject.split_once('#').map_or("", |(_, part)| part);
            warnings += u32::from(verdict == "warn");
            failures += u32::from(verdict == "fail");
            if ["warn", "fail"].contains(&verdict.as_str()) {
                say(&format!("{name}: {verdict} {check}#{part}: {because}"));
            }
            let statement: &mut Statement = table.entry(format!("{check}#{part}")).or_default();
            *statement.verdicts.entry(verdict).or_default() += 1;
            if let Ok(measured) = field(line, "measured").parse::<f64>() {
                let [low, high] = statement.extent.unwrap_or([measured; 2]);
                statement.extent = Some([low.min(measured), high.max(measured)]);
            }
        }
    }
    for (name, Statement { verdicts, extent }) in &table {
        let counts: Vec<String> = verdicts.iter().map(|(verdict, n)| format!("{n} {verdict}")).collect();
        let extent = extent.map_or_else(String::new, |[low, high]| format!("{low:.4} to {high:.4}"));
        say(&format!("{name:28} {:40} {extent}", counts.join(", ")));
    }
    say(&format!(
        "{scenes} sound releases: {failures} failures, {disagreements} disagreements, {warnings} warnings"
    ));
    if failures + disagreements == 0 {
        Ok(())
    } else {
        Err("a check raised an alarm on a sound release".to_owned())
    }
}

/// The verdicts on a sound release.
struct CheckedRelease {
    /// The records of `check --tree`, or of the release if that was refused.
    findings: String,
    /// How the release and its check differ, if they do.
    disagrees: Option<String>,
}

/// Makes a release and checks it.
fn checked(gs2e: &Path, folder: &Path, recipe: &str) -> Outcome<CheckedRelease> {
    let failed = |e: std::io::Error| format!("{}: {e}", folder.display());
    if folder.exists() {
        fs::remove_dir_all(folder).map_err(failed)?;
    }
    fs::create_dir_all(folder).map_err(failed)?;
    let at = |name: &str| folder.join(name).to_string_lossy().into_owned();
    fs::write(at("recipe.yaml"), recipe).map_err(failed)?;
    let [store, out, recipe] = ["store", "out", "recipe.yaml"].map(at);
    let arguments = ["release", "--json", "--copy", "--store", &store, "--to", &out, &recipe];
    let released = program(gs2e.as_os_str(), &arguments).any_code()?;
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    if !Path::new(&out).exists() {
        let said = text(&released.stderr);
        let disagrees = Some(format!("not released: {}", said.lines().last().unwrap_or_default()));
        return Ok(CheckedRelease { findings: text(&released.stdout), disagrees });
    }
    let checked = program(gs2e.as_os_str(), &["check", "--json", "--tree", &out]).any_code()?;
    let findings = text(&checked.stdout);
    let [said, counted] = [counts(&text(&released.stderr)), counts_of(&findings)];
    let disagrees = (said != counted).then(|| format!("release says {said:?}, check --tree {counted:?}"));
    Ok(CheckedRelease { findings, disagrees })
}

/// The counts of a release's line `checks: 40 pass, 1 warn, 0 fail, 0 waived, 3 not run`, without those
/// not run.
fn counts(said: &str) -> String {
    let line = said.lines().find_map(|line| line.strip_prefix("checks: ")).unwrap_or_default();
    line.split(", ").take(4).collect::<Vec<_>>().join(", ")
}

/// The same counts over the records of findings.
fn counts_of(findings: &str) -> String {
    let count = |verdict: &str| findings.lines().filter(|line| field(line, "verdict") == verdict).count();
    let counted = ["pass", "warn", "fail", "waived"].map(|verdict| format!("{} {verdict}", count(verdict)));
    counted.join(", ")
}

/// The text of a value of a flat JSON object; empty if it is absent.
fn field(line: &str, key: &str) -> String {
    let Some((_, rest)) = line.split_once(&format!("\"{key}\":")) else { return String::new() };
    match rest.strip_prefix('"') {
        Some(text) => text.split('"').next().unwrap_or_default().to_owned(),
        None => rest.split([',', '}']).next().unwrap_or_default().to_owned(),
    }
}
