//! Timing of workloads in rounds, and the table and JSON of what came out.

use serde_json::{Value, json};
use std::time::Instant;

/// How much of something one run did.
pub(crate) struct Amount {
    pub(crate) count: f64,
    /// What is counted, as in `Mpixel`; rates are per second.
    pub(crate) unit: &'static str,
}

/// Something that is timed.
pub(crate) struct Workload {
    pub(crate) part: &'static str,
    /// What exactly is done, sizes included.
    pub(crate) what: String,
    /// Does it once. Deterministic: every run returns the same amounts.
    pub(crate) run: Box<dyn FnMut() -> Vec<Amount>>,
}

/// The times of one workload.
pub(crate) struct Timing {
    part: &'static str,
    what: String,
    amounts: Vec<Amount>,
    /// Sorted.
    seconds: Vec<f64>,
}

/// Runs each workload once to warm up, then `runs` times. Rounds are interleaved (A B C, A B C, …), so that a machine
/// that is busy for a while slows every workload and not one of them.
pub(crate) fn measure(mut workloads: Vec<Workload>, runs: usize) -> Vec<Timing> {
    let first = |work: &mut Workload| Timing {
        part: work.part,
        what: work.what.clone(),
        amounts: (work.run)(),
        seconds: Vec::with_capacity(runs),
    };
    let mut timings: Vec<Timing> = workloads.iter_mut().map(first).collect();
    for _ in 0..runs {
        for (work, timing) in workloads.iter_mut().zip(&mut timings) {
            let start = Instant::now();
            std::hint::black_box((work.run)());
            timing.seconds.push(start.elapsed().as_secs_f64());
        }
    }
    timings.iter_mut().for_each(|timing| timing.seconds.sort_by(f64::total_cmp));
    timings
}

impl Timing {
    fn median(&self) -> f64 {
        let n = self.seconds.len();
        f64::midpoint(self.seconds[(n - 1) / 2], self.seconds[n / 2])
    }

    fn min(&self) -> f64 {
        self.seconds[0]
    }

    /// One line a unit: the rate at the median and at the fastest run.
    pub(crate) fn rows(&self) -> Vec<String> {
        let row = |amount: &Amount| {
            let [median, best] = [self.median(), self.min()].map(|seconds| amount.count / seconds);
            format!(
                "{:<11} {:>9} {:>9}  {:<17} {:>8.2} {:>8.2}  {}",
                self.part,
                significant(median),
                significant(best),
                format!("{}/s", amount.unit),
                1e3 * self.median(),
                1e3 * self.min(),
                self.what
            )
        };
        self.amounts.iter().map(row).collect()
    }

    /// The same for programs.
    pub(crate) fn json(&self) -> Value {
        let rate = |a: &Amount| json!({ "unit": format!("{}/s", a.unit), "median": a.count / self.median(), "best": a.count / self.min() });
        json!({
            "part": self.part,
            "workload": self.what,
            "seconds": { "median": self.median(), "min": self.min(), "all": self.seconds },
            "rates": self.amounts.iter().map(rate).collect::<Vec<_>>(),
        })
    }
}

/// Head of the table that [`Timing::rows`] makes.
pub(crate) const HEAD: &str = "part           median      best  rate              ms med.  ms min.  workload";

/// Three significant digits: `0.0123`, `1.23`, `12.3`, `123`, `1234`.
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
