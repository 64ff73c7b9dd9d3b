//! `gs2e plan`: shows the steps that `build` would run, may run and keep, each with its reason.

use super::build::{option_tag, store_options};
use super::{CommonArgs, Console, ExitKind, RecipeTargets, UserMessage, VerbError, path};
use gs2e_build::plan::Plan;
use gs2e_build::plan::assess::{StepAction, StepAssessment, StepReason, assess_plan};
use gs2e_build::plan::edits::{edits_of_step, edits_since};
use gs2e_build::plan::forecast::PlanForecast;
use gs2e_build::plan::kept::kept_names;
use gs2e_build::plan::past::{past_costs, sharing_steps};
use gs2e_build::plan::size::expected_bytes;
use gs2e_build::plan::survey::{CurrentScene, PlanSurvey, survey_recipes};
use gs2e_build::plan::warnings::{PlanWarning, forecast_words, no_scene_file, recipe_warnings, size_warning};
use gs2e_files::escape;
use gs2e_num::units::format_amount;
use gs2e_recipe::RecipeEdit;
use gs2e_store::record::StoredOutput;
use gs2e_store::{Digest, Key, Store, StoreAccess, StoreOptions};
use serde::Serialize;
use serde_json::{Value, json};

/// Arguments of `plan`.
#[derive(Debug, clap::Args)]
pub(super) struct PlanArgs {
    #[command(flatten)]
    targets: RecipeTargets,
    /// Read every up-to-date file, instead of trusting its metadata
    #[arg(long)]
    verify: bool,
    /// Show time, disk space and memory for the steps that would run, estimated from earlier runs
    #[arg(long)]
    estimate: bool,
}

/// A step as it is printed.
#[derive(Serialize)]
struct PlanRow<'a> {
    scene: &'a str,
    step: &'a str,
    action: StepAction,
    reason: &'a StepReason,
    key: Option<Key>,
    outputs: Vec<StepFile<'a>>,
    /// The reason in words for people.
    #[serde(skip)]
    words: String,
    /// True if it would run, and the store has frames of its path.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    kept_frames: bool,
}

/// A file of a step, in the form for programs.
#[derive(Debug, Serialize)]
pub(super) struct StepFile<'a> {
    role: &'a str,
    digest: Digest,
    path: String,
}

impl PlanArgs {
    pub(super) fn run(mut self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        self.targets.resolve()?;
        let opening = StoreOptions { verify: self.verify, ..store_options(common, StoreAccess::Read) };
        let store = Store::open(&common.store, opening, &mut |_| {})?;
        let chosen = common.renderers()?;
        let (renderers, tag) = (chosen.knowing(&store), option_tag(&chosen, None));
        let surveyed = survey_recipes(&self.targets.recipes, &renderers, &store, &tag);
        let PlanSurvey { settled, plan, taken_down } = surveyed?;
        let assessed = assess_plan(&plan, &store)?;
        super::build::refuse_lens(&plan)?;
        // Programs get a single array, so nothing else may go to stdout.
        super::build::report_notices(&store, &console.for_people());
        super::takedown::report_takedown(taken_down, &console.for_people());
        refuse_no_scene(&plan)?;
        plan.scenes().iter().flat_map(recipe_warnings).for_each(|warning| report_warning(&warning, console));
        let forecast = PlanForecast::of_plan(&plan, &assessed, &store);
        size_warning(&forecast).iter().for_each(|warning| report_warning(warning, console));
        if self.estimate {
            let estimate = EstimateTotal::of_plan(&plan, &assessed, &store, common.cores())?;
            estimate.report(&forecast, console);
            return Ok(ExitKind::Done);
        }
        let rows = plan_rows(&plan, &assessed, &settled, &store)?;
        if console.json {
            console.result(&rows);
        } else {
            report_rows(&rows, console);
            forecast_words(&forecast).iter().for_each(|line| console.note(line));
        }
        Ok(ExitKind::Done)
    }
}

/// Refuses a file that holds no scene, before its step runs.
pub(super) fn refuse_no_scene(plan: &Plan) -> Result<(), VerbError> {
    let found = plan.scenes().iter().find_map(|recipe| Some((recipe, no_scene_file(recipe)?)));
    let Some((recipe, path)) = found else { return Ok(()) };
    let what = format!("the scene file of {} is no scene: {}", recipe.scene, escape::path(&path));
    Err(VerbError::usage("recipe-invalid", what)
        .help("name a .ply, .splat, .spz, .sog or .splatv file in reconstruct"))
}

/// Shows a warning about a recipe. Programs get a single array, so it never goes to stdout.
pub(super) fn report_warning(warning: &PlanWarning, console: &Console) {
    let PlanWarning { scene, code, what, help } = warning;
    let what = scene.as_ref().map_or_else(|| what.clone(), |scene| format!("{scene}: {what}"));
    console.for_people().report(&UserMessage::warning(code, what).help(help));
}

/// All steps, sorted by scene.
fn plan_rows<'a>(
    plan: &'a Plan,
    assessed: &'a [StepAssessment],
    settled: &'a [CurrentScene],
    store: &Store,
) -> Result<Vec<PlanRow<'a>>, VerbError> {
    let known = settled.iter().flat_map(|scene| {
        scene.steps.iter().map(|step| PlanRow {
            scene: &scene.scene,
            step: &step.name,
            action: StepAction::Keep,
            reason: &StepReason::UpToDate,
            key: Some(step.key),
            outputs: output_files(store, &step.outputs),
            words: reason_words(&StepReason::UpToDate),
            kept_frames: false,
        })
    });
    let mut has_frames = Vec::new();
    for (name, a) in kept_names(plan, assessed, store).into_iter().zip(assessed) {
        // A step that is up to date does not use its frames, so the store is not asked for them.
        let name = name.filter(|_| a.action != StepAction::Keep);
        let frames = name.map(|name| store.frames_of(&name)).transpose()?;
        has_frames.push(frames.is_some_and(|files| !files.is_empty()));
    }
    let edits: Vec<Vec<RecipeEdit>> = plan.scenes().iter().map(|recipe| edits_since(recipe, store)).collect();
    let others = plan.steps().iter().zip(assessed).zip(has_frames).map(|((step, a), kept_frames)| PlanRow {
        scene: plan.scene_of(step),
        step: &step.name,
        action: a.action,
        reason: &a.reason,
        key: a.key,
        outputs: output_files(store, a.outputs.as_deref().unwrap_or_default()),
        words: edited_words(&a.reason, &edits_of_step(&edits[step.scene], &step.name)),
        kept_frames,
    });
    let mut rows: Vec<PlanRow<'a>> = known.chain(others).collect();
    // The sort is stable: the steps of a scene stay in the order of the plan.
    rows.sort_by(|a, b| a.scene.cmp(b.scene));
    Ok(rows)
}

/// The files of a step, in the form for programs.
pub(super) fn output_files<'a>(store: &Store, outputs: &'a [StoredOutput]) -> Vec<StepFile<'a>> {
    let file = |o: &'a StoredOutput| StepFile {
        role: &o.name,
        digest: o.digest,
        path: path(store.path_of(&o.digest)),
    };
    outputs.iter().map(file).collect()
}

fn report_rows(rows: &[PlanRow<'_>], console: &Console) {
    let line = |row: &PlanRow<'_>| {
        let action = match row.action {
            StepAction::Run => "run",
            StepAction::MayRun => "may run",
            StepAction::Keep => "keep",
        };
        let frames = if row.kept_frames { "; its frames are kept" } else { "" };
        format!("{action:7}  {}/{}  {}{frames}", row.scene, row.step, row.words)
    };
    rows.iter().for_each(|row| console.print(&line(row)));
    let count = |action| rows.iter().filter(|row| row.action == action).count();
    let [run, may, keep] = [StepAction::Run, StepAction::MayRun, StepAction::Keep].map(count);
    console.note(&format!("{run} to run, {may} may run, {keep} up to date"));
}

/// The estimate for all steps that would run.
#[derive(Debug, Default, Serialize)]
struct EstimateTotal {
    /// Number of steps that will or may run.
    steps: usize,
    /// Number of steps without an earlier run of their kind. They are in no sum but that of bytes, and there
    /// only if their parameters state a size.
    unknown: usize,
    core_seconds: f64,
    /// Wall time at best, if the work is shared evenly among the cores.
    seconds: f64,
    bytes: f64,
    /// Memory of the step that needs the most.
    memory: f64,
    #[serde(skip)]
    cores: usize,
}

impl EstimateTotal {
    fn of_plan(
        plan: &Plan,
        assessed: &[StepAssessment],
        store: &Store,
        cores: usize,
    ) -> Result<Self, VerbError> {
        let mut sum = Self { cores, ..Self::default() };
        let past = past_costs(plan, store)?;
        let runs: Vec<bool> = assessed.iter().map(|a| a.action != StepAction::Keep).collect();
        let bytes = expected_bytes(plan, &past);
        let steps = past.into_iter().zip(bytes).zip(&runs).zip(sharing_steps(plan, &runs));
        for (((past, bytes), _), shares) in steps.filter(|((_, runs), _)| **runs) {
            sum.steps += 1;
            sum.bytes += bytes.unwrap_or(0.0);
            let Some(past) = past else {
                sum.unknown += 1;
                continue;
            };
            // A step that shares its pass costs its part of the rendering only. Alone, it pays for all of it.
            sum.core_seconds += if shares { past.core_seconds } else { past.alone_core_seconds };
            sum.memory = sum.memory.max(past.memory);
        }
        sum.seconds = sum.core_seconds / cores as f64;
        Ok(sum)
    }

    fn report(&self, forecast: &PlanForecast, console: &Console) {
        if console.json {
            let mut estimate = json!(self);
            estimate["release"] = json!(forecast);
            return console.result(&estimate);
        }
        let Self { steps, unknown, core_seconds, seconds, bytes, memory, cores } = self;
        let outputs = bytes_text(*bytes);
        if unknown == steps && *steps > 0 {
            console.print(&format!(
                "{steps} steps would run, or may: time and memory are unknown, because no step like them ran before"
            ));
            console.print(&format!("outputs of known size: {outputs}"));
            return console.print_lines(&forecast_words(forecast).join("\n"));
        }
        console.print(&format!("{steps} steps would or may run: about {core_seconds:.1} core seconds, {seconds:.1} s on {cores} cores"));
        console
            .print(&format!("{outputs} of outputs; {:.0} MB of memory for the largest step", memory * 1e-6));
        if *unknown > 0 {
            console
                .print(&format!("{unknown} of them are not counted: no step of their kind has run before"));
        }
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the cast saturates")]
fn bytes_text(bytes: f64) -> String {
    format_amount(bytes as u64, "B")
}

/// A reason in words for people, with the edits of the recipe in the place of the parameters that follow
/// from them.
pub(super) fn edited_words(reason: &StepReason, edits: &[&RecipeEdit]) -> String {
    match reason {
        StepReason::ParamChanged { .. } if !edits.is_empty() => {
            let edits: Vec<String> = edits.iter().map(|edit| edit_words(edit)).collect();
            format!("the recipe changed: {}", edits.join("; "))
        }
        other => reason_words(other),
    }
}

/// An edit of a recipe in words.
pub(super) fn edit_words(edit: &RecipeEdit) -> String {
    let RecipeEdit { path, old, new } = edit;
    let shown = |value: &Option<Value>| value.as_ref().map_or("absent".into(), Value::to_string);
    match (old, new) {
        (Some(Value::Object(_)), None) => format!("{path}: removed"),
        (None, Some(Value::Object(_))) => format!("{path}: added"),
        (old, new) => format!("{path}: {} -> {}", shown(old), shown(new)),
    }
}

/// A reason in words for people.
fn reason_words(reason: &StepReason) -> String {
    let was = |text: &str| if text.is_empty() { "absent".to_owned() } else { text.to_owned() };
    match reason {
        StepReason::UpToDate => "up to date".to_owned(),
        StepReason::InputMayChange { step } => format!("depends on {step}"),
        StepReason::NotAsked { program } => {
            format!("the version of {program} is unknown: a build determines it")
        }
        StepReason::NoRecord => "never made".to_owned(),
        StepReason::InputChanged { name, old, new } => {
            let brief = |digest: &str| was(&digest.chars().take(12).collect::<String>());
            format!("input `{name}` changed: {} -> {}", brief(old), brief(new))
        }
        StepReason::ParamChanged { name, old, new } => {
            format!("`{name}` changed: {} -> {}", was(old), was(new))
        }
        StepReason::Revision { old, new } => format!("revision {} -> {}", was(old), was(new)),
        StepReason::Class { old, new } => format!("numerical class {} -> {}", was(old), was(new)),
        StepReason::BlobMissing { digest } => format!("output {} is gone", &digest[..12]),
        StepReason::BlobAltered { digest } => format!("output {} was altered", &digest[..12]),
    }
}
