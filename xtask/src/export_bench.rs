//! Cost of the exports: the time and the peak memory of each layout for a long stream, next to a plain
//! copy of the files that it wrote.

use crate::check_bench::{watch, write_stream};
use crate::command::{Outcome, root, say};
use crate::options::Options;
use std::fs;
use std::path::Path;
use std::time::Instant;

/// A scene with all that the layouts read. Its stream is replaced by a longer one.
const RECIPE: &str = "\
version: 1
scene: bench
source: { procedural: { kind: still-life, gaussians: 2000, views: 30, arc: 20, seed: 1 } }
camera: { width: 640, height: 360 }
trajectories: [{ name: base, refine: { window: 2, factor: 5 } }]
sensor: { esim: { threshold: { on: 0.2, off: 0.2 } } }
outputs: [events, sharp, blur, depth, flow]
depth: { every: 15 }
flow: { every: 15 }
licence: { expression: CC0-1.0, holder: a benchmark }
";

/// The layouts with events.
const FORMATS: [&str; 17] = [
    "e-nerf",
    "event-3dgs",
    "eventnerf",
    "e-3dgs",
    "robust-e-nerf",
    "deblur-e-nerf",
    "evdeblurnerf",
    "e2nerf",
    "e2gs",
    "inceventgs",
    "monash-h5",
    "e2vid",
    "e2vid-zip",
    "evreal",
    "dsec",
    "webdataset",
    "parquet",
];

/// Measures: `--program FILE` (built in release mode), `--events N` (10^8), `--only FORMAT,…`.
pub(crate) fn run(args: &[String]) -> Outcome {
    let options = Options(args);
    let events = options.number("--events", 100_000_000)?;
    let gs2e = options.program(&[])?;
    let folder = root().join("target/export-bench");
    if folder.exists() {
        fs::remove_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    }
    fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    make_release(&gs2e, &folder, events)?;
    say(&format!("| `--to` | {events} events | peak | written | plain copy of it |\n|---|---|---|---|---|"));
    let only = options.value("--only");
    let is_asked = |format: &&&str| only.is_none_or(|only| only.split(',').any(|name| name == **format));
    for format in FORMATS.iter().filter(is_asked) {
        measure(&gs2e, &folder, format, events)?;
    }
    fs::remove_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))
}

/// A release whose stream has this many events over the time of its poses.
fn make_release(gs2e: &Path, folder: &Path, events: u64) -> Outcome {
    let at = |name: &str| folder.join(name).to_string_lossy().into_owned();
    let (recipe, raw, h5) = (at("bench.yaml"), at("stream.raw"), at("stream.h5"));
    fs::write(&recipe, RECIPE).map_err(|e| format!("{recipe}: {e}"))?;
    let release = ["release", "--copy", "-q", "--store", &at("store"), "--to", &at("release"), &recipe];
    watch(gs2e, &release, &[0])?;
    write_stream(Path::new(&raw), events).map_err(|e| format!("{raw}: {e}"))?;
    watch(gs2e, &["convert", "-q", &raw, &h5], &[0])?;
    fs::rename(&h5, folder.join("release/bench/base/events.h5")).map_err(|e| format!("{h5}: {e}"))?;
    fs::remove_file(&raw).map_err(|e| format!("{raw}: {e}"))
}

fn measure(gs2e: &Path, folder: &Path, format: &str, events: u64) -> Outcome {
    let [release, out, copy] = ["release", "out", "copy"].map(|name| folder.join(name));
    let [from, to] = [&release, &out].map(|path| path.to_string_lossy().into_owned());
    let cost = watch(gs2e, &["export", "-q", &from, "--to", format, "--out", &to, "--lossy"], &[0])?;
    let begun = Instant::now();
    let bytes = copy_folder(&out, &copy).map_err(|e| format!("{}: {e}", copy.display()))?;
    let copied = begun.elapsed().as_secs_f64();
    say(&format!(
        "| `{format}` | {:.1} s, {:.1} Mev/s | {:.0} MB | {:.0} MB | {copied:.1} s |",
        cost.seconds,
        events as f64 * 1e-6 / cost.seconds,
        cost.peak_mb,
        bytes as f64 * 1e-6
    ));
    for done in [&out, &copy] {
        fs::remove_dir_all(done).map_err(|e| format!("{}: {e}", done.display()))?;
    }
    Ok(())
}

/// Copies a folder, and returns the number of bytes.
fn copy_folder(from: &Path, to: &Path) -> std::io::Result<u64> {
    fs::create_dir(to)?;
    let mut bytes = 0;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let target = to.join(entry.file_name());
        bytes += if entry.file_type()?.is_dir() {
            copy_folder(&entry.path(), &target)?
        } else {
            fs::copy(entry.path(), target)?
        };
    }
    Ok(bytes)
}
