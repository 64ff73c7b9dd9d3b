//! `gs2e why`: shows the parts of a step's key, and the changes since the step was last made.

use super::build::read_store;
use super::plan::{edit_words, edited_words};
use super::{CommonArgs, Console, ExitKind, RecipeTargets, VerbError};
use gs2e_build::plan::assess::{DescriptionChange, StepAction, StepAssessment, StepReason, assess_plan};
use gs2e_build::plan::edits::{edits_of_step, edits_since};
use gs2e_build::plan::{Plan, PlannedStep};
use gs2e_recipe::{self as recipe, RecipeEdit};
use gs2e_store::description::ExplanationLine;
use gs2e_store::{Store, StoreError};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Arguments of `why`.
#[derive(Debug, clap::Args)]
pub(super) struct WhyArgs {
    /// Scene id, or a step of it as `scene/trajectory/events`
    #[arg(value_name = "SCENE[/STEP]")]
    name: String,
    /// Recipes, or folders of recipes
    #[arg(long, value_name = "RECIPE or DIR", default_value = RecipeTargets::DEFAULT)]
    recipes: Vec<PathBuf>,
}

impl WhyArgs {
    pub(super) fn run(self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        let (recipes, renderers) = (recipe::read_named(&self.recipes, &self.name)?, common.renderers()?);
        let store = read_store(common)?;
        let plan = Plan::new(recipes, &renderers.knowing(&store));
        let assessed = assess_plan(&plan, &store)?;
        let (scene, chosen) = choose_steps(&plan, &self.name)?;
        let edits = edits_since(&plan.scenes()[scene], &store);
        // Programs get the edits with the record of each step.
        if !edits.is_empty() && !console.json {
            report_edits(&plan, scene, &edits, &assessed, console);
        }
        let pairs = plan.steps().iter().zip(&assessed).filter(|(step, _)| chosen(step));
        for (step, assessed) in pairs {
            let why = explain_step(&plan, &store, step, assessed)?;
            if console.json {
                console.result(&to_json(&why, &edits));
            } else {
                report_explanation(&why, &edits, console);
            }
        }
        Ok(ExitKind::Done)
    }
}

/// Prints the edited values, and the steps that will or may run because of them.
fn report_edits(
    plan: &Plan,
    scene: usize,
    edits: &[RecipeEdit],
    assessed: &[StepAssessment],
    console: &Console,
) {
    console.print(&format!("{}: the recipe was edited since the last build", plan.scenes()[scene].scene));
    edits.iter().for_each(|edit| console.print(&format!("  {}", edit_words(edit))));
    let steps: Vec<_> = plan.steps_of(scene).map(|(id, step)| (step, &assessed[id.0])).collect();
    let names = |wanted: &dyn Fn(&StepAssessment) -> bool| {
        let names = steps.iter().filter(|(_, a)| wanted(a)).map(|(step, _)| step.name.as_str());
        names.collect::<Vec<_>>().join(", ")
    };
    let run = names(&|a| a.action == StepAction::Run && is_of_recipe(&a.reason));
    let may_run = names(&|a| a.action == StepAction::MayRun);
    for (what, steps) in [("will run", &run), ("may run", &may_run)] {
        if !steps.is_empty() {
            console.print(&format!("  {what}: {steps}"));
        }
    }
    if run.is_empty() && may_run.is_empty() {
        console.print("  no step has to run for it");
    }
}

/// Returns true if an edit of the recipe can be the reason for a run, unlike a lost blob or another
/// version of the program.
fn is_of_recipe(reason: &StepReason) -> bool {
    matches!(reason, StepReason::NoRecord | StepReason::InputChanged { .. } | StepReason::ParamChanged { .. })
}

/// The scene and the steps that a name means. The scene is the longest id that matches. The rest of
/// the name is a step, or a folder of steps.
fn choose_steps<'p>(
    plan: &'p Plan,
    name: &'p str,
) -> Result<(usize, impl Fn(&PlannedStep) -> bool + 'p), VerbError> {
    let rest_of = |id: &str| match name.strip_prefix(id) {
        Some("") => Some(""),
        Some(rest) => rest.strip_prefix('/'),
        None => None,
    };
    // The ids of scenes contain slashes, and one id may begin with another.
    let matches =
        plan.scenes().iter().enumerate().filter_map(|(i, r)| Some((r.scene.len(), i, rest_of(&r.scene)?)));
    let Some((_, scene, step)) = matches.max_by_key(|(length, ..)| *length) else {
        let known: Vec<&str> = plan.scenes().iter().take(5).map(|r| r.scene.as_str()).collect();
        let message = format!("no scene `{name}` among {} recipes", plan.scenes().len());
        return Err(VerbError::usage("no-scene", message).help(format!("scenes here: {}", known.join(", "))));
    };
    let chosen = move |planned: &PlannedStep| {
        let below =
            planned.name.strip_prefix(step).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'));
        planned.scene == scene && (step.is_empty() || below)
    };
    if !plan.steps().iter().any(&chosen) {
        let names: Vec<&str> = plan.steps_of(scene).map(|(_, s)| s.name.as_str()).collect();
        let message = format!("scene `{}` has no step `{step}`", plan.scenes()[scene].scene);
        return Err(VerbError::usage("no-step", message).help(format!("its steps: {}", names.join(", "))));
    }
    Ok((scene, chosen))
}

/// A step, its inputs, and its changes since it was last made.
struct StepExplanation<'a> {
    scene: &'a str,
    step: &'a str,
    assessed: &'a StepAssessment,
    lines: Vec<ExplanationLine>,
    changes: Vec<DescriptionChange>,
}

fn explain_step<'a>(
    plan: &'a Plan,
    store: &Store,
    step: &'a PlannedStep,
    assessed: &'a StepAssessment,
) -> Result<StepExplanation<'a>, StoreError> {
    let scene = plan.scene_of(step);
    let last = store.last_key(scene, &step.name).map(|key| store.full_record(&key)).transpose()?.flatten();
    let changes = last.map(|record| assessed.changes(&record.description)).unwrap_or_default();
    Ok(StepExplanation { scene, step: &step.name, assessed, lines: assessed.description.lines(), changes })
}

fn to_json(why: &StepExplanation<'_>, edits: &[RecipeEdit]) -> Value {
    let StepExplanation { scene, step, assessed, lines, changes } = why;
    json!({
        "scene": scene, "step": step, "action": assessed.action, "reason": assessed.reason,
        "key": assessed.key.map(|key| key.to_string()),
        "description": lines, "changes": changes, "recipe_edits": edits,
    })
}

fn report_explanation(why: &StepExplanation<'_>, edits: &[RecipeEdit], console: &Console) {
    let StepExplanation { scene, step, assessed, lines, changes } = why;
    let edits = edits_of_step(edits, step);
    console.print(&format!("{scene}/{step}: {}", edited_words(&assessed.reason, &edits)));
    for edit in &edits {
        console.print(&format!("  changed since the last run: {}", edit_words(edit)));
    }
    // Parameters have other names and forms than the keys of the recipe that they follow from.
    let own = changes.iter().filter(|change| edits.is_empty() || !change.path.starts_with("params."));
    for DescriptionChange { path, old, new } in own {
        let [old, new] = [old, new].map(|text| if text.is_empty() { "absent" } else { text });
        console.print(&format!("  changed since the last run: {path}: {old} -> {new}"));
    }
    match &assessed.key {
        Some(key) => console.print(&format!("  key {key}")),
        None => console.print("  no key yet: an input must be made first"),
    }
    for line in lines {
        console.print(&format!("  {} = {}", line.path, line.text));
    }
}
