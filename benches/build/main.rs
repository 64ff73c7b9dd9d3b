//! Time of `gs2e` when there is nothing to do, compared with ninja on a graph of the same size:
//! `cargo xtask bench build [--scenes N] [--runs N] [--long] [--check]`.
//!
//! Every figure is a ratio of commands that take turns in one run (A B A B …), since a busy machine
//! changes wall times by a factor of three; CPU seconds change least. ninja's graph comes from
//! `../shared/tools/build_bench`. If that or ninja is absent, the ratios are not measured, and the
//! output says so. `--check` ends with 1 if a limit is exceeded or could not be checked.
#![expect(clippy::print_stdout, clippy::print_stderr, reason = "the figures are printed")]

mod dataset;
mod graph;
mod series;

use graph::{Ninja, Ours, Template};
use series::{Contender, Series, interleave};
use std::path::Path;
use std::process::ExitCode;
use std::thread::sleep;
use std::time::Duration;

/// The reason why a measurement failed: a sentence for users.
type Outcome<T = ()> = Result<T, String>;

/// Multiple of ninja's time above which `--check` fails.
const RATIO_LIMIT: f64 = 2.0;

/// Peak of a no-op above which `--check` fails, MB.
const MEMORY_LIMIT_MB: f64 = 64.0;

/// A file younger than this may still change within the clock's resolution: tools that know this
/// read it again.
const AT_REST: Duration = Duration::from_millis(2500);

/// Threads of a first build, as an option and as a number.
const COLD: (&str, f64) = ("-j2", 2.0);

struct Options {
    scenes: usize,
    runs: usize,
    /// True if ten times as many scenes are measured too.
    long: bool,
    check: bool,
}

fn main() -> ExitCode {
    let options = match parse(std::env::args().skip(1)) {
        Ok(options) => options,
        Err(why) => {
            let usage = "usage: cargo xtask bench build [--scenes N] [--runs N] [--long] [--check]";
            eprintln!("error: {why}\n{usage}");
            return ExitCode::from(2);
        }
    };
    match measure(&options) {
        Ok(exceeded) => {
            exceeded.iter().for_each(|line| println!("exceeded: {line}"));
            ExitCode::from(u8::from(options.check && !exceeded.is_empty()))
        }
        Err(why) => {
            eprintln!("error: {why}");
            ExitCode::FAILURE
        }
    }
}

fn parse(mut args: impl Iterator<Item = String>) -> Outcome<Options> {
    let mut options = Options { scenes: 2000, runs: 11, long: false, check: false };
    while let Some(arg) = args.next() {
        let mut count = || {
            let found = args.next().unwrap_or_else(|| "nothing".into());
            found
                .parse()
                .ok()
                .filter(|n| *n > 0)
                .ok_or(format!("found {found} after {arg}, wanted a count above 0"))
        };
        match arg.as_str() {
            "--scenes" => options.scenes = count()?,
            "--runs" => options.runs = count()?,
            "--long" => options.long = true,
            "--check" => options.check = true,
            // cargo passes this to every benchmark.
            "--bench" => {}
            _ => return Err(format!("found `{arg}`, wanted an option")),
        }
    }
    Ok(options)
}

/// Measures everything; returns the limits that were exceeded.
fn measure(options: &Options) -> Outcome<Vec<String>> {
    let folder = tempfile::tempdir().map_err(|e| format!("a temporary folder: {e}"))?;
    let (root, scenes, runs) = (folder.path(), options.scenes, options.runs);
    println!("{scenes} scenes, {runs} runs each after one to warm up; wall time in s, CPU in s, peak in MB");
    let ninja = Ninja::prepare(root, scenes)?;
    let ours = Ours::prepare(&root.join("gs2e"), scenes, Template::FourSteps)?;
    if let Some(ninja) = &ninja {
        let cold = series::timed(ninja.cold(COLD.0))?;
        println!("cold     ninja  {}", cold.each(4 * scenes + 1));
    }
    cold(&ours)?;
    sleep(AT_REST);
    let mut exceeded = compare("no-op", ninja.as_ref(), &ours, false, runs)?;
    exceeded.extend(compare("changed", ninja.as_ref(), &ours, true, runs)?);
    step_work(&ours)?;
    for (label, args) in [("plan", ["plan", "--json"].as_slice()), ("version", &["--version"])] {
        let [series] = interleave(runs, &[Contender::still(|| ours.gs2e(args))])?;
        println!("{label:8} gs2e   {}", series.line());
    }
    shared_store(&ours, runs)?;
    growth(root, &ours, options)?;
    with_events(root, options)?;
    dataset::measure(root, scenes)?;
    // This comes last: the memory that this program holds counts towards the peak of its child
    // processes.
    ours.tell_keys()?;
    Ok(exceeded)
}

/// Measures the first build, by [`COLD`] threads. Time beyond the steps' own work is the cost of
/// the engine.
fn cold(ours: &Ours) -> Outcome {
    let (cold, own) = ours.build_telling(COLD.0)?;
    let (steps, own) = (own.len(), own.iter().sum::<f64>());
    let each = |seconds: f64| 1e3 * seconds / steps.max(1) as f64;
    let (share, beyond) = (each(own), each(COLD.1 * cold.seconds - own));
    println!(
        "cold     gs2e   {}; of both threads {share:.3} ms a step are its own work, {beyond:.3} are not",
        cold.each(steps)
    );
    Ok(())
}

/// Compares both tools with nothing to do, or with one recipe changed before each run.
fn compare(
    label: &str,
    ninja: Option<&Ninja>,
    ours: &Ours,
    change: bool,
    runs: usize,
) -> Outcome<Vec<String>> {
    let before_ours = || if change { ours.change() } else { Ok(()) };
    let gs2e = Contender { before: Box::new(before_ours), command: Box::new(|| ours.gs2e(&["build", "-q"])) };
    let Some(ninja) = ninja else {
        let [series] = interleave(runs, &[gs2e])?;
        println!("{label:8} gs2e   {}", series.line());
        return Ok(vec![format!("{label}: there is no ratio to check")]);
    };
    let before_ninja = || if change { ninja.change() } else { Ok(()) };
    let theirs = Contender { before: Box::new(before_ninja), command: Box::new(|| ninja.build()) };
    let [theirs, own] = interleave(runs, &[theirs, gs2e])?;
    println!("{label:8} ninja  {}", theirs.line());
    println!("{label:8} gs2e   {}", own.line());
    let [best, median] = [own.min() / theirs.min(), own.median() / theirs.median()];
    println!("{label:8} ratio  of minima {best:.2}, of medians {median:.2} (limit {RATIO_LIMIT})");
    let slow = (best > RATIO_LIMIT).then(|| format!("{label}: {best:.2} times ninja's time"));
    let peak = own.peak_mb();
    let large = (!change && peak > MEMORY_LIMIT_MB).then(|| format!("{label}: a peak of {peak:.0} MB"));
    Ok(slow.into_iter().chain(large).collect())
}

/// Measures a build that gives all of its steps to a shared store, a no-op with and without that store, and a
/// build with an empty store of its own.
fn shared_store(ours: &Ours, runs: usize) -> Outcome {
    let sharing = ["build", "-q", "--shared-store", "shared"];
    let steps = 4 * ours.scenes;
    println!("shared   gs2e   gives  {}", series::timed(ours.gs2e(&sharing))?.each(steps));
    let contenders =
        [Contender::still(|| ours.gs2e(&["build", "-q"])), Contender::still(|| ours.gs2e(&sharing))];
    let [alone, shared] = interleave(runs, &contenders)?;
    println!("shared   gs2e   no-op  {}", shared.line());
    let [best, median] = [shared.min() / alone.min(), shared.median() / alone.median()];
    println!("shared   ratio  to a no-op without it: of minima {best:.2}, of medians {median:.2}");
    let takes = ["build", "-q", "--shared-store", "shared", "--store", "empty"];
    println!("shared   gs2e   takes  {}", series::timed(ours.gs2e(&takes))?.each(steps));
    Ok(())
}

/// Measures the work of a changed recipe's steps, to be subtracted from the time of a changed
/// build.
fn step_work(ours: &Ours) -> Outcome {
    let mut sums = Vec::new();
    let mut steps = 0;
    for _ in 0..3 {
        ours.change()?;
        let (_, own) = ours.build_telling(COLD.0)?;
        steps = own.len();
        sums.push(own.iter().sum::<f64>());
    }
    sums.sort_by(f64::total_cmp);
    println!("changed  gs2e   {steps} steps ran, whose own work is {:.4} s (median of 3)", sums[1]);
    Ok(())
}

/// Measures a no-op over a tenth of the scenes, over all, and with `--long` over ten times as many.
fn growth(root: &Path, ours: &Ours, options: &Options) -> Outcome {
    let few = Ours::prepare(&root.join("few"), options.scenes.div_ceil(10), Template::FourSteps)?;
    cold(&few)?;
    sleep(AT_REST);
    let noop = |of: &'_ Ours| of.gs2e(&["build", "-q"]);
    let [small, large] =
        interleave(options.runs, &[Contender::still(|| noop(&few)), Contender::still(|| noop(ours))])?;
    tell_growth([few.scenes, ours.scenes], [&small, &large]);
    if options.long {
        let many = Ours::prepare(&root.join("many"), 10 * options.scenes, Template::FourSteps)?;
        cold(&many)?;
        sleep(AT_REST);
        let turns = [Contender::still(|| noop(ours)), Contender::still(|| noop(&many))];
        let [large, huge] = interleave(options.runs, &turns)?;
        tell_growth([ours.scenes, many.scenes], [&large, &huge]);
    }
    Ok(())
}

fn tell_growth(scenes: [usize; 2], series: [&Series; 2]) {
    for (scenes, series) in scenes.iter().zip(series) {
        println!("growth   gs2e   {}, {scenes} scenes", series.line());
    }
    let times = series[1].min() / series[0].min();
    let linear = times * scenes[0] as f64 / scenes[1] as f64;
    println!("growth   ratio  of minima {times:.2}; {linear:.2} of linear growth");
}

/// Repeats the measurements with a fifth step per scene that renders and simulates.
fn with_events(root: &Path, options: &Options) -> Outcome {
    println!("with `outputs: [events]`, five steps a scene:");
    let ours = Ours::prepare(&root.join("events"), options.scenes, Template::WithEvents)?;
    cold(&ours)?;
    sleep(AT_REST);
    compare_alone("no-op", &ours, false, options.runs)?;
    compare_alone("changed", &ours, true, options.runs)?;
    step_work(&ours)
}

fn compare_alone(label: &str, ours: &Ours, change: bool, runs: usize) -> Outcome {
    compare(label, None, ours, change, runs).map(drop)
}
