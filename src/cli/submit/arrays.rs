//! The array jobs of a submission: which scenes, in which task, with what memory.

use super::{ClusterScenes, CommonArgs, SubmitArgs, VerbError};
use crate::cli::cluster::recipe_digest;
use crate::cli::{BackendArg, environment};
use gs2e_build::cluster::scene_state::SceneState;
use gs2e_build::cluster::script::BatchScript;
use gs2e_build::cluster::submission::{PlannedTask, Submission, SubmittedScene, TaskNeed};
use gs2e_build::plan::shard::SceneShard;
use gs2e_recipe::Recipe;
use std::collections::BTreeMap;

/// An array job that is ready to be submitted.
pub(super) struct ArrayJob {
    pub(super) submission: Submission,
    pub(super) tasks: Vec<PlannedTask>,
    pub(super) script: String,
}

/// Tasks of a job, if the user does not say.
const TASKS: u32 = 64;
/// Cores and memory in MB of a task, if nothing is known.
const UNKNOWN: (u16, u64) = (4, 8000);
/// Cores of a task at most, unless the user asks for more.
const MOST_CORES: f64 = 8.0;
/// Time that a task should take, s.
const TASK_SECONDS: f64 = 3600.0;

impl SubmitArgs {
    /// One array for each amount of memory: scenes whose task exceeded its memory get twice as much.
    pub(super) fn arrays(
        &self,
        found: &ClusterScenes,
        common: &CommonArgs,
    ) -> Result<Vec<ArrayJob>, VerbError> {
        let default = self.default_memory(found);
        let mut by_memory: BTreeMap<u64, Vec<Recipe>> = BTreeMap::new();
        for (recipe, state) in found.plan.scenes().iter().zip(&found.states) {
            let memory = match state {
                SceneState::Open => default,
                SceneState::Failed(failure) if failure.is_out_of_memory => default.max(2 * failure.memory_mb),
                SceneState::Failed(failure) => default.max(failure.memory_mb),
                SceneState::Done | SceneState::Running { .. } | SceneState::Queued { .. } => continue,
            };
            by_memory.entry(memory).or_default().push(recipe.clone());
        }
        let array = |(memory, recipes): (u64, Vec<Recipe>)| self.array(memory, &recipes, found, common);
        by_memory.into_iter().map(array).collect()
    }

    fn array(
        &self,
        memory_mb: u64,
        recipes: &[Recipe],
        found: &ClusterScenes,
        common: &CommonArgs,
    ) -> Result<ArrayJob, VerbError> {
        let of = u32::try_from(recipes.len()).unwrap_or(u32::MAX).min(self.tasks.unwrap_or(TASKS));
        let shares = (1..=of).map(|number| SceneShard { number, of }.choose(recipes));
        let scene = |recipe: &Recipe| {
            let submitted = SubmittedScene { scene: recipe.scene.clone(), recipe: recipe_digest(recipe) };
            (submitted, recipe.meta.file.clone())
        };
        let tasks: Vec<PlannedTask> = shares.map(|share| share.into_iter().map(scene).collect()).collect();
        let options = self.batch_options()?;
        let cores = self.resources.cpus.unwrap_or_else(|| default_cores(found, tasks.len()));
        let shared = &self.targets.shared_store;
        let submission = Submission::plan(shared, TaskNeed { memory_mb, cores, gpu: options.gpu }, &tasks);
        let lost = |e| VerbError::failed("input-missing", format!("failed to find the current folder: {e}"));
        let folder = std::env::current_dir().map_err(lost)?;
        let program = environment::this_program();
        let script = BatchScript {
            submission: &submission,
            options: &options,
            program: &program,
            shared,
            folder: &folder,
            words: &self.build_words(common, options.gpu),
        }
        .text();
        Ok(ArrayJob { submission, tasks, script })
    }

    /// The options of this command that its tasks need too.
    fn build_words(&self, common: &CommonArgs, gpu: bool) -> Vec<String> {
        // Never `auto`: the class of a step would then depend on the node on which its task happens to run.
        let backend = match common.backend {
            BackendArg::Reference => "reference",
            BackendArg::Gpu => "gpu",
            BackendArg::Auto if gpu => "gpu",
            BackendArg::Auto | BackendArg::Cpu => "cpu",
        };
        let mut words = vec!["--backend".to_owned(), backend.to_owned()];
        let without = common.gpu_without.filter(|_| backend == "gpu");
        words.extend(without.map(|features| format!("--gpu-without={features}")));
        words.extend(common.no_omit.then(|| "--no-omit".to_owned()));
        words.extend(common.allow_commands.then(|| "--allow-commands".to_owned()));
        words.extend(self.cache_size.map(|bytes| format!("--cache-size={bytes}")));
        words
    }

    /// Memory of a task, MB.
    fn default_memory(&self, found: &ClusterScenes) -> u64 {
        /// For the program itself.
        const BASE_MB: u64 = 1000;
        if let Some(bytes) = self.resources.mem {
            return bytes.div_ceil(1_000_000);
        }
        let Some(memory) = found.progress.memory else { return UNKNOWN.1 };
        // A step gets the share of the memory that the script grants, and a half more for the unexpected.
        BASE_MB + whole(memory * 1.5e-6) * 100 / 80
    }
}

/// Cores with which a task takes about an hour.
fn default_cores(found: &ClusterScenes, tasks: usize) -> u16 {
    if found.progress.memory.is_none() {
        return UNKNOWN.0;
    }
    let cores = found.progress.core_seconds / tasks.max(1) as f64 / TASK_SECONDS;
    u16::try_from(whole(cores.clamp(1.0, MOST_CORES))).unwrap_or(1)
}

/// A number, rounded up.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive, and below 2^53")]
fn whole(number: f64) -> u64 {
    number.ceil() as u64
}
