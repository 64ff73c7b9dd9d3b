//! `gs2e cancel`: ends the queued and running tasks of scenes.

use super::cluster::{ClusterAccess, ClusterTargets, recipe_digest};
use super::{CommonArgs, Console, ExitKind, VerbError};
use gs2e_build::cluster::queue::TaskId;
use gs2e_build::cluster::slurm::Slurm;
use gs2e_store::Digest;
use serde_json::json;
use std::collections::BTreeSet;

/// Arguments of `cancel`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Finished steps stay in the shared store. A task that also builds other scenes goes on."
)]
pub(super) struct CancelArgs {
    #[command(flatten)]
    targets: ClusterTargets,
}

impl CancelArgs {
    pub(super) fn run(mut self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        self.targets.resolve()?;
        self.targets.require_folder()?;
        self.targets.require_store()?;
        let slurm = Slurm::new(common.programs());
        slurm.require()?;
        let found = self.targets.look(common, ClusterAccess::Look, Some(&slurm), console)?;
        let named: BTreeSet<Digest> = found.plan.scenes().iter().map(recipe_digest).collect();
        let (mut ended, mut shared): (Vec<TaskId>, Vec<TaskId>) = (Vec::new(), Vec::new());
        for (task, plan) in found.view.live() {
            let index = usize::try_from(task.id.task).unwrap_or(0).wrapping_sub(1);
            let scenes = plan.plan.tasks.get(index).map(Vec::as_slice).unwrap_or_default();
            let count = scenes.iter().filter(|scene| named.contains(&scene.recipe)).count();
            // `scancel` ends whole tasks, so a task that also builds scenes without a name here must go on.
            if count == scenes.len() {
                ended.push(task.id);
            } else if count > 0 {
                shared.push(task.id);
            }
        }
        if !ended.is_empty() {
            slurm.cancel(&ended)?;
        }
        for task in &shared {
            console.note(&format!("task {task} goes on: it also builds scenes that were not named"));
        }
        console.note(&format!("cancelled {} tasks", ended.len()));
        let names = |tasks: &[TaskId]| tasks.iter().map(ToString::to_string).collect::<Vec<_>>();
        console.result(&json!({ "cancelled": names(&ended), "running": names(&shared) }));
        Ok(ExitKind::Done)
    }
}
