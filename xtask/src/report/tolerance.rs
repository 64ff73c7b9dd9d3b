//! The page that compares a tolerance with a rate: builds of both, and their results.

use super::{Options, gs2e, present};
use crate::command::{Outcome, say};
use crate::folder::Folder;
use std::fmt::Write as _;
use std::time::Instant;

/// The page, below `docs/` or, for a part of the runs, `target/report/`.
const PAGE: &str = "tolerance.md";

const INTRODUCTION: &str = "\
# A tolerance against a rate

The time and the error of `sampling: { tolerance: 0.03 }`, compared with `sampling: { rate: 2400 }`: builds of the whole path
of three scenes, whose picture moves at 300 px/s (`base`) and at 1,200 px/s (`fast`). Written by `cargo xtask report tolerance`.

The times are wall-clock times of the step `events` on an idle machine, including the frames that choose the sampling. The rate
uses the rules `official` and linear interpolation, as published datasets do; the tolerance uses the rules `soft`, and the
interpolation that it chooses. The error is measured on twelve intervals of the path that the choice did not use, in
thresholds; `scene.json` has the predicted error and a 95 % bound, which is at most the tolerance, or else the step fails. A
rate has no such bound: the curves of [error against run time](work-precision.md) show the error of 2,400 frames per second.

| scene | trajectory | sampling | s | events | frames |
|---|---|---|---|---|---|
";

const TRAJECTORIES: [&str; 2] = ["base", "fast"];
const SAMPLINGS: [&str; 2] = ["rate: 2400", "tolerance: 0.03"];

/// Builds the scenes and writes the page.
pub(super) fn run(options: &Options) -> Outcome {
    let work = Folder::new("tolerance")?;
    let mut page = INTRODUCTION.to_owned();
    let (scenes, to) = present(options);
    for scene in scenes {
        let recipe = work.path().join(format!("{}.yaml", scene.name));
        for trajectory in TRAJECTORIES {
            for sampling in SAMPLINGS {
                let start = Instant::now();
                let text = scene.events(options.quick, trajectory, sampling);
                std::fs::write(&recipe, text).map_err(|e| format!("{}: {e}", recipe.display()))?;
                let message = gs2e(&["build", "--backend", "cpu"], work.path(), &recipe, &[])?;
                let _ = write!(page, "{}", row(scene.name, sampling, &message).unwrap_or_default());
                let seconds = start.elapsed().as_secs_f64();
                say(&format!("{}, {trajectory}, {sampling}: {seconds:.0} s", scene.name));
            }
        }
    }
    let file = to.join(PAGE);
    std::fs::create_dir_all(&to).map_err(|e| format!("{}: {e}", to.display()))?;
    std::fs::write(&file, page).map_err(|e| format!("{}: {e}", file.display()))?;
    say(&format!("written: {}", file.display()));
    Ok(())
}

/// A table row from the step that made events: its seconds and its message. `None` if the step was
/// up to date.
fn row(scene: &str, sampling: &str, message: &str) -> Option<String> {
    let of_line = |line: &str| {
        let (step, rest) = line.split_once("] ")?.1.split_once("/events ")?;
        let (seconds, made) = rest.split_once(" s ")?;
        let (events, frames) = made.split_once(", ").unwrap_or((made, ""));
        let trajectory = step.rsplit('/').next()?;
        Some(format!("| {scene} | {trajectory} | `{sampling}` | {seconds} | {events} | {frames} |\n"))
    };
    message.lines().find_map(of_line)
}

#[cfg(test)]
mod tests {
    use super::row;

    #[test]
    fn the_step_that_made_events_is_a_row() {
        let message = "scenes: 1\n[3/6] plant/base/trajectory 0.1 s\n[4/6] plant/base/events 33.6 s 421.8 kev, 33 frames (hermite) and \
                    96 to choose them\n";
        let wanted =
            "| a | base | `rate: 1` | 33.6 | 421.8 kev | 33 frames (hermite) and 96 to choose them |\n";
        assert_eq!(row("a", "rate: 1", message).as_deref(), Some(wanted));
        let plain = "[5/6] plant/fast/events 7.0 s 1.2 Mev\n";
        assert_eq!(
            row("b", "rate: 1", plain).as_deref(),
            Some("| b | fast | `rate: 1` | 7.0 | 1.2 Mev |  |\n")
        );
        assert_eq!(row("b", "rate: 1", "made 0, up to date 6"), None);
    }
}
