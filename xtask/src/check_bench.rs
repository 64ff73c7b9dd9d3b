//! Cost of the checks on files: the time of `check --tree` next to that of the releases, and the memory
//! and speed for streams of 10^6 to 10^8 events.

use crate::command::{Outcome, root, say};
use crate::options::Options;
use std::fs;
use std::io::{BufWriter, Write as _};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Size of the sensor of the demo and of the streams.
const SIZE: [u64; 2] = [640, 360];
/// Length of a stream, us: that of the demo.
const SPAN_US: u64 = 62_000;
const RECIPE: &str = "recipes/demo.yaml";
const REAL_SCENE: &str = "../shared/data/scenes";
/// Events of the demo's scene, in its release.
const EVENTS: &str = "demo/procedural/still-life/base/events.h5";

/// A finished run.
pub(crate) struct Cost {
    pub(crate) seconds: f64,
    /// CPU time in user and system mode, to a hundredth of a second.
    pub(crate) cpu_seconds: f64,
    /// Largest resident memory, MB.
    pub(crate) peak_mb: f64,
}

/// Measures: `--program FILE` (built in release mode), `--most N` (10^8 events), `--runs N` (3).
pub(crate) fn run(args: &[String]) -> Outcome {
    let options = Options(args);
    let (most, runs) = (options.number("--most", 100_000_000)?, options.number("--runs", 3)?.max(1));
    let gs2e = options.program(&[])?;
    let folder = root().join("target/check-bench");
    fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    if root().join(REAL_SCENE).is_dir() {
        let recipe = folder.join("playbot.yaml");
        fs::write(&recipe, real_recipe()).map_err(|e| format!("{}: {e}", recipe.display()))?;
        compare_with_release(&gs2e, &folder, ("playbot", &recipe.to_string_lossy()), runs)?;
    } else {
        say(&format!("absent: {REAL_SCENE}: the check of a real scene is not timed"));
    }
    // The last one: its tree then takes the streams.
    compare_with_release(&gs2e, &folder, ("demo", RECIPE), runs)?;
    measure_streams(&gs2e, &folder, most)
}

/// A real scene of 500,000 Gaussians, with the demo's path, size and outputs, and the default sensor.
fn real_recipe() -> String {
    let scenes = root().join(REAL_SCENE);
    let [views, gaussians] = ["playbot.transforms.json", "playbot.spz"].map(|name| scenes.join(name));
    // A path in Rust's quotes is a string of YAML too.
    format!(
        "version: 1\nscene: real/playbot\nsource: {{ nerfstudio: {{ path: {views:?} }} }}\n\
         reconstruct: {{ given: {{ path: {gaussians:?} }} }}\ncamera: {{ width: 640, height: 360 }}\n\
         trajectories: [{{ name: base, refine: {{ window: 2, factor: 5 }}, \
         speed: {{ function: \"0.25*sin(t) + 1.1\" }} }}]\noutputs: [events, sharp]\n\
         licence: {{ expression: CC0-1.0, holder: a benchmark }}\n"
    )
}

/// The time of `check --tree` on a release, and that of the release from an empty store; the fastest of
/// some runs.
fn compare_with_release(gs2e: &Path, folder: &Path, (scene, recipe): (&str, &str), runs: u64) -> Outcome {
    let [store, out] = ["store", scene].map(|name| folder.join(name));
    let [mut made, mut checked, mut made_cpu, mut checked_cpu] = [f64::INFINITY; 4];
    for _ in 0..runs {
        for old in [&store, &out] {
            if old.exists() {
                fs::remove_dir_all(old).map_err(|e| format!("{}: {e}", old.display()))?;
            }
        }
        let [store, out] = [&store, &out].map(|path| path.to_string_lossy().into_owned());
        let release = ["release", "--copy", "-q", "--store", &store, "--to", &out, recipe];
        let of_release = watch(gs2e, &release, &[0])?;
        let of_check = watch(gs2e, &["check", "--json", "--tree", &out], &[0])?;
        (made, checked) = (made.min(of_release.seconds), checked.min(of_check.seconds));
        (made_cpu, checked_cpu) =
            (made_cpu.min(of_release.cpu_seconds), checked_cpu.min(of_check.cpu_seconds));
    }
    say(&format!(
        "{scene}: released in {made:.2} s, checked from its files in {checked:.2} s: {:.1} %; \
         CPU time {made_cpu:.2} s and {checked_cpu:.2} s: {:.1} %",
        100.0 * checked / made,
        100.0 * checked_cpu / made_cpu
    ));
    Ok(())
}

fn measure_streams(gs2e: &Path, folder: &Path, most: u64) -> Outcome {
    say("| events | `check --events` | peak | `check --tree` | peak |\n|---|---|---|---|---|");
    let at = |name: &str| folder.join(name).to_string_lossy().into_owned();
    let mut events = 1_000_000;
    while events <= most {
        let (raw, h5) = (at("stream.raw"), at("stream.h5"));
        write_stream(Path::new(&raw), events).map_err(|e| format!("{raw}: {e}"))?;
        // These events are of no scene, so that checks fail.
        let of_events = watch(gs2e, &["check", "--json", "--events", &raw], &[0, 3])?;
        let _ = fs::remove_file(&h5);
        watch(gs2e, &["convert", "-q", &raw, &h5], &[0])?;
        fs::rename(&h5, folder.join(EVENTS)).map_err(|e| format!("{h5}: {e}"))?;
        let of_tree = watch(gs2e, &["check", "--json", "--tree", &at("demo")], &[0, 3])?;
        let cell = |cost: &Cost| {
            let rate = events as f64 * 1e-6 / cost.seconds;
            format!("{:.1} s, {rate:.1} Mev/s | {:.0} MB", cost.seconds, cost.peak_mb)
        };
        say(&format!("| {events} | {} | {} |", cell(&of_events), cell(&of_tree)));
        events *= 10;
    }
    Ok(())
}

/// Runs the program, which must end with one of these codes.
pub(crate) fn watch(gs2e: &Path, args: &[&str], codes: &[i32]) -> Outcome<Cost> {
    watch_messages(gs2e, args, codes, Stdio::null())
}

/// [`watch`], with the messages of the program going to `messages`.
pub(crate) fn watch_messages(gs2e: &Path, args: &[&str], codes: &[i32], messages: Stdio) -> Outcome<Cost> {
    let what = format!("gs2e {}", args.join(" "));
    let begun = Instant::now();
    let mut command = Command::new(gs2e);
    command.args(args).current_dir(root()).stdin(Stdio::null()).stdout(Stdio::null()).stderr(messages);
    let mut child = command.spawn().map_err(|e| format!("`{what}` cannot be started: {e}"))?;
    let [status, stat] = ["status", "stat"].map(|name| format!("/proc/{}/{name}", child.id()));
    let mut peak_kib = 0_u64;
    let mut ticks = 0_u64;
    loop {
        let text = fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kib = line.and_then(|line| line.trim().strip_suffix("kB")?.trim().parse().ok());
        peak_kib = peak_kib.max(kib.unwrap_or(0));
        ticks = ticks.max(cpu_ticks(&fs::read_to_string(&stat).unwrap_or_default()).unwrap_or(0));
        if let Some(ended) = child.try_wait().map_err(|e| format!("`{what}`: {e}"))? {
            let seconds = begun.elapsed().as_secs_f64();
            let known = ended.code().is_some_and(|code| codes.contains(&code));
            // Linux counts in hundredths of a second on every architecture (proc_pid_stat(5)).
            let cpu_seconds = ticks as f64 * 0.01;
            let cost = Cost { seconds, cpu_seconds, peak_mb: peak_kib as f64 * 1.024e-3 };
            return if known { Ok(cost) } else { Err(format!("`{what}` ended with {ended}")) };
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// User and system time of a process and its ended children, from the text of `/proc/PID/stat`. The name of
/// the program, in parentheses, may hold spaces.
fn cpu_ticks(stat: &str) -> Option<u64> {
    let (_, after_name) = stat.rsplit_once(')')?;
    // Fields 14 to 17; the name is field 2.
    let fields = after_name.split_whitespace().skip(11).take(4);
    fields.map(|field| field.parse::<u64>().ok()).sum()
}

/// Writes a stream in EVT 2.0 (Prophesee, docs.prophesee.ai): 32-bit words, of which the highest four
/// bits are the kind. The events jump over the sensor, ON and OFF in turn.
pub(crate) fn write_stream(path: &Path, events: u64) -> std::io::Result<()> {
    let mut out = BufWriter::new(fs::File::create(path)?);
    let [width, height] = SIZE;
    write!(
        out,
        "% evt 2.0\n% format EVT2;height={height};width={width}\n% geometry {width}x{height}\n% end\n"
    )?;
    let mut high = u64::MAX;
    for i in 0..events {
        let t_us = i * SPAN_US / events;
        if t_us >> 6 != high {
            high = t_us >> 6;
            out.write_all(&word(0x8, high))?;
        }
        let pixel = i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32;
        let (x, y) = (pixel % width, pixel / width % height);
        out.write_all(&word(i % 2, (t_us & 63) << 22 | x << 11 | y))?;
    }
    out.flush()
}

#[expect(clippy::cast_possible_truncation, reason = "a word of 32 bits")]
fn word(kind: u64, content: u64) -> [u8; 4] {
    ((kind << 28 | content) as u32).to_le_bytes()
}
