//! Cost of one pass of the renderer for all outputs of a trajectory, next to that of a step for each output.
//!
//! A build from an empty store makes the outputs in one pass. `--recheck 1` then makes each step again,
//! alone, and compares the bytes. Then the threshold of the sensor changes, and the events are made of kept
//! frames, and of rendered ones.

use crate::check_bench::{Cost, watch};
use crate::command::{Outcome, root, say};
use crate::options::Options;
use std::fs;
use std::path::Path;

const REAL_SCENE: &str = "../shared/data/scenes";

/// A path with about 150 poses, all outputs, and no settings that one output alone needs.
const PATH_AND_OUTPUTS: &str = "\
camera: { width: 640, height: 360 }
trajectories: [{ name: base, refine: { window: 2, factor: 5 }, speed: { function: \"0.25*sin(t) + 1.1\" } }]
outputs: [events, sharp, blur, depth, flow]
licence: { expression: CC0-1.0, holder: a benchmark }
";

/// The scene of the demo: a still life of Gaussians made by a formula.
const PROCEDURAL: &str = "\
source: { procedural: { kind: still-life, gaussians: 20000, views: 30, arc: 20, seed: 1 } }
";

/// Measures: `--program FILE` (built in release mode), `--runs N` (3), `-j N` (1).
pub(crate) fn run(args: &[String]) -> Outcome {
    let options = Options(args);
    let runs = options.number("--runs", 3u32)?.max(1);
    let jobs = options.value("-j").unwrap_or("1");
    let gs2e = options.program(&[])?;
    let folder = root().join("target/pass-bench");
    fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    say(&format!("cores: {jobs}; the least CPU time of {runs} runs"));
    say("| scene | one pass | a step for each output | ratio | peak | peak |\n|---|---|---|---|---|---|");
    let scenes = root().join(REAL_SCENE);
    let [views, gaussians] = ["playbot.transforms.json", "playbot.spz"].map(|name| scenes.join(name));
    if gaussians.is_file() {
        // A path in Rust's quotes is a string of YAML too.
        let source = format!(
            "source: {{ nerfstudio: {{ path: {views:?} }} }}\n\
             reconstruct: {{ given: {{ path: {gaussians:?} }} }}\n"
        );
        measure((&gs2e, &folder), ("playbot", &source), (runs, jobs))?;
    } else {
        say(&format!("absent: {REAL_SCENE}: the passes of a real scene are not timed"));
    }
    measure((&gs2e, &folder), ("still-life", PROCEDURAL), (runs, jobs))
}

fn measure(
    (gs2e, folder): (&Path, &Path),
    (scene, source): (&str, &str),
    (runs, jobs): (u32, &str),
) -> Outcome {
    let (recipe, store) = (folder.join(format!("{scene}.yaml")), folder.join("store"));
    let text = format!("version: 1\nscene: {scene}\n{source}{PATH_AND_OUTPUTS}");
    fs::write(&recipe, &text).map_err(|e| format!("{}: {e}", recipe.display()))?;
    let [store_arg, recipe] = [&store, &recipe].map(|path| path.to_string_lossy().into_owned());
    let args = ["build", "-q", "-j", jobs, "--backend", "cpu", "--store", &store_arg, &recipe];
    let (mut together, mut alone): (Vec<Cost>, Vec<Cost>) = (Vec::new(), Vec::new());
    let mut filling = Vec::new();
    for _ in 0..runs {
        if store.exists() {
            fs::remove_dir_all(&store).map_err(|e| format!("{}: {e}", store.display()))?;
        }
        together.push(watch(gs2e, &[&args[..], &["--keep-frames", "off"]].concat(), &[0])?);
        alone.push(watch(gs2e, &[&args[..], &["--recheck", "1"]].concat(), &[0])?);
    }
    let (mut kept, mut rendered): (Vec<Cost>, Vec<Cost>) = (Vec::new(), Vec::new());
    // The first build keeps the frames that the later ones show.
    for number in 0..=2 * runs {
        // A threshold that no build had before.
        let threshold = 0.9 + 0.001 * f64::from(number);
        let sensor = format!(
            "sensor: {{ voltmeter: {{ preset: davis346, threshold: {{ on: {threshold}, off: {threshold} }} }} }}\n"
        );
        fs::write(&recipe, text.clone() + &sensor).map_err(|e| format!("{recipe}: {e}"))?;
        let keeps = number % 2 == 0;
        let mode = if keeps { "2GB" } else { "off" };
        let cost = watch(gs2e, &[&args[..], &["--keep-frames", mode]].concat(), &[0])?;
        match (number, keeps) {
            (0, _) => filling.push(cost),
            (_, true) => kept.push(cost),
            (_, false) => rendered.push(cost),
        }
    }
    let least = |costs: &[Cost]| costs.iter().map(|cost| cost.cpu_seconds).fold(f64::INFINITY, f64::min);
    let peak = |costs: &[Cost]| costs.iter().map(|cost| cost.peak_mb).fold(0.0, f64::max);
    let [one, each] = [least(&together), least(&alone)];
    say(&format!(
        "| {scene} | {one:.1} s | {each:.1} s | {:.2} | {:.0} MB | {:.0} MB |",
        one / each,
        peak(&together),
        peak(&alone)
    ));
    let [shown, made, first] = [least(&kept), least(&rendered), least(&filling)];
    say(&format!(
        "{scene}, another threshold: {shown:.1} s from kept frames, {made:.1} s from rendered ones ({:.2}); {first:.1} s \
         if they are kept for the first time",
        shown / made
    ));
    Ok(())
}
