//! The page that compares a tolerance with a rate: builds of both, and their results.

use super::{Options, present};
use crate::check_bench::watch_messages;
use crate::command::{Outcome, cargo, root, say};
use crate::folder::Folder;
use std::fmt::Write as _;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The page, below `crates/lab/results/` or, for a part of the runs, `target/report/`.
const PAGE: &str = "tolerance.md";

const INTRODUCTION: &str = "\
# A tolerance against a rate

The cost and the error of `sampling: { tolerance: 0.03 }`, compared with fixed rates: builds of whole paths of three scenes,
whose picture moves at 300 px/s (`base`), 1,200 px/s (`fast`) and 4,800 px/s (`faster`). Written by `cargo xtask report
tolerance`.

Core-seconds are the processor time of the build of the events from a finished trajectory, on one core: the frames, the sensor,
`events.h5` and the checks, and for a tolerance the frames that choose its sampling. `rate: 2400` uses the rules `official` and
linear interpolation, as published datasets do. The tolerance uses the rules `soft`, and the interpolation that it chooses. The
last row of each path is a fixed rate with as many frames as the tolerance chose, with the same rules and interpolation: what
the tolerance would cost if the choice were free.

The error is measured on twelve intervals of the path that the choice did not use, in thresholds; `scene.json` has the predicted
error and a 95 % bound, which is at most the tolerance, or else the step fails. A rate has no such bound: the curves of [error
against run time](work-precision.md) show the error of 2,400 frames per second. A pilot frame is a sample of the tiles of a
frame.

| scene | trajectory | sampling | core-s | events | frames |
|---|---|---|---|---|---|
";

/// Builds the scenes and writes the page.
pub(super) fn run(options: &Options) -> Outcome {
    let work = Folder::new("tolerance")?;
    let gs2e = match &options.program {
        Some(program) => program.clone(),
        None => {
            cargo(&["build", "--release", "--quiet"]).run()?;
            root().join("target/release/gs2e")
        }
    };
    let mut page = INTRODUCTION.to_owned();
    let (scenes, to) = present(options);
    let mut costs = Vec::new();
    for scene in scenes {
        let build = EventBuild { gs2e: &gs2e, work: work.path(), scene: scene.name };
        for trajectory in scene.compared() {
            let recipe =
                |sampling: &str, outputs: &str| scene.sampled(options.quick, trajectory, sampling, outputs);
            build.run(&recipe(RATE, ""))?;
            let seconds = build.duration(trajectory)?;
            let mut add = |sampling: &str, made: &EventCounts| {
                let EventCounts { core_seconds, events, frames } = made;
                let name = scene.name;
                let line = format!(
                    "| {name} | {trajectory} | `{sampling}` | {core_seconds:.1} | {events} | {frames} |"
                );
                say(&line);
                let _ = writeln!(page, "{line}");
            };
            let rate = build.run(&recipe(RATE, "events"))?;
            add("rate: 2400", &rate);
            let tolerance = build.run(&recipe(TOLERANCE, "events"))?;
            add("tolerance: 0.03", &tolerance);
            let frames = tolerance.frame_count().ok_or("the message of the step has no number of frames")?;
            let same = f64::from(frames - 1) / seconds;
            let between = tolerance.interpolation().ok_or("the message of the step has no interpolation")?;
            let fixed =
                format!("sampling: {{ rate: {same:.3}, between: {between} }}\nrender: {{ rules: soft }}");
            let fixed = build.run(&recipe(&fixed, "events"))?;
            add(&format!("rate: {same:.0}"), &fixed);
            costs.push((
                scene.name,
                *trajectory,
                tolerance.core_seconds,
                fixed.core_seconds,
                rate.core_seconds,
            ));
        }
    }
    page += "\n| scene | trajectory | tolerance by the fixed rate with as many frames | by 2,400 frames per second |\n|---|---|---|---|\n";
    for (scene, trajectory, tolerance, fixed, rate) in costs {
        let _ =
            writeln!(page, "| {scene} | {trajectory} | {:.2} | {:.2} |", tolerance / fixed, tolerance / rate);
    }
    let file = to.join(PAGE);
    fs::create_dir_all(&to).map_err(|e| format!("{}: {e}", to.display()))?;
    fs::write(&file, page).map_err(|e| format!("{}: {e}", file.display()))?;
    say(&format!("written: {}", file.display()));
    Ok(())
}

const RATE: &str = "sampling: { rate: 2400 }";
const TOLERANCE: &str = "sampling: { tolerance: 0.03 }";

/// Builds of one scene in one store.
struct EventBuild<'a> {
    gs2e: &'a Path,
    work: &'a Path,
    scene: &'a str,
}

/// What a build of events says of itself.
#[derive(Debug, PartialEq)]
struct EventCounts {
    core_seconds: f64,
    events: String,
    /// The number of frames and their choice, for a tolerance.
    frames: String,
}

impl EventBuild<'_> {
    /// Builds a recipe, and returns what it made of events.
    fn run(&self, recipe: &str) -> Outcome<EventCounts> {
        let file = self.recipe();
        fs::write(&file, recipe).map_err(|e| format!("{}: {e}", file.display()))?;
        let messages = self.work.join("messages.txt");
        let to = File::create(&messages).map_err(|e| format!("{}: {e}", messages.display()))?;
        let [store, recipe] = [self.work.join("store"), file].map(|path| path.display().to_string());
        let args =
            ["build", "--backend", "cpu", "-j", "1", "--keep-frames", "off", "--store", &store, &recipe];
        let cost = watch_messages(self.gs2e, &args, &[0], to.into())?;
        let text = fs::read_to_string(&messages).map_err(|e| format!("{}: {e}", messages.display()))?;
        let (events, frames) = made(&text).unwrap_or_default();
        Ok(EventCounts { core_seconds: cost.cpu_seconds, events, frames })
    }

    fn recipe(&self) -> PathBuf {
        self.work.join(format!("{}.yaml", self.scene))
    }

    /// Duration of the path, s: the last time stamp of its poses.
    fn duration(&self, trajectory: &str) -> Outcome<f64> {
        let links = self.work.join("links");
        let mut build = Command::new(self.gs2e);
        build.args(["build", "--backend", "cpu", "--store"]).arg(self.work.join("store"));
        build.arg("--to").arg(&links).arg(self.recipe());
        build.output().map_err(|e| format!("gs2e build: {e}"))?;
        let path = links.join(self.scene).join(trajectory).join("trajectory/timestamps_us.txt");
        let text = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        let last = text.lines().last().and_then(|line| line.trim().parse::<f64>().ok());
        Ok(last.ok_or_else(|| format!("{}: no time stamp in the last line", path.display()))? * 1e-6)
    }
}

impl EventCounts {
    /// Number of frames that a tolerance chose.
    fn frame_count(&self) -> Option<u32> {
        self.frames.split(' ').next()?.parse().ok()
    }

    /// The interpolation that a tolerance chose.
    fn interpolation(&self) -> Option<&str> {
        Some(self.frames.split_once('(')?.1.split_once(')')?.0)
    }
}

/// The events, and the frames with their choice, from the line of the step that made them. `None` if no step
/// made events.
fn made(messages: &str) -> Option<(String, String)> {
    let of_line = |line: &str| {
        let (_, rest) = line.split_once("] ")?.1.split_once("/events ")?;
        let (_, made) = rest.split_once(" s ")?;
        let (events, frames) = made.split_once(", ").unwrap_or((made, ""));
        Some((events.to_owned(), frames.to_owned()))
    };
    messages.lines().find_map(of_line)
}

#[cfg(test)]
mod tests {
    use super::{EventCounts, made};

    #[test]
    fn the_line_of_the_step_says_what_it_made() {
        let message = "scenes: 1\n[3/6] plant/base/trajectory 0.1 s\n[4/6] plant/base/events 33.6 s 421.8 kev, 33 frames (hermite) and \
                    96 to choose them\n";
        let (events, frames) = made(message).expect("a step made events");
        assert_eq!((&*events, &*frames), ("421.8 kev", "33 frames (hermite) and 96 to choose them"));
        let made_events = EventCounts { core_seconds: 1.0, events, frames };
        assert_eq!((made_events.frame_count(), made_events.interpolation()), (Some(33), Some("hermite")));
        let plain = "[5/6] plant/fast/events 7.0 s 1.2 Mev\n";
        assert_eq!(made(plain), Some(("1.2 Mev".to_owned(), String::new())));
        assert_eq!(made("0 steps built, 6"), None);
    }
}
