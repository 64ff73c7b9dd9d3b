//! `gs2e status`: the state of each scene that tasks of a batch system build.

use super::cluster::{ClusterAccess, ClusterScenes, ClusterTargets};
use super::{CommonArgs, Console, ExitKind, VerbError, clock, output};
use gs2e_build::cluster::page::{ScenePanel, StatusPage};
use gs2e_build::cluster::scene_state::{SceneFailure, SceneState, StateCounts};
use gs2e_build::cluster::slurm::Slurm;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Duration;

const HOUR: Duration = Duration::from_secs(3600);

/// Arguments of `status`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "A scene is done if the shared store has all of its steps, however they were made. Without Slurm, nothing is running or queued."
)]
pub(super) struct StatusArgs {
    #[command(flatten)]
    targets: ClusterTargets,
    /// Also write one HTML page: states, time left, machines, slowest steps, failures by kind
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

impl StatusArgs {
    pub(super) fn run(mut self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        self.targets.resolve()?;
        output::screen_outputs(self.html.as_deref(), [], console.json)?;
        self.targets.require_store()?;
        let slurm = Slurm::new(common.programs());
        let slurm = slurm.require().is_ok().then_some(slurm);
        if slurm.is_none() {
            console.note("there is no Slurm here: scenes that a job builds are shown as open or failed");
        }
        let found = self.targets.look(common, ClusterAccess::Look, slurm.as_ref(), console)?;
        let ClusterScenes { plan, progress, states, .. } = &found;
        for ((recipe, progress), state) in plan.scenes().iter().zip(&progress.scenes).zip(states) {
            let (scene, finished, steps) = (&recipe.scene, progress.finished, progress.steps);
            if console.json {
                let mut line = to_json(state);
                line["scene"] = json!(scene);
                (line["steps"], line["finished"]) = (json!(steps), json!(finished));
                console.result(&line);
            } else {
                console.print(&format!("{state}  {scene}  {finished}/{steps} steps"));
            }
        }
        if !console.json {
            found.failures().for_each(|message| console.report_to_people(&message));
        }
        console.note(&StateCounts::of(states).to_string());
        if let Some(file) = &self.html {
            let page = compose_page(&found, &self.targets.shared_store);
            output::write_whole(file, page.as_bytes()).map_err(|e| output::not_written(file, e))?;
            console.note(&format!("wrote {}", file.display()));
        }
        Ok(ExitKind::Done)
    }
}

fn compose_page(found: &ClusterScenes, shared: &Path) -> String {
    let ClusterScenes { plan, progress, view, states } = found;
    let shown = plan.scenes().iter().zip(&progress.scenes).zip(states);
    let scenes: Vec<ScenePanel<'_>> = shown
        .map(|((recipe, progress), state)| ScenePanel { scene: &recipe.scene, progress: *progress, state })
        .collect();
    StatusPage {
        shared: &shared.to_string_lossy(),
        now: &clock::utc_now(),
        hour_ago: &clock::utc_before(HOUR),
        scenes: &scenes,
        core_seconds: progress.core_seconds,
        cores: view.cores_at_work(),
        made: &view.steps_made(),
    }
    .compose()
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
