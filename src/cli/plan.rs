//! `gs2e plan`: what `build` would run, may run and leave alone, each with its reason.

use super::build::read_plan;
use super::console::Console;
use super::problem::{Exit, Problem};
use super::{Common, Targets};
use crate::plan::Plan;
use crate::plan::assess::{Action, Assessment, Reason, assess};
use crate::store::{Access, Store};
use serde_json::json;

/// Arguments of `plan`.
#[derive(Debug, clap::Args)]
pub(super) struct Show {
    #[command(flatten)]
    targets: Targets,
}

impl Show {
    pub(super) fn run(self, common: &Common, console: &Console) -> Result<Exit, Problem> {
        let plan = read_plan(&self.targets.recipes)?;
        let store = Store::open(&common.store, Access::Read, &mut |_| {})?;
        let assessed = assess(&plan, &store)?;
        if console.json {
            let steps = plan.steps().iter().zip(&assessed);
            let list = steps.map(|(step, a)| {
                json!({
                    "scene": plan.scene_of(step), "step": step.name, "action": a.action, "reason": a.reason,
                    "key": a.key.map(|key| key.to_string()), "outputs": outputs(&store, a),
                })
            });
            console.result(&list.collect());
        } else {
            show(&plan, &assessed, console);
        }
        Ok(Exit::Done)
    }
}

fn outputs(store: &Store, assessed: &Assessment) -> serde_json::Value {
    let list = assessed.outputs.iter().flatten();
    list.map(|o| json!({ "role": o.name, "digest": o.digest, "path": store.path_of(&o.digest) })).collect()
}

fn show(plan: &Plan, assessed: &[Assessment], console: &Console) {
    for (step, a) in plan.steps().iter().zip(assessed) {
        let action = match a.action {
            Action::Run => "run",
            Action::MayRun => "may run",
            Action::Keep => "keep",
        };
        console.print(&format!("{action:7}  {}/{}  {}", plan.scene_of(step), step.name, words(&a.reason)));
    }
    let count = |action| assessed.iter().filter(|a| a.action == action).count();
    let [run, may, keep] = [Action::Run, Action::MayRun, Action::Keep].map(count);
    console.say(&format!("{run} to run, {may} may run, {keep} up to date"));
}

/// A reason for people.
pub(super) fn words(reason: &Reason) -> String {
    let was = |text: &str| if text.is_empty() { "absent".to_owned() } else { text.to_owned() };
    match reason {
        Reason::UpToDate => "up to date".to_owned(),
        Reason::InputMayChange { step } => format!("behind {step}"),
        Reason::NoRecord => "never made".to_owned(),
        Reason::InputChanged { name, old, new } => {
            let brief = |digest: &str| was(&digest.chars().take(12).collect::<String>());
            format!("input `{name}` changed: {} -> {}", brief(old), brief(new))
        }
        Reason::ParamChanged { name, old, new } => format!("`{name}` changed: {} -> {}", was(old), was(new)),
        Reason::Revision { old, new } => format!("revision {} -> {}", was(old), was(new)),
        Reason::Class { old, new } => format!("numerical class {} -> {}", was(old), was(new)),
        Reason::BlobMissing { digest } => format!("output {} is gone", &digest[..12]),
        Reason::BlobAltered { digest } => format!("output {} was altered", &digest[..12]),
    }
}
