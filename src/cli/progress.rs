//! The output of a run: bars on a terminal, plain lines elsewhere, objects for programs.

mod bars;
mod pace;

use super::environment::Environment;
use super::failure::{self, StepPlace};
use super::left_out::OmissionTable;
use super::{Console, UserMessage, clock, plan};
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

/// A run that is shown.
pub(super) struct ProgressRun<'a> {
    pub(super) plan: &'a Plan,
    /// Number of steps outside the plan that were up to date at a glance.
    pub(super) settled: usize,
    /// True if a step that fails on the GPU is rendered on the CPU next, and so is no failure.
    pub(super) falls_back: bool,
    pub(super) store: &'a Store,
    pub(super) console: &'a Console,
    /// It names this machine, and the task of a batch system, for programs.
    pub(super) environment: &'a Environment,
}

/// Shows a run while it goes on.
pub(super) struct Progress<'a> {
    run: ProgressRun<'a>,
    began: Instant,
    view: Mutex<ProgressView>,
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
    end: EndSummary,
}

/// The summary that is printed after a run.
#[derive(Default)]
pub(super) struct EndSummary {
    /// The message of each failure.
    pub(super) failed: Vec<UserMessage>,
    /// The work left out, by trajectory with a rendered step.
    pub(super) left_out: BTreeMap<String, OmissionTable>,
}

/// The end of a step, for people and programs.
struct StepEnd<'a> {
    step: StepId,
    state: &'static str,
    key: Option<&'a Key>,
    outputs: &'a [StoredOutput],
    /// The work, if the step was made.
    work: Option<StepWork>,
}

/// The time and the memory that a step took, and the machine that made it.
struct StepWork {
    seconds: f64,
    threads: usize,
    /// Processor time, s.
    core_seconds: f64,
    /// Bytes.
    memory: u64,
    /// The machine that made it.
    origin: StepOrigin,
    /// The work that the step left out, if it renders.
    left_out: Option<OmissionTable>,
}

impl<'a> Progress<'a> {
    /// Shows a run on `cores`. `expected` returns the core-seconds that a step took before.
    pub(super) fn new(run: ProgressRun<'a>, cores: usize, expected: &dyn Fn(StepId) -> Option<f64>) -> Self {
        let bars = run.console.is_live().then(|| ProgressBars::new(run.plan, cores, expected));
        bars.iter().for_each(|bars| bars.with_settled(run.settled));
        let view =
            ProgressView { bars, ended: run.settled, finished: run.settled, ..ProgressView::default() };
        Self { run, began: Instant::now(), view: Mutex::new(view) }
    }

    /// Number of all steps, settled or planned.
    fn all(&self) -> usize {
        self.run.settled + self.run.plan.steps().len()
    }

    /// Removes the bars, and returns the summary to be printed now.
    pub(super) fn close(self) -> EndSummary {
        let mut view = self.view.into_inner().expect("no observer panics");
        view.bars.iter_mut().for_each(ProgressBars::close);
        view.end
    }

    fn place(&self, step: StepId) -> (&'a str, &'a str) {
        let step = &self.run.plan.steps()[step.0];
        (self.run.plan.scene_of(step), &step.name)
    }

    fn name(&self, step: StepId) -> String {
        let (scene, step) = self.place(step);
        format!("{scene}/{step}")
    }

    fn started(&self, view: &mut ProgressView, step: StepId, reason: &StepReason, cores: f64) {
        if let Some(bars) = &mut view.bars {
            bars.started(step, &self.name(step), cores);
        }
        if let StepReason::BlobAltered { digest } = reason {
            // The step has not moved the altered file to the trash yet, so its size can be read.
            let path = digest.parse().ok().map(|digest| self.run.store.path_of(&digest));
            let size = path.and_then(|path| Some(path.metadata().ok()?.len()));
            let size = size.map_or(String::new(), |size| format!(", {}", format_amount(size, "B")));
            let file = format!("cas/{}/{}…{size}", &digest[..2], &digest[..4]);
            view.altered.insert(step, format!("stored bytes do not match their digest ({file})"));
        }
    }

    /// Shows the state of a running step.
    fn advanced(&self, view: &mut ProgressView, step: StepId, words: &str) {
        let line = format!("{}: {words}", self.name(step));
        match &view.bars {
            Some(bars) => bars.advanced(step, &line),
            None if view.pace.admits(self.began.elapsed().as_secs_f64()) => self.line(view, &line),
            None => {}
        }
    }

    /// Counts a step that ended, and prints its record for programs.
    fn ended(&self, view: &mut ProgressView, ended: &StepEnd<'_>) {
        view.ended += 1;
        if let Some(bars) = &mut view.bars {
            bars.ended(ended.step, ended.work.as_ref().map(|work| work.core_seconds));
        }
        if let Some(what) = view.altered.remove(&ended.step) {
            let again = if ended.work.is_some() { ", made again" } else { "" };
            let (scene, step) = self.place(ended.step);
            let what = format!("{scene}/{step}: {what}; moved to trash{again}");
            self.report(view, &UserMessage::warning("blob-altered", what).step(scene, step));
        }
        if self.run.console.json {
            Self::above_bars(view, || self.run.console.result(&self.to_json(ended)));
        }
    }

    fn to_json(&self, ended: &StepEnd<'_>) -> Value {
        let StepEnd { step, state, key, outputs, work } = ended;
        let bytes: u64 = outputs.iter().map(|output| output.size).sum();
        let used = work.as_ref().filter(|work| work.origin != StepOrigin::Elsewhere);
        let mut record = json!({
            "scene": self.place(*step).0, "step": self.name(*step), "state": state,
            "key": key.map(Key::to_string), "outputs": plan::output_files(self.run.store, outputs),
            "seconds": work.as_ref().map(|work| work.seconds), "cores": used.map(|work| work.threads),
            "core_seconds": used.map(|work| work.core_seconds),
            "memory": used.map(|work| work.memory),
            "bytes": bytes, "host": self.run.environment.host(), "job": self.run.environment.job, "ended": clock::utc_now(),
        });
        match work.as_ref().map(|work| work.origin) {
            Some(StepOrigin::Twice) => record["twice"] = json!(true),
            Some(StepOrigin::Confirmed) => record["confirmed"] = json!(true),
            Some(StepOrigin::Here | StepOrigin::Elsewhere) | None => {}
        }
        if let Some(OmissionTable { rows, saving }) = work.as_ref().and_then(|work| work.left_out.as_ref()) {
            (record["left_out"], record["saving"]) = (json!(rows), json!(saving));
        }
        record
    }

    /// The work that a step left out; `None` for a step that does not render.
    fn left_out(
        &self,
        view: &ProgressView,
        step: StepId,
        outputs: &[StoredOutput],
        saving: Option<TimeSaved>,
    ) -> Option<OmissionTable> {
        let planned = &self.run.plan.steps()[step.0].step;
        if !left_out::is_rendering(planned.stage()) {
            return None;
        }
        let files = ArtifactFiles::from_outputs(outputs, self.run.store);
        let rows = left_out::of_step(planned.stage(), planned.facts().class().as_deref(), &files);
        // A missing account must not fail a step that was made.
        let report = |error| self.line(view, &format!("warning: {}: failed to {error}", self.name(step)));
        Some(OmissionTable { rows: rows.map_err(report).ok()?, saving })
    }

    /// Keeps the work that a step left out for the end of the run.
    fn keep_left_out(&self, view: &mut ProgressView, step: StepId, left_out: OmissionTable) {
        let name = self.name(step);
        let trajectory = name.rsplit_once('/').map_or(name.as_str(), |(trajectory, _)| trajectory);
        let table = view.end.left_out.entry(trajectory.to_owned()).or_default();
        table.rows.extend(left_out.rows);
        // Steps end in any order; the sort is stable, so the rows of one step keep their order.
        table.rows.sort_by(|a, b| a.step.cmp(&b.step));
        table.saving = table.saving.or(left_out.saving);
    }

    /// Shows lines above the bars, if there are bars.
    fn above_bars(view: &ProgressView, show: impl FnOnce()) {
        // A redraw of the bars at the same time would overwrite the lines.
        match &view.bars {
            Some(bars) => bars.above(show),
            None => show(),
        }
    }

    /// Prints a line for people.
    fn line(&self, view: &ProgressView, text: &str) {
        Self::above_bars(view, || self.run.console.note(text));
    }

    /// Prints a message, even if the user asked for quiet.
    fn report(&self, view: &ProgressView, message: &UserMessage) {
        Self::above_bars(view, || self.run.console.report(message));
    }

    /// Prints the line of a step that was made.
    fn made(&self, view: &mut ProgressView, step: StepId, seconds: f64, remark: Option<&str>) {
        // The bars show each step already.
        if view.bars.is_none() && view.pace.admits(self.began.elapsed().as_secs_f64()) {
            let (all, name, ended) = (self.all(), self.name(step), view.ended);
            let width = all.to_string().len();
            let remark = remark.map_or(String::new(), |remark| format!(" {remark}"));
            self.line(view, &format!("[{ended:width$}/{all}] {name} {seconds:.1} s{remark}"));
        }
    }

    fn failed(&self, view: &mut ProgressView, failure: &StepFailure) {
        let step = failure.step;
        // The step runs again on the CPU, so it has not ended and is no failure yet.
        if let Some(because) = failure.of_gpu().filter(|_| self.run.falls_back) {
            let scene = self.place(step).0;
            let what = format!("{scene} is rendered on the CPU, because {because}");
            return self.report(view, &UserMessage::warning("on-cpu", what).scene(scene));
        }
        self.ended(view, &StepEnd { step, state: "failed", key: None, outputs: &[], work: None });
        let (scene, name) = self.place(step);
        let place = StepPlace { scene, step: name, finished: view.finished, all: self.all() };
        let message = failure::failure_message(place, &failure.error);
        self.report(view, &message);
        view.end.failed.push(message.step(scene, name));
        if let Some(bars) = &view.bars {
            // The remaining time must not count steps that can no longer run.
            self.behind(step).iter().for_each(|step| bars.lost(*step));
        }
    }

    /// The steps that depend on this one, directly or not.
    fn behind(&self, step: StepId) -> BTreeSet<StepId> {
        let mut behind = BTreeSet::new();
        // Inputs have smaller indices than the steps that need them, so one pass finds all.
        for (id, planned) in self.run.plan.steps().iter().enumerate().skip(step.0) {
            if planned.step.inputs().iter().any(|(_, input)| *input == step || behind.contains(input)) {
                behind.insert(StepId(id));
            }
        }
        behind
    }
}

impl RunObserver for Progress<'_> {
    fn observe(&self, event: &RunEvent<'_>) {
        // One lock for each event, so that lines of steps on other threads do not come in between.
        let view = &mut *self.view.lock().expect("no observer panics");
        match *event {
            RunEvent::Started { step, reason, cores, together } => {
                self.started(view, step, reason, cores as f64 / together as f64);
            }
            RunEvent::Kept { step, key, outputs } => {
                view.finished += 1;
                self.ended(view, &StepEnd { step, state: "kept", key: Some(key), outputs, work: None });
            }
            RunEvent::TooLarge { step, memory, budget } => {
                let [need, all] = [memory, budget].map(|bytes| format_amount(bytes, "B"));
                let (scene, name) = self.place(step);
                let what = format!(
                    "{scene}/{name} needs about {need} of memory, budget {all}: no other step runs with it"
                );
                self.report(view, &UserMessage::warning("memory", what).step(scene, name));
            }
            RunEvent::Advanced { step, words } => self.advanced(view, step, words),
            RunEvent::Made {
                step,
                key,
                outputs,
                seconds,
                threads,
                core_seconds,
                warnings,
                remark,
                saving,
                memory,
                origin,
            } => {
                view.finished += 1;
                let left_out = self.left_out(view, step, outputs, saving);
                let is_adopted = matches!(origin, StepOrigin::Elsewhere | StepOrigin::Confirmed);
                let state = if is_adopted { "adopted" } else { "made" };
                let work = Some(StepWork { seconds, threads, core_seconds, memory, origin, left_out });
                let ended = StepEnd { step, state, key: Some(key), outputs, work };
                self.ended(view, &ended);
                self.made(view, step, seconds, remark);
                for warning in warnings {
                    self.line(view, &format!("warning: {}: {warning}", self.name(step)));
                }
                let left_out = ended.work.and_then(|work| work.left_out);
                left_out.into_iter().for_each(|table| self.keep_left_out(view, step, table));
            }
            RunEvent::Failed { failure } => self.failed(view, failure),
        }
    }
}
