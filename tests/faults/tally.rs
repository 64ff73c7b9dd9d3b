//! The result of a test: its trials, the wrong ones with their reasons, and its figures.

use crate::Size;
use std::collections::BTreeMap;
use std::fmt;

/// Trials and the figures counted in them.
#[derive(Debug, Default)]
pub(crate) struct Tally {
    trials: u64,
    wrong: Vec<String>,
    figures: BTreeMap<&'static str, u64>,
    /// The parts that were left out, with the reason.
    pub(crate) notes: Vec<String>,
}

impl Tally {
    /// Counts one trial. An error gives the reason why it is wrong.
    pub(crate) fn trial(&mut self, ended: Result<(), String>) {
        self.trials += 1;
        self.wrong.extend(ended.err());
    }

    /// Adds to a figure. A figure is shown even if it stays 0.
    pub(crate) fn count(&mut self, figure: &'static str, n: u64) {
        *self.figures.entry(figure).or_default() += n;
    }

    /// Adds another worker's trials.
    pub(crate) fn merge(&mut self, other: Self) {
        self.trials += other.trials;
        self.wrong.extend(other.wrong);
        other.figures.into_iter().for_each(|(figure, n)| self.count(figure, n));
        self.notes.extend(other.notes);
    }

    pub(crate) fn wrong(&self) -> u64 {
        self.wrong.len() as u64
    }

    pub(crate) fn trials(&self) -> u64 {
        self.trials
    }

    /// The figures, preceded by `before` if there are any.
    fn figures(&self, before: &str) -> String {
        let figures: Vec<String> = self.figures.iter().map(|(name, n)| format!("{name} {n}")).collect();
        if figures.is_empty() { String::new() } else { before.to_owned() + &figures.join(", ") }
    }
}

/// A test that ran.
#[derive(Debug)]
pub(crate) struct Line {
    pub(crate) name: &'static str,
    pub(crate) what: &'static str,
    pub(crate) size: Size,
    pub(crate) tally: Tally,
    pub(crate) seconds: f64,
}

/// Maximum number of reasons shown; the rest is counted.
const SHOWN: usize = 5;

impl fmt::Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, size, tally, seconds, .. } = self;
        write!(f, "{name}, seed {}, N {}, wrong {}", size.seed, tally.trials, tally.wrong())?;
        writeln!(f, ", {seconds:.1} s{}", tally.figures(": "))?;
        for why in tally.wrong.iter().take(SHOWN) {
            writeln!(f, "  wrong: {}", why.trim_end().replace('\n', "\n         "))?;
        }
        if tally.wrong.len() > SHOWN {
            writeln!(f, "  wrong: and {} more", tally.wrong.len() - SHOWN)?;
        }
        for note in &tally.notes {
            writeln!(f, "  {note}")?;
        }
        let long = if size.long { " --long" } else { "" };
        write!(f, "  repeat: cargo xtask faults{long} --only {name} --seed {}", size.seed)
    }
}

impl Line {
    /// The head of the table.
    pub(crate) fn head() -> String {
        format!("{:<10} {:>6} {:>8} {:>6} {:>8}  {}", "test", "seed", "N", "wrong", "seconds", "what")
    }

    /// The test's row of the table.
    pub(crate) fn row(&self) -> String {
        let Self { name, what, size, tally, seconds } = self;
        let (seed, trials, wrong) = (size.seed, tally.trials, tally.wrong());
        let figures = tally.figures("; ");
        format!("{name:<10} {seed:>6} {trials:>8} {wrong:>6} {seconds:>8.1}  {what}{figures}")
    }
}
