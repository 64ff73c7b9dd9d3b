//! Power of the checks on releases of many kinds, as the table of crates/lab/results/checks.md.
//!
//! Each release varies the scene, the sensor, the path, the size, the rate and the rules of
//! rendering. All of them have sharp frames and depth at every pose. Streams of other thresholds are
//! made from the same scenes. `examples/power.rs` plants the other faults and prints the table.

use crate::command::{Outcome, cargo, program, root};
use crate::options::Options;
use std::fs;
use std::path::Path;

/// Thresholds and the sensors with them; `ON` and `OFF` stand for the thresholds.
const SENSORS: [(&str, [f64; 2]); 5] = [
    ("{ voltmeter: { preset: dvs346, threshold: { on: ON, off: OFF } } }", [0.7, 0.7]),
    ("{ esim: { threshold: { on: ON, off: OFF } } }", [0.2, 0.2]),
    ("{ voltmeter: { preset: dvs346, threshold: { on: ON, off: OFF } } }", [0.5, 0.8]),
    ("{ voltmeter: { preset: dvs346, initial: stationary, threshold: { on: ON, off: OFF } } }", [0.6, 0.6]),
    ("{ esim: { threshold: { on: ON, off: OFF } } }", [0.15, 0.1]),
];

/// Sensors with unequal pixels, noise in dim light, and a dead time.
const NOISY_SENSORS: [(&str, [f64; 2]); 5] = [
    ("{ voltmeter: { preset: davis346, threshold: { on: ON, off: OFF } } }", [1.0, 1.907]),
    (
        "{ voltmeter: { preset: davis346, front_end: { lux: 60 }, threshold: { on: ON, off: OFF } } }",
        [1.0, 1.907],
    ),
    ("{ voltmeter: { preset: davis346, threshold: { on: ON, off: OFF, spread: 0.1 } } }", [0.6, 1.1]),
    ("{ voltmeter: { preset: evk4, threshold: { on: ON, off: OFF } } }", [1.0, 1.0]),
    ("{ esim: { threshold: { on: ON, off: OFF, spread: 0.03 } } }", [0.2, 0.2]),
];

const PATHS: [&str; 4] = [
    "{ name: base, refine: { window: 2, factor: 6 } }",
    "{ name: base, refine: { window: 2, factor: 6 }, speed: { function: \"0.25*sin(t) + 1.1\" } }",
    "{ name: base, orbit: { centre: [0.12, -0.56, 0.12], from: [-0.3, -1.7, -4], up: [0, -1, 0], arc: 10, frames: 80 } }",
    "{ name: base, refine: { window: 1, factor: 6 }, speed: { function: \"1 + 2*t\" } }",
];

const SIZES: [&str; 5] = [
    "{ width: 160, height: 120 }",
    "{ width: 240, height: 136 }",
    "{ width: 64, height: 48 }",
    "{ width: 128, height: 128 }",
    "{ width: 173, height: 91 }",
];

const RATES: [&str; 3] = ["2400", "1000", "240"];
const GAUSSIANS: [u32; 4] = [4000, 500, 20_000, 10_000];
const ARCS: [u32; 3] = [8, 12, 16];
const RENDER: [&str; 3] = ["{ rules: official }", "{ rules: soft }", "{ rules: exact, antialiased: true }"];

/// Relative changes of both thresholds, as in `examples/power.rs`.
const THRESHOLDS: [f64; 5] = [0.01, 0.02, 0.05, 0.1, 0.2];

/// The recipe of a release with thresholds times `factor`.
fn recipe(i: usize, (sensors, factor): (&[(&str, [f64; 2])], f64), outputs: &str) -> String {
    let (sensor, thresholds) = sensors[i % sensors.len()];
    let [on, off] = thresholds.map(|threshold| (threshold * factor).to_string());
    let sensor = sensor.replace("OFF", &off).replace("ON", &on);
    let size = SIZES[(i + i / 5) % SIZES.len()];
    format!(
        "version: 1\nscene: power/s{i:02}\nseed: {i}\n\
         source: {{ procedural: {{ kind: still-life, gaussians: {}, views: 12, arc: {}, seed: {i} }} }}\n\
         camera: {size}\ntrajectories: [{}]\nsampling: {{ rate: {} }}\nrender: {}\nsensor: {sensor}\n\
         outputs: [{outputs}]\n",
        GAUSSIANS[i % GAUSSIANS.len()],
        ARCS[i % ARCS.len()],
        PATHS[(i + i / 4) % PATHS.len()],
        RATES[(i + i / 3) % RATES.len()],
        RENDER[i % RENDER.len()],
    )
}

/// Measures the power: `--releases N` (20), `--program FILE` (built in release mode), `--stated` (faults of
/// the stated sizes alone), `--noisy` (sensors with unequal pixels and noise).
pub(crate) fn run(args: &[String]) -> Outcome {
    let options = Options(args);
    let releases: usize = options.number("--releases", 20)?;
    let gs2e = options.program(&[])?;
    let stated = args.iter().find(|arg| *arg == "--stated");
    let sizes: &[f64] = if stated.is_some() { &[] } else { &THRESHOLDS };
    let noisy = args.iter().any(|arg| arg == "--noisy");
    let (sensors, kind) = if noisy { (&NOISY_SENSORS, "noisy-") } else { (&SENSORS, "") };
    let mut made = Vec::new();
    for i in 0..releases {
        let folder = root().join(format!("target/power/{kind}{i:02}"));
        make_release(&gs2e, &folder, "out", &recipe(i, (sensors, 1.0), "events, sharp, depth"))?;
        for size in sizes {
            for (sign, factor) in [("-", 1.0 - size), ("+", 1.0 + size)] {
                make_release(
                    &gs2e,
                    &folder,
                    &format!("threshold{sign}{size}"),
                    &recipe(i, (sensors, factor), "events"),
                )?;
            }
        }
        made.push(folder.join("out").into_os_string());
    }
    cargo(&["run", "--release", "--quiet", "--example", "power", "--"]).args(stated).args(made).run()
}

/// Makes a release in the folder, unless it is there.
fn make_release(gs2e: &Path, folder: &Path, name: &str, recipe: &str) -> Outcome {
    let failed = |e: std::io::Error| format!("{}: {e}", folder.display());
    let (out, yaml) = (folder.join(name), folder.join(format!("{name}.yaml")));
    if out.exists() && fs::read_to_string(&yaml).is_ok_and(|text| text == recipe) {
        return Ok(());
    }
    if out.exists() {
        fs::remove_dir_all(&out).map_err(failed)?;
    }
    fs::create_dir_all(folder).map_err(failed)?;
    fs::write(&yaml, recipe).map_err(failed)?;
    let [store, out, yaml] =
        [folder.join("store"), out, yaml].map(|path| path.to_string_lossy().into_owned());
    program(gs2e.as_os_str(), &["release", "--copy", "--store", &store, "--to", &out, &yaml]).capture()?;
    Ok(())
}
