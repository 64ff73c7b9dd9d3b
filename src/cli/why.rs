//! `gs2e why`: what goes into a step's key, and what changed since it was last made.

use super::Common;
use super::build::read_plan;
use super::console::Console;
use super::plan::words;
use super::problem::{Exit, Problem};
use crate::plan::assess::{Assessment, Change, assess};
use crate::plan::{Plan, PlannedStep};
use crate::store::{Access, Store};
use serde_json::json;
use std::path::PathBuf;

/// Arguments of `why`.
#[derive(Debug, clap::Args)]
pub(super) struct Why {
    /// Scene id, or a step of it as `scene/trajectory/events`
    #[arg(value_name = "SCENE[/STEP]")]
    name: String,
    /// Where the recipes are
    #[arg(long, value_name = "RECIPE or DIR", default_value = "recipes")]
    recipes: Vec<PathBuf>,
}

impl Why {
    pub(super) fn run(self, common: &Common, console: &Console) -> Result<Exit, Problem> {
        let plan = read_plan(&self.recipes)?;
        let store = Store::open(&common.store, Access::Read, &mut |_| {})?;
        let assessed = assess(&plan, &store)?;
        let chosen = choose(&plan, &self.name)?;
        let pairs = plan.steps().iter().zip(&assessed).filter(|(step, _)| chosen(step));
        for (step, assessed) in pairs {
            explain(&plan, &store, step, assessed, console);
        }
        Ok(Exit::Done)
    }
}

/// The steps that a name means: the scene is the longest id that matches, the rest names a step or all below it.
fn choose<'p>(plan: &'p Plan, name: &'p str) -> Result<impl Fn(&PlannedStep) -> bool + 'p, Problem> {
    let rest_of = |id: &str| match name.strip_prefix(id) {
        Some("") => Some(""),
        Some(rest) => rest.strip_prefix('/'),
        None => None,
    };
    let matches =
        plan.scenes().iter().enumerate().filter_map(|(i, r)| Some((r.scene.len(), i, rest_of(&r.scene)?)));
    let Some((_, scene, step)) = matches.max_by_key(|(length, ..)| *length) else {
        let known: Vec<&str> = plan.scenes().iter().take(5).map(|r| r.scene.as_str()).collect();
        let message = format!("no scene `{name}` among {} recipes", plan.scenes().len());
        return Err(Problem::usage("no-scene", message).help(&format!("scenes here: {}", known.join(", "))));
    };
    let chosen = move |planned: &PlannedStep| {
        let below =
            planned.name.strip_prefix(step).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'));
        planned.scene == scene && (step.is_empty() || below)
    };
    if !plan.steps().iter().any(&chosen) {
        let names: Vec<&str> = plan.steps_of(scene).map(|(_, s)| s.name.as_str()).collect();
        let message = format!("scene `{}` has no step `{step}`", plan.scenes()[scene].scene);
        return Err(Problem::usage("no-step", message).help(&format!("its steps: {}", names.join(", "))));
    }
    Ok(chosen)
}

fn explain(plan: &Plan, store: &Store, step: &PlannedStep, assessed: &Assessment, console: &Console) {
    let scene = plan.scene_of(step);
    let lines = assessed.description.lines();
    let last = store.last_key(scene, &step.name).and_then(|key| store.full_record(&key));
    let changed = last.map(|record| assessed.changes(&record.description)).unwrap_or_default();
    if console.json {
        console.result(&json!({
            "scene": scene, "step": step.name, "action": assessed.action, "reason": assessed.reason,
            "key": assessed.key.map(|key| key.to_string()),
            "description": lines, "changes": changed,
        }));
        return;
    }
    console.print(&format!("{scene}/{}: {}", step.name, words(&assessed.reason)));
    for Change { path, old, new } in &changed {
        let was = |text: &str| if text.is_empty() { "absent".to_owned() } else { text.to_owned() };
        console.print(&format!("  changed since it was last made: {path}: {} -> {}", was(old), was(new)));
    }
    match &assessed.key {
        Some(key) => console.print(&format!("  key {key}")),
        None => console.print("  no key yet: an input will be made first"),
    }
    for line in &lines {
        console.print(&format!("  {} = {}", line.path, line.text));
    }
}
