//! `gs2e submit`: builds scenes by array jobs of a batch system.

mod arrays;
mod watch;

use super::cluster::{ClusterAccess, ClusterScenes, ClusterTargets, absolute};
use super::{CommonArgs, Console, ExitKind, VerbError, machine, on_interrupt};
use gs2e_build::cluster::scene_state::StateCounts;
use gs2e_build::cluster::script::BatchOptions;
use gs2e_build::cluster::slurm::Slurm;
use gs2e_files::escape::is_hidden;
use serde_json::json;
use std::collections::BTreeSet;
use std::io::Write as _;
use std::path::PathBuf;
use tempfile::NamedTempFile;
use watch::{WatchEnd, wait_for_tasks};

/// Arguments of `submit`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Finished steps of the shared store are adopted. Scenes whose task is queued or running are not submitted again. \
    Ctrl-C detaches: the jobs go on, and the same command waits for them again."
)]
pub(super) struct SubmitArgs {
    #[command(flatten)]
    targets: ClusterTargets,
    /// Batch system
    #[arg(long, value_enum)]
    to: SchedulerArg,
    /// Maximum number of tasks of a job [default: 64]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    tasks: Option<u32>,
    #[command(flatten)]
    resources: ResourceArgs,
    /// Image of Apptainer in which tasks run
    #[arg(long, value_name = "IMAGE")]
    container: Option<PathBuf>,
    /// Folder for the stores of tasks, which then outlive them [default: deleted, in TMPDIR of the node]
    #[arg(long, value_name = "DIR")]
    task_store: Option<PathBuf>,
    /// Size of the store of a task, as for build
    #[arg(long, value_name = "BYTES", value_parser = machine::parse_bytes)]
    cache_size: Option<u64>,
    /// Number of times that failed scenes are submitted again
    #[arg(long, value_name = "K", default_value_t = 2)]
    retries: u32,
    /// Print the batch scripts, and submit nothing
    #[arg(long)]
    dry_run: bool,
    /// Submit, and do not wait
    #[arg(long, conflicts_with = "dry_run")]
    detach: bool,
}

/// Batch systems.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum SchedulerArg {
    Slurm,
}

/// Resources of each task.
#[derive(Debug, clap::Args)]
struct ResourceArgs {
    /// Account of the job, as for sbatch
    #[arg(long, value_name = "NAME")]
    account: Option<String>,
    /// Partition of the job, as for sbatch
    #[arg(long, value_name = "NAME")]
    partition: Option<String>,
    /// Time limit of a task, as for sbatch
    #[arg(long, value_name = "TIME")]
    time: Option<String>,
    /// Generic resources of a task, as for sbatch: with a GPU, scenes are rendered on it
    #[arg(long, value_name = "LIST")]
    gres: Option<String>,
    /// Memory of a task, as 8GB [default: by earlier runs, else 8GB]
    #[arg(long, value_name = "BYTES", value_parser = machine::parse_bytes)]
    mem: Option<u64>,
    /// Cores of a task [default: by earlier runs, else 4]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    cpus: Option<u16>,
}

impl SubmitArgs {
    pub(super) fn run(mut self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        self.targets.resolve()?;
        self.targets.require_folder()?;
        let SchedulerArg::Slurm = self.to;
        let slurm = Slurm::new(common.programs());
        let has_slurm = slurm.require();
        if self.dry_run {
            // A dry run also serves on a machine without Slurm. Scenes at work then look open or failed, and
            // are in the scripts.
            let access = ClusterAccess::Look;
            let found = self.targets.look(common, access, has_slurm.is_ok().then_some(&slurm), console)?;
            self.arrays(&found, common)?.iter().for_each(|array| console.print_lines(&array.script));
            console.note(&StateCounts::of(&found.states).to_string());
            return Ok(ExitKind::Done);
        }
        has_slurm?;
        self.submit_and_wait(&slurm, common, console)
    }

    fn submit_and_wait(
        &self,
        slurm: &Slurm,
        common: &CommonArgs,
        console: &Console,
    ) -> Result<ExitKind, VerbError> {
        let detached = on_interrupt()?;
        let mut retries = self.retries;
        let mut found = self.targets.look(common, ClusterAccess::Offer, Some(slurm), console)?;
        loop {
            console.note(&StateCounts::of(&found.states).to_string());
            let mut names = self.submit(&found, slurm, common, console)?;
            // Other submitters may have jobs for the same scenes.
            names.extend(found.view.live().map(|(task, _)| task.name.clone()));
            if names.is_empty() {
                return Ok(self.end(&found, console));
            }
            if self.detach {
                console.note("detached: gs2e status shows the scenes, gs2e cancel ends the tasks");
                return Ok(ExitKind::Done);
            }
            if wait_for_tasks(&names, slurm, &detached, console) == WatchEnd::Detached {
                console.note("detached: the jobs go on; run the same command to wait for them");
                return Ok(ExitKind::Interrupted);
            }
            found = self.targets.look(common, ClusterAccess::Offer, Some(slurm), console)?;
            let counts = StateCounts::of(&found.states);
            if counts.failed + counts.open > 0 {
                if retries == 0 {
                    console.note(&counts.to_string());
                    return Ok(self.end(&found, console));
                }
                retries -= 1;
            }
        }
    }

    /// Submits the scenes that are open or failed, and returns the names of the jobs.
    fn submit(
        &self,
        found: &ClusterScenes,
        slurm: &Slurm,
        common: &CommonArgs,
        console: &Console,
    ) -> Result<BTreeSet<String>, VerbError> {
        let mut names = BTreeSet::new();
        for array in self.arrays(found, common)? {
            // The files come first, because a task may start before `sbatch` has answered.
            array.submission.write(&array.tasks, &array.script)?;
            // Not the copy in the shared store: others can write there.
            let job = slurm.submit(private_script(&array.script)?.path())?;
            let plan = &array.submission.plan;
            let scenes: usize = plan.tasks.iter().map(Vec::len).sum();
            let (tasks, cores, memory_mb) = (plan.tasks.len(), plan.cores, plan.memory_mb);
            console.note(&format!(
                "job {job}: {scenes} scenes in {tasks} tasks, each with {cores} cores and {memory_mb} MB"
            ));
            console.result(&json!({
                "job": job, "tasks": tasks, "scenes": scenes, "cores": cores, "memory_mb": memory_mb,
            }));
            names.insert(array.submission.name());
        }
        Ok(names)
    }

    /// Reports the scenes that are not done, and returns the exit code.
    fn end(&self, found: &ClusterScenes, console: &Console) -> ExitKind {
        found.failures().for_each(|message| console.report(&message));
        let StateCounts { failed, open, .. } = StateCounts::of(&found.states);
        if failed + open > 0 {
            return ExitKind::Failed;
        }
        let shared = self.targets.shared_store.display();
        console.note(&format!("all scenes are done; gs2e release --shared-store {shared} writes them"));
        ExitKind::Done
    }

    /// The options of the batch system.
    fn batch_options(&self) -> Result<BatchOptions, VerbError> {
        let ResourceArgs { account, partition, time, gres, .. } = &self.resources;
        let given = [("account", account), ("partition", partition), ("time", time), ("gres", gres)];
        let given = given.into_iter().filter_map(|(name, value)| Some((name, value.clone()?)));
        let slurm: Vec<_> = given.collect();
        // A line break in a value would begin a new line of the script, which could be another command.
        if let Some((name, value)) = slurm.iter().find(|(_, value)| value.chars().any(is_hidden)) {
            let wanted = "has a control or invisible character, wanted one line of text";
            return Err(VerbError::usage("usage", format!("--{name} `{value}` {wanted}")));
        }
        let absolute = |path: &Option<PathBuf>| path.as_deref().map(absolute).transpose();
        Ok(BatchOptions {
            slurm,
            container: absolute(&self.container)?,
            gpu: self.resources.gres.is_some(),
            task_store: absolute(&self.task_store)?,
        })
    }
}

/// A file with the script that only this user can write to.
fn private_script(text: &str) -> Result<NamedTempFile, VerbError> {
    let write = || {
        let mut file = tempfile::Builder::new().prefix("gs2e-").suffix(".sh").tempfile()?;
        file.write_all(text.as_bytes())?;
        std::io::Result::Ok(file)
    };
    write().map_err(|e| VerbError::failed("plan-files", format!("failed to write a script for sbatch: {e}")))
}
