//! Timing of workloads in rounds, and the results as a table and as JSON.

use serde_json::{Value, json};
use std::time::Instant;

/// The amount of work that one run did.
pub(crate) struct Amount {
    pub(crate) count: f64,
    /// The unit of the count, as in `Mpixel`; rates are per second.
    pub(crate) unit: &'static str,
}

/// One run: its time and its amounts.
pub(crate) struct Run {
    seconds: f64,
    amounts: Vec<Amount>,
}

/// Times `work`. Anything before this call is not timed.
pub(crate) fn timed(work: impl FnOnce() -> Vec<Amount>) -> Run {
    let start = Instant::now();
    let amounts = std::hint::black_box(work());
    Run { seconds: start.elapsed().as_secs_f64(), amounts }
}

/// A timed piece of work.
pub(crate) struct Workload {
    pub(crate) part: &'static str,
    /// Description of the work, sizes included.
    pub(crate) what: String,
    /// True if another program does the work of the previous workload; the ratio of the two is
    /// reported.
    pub(crate) rival: bool,
    /// Does the work once. Deterministic: every run does the same amounts.
    pub(crate) run: Box<dyn FnMut() -> Run>,
}

/// The times of one workload.
pub(crate) struct Timing {
    part: &'static str,
    what: String,
    rival: bool,
    amounts: Vec<Amount>,
    /// Times, sorted.
    seconds: Vec<f64>,
}

/// Runs each workload once to warm up, then `runs` times. Rounds are interleaved (A B C, A B C, …),
/// so that a machine that is busy for a while slows every workload and not one of them.
pub(crate) fn measure(workloads: Vec<Workload>, runs: usize) -> Vec<Timing> {
    let warm = |mut work: Workload| {
        let amounts = (work.run)().amounts;
        let (part, what, rival) = (work.part, work.what.clone(), work.rival);
        let timing = Timing { part, what, rival, amounts, seconds: Vec::new() };
        (work, timing)
    };
    let mut all: Vec<(Workload, Timing)> = workloads.into_iter().map(warm).collect();
    for _ in 0..runs {
        all.iter_mut().for_each(|(work, timing)| timing.seconds.push((work.run)().seconds));
    }
    let sorted = |(_, mut timing): (Workload, Timing)| {
        timing.seconds.sort_by(f64::total_cmp);
        timing
    };
    all.into_iter().map(sorted).collect()
}

impl Timing {
    fn median(&self) -> f64 {
        let n = self.seconds.len();
        f64::midpoint(self.seconds[(n - 1) / 2], self.seconds[n / 2])
    }

    fn min(&self) -> f64 {
        self.seconds[0]
    }

    /// Lines for users: the work, then the rates at the median and at the fastest run.
    pub(crate) fn lines(&self) -> String {
        let rates = |seconds: f64| {
            let rate =
                |a: &Amount| format!("{:>8} {:<15}", significant(a.count / seconds), format!("{}/s", a.unit));
            let rates: Vec<String> = self.amounts.iter().map(rate).collect();
            format!("{:>9} ms {}", significant(1e3 * seconds), rates.join("").trim_end())
        };
        let (head, [median, best]) = (self.part, [self.median(), self.min()].map(rates));
        format!("{head}: {}\n  median {median}\n  best   {best}", self.what)
    }

    /// The figures as JSON.
    pub(crate) fn json(&self) -> Value {
        let rate = |a: &Amount| {
            let [median, best] = [self.median(), self.min()].map(|seconds| a.count / seconds);
            json!({ "unit": format!("{}/s", a.unit), "median": median, "best": best })
        };
        json!({
            "part": self.part,
            "workload": self.what,
            "seconds": { "median": self.median(), "min": self.min(), "all": self.seconds },
            "rates": self.amounts.iter().map(rate).collect::<Vec<_>>(),
        })
    }
}

/// Speed of each workload that has a rival, as a share of the rival's: (part, at the median, at the
/// best).
pub(crate) fn ratios(timings: &[Timing]) -> Vec<(&'static str, [f64; 2])> {
    let pairs = timings.iter().zip(timings.iter().skip(1)).filter(|(_, rival)| rival.rival);
    pairs.map(|(own, rival)| (own.part, [rival.median() / own.median(), rival.min() / own.min()])).collect()
}

/// Begins the name of a model whose cost is compared with that of the first on the same work.
pub(crate) const COST_OF: &str = "cost of ";

/// Tables of the costs of models, and of their ratios to the first model with the same work, which is the
/// text behind the name of the model. Amounts are counted in millions.
pub(crate) fn costs(timings: &[Timing]) -> String {
    let mut lines = Vec::new();
    let mut first: Option<(&str, &Timing)> = None;
    for timing in timings {
        let Some((_, named)) = timing.what.split_once(COST_OF) else { continue };
        let (name, work) = named.split_once(", ").unwrap_or((named, ""));
        let base = match first {
            Some((begun, base)) if begun == work => base,
            _ => {
                lines.push(format!(
                    "\n{work}\n| model | ns at the median | of the first: median, best |\n|---|---|---|"
                ));
                first = Some((work, timing));
                timing
            }
        };
        let each = |a: &Amount| {
            let unit = a.unit.strip_prefix('M').unwrap_or(a.unit);
            format!("{} a {unit}", significant(1e3 * timing.median() / a.count))
        };
        let each: Vec<String> = timing.amounts.iter().map(each).collect();
        let [median, best] = [timing.median() / base.median(), timing.min() / base.min()].map(significant);
        lines.push(format!("| {name} | {} | {median}, {best} |", each.join(", ")));
    }
    lines.join("\n")
}

/// Three significant digits and never an exponent: `0.0123`, `1.23`, `12.3`, `123`, `1234`.
fn significant(x: f64) -> String {
    let decimals = match x.abs() {
        a if a >= 100.0 => 0,
        a if a >= 10.0 => 1,
        a if a >= 1.0 => 2,
        a if a >= 0.1 => 3,
        _ => 4,
    };
    format!("{x:.decimals$}")
}
