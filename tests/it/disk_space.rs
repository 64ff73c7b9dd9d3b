//! The warning about a disk that is too small for what a build expects to write.

use crate::support::absent::not_run;
use crate::support::workspace::{TINY, Workspace};
use serde_json::Value;
use std::io::BufRead as _;
use std::process::Command;

/// Runs a build with a store on a file system that has 400 kB free, in a name space of its own.
const SCRIPT: &str = "mkdir full && mount -t tmpfs -o size=$(( $(du -s -k .gs2e | cut -f1) + 400 ))k none full \
                      && cp -a .gs2e full/store && exec \"$0\" build --store full/store tiny.yaml";

#[test]
fn a_small_disk_is_named_before_the_steps_run() {
    let can = Command::new("unshare").args(["-rm", "mount", "-t", "tmpfs", "none", "/mnt"]).output();
    if !can.is_ok_and(|output| output.status.success()) {
        return not_run("no file system can be mounted");
    }
    let place = Workspace::new();
    let recipe = TINY.replace("width: 64, height: 48", "width: 320, height: 240");
    place.write("tiny.yaml", &recipe);
    place.ok("build tiny.yaml");
    // The pictures are made again, and take as much as before.
    place.write("tiny.yaml", format!("{recipe}render: {{ background: [1, 1, 1] }}\n"));
    let script = ["-rm", "sh", "-c", SCRIPT, env!("CARGO_BIN_EXE_gs2e")];
    let ended = Command::new("unshare").args(script).current_dir(place.path("")).output().unwrap();
    let said = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert!(said.contains("the outputs take about ") && said.contains(" GB free"), "{said}");
    // On a disk with room the same build says nothing of it.
    let said = place.ok("build tiny.yaml").stderr;
    assert!(!said.contains("the outputs take about "), "{said}");
}

/// A day at 100 kHz has 8.64e9 samples. Each takes at least 100 bytes: 13 numbers of several digits and their
/// stamps. No step of the kind has run before.
#[test]
fn inertial_samples_of_a_day_are_expected_before_any_step_ran() {
    let place = Workspace::new();
    let path = "base\n    keyframes: { duration: 86400, poses: [{ position: [0, 0, -4], rotation: [0, 0, 0, 1] }, { position: [1, 0, -4], rotation: [0, 0, 0, 1] }] }";
    let recipe = TINY
        .replace("base\n    refine: { window: 2, factor: 2, curve: cubic }", path)
        .replace("rate: 2400", "rate: 0.01")
        .replace(
            "sensor:\n  voltmeter: { preset: dvs346, threshold: { on: 1.0, off: 1.0 } }",
            "sensor: { esim: {} }\nscale: { metres_per_unit: 1 }",
        )
        .replace("outputs: [events, sharp]", "outputs: [imu]\nimu: { rate: 100000, up: [0, 0, 1] }");
    place.write("tiny.yaml", recipe);
    let estimate: Value = serde_json::from_str(&place.ok("plan --estimate --json tiny.yaml").stdout).unwrap();
    let bytes = estimate["bytes"].as_f64().unwrap();
    assert!((0.864e12..20e12).contains(&bytes), "{estimate}");
    let said = place.ok("plan --estimate tiny.yaml").stdout;
    assert!(said.contains(" TB"), "{said}");
    let mut child = place.spawn("build tiny.yaml");
    let stderr = std::io::BufReader::new(child.stderr.take().unwrap());
    let warned = stderr.lines().map_while(Result::ok).find(|line| line.contains("the outputs take about "));
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(warned.is_some(), "no warning of the space");
}

/// The size of products whose form has no compression is known to a few bytes.
#[test]
fn expected_sizes_are_those_of_the_files() {
    let place = Workspace::new();
    let outputs = "outputs: [depth, flow, sharp, blur]\nsharp: { every: 5 }\nblur: { frames: 3 }";
    place.write(
        "tiny.yaml",
        TINY.replace("factor: 2", "frames: 33").replace("outputs: [events, sharp]", outputs),
    );
    let estimate =
        || -> Value { serde_json::from_str(&place.ok("plan --estimate --json tiny.yaml").stdout).unwrap() };
    let bytes = estimate()["bytes"].as_f64().unwrap();
    // 33 images of 64x48 pixels, with 4 bytes for depth and 8 for flow, and pictures of at most 3 bytes a
    // pixel.
    let exact = 33.0 * 64.0 * 48.0 * 12.0;
    assert!(bytes > exact && bytes < exact + (7.0 + 10.0) * 64.0 * 48.0 * 3.0 + 33.0 * 1e3, "{bytes}");
    place.ok("build tiny.yaml");
    // Other bytes for all steps, and paths of twice the length.
    let longer = TINY.replace("factor: 2", "frames: 66").replace("outputs: [events, sharp]", outputs);
    place.write("tiny.yaml", longer.replace("seed: 7", "seed: 7\nrender: { background: [1, 1, 1] }"));
    let twice = estimate()["bytes"].as_f64().unwrap();
    assert!(twice > 1.9 * exact && twice < 2.6 * exact, "{twice} where {exact} was half");
}
