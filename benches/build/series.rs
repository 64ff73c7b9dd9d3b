//! Commands that take turns, and the cost of each of their runs.

use crate::Outcome;
use std::process::Command;
use std::time::Instant;
use wait4::Wait4 as _;

/// The cost of one run.
pub(crate) struct RunCost {
    pub(crate) seconds: f64,
    /// User and system time, including that of child processes, s.
    pub(crate) cpu: f64,
    /// Largest resident set, at least that of the program that starts it, MB.
    pub(crate) peak_mb: f64,
}

/// A command that is measured in turns with others.
pub(crate) struct Contender<'a> {
    /// Work before each run, untimed.
    pub(crate) before: Box<dyn Fn() -> Outcome + 'a>,
    pub(crate) command: Box<dyn Fn() -> Command + 'a>,
}

impl<'a> Contender<'a> {
    /// A contender without work before its runs.
    pub(crate) fn still(command: impl Fn() -> Command + 'a) -> Self {
        Self { before: Box::new(|| Ok(())), command: Box::new(command) }
    }
}

/// All runs of one contender.
pub(crate) struct Series(Vec<RunCost>);

/// Runs a command to its end, which must be successful.
pub(crate) fn timed(mut command: Command) -> Outcome<RunCost> {
    let message = format!("{command:?}");
    let start = Instant::now();
    let child = command.spawn().map_err(|e| format!("{message} cannot be started: {e}"))?;
    let used = child.wait4().map_err(|e| format!("{message} cannot be waited for: {e}"))?;
    let seconds = start.elapsed().as_secs_f64();
    if !used.status.success() {
        return Err(format!("{message} ended with {}", used.status));
    }
    let cpu = (used.rusage.utime + used.rusage.stime).as_secs_f64();
    Ok(RunCost { seconds, cpu, peak_mb: used.rusage.maxrss as f64 * 1e-6 })
}

/// Runs each contender once to warm up, then all in turns.
pub(crate) fn interleave<const N: usize>(
    runs: usize,
    contenders: &[Contender<'_>; N],
) -> Outcome<[Series; N]> {
    let mut all = std::array::from_fn(|_| Series(Vec::new()));
    for turn in 0..=runs {
        for (contender, series) in contenders.iter().zip(&mut all) {
            (contender.before)()?;
            let ran = timed((contender.command)())?;
            if turn > 0 {
                series.0.push(ran);
            }
        }
    }
    Ok(all)
}

impl RunCost {
    /// Describes the run as a run of `steps` steps.
    pub(crate) fn each(&self, steps: usize) -> String {
        let ms = |seconds: f64| 1e3 * seconds / steps.max(1) as f64;
        let Self { seconds, cpu, peak_mb } = self;
        let (each, cpu_each) = (ms(*seconds), ms(*cpu));
        format!(
            "{seconds:.2}, CPU {cpu:.2}, {peak_mb:.1} MB; {steps} steps, {each:.3} ms and {cpu_each:.3} ms of CPU a step"
        )
    }
}

impl Series {
    fn sorted(&self, of: impl Fn(&RunCost) -> f64) -> Vec<f64> {
        let mut values: Vec<f64> = self.0.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        values
    }

    pub(crate) fn min(&self) -> f64 {
        self.sorted(|ran| ran.seconds)[0]
    }

    pub(crate) fn median(&self) -> f64 {
        middle(&self.sorted(|ran| ran.seconds))
    }

    pub(crate) fn peak_mb(&self) -> f64 {
        self.0.iter().map(|ran| ran.peak_mb).fold(0.0, f64::max)
    }

    pub(crate) fn line(&self) -> String {
        let cpu = middle(&self.sorted(|ran| ran.cpu));
        let (min, median, peak) = (self.min(), self.median(), self.peak_mb());
        format!("min {min:.4}, median {median:.4}, CPU {cpu:.4}, {peak:.1} MB")
    }
}

fn middle(sorted: &[f64]) -> f64 {
    let n = sorted.len();
    f64::midpoint(sorted[(n - 1) / 2], sorted[n / 2])
}
