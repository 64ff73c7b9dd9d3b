//! The output of a run: bars on a terminal, plain lines elsewhere, objects for programs.

mod bars;
mod pace;

use super::console::Console;
use super::environment::Environment;
use super::failure::{self, StepPlace};
use super::left_out::OmissionTable;
use super::message::{MessageLevel, UserMessage};
use super::{clock, plan};
use bars::ProgressBars;
use gs2e_build::artifact::ArtifactFiles;
use gs2e_build::plan::Plan;
use gs2e_build::plan::assess::StepReason;
use gs2e_build::run::{RunEvent, RunObserver, StepFailure, StepOrigin};
use gs2e_build::stage::StepId;
use gs2e_num::units::format_amount;
use gs2e_release::left_out;
use gs2e_sampling::rendered::TimeSaved;
use gs2e_store::record::StoredOutput;
use gs2e_store::{Key, Store};
use pace::LinePacing;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Mutex;
use std::time::Instant;

/// Shows a run while it goes on.
pub(super) struct Progress<'a> {
    plan: &'a Plan,
    /// Number of steps outside the plan that were up to date at a glance.
    settled: usize,
    /// True if a step that fails on the GPU is rendered on the CPU next.
    falls_back: bool,
    store: &'a Store,
    console: &'a Console,
    began: Instant,
    /// Name of this machine, and of the task of a batch system, for programs.
    host: (String, Option<String>),
    shown: Mutex<ProgressView>,
}

#[derive(Default)]
struct ProgressView {
    bars: Option<ProgressBars>,
    pace: LinePacing,
    /// Number of steps that ended. `finished` counts those that were made or kept.
    ended: usize,
    finished: usize,
    /// The damage of stored bytes, for steps that run again because of it.
    altered: BTreeMap<StepId, String>,
    /// The work left out, by trajectory with a rendered step.
    left_out: BTreeMap<String, OmissionTable>,
    /// Scene, step and message of each failure.
    failed: Vec<(String, String, UserMessage)>,
}

/// The summary that is printed after a run.
pub(super) struct EndSummary {
    /// Scene, step and message of each failure.
    pub(super) failed: Vec<(String, String, UserMessage)>,
    /// The work left out, by trajectory with a rendered step.
    pub(super) left_out: BTreeMap<String, OmissionTable>,
}

/// The end of a step, for people and programs.
struct StepEnd<'a> {
    step: StepId,
    state: &'static str,
    key: Option<&'a Key>,
    outputs: &'a [StoredOutput],
    seconds: Option<f64>,
    /// The machine that made it.
    origin: StepOrigin,
    /// Cores and memory in bytes, if the step ran.
    used: Option<(usize, u64)>,
    /// The work that the step left out, if it renders.
    left_out: Option<&'a OmissionTable>,
}

impl<'a> StepEnd<'a> {
    /// A step that did not run to its end here.
    fn without_work(
        step: StepId,
        state: &'static str,
        key: Option<&'a Key>,
        outputs: &'a [StoredOutput],
    ) -> Self {
        Self {
            step,
            state,
            key,
            outputs,
            seconds: None,
            origin: StepOrigin::Here,
            used: None,
            left_out: None,
        }
    }
}

impl<'a> Progress<'a> {
    /// Shows the run of a plan on `cores`. `expected` returns the core-seconds that a step took
    /// before.
    pub(super) fn new(
        plan: &'a Plan,
        store: &'a Store,
        console: &'a Console,
        cores: usize,
        expected: &dyn Fn(StepId) -> Option<f64>,
    ) -> Self {
        let bars = console.is_live().then(|| ProgressBars::new(plan, cores, expected));
        let shown = Mutex::new(ProgressView { bars, ..ProgressView::default() });
        let host = (String::new(), None);
        Self { plan, settled: 0, falls_back: false, store, console, began: Instant::now(), host, shown }
    }

    /// Sets the name of this machine, and of the task of a batch system.
    pub(super) fn on_host(self, environment: &Environment) -> Self {
        Self { host: (environment.host(), environment.job.clone()), ..self }
    }

    /// Counts steps outside the plan that were up to date at a glance.
    pub(super) fn with_settled(self, settled: usize) -> Self {
        let mut shown = self.shown.into_inner().expect("no observer panics");
        shown.ended += settled;
        shown.finished += settled;
        shown.bars.iter().for_each(|bars| bars.with_settled(settled));
        Self { settled, shown: Mutex::new(shown), ..self }
    }

    /// Sets whether a step that fails on the GPU is rendered on the CPU next, and so is no failure.
    pub(super) fn falling_back(self, falls_back: bool) -> Self {
        Self { falls_back, ..self }
    }

    /// Number of all steps, settled or planned.
    fn all(&self) -> usize {
        self.settled + self.plan.steps().len()
    }

    /// Removes the bars, and returns the summary to be printed now.
    pub(super) fn close(self) -> EndSummary {
        let mut shown = self.shown.into_inner().expect("no observer panics");
        shown.bars.iter_mut().for_each(ProgressBars::close);
        EndSummary { failed: shown.failed, left_out: shown.left_out }
    }

    fn place(&self, step: StepId) -> (&'a str, &'a str) {
        let step = &self.plan.steps()[step.0];
        (self.plan.scene_of(step), &step.name)
    }

    fn name(&self, step: StepId) -> String {
        let (scene, step) = self.place(step);
        format!("{scene}/{step}")
    }

    fn started(&self, shown: &mut ProgressView, step: StepId, reason: &StepReason, cores: f64) {
        if let Some(bars) = &mut shown.bars {
            bars.started(step, &self.name(step), cores);
        }
        if let StepReason::BlobAltered { digest } = reason {
            // The step has not moved the altered file to the trash yet, so its size can be read.
            let path = digest.parse().ok().map(|digest| self.store.path_of(&digest));
            let size = path.and_then(|path| Some(path.metadata().ok()?.len()));
            let size = size.map_or(String::new(), |size| format!(", {}", format_amount(size, "B")));
            let file = format!("cas/{}/{}…{size}", &digest[..2], &digest[..4]);
            shown.altered.insert(step, format!("stored bytes do not match their digest ({file})"));
        }
    }

    /// Shows the state of a running step.
    fn advanced(&self, shown: &mut ProgressView, step: StepId, words: &str) {
        let line = format!("{}: {words}", self.name(step));
        match &shown.bars {
            Some(bars) => bars.advanced(step, &line),
            None if shown.pace.admits(self.began.elapsed().as_secs_f64()) => self.line(shown, &line),
            None => {}
        }
    }

    /// Counts a step that ended, and prints its record for programs.
    fn ended(&self, shown: &mut ProgressView, ended: &StepEnd<'_>, core_seconds: Option<f64>) {
        shown.ended += 1;
        if let Some(bars) = &mut shown.bars {
            bars.ended(ended.step, core_seconds);
        }
        if let Some(what) = shown.altered.remove(&ended.step) {
            let again = if core_seconds.is_some() { ", made again" } else { "" };
            let (scene, step) = self.place(ended.step);
            let what = format!("{scene}/{step}: {what}; moved to trash{again}");
            self.tell(
                shown,
                &UserMessage::new(MessageLevel::Warning, "blob-altered", what).step(scene, step),
            );
        }
        if self.console.json {
            Self::above_bars(shown, || self.console.result(&self.to_json(ended)));
        }
    }

    fn to_json(&self, ended: &StepEnd<'_>) -> Value {
        let StepEnd { step, state, key, outputs, seconds, origin, used, left_out } = ended;
        let bytes: u64 = outputs.iter().map(|output| output.size).sum();
        let mut record = json!({
            "scene": self.place(*step).0, "step": self.name(*step), "state": state,
            "key": key.map(Key::to_string), "outputs": plan::output_files(self.store, outputs),
            "seconds": seconds, "cores": used.map(|(cores, _)| cores), "memory": used.map(|(_, memory)| memory),
            "bytes": bytes, "host": self.host.0, "job": self.host.1, "ended": clock::utc_now(),
        });
        match origin {
            StepOrigin::Twice => record["twice"] = json!(true),
            StepOrigin::Confirmed => record["confirmed"] = json!(true),
            StepOrigin::Here | StepOrigin::Elsewhere => {}
        }
        if let Some(OmissionTable { rows, saving }) = left_out {
            record["left_out"] = json!(rows);
            record["saving"] = json!(saving);
        }
        record
    }

    /// The work that a step left out; `None` for a step that does not render.
    fn left_out(
        &self,
        shown: &ProgressView,
        step: StepId,
        outputs: &[StoredOutput],
        saving: Option<TimeSaved>,
    ) -> Option<OmissionTable> {
        let planned = &self.plan.steps()[step.0].step;
        if !left_out::is_rendering(planned.stage()) {
            return None;
        }
        let files = ArtifactFiles::from_outputs(outputs, self.store);
        let rows = left_out::of_step(planned.stage(), planned.facts().class().as_deref(), &files);
        // A missing account must not fail a step that was made.
        let report = |error| self.line(shown, &format!("warning: {}: failed to {error}", self.name(step)));
        Some(OmissionTable { rows: rows.map_err(report).ok()?, saving })
    }

    /// Keeps the work that a step left out for the end of the run.
    fn keep_left_out(&self, shown: &mut ProgressView, step: StepId, left_out: OmissionTable) {
        let name = self.name(step);
        let trajectory = name.rsplit_once('/').map_or(name.as_str(), |(trajectory, _)| trajectory);
        let table = shown.left_out.entry(trajectory.to_owned()).or_default();
        table.rows.extend(left_out.rows);
        // Steps end in any order; the sort is stable, so the rows of one step keep their order.
        table.rows.sort_by(|a, b| a.step.cmp(&b.step));
        table.saving = table.saving.or(left_out.saving);
    }

    /// Shows lines above the bars, if there are bars.
    fn above_bars(shown: &ProgressView, show: impl FnOnce()) {
        // A redraw of the bars at the same time would overwrite the lines.
        match &shown.bars {
            Some(bars) => bars.above(show),
            None => show(),
        }
    }

    /// Prints a line for people.
    fn line(&self, shown: &ProgressView, text: &str) {
        Self::above_bars(shown, || self.console.say(text));
    }

    /// Prints a message, even if the user asked for quiet.
    fn tell(&self, shown: &ProgressView, message: &UserMessage) {
        Self::above_bars(shown, || self.console.tell(message));
    }

    fn made(
        &self,
        shown: &mut ProgressView,
        step: StepId,
        seconds: f64,
        remark: Option<&str>,
        warnings: &[String],
    ) {
        let (all, name) = (self.all(), self.name(step));
        // The bars show each step already.
        if shown.bars.is_none() && shown.pace.admits(self.began.elapsed().as_secs_f64()) {
            let (width, ended) = (all.to_string().len(), shown.ended);
            let remark = remark.map_or(String::new(), |remark| format!(" {remark}"));
            self.line(shown, &format!("[{ended:width$}/{all}] {name} {seconds:.1} s{remark}"));
        }
        for warning in warnings {
            self.line(shown, &format!("warning: {name}: {warning}"));
        }
    }

    fn failed(&self, shown: &mut ProgressView, failure: &StepFailure) {
        let step = failure.step;
        // The step runs again on the CPU, so it has not ended and is no failure yet.
        if let Some(because) = failure.of_gpu().filter(|_| self.falls_back) {
            let scene = self.place(step).0;
            let what = format!("{scene} is rendered on the CPU, because {because}");
            return self.tell(shown, &UserMessage::new(MessageLevel::Warning, "on-cpu", what).scene(scene));
        }
        let ended = StepEnd::without_work(step, "failed", None, &[]);
        self.ended(shown, &ended, None);
        let (scene, name) = self.place(step);
        let place = StepPlace { scene, step: name, finished: shown.finished, all: self.all() };
        let message = failure::failure_message(place, &failure.error);
        self.tell(shown, &message);
        shown.failed.push((scene.to_owned(), name.to_owned(), message));
        if let Some(bars) = &shown.bars {
            // The remaining time must not count steps that can no longer run.
            self.behind(step).iter().for_each(|step| bars.lost(*step));
        }
    }

    /// The steps that depend on this one, directly or not.
    fn behind(&self, step: StepId) -> BTreeSet<StepId> {
        let mut behind = BTreeSet::new();
        // Inputs have smaller indices than the steps that need them, so one pass finds all.
        for (id, planned) in self.plan.steps().iter().enumerate().skip(step.0) {
            if planned.step.inputs().iter().any(|(_, input)| *input == step || behind.contains(input)) {
                behind.insert(StepId(id));
            }
        }
        behind
    }
}

impl RunObserver for Progress<'_> {
    fn tell(&self, event: &RunEvent<'_>) {
        let shown = &mut *self.shown.lock().expect("no observer panics");
        match *event {
            RunEvent::Started { step, reason, cores, together } => {
                self.started(shown, step, reason, cores as f64 / together as f64);
            }
            RunEvent::Kept { step, key, outputs } => {
                shown.finished += 1;
                self.ended(shown, &StepEnd::without_work(step, "kept", Some(key), outputs), None);
            }
            RunEvent::TooLarge { step, memory, budget } => {
                let [need, all] = [memory, budget].map(|bytes| format_amount(bytes, "B"));
                let (scene, name) = self.place(step);
                let what = format!(
                    "{scene}/{name} needs about {need} of memory, budget {all}: no other step runs with it"
                );
                self.tell(shown, &UserMessage::new(MessageLevel::Warning, "memory", what).step(scene, name));
            }
            RunEvent::Advanced { step, words } => self.advanced(shown, step, words),
            RunEvent::Made {
                step,
                key,
                outputs,
                seconds,
                cores,
                warnings,
                remark,
                saving,
                memory,
                origin,
            } => {
                shown.finished += 1;
                let left_out = self.left_out(shown, step, outputs, saving);
                let is_adopted = matches!(origin, StepOrigin::Elsewhere | StepOrigin::Confirmed);
                let ended = StepEnd {
                    step,
                    state: if is_adopted { "adopted" } else { "made" },
                    origin,
                    key: Some(key),
                    outputs,
                    seconds: Some(seconds),
                    used: (origin != StepOrigin::Elsewhere).then_some((cores, memory)),
                    left_out: left_out.as_ref(),
                };
                self.ended(shown, &ended, Some(seconds * cores as f64));
                self.made(shown, step, seconds, remark, warnings);
                left_out.into_iter().for_each(|table| self.keep_left_out(shown, step, table));
            }
            RunEvent::Failed { failure } => self.failed(shown, failure),
        }
    }
}
