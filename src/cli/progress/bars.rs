//! The bars on a terminal: one for the whole run with its remaining time, and one row per running
//! step.

use gs2e_build::plan::Plan;
use gs2e_build::run::estimate::RunEstimate;
use gs2e_build::stage::StepId;
use gs2e_files::escape;
use indicatif::{MultiProgress, ProgressBar, ProgressState, ProgressStyle};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Maximum number of running steps shown. With more rows, a terminal would lose the top of the
/// picture.
const ROWS: usize = 16;

const TICK: Duration = Duration::from_millis(200);

/// One bar for the run, and one row per running step.
#[derive(Debug)]
pub(super) struct ProgressBars {
    all: MultiProgress,
    whole: ProgressBar,
    rows: BTreeMap<StepId, ProgressBar>,
    estimate: Arc<Mutex<RunEstimate>>,
    began: Instant,
}

impl ProgressBars {
    /// Creates the bars for a plan on `cores`. `expected` returns the core-seconds that a step took
    /// before.
    pub(super) fn new(plan: &Plan, cores: usize, expected: &dyn Fn(StepId) -> Option<f64>) -> Self {
        let steps = plan.steps().iter().enumerate();
        let steps = steps.map(|(id, step)| (step.step.stage(), expected(StepId(id))));
        let estimate = Arc::new(Mutex::new(RunEstimate::new(steps, cores)));
        let (shared, began) = (estimate.clone(), Instant::now());
        let left = move |_: &ProgressState, out: &mut dyn Write| {
            let estimate = shared.lock().expect("no holder of the estimate panics");
            let text = estimate.remaining(began.elapsed().as_secs_f64()).map(left_words).unwrap_or_default();
            // A write to memory cannot fail.
            let _ = out.write_str(&text);
        };
        let shared = estimate.clone();
        let share = move |state: &ProgressState, out: &mut dyn Write| {
            let (estimate, elapsed) =
                (shared.lock().expect("no holder of the estimate panics"), began.elapsed());
            let share = time_share(elapsed.as_secs_f64(), estimate.remaining(elapsed.as_secs_f64()));
            // Steps differ in cost by a factor of a thousand, so they are counted only without an
            // expectation.
            let _ = out.write_str(&bar_words(share.unwrap_or_else(|| f64::from(state.fraction()))));
        };
        let style = ProgressStyle::with_template("{share} {pos}/{len} {elapsed} {left}");
        let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
        let style = style.with_key("left", left).with_key("share", share);
        let all = MultiProgress::new();
        let whole = all.add(ProgressBar::new(plan.steps().len() as u64).with_style(style));
        // The bar ticks by itself, because a single step may take hours without an event.
        whole.enable_steady_tick(TICK);
        Self { all, whole, rows: BTreeMap::new(), estimate, began }
    }

    /// Counts steps outside the plan that were up to date.
    pub(super) fn with_settled(&self, settled: usize) {
        self.whole.inc_length(settled as u64);
        self.whole.inc(settled as u64);
    }

    /// Removes the bars from the terminal.
    pub(super) fn close(&mut self) {
        for row in std::mem::take(&mut self.rows).into_values() {
            row.finish_and_clear();
        }
        self.whole.finish_and_clear();
    }

    /// Shows lines above the bars.
    pub(super) fn above(&self, show: impl FnOnce()) {
        self.all.suspend(show);
    }

    pub(super) fn started(&mut self, step: StepId, name: &str, cores: f64) {
        let now = self.began.elapsed().as_secs_f64();
        self.change(|estimate| estimate.started(step, now, cores));
        if self.rows.len() < ROWS {
            let style = ProgressStyle::with_template("  {spinner} {wide_msg} {elapsed}");
            let style = style.unwrap_or_else(|_| ProgressStyle::default_spinner());
            let row =
                ProgressBar::new_spinner().with_style(style).with_message(escape::line(name).into_owned());
            // The name in the row is escaped above, because bars do not pass through the console.
            let row = self.all.add(row);
            row.enable_steady_tick(TICK);
            self.rows.insert(step, row);
        }
    }

    /// Shows the name and the state of a running step in its row.
    pub(super) fn advanced(&self, step: StepId, line: &str) {
        if let Some(row) = self.rows.get(&step) {
            row.set_message(escape::line(line).into_owned());
        }
    }

    /// Ends a step. `core_seconds` is its cost if it was made.
    pub(super) fn ended(&mut self, step: StepId, core_seconds: Option<f64>) {
        self.change(|estimate| match core_seconds {
            Some(taken) => estimate.made(step, taken),
            None => estimate.ended(step),
        });
        if let Some(row) = self.rows.remove(&step) {
            row.finish_and_clear();
            self.all.remove(&row);
        }
        self.whole.inc(1);
    }

    /// Ends a step that will not be reached.
    pub(super) fn lost(&self, step: StepId) {
        self.change(|estimate| estimate.ended(step));
    }

    fn change(&self, change: impl FnOnce(&mut RunEstimate)) {
        change(&mut self.estimate.lock().expect("no holder of the estimate panics"));
    }
}

/// Share of the expected time that has passed; `None` if nothing is known of the rest.
fn time_share(elapsed: f64, remaining: Option<f64>) -> Option<f64> {
    remaining.map(|left| if elapsed + left > 0.0 { elapsed / (elapsed + left) } else { 0.0 })
}

/// A bar of 30 characters.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share is from 0 to 1")]
fn bar_words(share: f64) -> String {
    const WIDTH: usize = 30;
    let full = ((share.clamp(0.0, 1.0) * WIDTH as f64) as usize).min(WIDTH);
    format!("{}{}", "█".repeat(full), "░".repeat(WIDTH - full))
}

/// The remaining time in words, no more precise than it is known.
fn left_words(seconds: f64) -> String {
    match seconds {
        s if s < 10.0 => "a few seconds left".to_owned(),
        s if s < 90.0 => format!("about {:.0} s left", 10.0 * (s / 10.0).ceil()),
        s if s < 5400.0 => format!("about {:.0} min left", (s / 60.0).ceil()),
        s => format!("about {:.1} h left", s / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bar_is_the_share_of_the_expected_time() {
        assert_eq!(time_share(1.0, Some(3.0)), Some(0.25));
        assert_eq!((time_share(0.0, Some(0.0)), time_share(5.0, None)), (Some(0.0), None));
        let full = |share| bar_words(share).chars().filter(|cell| *cell == '█').count();
        assert_eq!([0.0, 0.25, 0.999, 1.0, 7.0, f64::NAN].map(full), [0, 7, 29, 30, 30, 0]);
        assert_eq!(bar_words(0.5).chars().count(), 30);
    }

    #[test]
    fn the_time_left_is_told_in_round_words() {
        let t = |seconds, wanted| assert_eq!(left_words(seconds), wanted, "{seconds}");
        t(0.0, "a few seconds left");
        t(41.0, "about 50 s left");
        t(90.0, "about 2 min left");
        t(3599.0, "about 60 min left");
        t(5400.0, "about 1.5 h left");
    }
}
