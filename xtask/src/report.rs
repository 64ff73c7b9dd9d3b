//! The page of error against run time: `gs2e study` over three scenes, and the growth of run time,
//! from real runs.
//!
//! All figures of a run are its own output; this module only arranges them.

mod scenes;
mod tolerance;

use crate::command::{Outcome, cargo, root, say};
use crate::folder::Folder;
use scenes::{SCENES, Scene};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The page, below `crates/lab/results/` or, for a part of the runs, `target/report/`; its pictures are in a
/// folder of its name.
const PAGE: &str = "work-precision.md";
const PICTURES: &str = "work-precision";

/// The first of the sections that the page leaves out.
const DETAILS: &str = "\n## Core-seconds at the error of";

const INTRODUCTION: &str = "\
# Error against run time

The cost of frames, interpolation, steps and rules, and the error of their events against those of the finest frames: `gs2e
study` on three scenes. `cargo xtask report` writes this page and its pictures, from runs on the machine that the tables name.

Each rule set is compared with its own limit, `hermite` between 9,600 frames per second. Published datasets are made with
linear interpolation of 2,400 frames per second under the rules `official`; each first table has the cheapest settings with the
same errors, rendering and sensor together. `soft` renders Gaussians that fade in and out instead of ending at an alpha of
1/255; `blended` is `soft` with layers of nearly the same depth that cover each other in part. In the pictures a curve is a
method: rules by colour, `hermite` solid, `catmull` dashed, `linear` dotted, flow steps with hollow marks.
[docs/sampling.md](../../../docs/sampling.md#how-many-frames-and-which) explains the errors and the costs.
";

const GROWTH: &str = "
## How run time grows

Core-seconds from the Gaussians in memory to the last event, by `cargo xtask bench growth`, on the same machine. The last row
of each table has the exponent by which the column grows, by least squares of logarithms, and for the total its standard error.
It is below 1 where a part of the time does not depend on the quantity that grows, and the columns show which part: projection
and sorting depend on the Gaussians, whatever the size of the picture; the raster depends on the pairs that it blends, whose
number is the same where more Gaussians make up one picture. The line below a table splits the time into a constant and a
share per frame, pixel or Gaussian.
";

struct Options {
    quick: bool,
    scenes: Vec<String>,
    /// A program that is built already, for the comparison of a tolerance with a rate.
    program: Option<PathBuf>,
}

/// A study that is made of each scene.
struct Setting {
    name: &'static str,
    title: &'static str,
    args: &'static [&'static str],
    /// Length of the window, s.
    seconds: &'static str,
    /// Measures whose pictures are shown.
    pictures: &'static [&'static str],
}

const SETTINGS: [Setting; 5] = [
    Setting {
        name: "base",
        title: "The picture moves at 300 px/s",
        args: &["--trajectory", "base"],
        seconds: "0.05",
        pictures: &["rms", "miscount", "time_median"],
    },
    Setting {
        name: "bursty",
        title: "In bursts: 0.1, 1.9, 0.4 and 1.6 times that speed, 20 ms each",
        args: &["--trajectory", "bursty"],
        seconds: "0.08",
        pictures: &["rms", "time_median"],
    },
    Setting {
        name: "fast",
        title: "The picture moves at 1,200 px/s",
        args: &["--trajectory", "fast"],
        seconds: "0.025",
        pictures: &["rms", "time_median"],
    },
    Setting {
        name: "noise",
        title: "At 300 px/s with the sensor's noise",
        args: &["--trajectory", "base", "--noise", "--steps", "uniform"],
        seconds: "0.025",
        pictures: &["time_median"],
    },
    Setting {
        name: "blended",
        title: "At 300 px/s, layers of nearly the same depth blended",
        args: &["--trajectory", "base", "--rules", "official,soft,blended", "--steps", "uniform"],
        seconds: "0.01",
        pictures: &["rms", "time_median"],
    },
];

/// Arguments of a quick trial, in place of those of the setting and the defaults.
const QUICK: [&str; 6] = ["--seconds", "0.02", "--rates", "300,600,1200,2400", "--finest", "4800"];
/// The rates for windows that would hold too few steps of the coarsest rate.
const SHORT: [&str; 2] = ["--rates", "300,600,1200,2400,4800"];

/// Runs the studies and the builds, and writes the pages; with `tolerance` as the first word, only
/// the builds.
pub(crate) fn run(args: &[String]) -> Outcome {
    if let [first, rest @ ..] = args
        && first == "tolerance"
    {
        return tolerance::run(&options(rest)?);
    }
    let options = options(args)?;
    studies(&options)?;
    tolerance::run(&options)
}

/// The selected scenes that are there, and the folder of a page about them.
fn present(options: &Options) -> (Vec<&'static Scene>, PathBuf) {
    let (present, absent): (Vec<&Scene>, Vec<&Scene>) =
        SCENES.iter().filter(|scene| options.wants(scene)).partition(|scene| scene.is_there());
    for scene in &absent {
        say(&format!("left out: {}, since ../shared is absent", scene.name));
    }
    let whole = present.len() == SCENES.len() && !options.quick;
    (present, root().join(if whole { "crates/lab/results" } else { "target/report" }))
}

fn studies(options: &Options) -> Outcome {
    let (present, to) = present(options);
    let pictures = to.join(PICTURES);
    std::fs::create_dir_all(&pictures).map_err(|e| format!("{}: {e}", pictures.display()))?;
    let work = Folder::new("report")?;
    let mut page = INTRODUCTION.to_owned();
    for scene in present {
        page += &study(scene, options, work.path(), &pictures)?;
    }
    page += GROWTH;
    page += &growth(options)?;
    let file = to.join(PAGE);
    std::fs::write(&file, page).map_err(|e| format!("{}: {e}", file.display()))?;
    say(&format!("written: {}", file.display()));
    Ok(())
}

fn options(args: &[String]) -> Outcome<Options> {
    let mut options = Options { quick: false, scenes: Vec::new(), program: None };
    let mut args = args.iter();
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--quick" => options.quick = true,
            "--scene" => {
                let names = SCENES.map(|scene| scene.name);
                let name = args.next().filter(|name| names.contains(&name.as_str()));
                options
                    .scenes
                    .push(name.ok_or(format!("--scene wants one of {}", names.join(", ")))?.clone());
            }
            "--program" => options.program = Some(args.next().ok_or("--program wants a file")?.into()),
            _ => {
                return Err(format!(
                    "found `{arg}`, wanted tolerance first, --quick, --scene NAME or --program FILE"
                ));
            }
        }
    }
    Ok(options)
}

impl Options {
    fn wants(&self, scene: &Scene) -> bool {
        self.scenes.is_empty() || self.scenes.iter().any(|name| name == scene.name)
    }
}

/// The section of a scene.
fn study(scene: &Scene, options: &Options, work: &Path, pictures: &Path) -> Outcome<String> {
    let recipe = work.join(format!("{}.yaml", scene.name));
    std::fs::write(&recipe, scene.paths(options.quick)).map_err(|e| format!("{}: {e}", recipe.display()))?;
    gs2e(&["build", "--backend", "cpu"], work, &recipe, &[])?;
    let mut section = format!("\n## {}\n\n{}\n", scene.name, scene.words);
    // Frames of the blended order take ten times as long, at any size.
    let tried = |setting: &&Setting| !options.quick || setting.name != "blended" || scene.is_ours();
    for setting in SETTINGS.iter().filter(tried) {
        let start = Instant::now();
        let to = work.join(format!("{}-{}", scene.name, setting.name));
        let mut args = vec!["--seconds", setting.seconds, "--to"];
        let shown = to.to_string_lossy();
        args.push(&shown);
        args.extend(setting.args);
        if options.quick {
            args.drain(..2);
            args.extend(QUICK);
        } else if setting.name == "blended" {
            args.extend(SHORT);
        }
        gs2e(&["study", "--no-pictures", "--backend", "cpu"], work, &recipe, &args)?;
        section += &part(scene, setting, &to, pictures)?;
        say(&format!("{}, {}: {:.0} s", scene.name, setting.name, start.elapsed().as_secs_f64()));
    }
    Ok(section)
}

/// Runs the program, and returns its messages.
fn gs2e(verb: &[&str], work: &Path, recipe: &Path, args: &[&str]) -> Outcome<String> {
    let built = ["run", "--release", "--quiet", "--bin", "gs2e", "--"];
    let task = cargo(&built).args(verb).args([Path::new("--store"), &work.join("store"), recipe]);
    let output = task.args(args).capture()?;
    Ok(String::from_utf8_lossy(&output.stderr).into_owned())
}

/// The text of one study, with its pictures copied.
fn part(scene: &Scene, setting: &Setting, found: &Path, pictures: &Path) -> Outcome<String> {
    let summary = found.join("summary.md");
    let summary = std::fs::read_to_string(&summary).map_err(|e| format!("{}: {e}", summary.display()))?;
    let mut section = format!("\n### {}: {}\n\n{}\n\n", scene.name, setting.title, head(&summary));
    for measure in setting.pictures {
        let name = format!("{}-{}-{measure}.svg", scene.name, setting.name);
        let [from, to]: [PathBuf; 2] = [found.join(format!("{measure}.svg")), pictures.join(&name)];
        if from.is_file() {
            std::fs::copy(&from, &to).map_err(|e| format!("{}: {e}", to.display()))?;
            let _ = writeln!(section, "![{}: {measure} over core-seconds]({PICTURES}/{name})\n", scene.name);
        }
    }
    section.truncate(section.trim_end().len());
    section.push('\n');
    Ok(section)
}

/// A summary without its title and its details, each heading two levels lower.
fn head(summary: &str) -> String {
    let short = summary.split(DETAILS).next().unwrap_or_default();
    let lines = short.lines().skip_while(|line| line.starts_with("# ") || line.is_empty());
    let lower = |line: &str| if line.starts_with("## ") { format!("##{line}") } else { line.to_owned() };
    lines.map(lower).collect::<Vec<_>>().join("\n")
}

fn growth(options: &Options) -> Outcome<String> {
    let start = Instant::now();
    let bench = ["bench", "--quiet", "--bench", "throughput", "--", "growth", "--runs"];
    let output = cargo(&bench).args([if options.quick { "1" } else { "7" }]).capture()?;
    say(&format!("growth: {:.0} s", start.elapsed().as_secs_f64()));
    Ok(format!("\n{}\n", String::from_utf8_lossy(&output.stdout).trim()))
}

#[cfg(test)]
mod tests {
    use super::head;

    #[test]
    fn a_page_has_what_stands_before_the_details() {
        let summary = "# Work\n\n1 px; 2 cores.\n\n## Rule sets\n\n| a |\n\n## Core-seconds at the error of `x`\n\n| b |\n";
        assert_eq!(head(summary), "1 px; 2 cores.\n\n#### Rule sets\n\n| a |");
    }
}
