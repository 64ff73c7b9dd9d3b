//! What is shown of a run: a bar on a terminal, plain lines otherwise.

use super::console::Console;
use super::problem::Problem;
use crate::plan::Plan;
use crate::plan::assess::Reason;
use crate::run::{Event, Observer};
use crate::stage::StepId;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;
use std::sync::Mutex;

/// Shows a run as it happens.
pub(super) struct Progress<'a> {
    plan: &'a Plan,
    console: &'a Console,
    bar: Option<ProgressBar>,
    shown: Mutex<Shown>,
}

#[derive(Default)]
struct Shown {
    ended: usize,
    running: Vec<StepId>,
}

impl<'a> Progress<'a> {
    pub(super) fn new(plan: &'a Plan, console: &'a Console) -> Self {
        let style = ProgressStyle::with_template("{bar:30} {pos}/{len} {elapsed} {wide_msg}");
        let bar = console.is_live().then(|| {
            let bar = ProgressBar::new(plan.steps().len() as u64);
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar.enable_steady_tick(std::time::Duration::from_millis(200));
            bar
        });
        Self { plan, console, bar, shown: Mutex::default() }
    }

    /// Takes the bar away.
    pub(super) fn close(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }

    fn name(&self, step: StepId) -> String {
        let step = &self.plan.steps()[step.0];
        format!("{}/{}", self.plan.scene_of(step), step.name)
    }

    /// A line above the bar, or alone.
    fn line(&self, text: &str, always: bool) {
        match &self.bar {
            Some(bar) => bar.suspend(|| self.console.insist(text)),
            None if always => self.console.insist(text),
            None => self.console.say(text),
        }
    }

    fn count(&self, change: impl FnOnce(&mut Shown)) -> usize {
        let mut shown = self.shown.lock().expect("no observer panics");
        change(&mut shown);
        if let Some(bar) = &self.bar {
            let running: Vec<String> = shown.running.iter().map(|step| self.name(*step)).collect();
            bar.set_position(shown.ended as u64);
            bar.set_message(running.join(", "));
        }
        shown.ended
    }

    fn end(&self, step: StepId) -> usize {
        self.count(|shown| {
            shown.ended += 1;
            shown.running.retain(|running| *running != step);
        })
    }

    fn tell_programs(&self, step: StepId, state: &str, seconds: Option<f64>) {
        if self.console.json {
            self.console.result(&json!({ "step": self.name(step), "state": state, "seconds": seconds }));
        }
    }
}

impl Observer for Progress<'_> {
    fn tell(&self, event: &Event<'_>) {
        match event {
            Event::Started { step, reason } => {
                self.count(|shown| shown.running.push(*step));
                if let Reason::BlobAltered { digest } = reason {
                    let name = self.name(*step);
                    let what = format!("the stored bytes of {} are not those of their digest", &digest[..12]);
                    self.line(&format!("warning: {name}: {what}; moved to trash, made again"), true);
                }
            }
            Event::Kept { step } => {
                self.end(*step);
                self.tell_programs(*step, "kept", None);
            }
            Event::TooLarge { step, memory, budget } => {
                let [need, all] = [*memory, *budget].map(|bytes| bytes as f64 * 1e-9);
                let name = self.name(*step);
                self.line(
                    &format!("warning: {name} needs about {need:.1} GB of {all:.1} GB: it runs alone"),
                    true,
                );
            }
            Event::Made { step, seconds, warnings } => {
                let ended = self.end(*step);
                let (all, name) = (self.plan.steps().len(), self.name(*step));
                let width = all.to_string().len();
                self.line(&format!("[{ended:width$}/{all}] {name} {seconds:.1} s"), false);
                for warning in *warnings {
                    self.line(&format!("warning: {name}: {warning}"), false);
                }
                self.tell_programs(*step, "made", Some(*seconds));
            }
            Event::Failed { failure } => {
                self.end(failure.step);
                let problem = Problem::of_step(&self.name(failure.step), &failure.error);
                self.line(&problem.to_text(), true);
                self.tell_programs(failure.step, "failed", None);
                if self.console.json {
                    self.console.result(&problem.to_json());
                }
            }
        }
    }
}
