//! Rival event simulators and renderers on the same frames and scene, in one run.
//!
//! Nothing is downloaded: a peer runs if it is installed, or if its folder is given. The others are named.

mod files;

use crate::check_bench::watch;
use crate::command::{Outcome, program, root, say};
use crate::options::Options;
use files::FileBench;
use std::ffi::OsString;
use std::fs;
use std::path::Path;

/// A still life at the size of a DAVIS346, and a frame at each pose. The picture moves by half a pixel per
/// frame at most.
const RECIPE: &str = "\
version: 1
scene: peers
source: { procedural: { kind: still-life, gaussians: 20000, views: 30, arc: 20, seed: 1 } }
camera: { width: 346, height: 260 }
trajectories: [{ name: base, refine: { window: 2, factor: 10 } }]
outputs: [sharp]
sharp: { every: 1 }
licence: { expression: CC0-1.0, holder: a benchmark }
";

/// The functions that call the peers.
const SCRIPT: &str = include_str!("peers_bench/run.py");

/// The sensors of this program, and the peer that computes the same law.
const SENSORS: [(&str, &str); 3] =
    [("dvs346-paper", "dvs-voltmeter"), ("v2e-clean", "v2e clean"), ("v2e-noisy", "v2e noisy")];

/// Measures: `--program FILE` (built in release mode), `--python FILE` (python3), `--dvs-voltmeter DIR`,
/// `--v2e DIR`, `--frames N` (100), `--runs N` (3). With `--events FILE`, it measures event files instead.
pub(crate) fn run(args: &[String]) -> Outcome {
    let options = Options(args);
    let (frames, runs) = (options.number("--frames", 100)?.max(2), options.number("--runs", 3)?.max(1));
    let gs2e = options.program(&[])?;
    let folder = root().join("target/peers-bench");
    fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let script = folder.join("run.py");
    fs::write(&script, SCRIPT).map_err(|e| format!("{}: {e}", script.display()))?;
    let python: OsString = options.value("--python").unwrap_or("python3").into();
    let call = |args: &[&str]| {
        let script = script.to_string_lossy();
        program(&python, &[&[&*script], args].concat())
    };
    if let Some(events) = options.value("--events") {
        return FileBench { gs2e: &gs2e, folder: &folder, runs, call: &call }.run(events);
    }
    make_frames(&gs2e, &folder)?;
    let at = |name: &str| folder.join(name).to_string_lossy().into_owned();
    let pictures = at("release/peers/base/sharp");
    let times = at("release/peers/base/timestamps_us.txt");
    let (stack, stamps) = (at("frames.npy"), at("stamps.npy"));
    call(&["frames", &pictures, &times, &frames.to_string(), &stack, &stamps]).run()?;
    say(&format!("{frames} frames of 346x260, 8 bits; one thread; the least CPU time of {runs} runs"));
    say("| simulator | core-s | events | Mpx/s | Mev/s | ratio |\n|---|---|---|---|---|---|");
    for (sensor, peer) in SENSORS {
        let own = command_cost(&gs2e, sensor, [&stack, &stamps, &at("events.npz")], runs)?;
        let events = call(&["count", &at("events.npz")]).capture()?;
        let events = String::from_utf8_lossy(&events.stdout).trim().parse::<f64>().unwrap_or(0.0);
        row(&format!("`gs2e simulate --sensor {sensor}`"), (own, events, frames), own);
        let home = match peer.split(' ').next() {
            Some("v2e") => options.value("--v2e"),
            _ => options.value("--dvs-voltmeter"),
        };
        let found =
            call(&["simulate", peer, home.unwrap_or(""), &stack, &stamps, &runs.to_string()]).capture()?;
        let found = String::from_utf8_lossy(&found.stdout).trim().to_owned();
        match found.split_once(' ').and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?))) {
            Some((seconds, events)) => row(peer, (seconds, events, frames), own),
            None => say(&format!("| {peer} | absent: {found} | | | | |")),
        }
    }
    let scene = call(&["gsplat"]).capture()?;
    say(String::from_utf8_lossy(&scene.stdout).trim());
    Ok(())
}

/// A release with a picture at each pose.
fn make_frames(gs2e: &Path, folder: &Path) -> Outcome {
    let at = |name: &str| folder.join(name).to_string_lossy().into_owned();
    let recipe = at("peers.yaml");
    fs::write(&recipe, RECIPE).map_err(|e| format!("{recipe}: {e}"))?;
    let release = ["release", "--copy", "-q", "--store", &at("store"), "--to", &at("release"), &recipe];
    watch(gs2e, &release, &[0]).map(|_| ())
}

/// The least CPU time of the whole command: it starts, reads the frames, and writes a file, which the peers
/// need not do.
fn command_cost(gs2e: &Path, sensor: &str, [frames, stamps, out]: [&String; 3], runs: usize) -> Outcome<f64> {
    let args = [
        "simulate", "-q", "-j", "1", "--frames", frames, "--stamps", stamps, "--sensor", sensor, "--out", out,
    ];
    (0..runs).try_fold(f64::INFINITY, |least, _| Ok(least.min(watch(gs2e, &args, &[0])?.cpu_seconds)))
}

fn row(name: &str, (seconds, events, frames): (f64, f64, usize), own: f64) {
    let pixels = (346 * 260 * frames) as f64;
    say(&format!(
        "| {name} | {seconds:.2} | {events} | {:.1} | {:.2} | {:.1} |",
        1e-6 * pixels / seconds,
        1e-6 * events / seconds,
        seconds / own
    ));
}
