//! `gs2e status`: the state of each scene that tasks of a batch system build.

use super::CommonArgs;
use super::cluster::{ClusterAccess, ClusterScenes, ClusterTargets, StateCounts, failure_message};
use super::console::Console;
use super::problem::{ExitKind, VerbError};
use crate::cluster::scene_state::{SceneFailure, SceneState};
use crate::cluster::slurm::Slurm;
use serde_json::{Value, json};

/// Arguments of `status`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "A scene is done if the shared store has all of its steps, however they were made. Without Slurm, nothing is running or queued."
)]
pub(super) struct StatusArgs {
    #[command(flatten)]
    targets: ClusterTargets,
}

impl StatusArgs {
    pub(super) fn run(mut self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        self.targets.resolve()?;
        self.targets.require_store()?;
        let slurm = Slurm::new(common.programs());
        let slurm = slurm.require().is_ok().then_some(slurm);
        if slurm.is_none() {
            console.say("there is no Slurm here: scenes that a job builds are shown as open or failed");
        }
        let found = self.targets.look(common, ClusterAccess::Look, slurm.as_ref(), console)?;
        let ClusterScenes { plan, progress, states, .. } = &found;
        for ((recipe, progress), state) in plan.scenes().iter().zip(&progress.scenes).zip(states) {
            if console.json {
                let mut line = to_json(state);
                line["scene"] = json!(recipe.scene);
                line["steps"] = json!(progress.steps);
                line["finished"] = json!(progress.finished);
                console.result(&line);
            } else {
                let steps = format!("{}/{} steps", progress.finished, progress.steps);
                console.print(&format!("{}  {}  {steps}", state_words(state), recipe.scene));
            }
        }
        if !console.json {
            let failures = plan.scenes().iter().zip(states).filter_map(|(recipe, state)| match state {
                SceneState::Failed(failure) => Some(failure_message(&recipe.scene, failure)),
                _ => None,
            });
            failures.for_each(|message| console.show(&message));
        }
        console.say(&StateCounts::of(states).to_string());
        Ok(ExitKind::Done)
    }
}

/// The state in one column.
fn state_words(state: &SceneState) -> String {
    match state {
        SceneState::Done => "done".to_owned(),
        SceneState::Running { task, node } => format!("running {task} on {node}"),
        SceneState::Queued { task, reason } => format!("queued {task} ({reason})"),
        SceneState::Failed(failure) => format!("failed {}", failure.task),
        SceneState::Open => "open".to_owned(),
    }
}

fn to_json(state: &SceneState) -> Value {
    match state {
        SceneState::Done => json!({ "state": "done" }),
        SceneState::Running { task, node } => {
            json!({ "state": "running", "job": task.to_string(), "node": node })
        }
        SceneState::Queued { task, reason } => {
            json!({ "state": "queued", "job": task.to_string(), "reason": reason })
        }
        SceneState::Failed(SceneFailure { task, because, last, is_out_of_memory, .. }) => json!({
            "state": "failed", "job": task.to_string(), "because": because, "log": last,
            "out_of_memory": is_out_of_memory,
        }),
        SceneState::Open => json!({ "state": "open" }),
    }
}
