//! Scenes on a shared store, for the verbs that deal with a batch system.

use super::build::{TrustOptions, open_store, store_options};
use super::{BackendArg, CommonArgs, Console, ExitKind, RecipeTargets, UserMessage, VerbError, takedown};
use gs2e_build::cluster::ClusterError;
use gs2e_build::cluster::finished::{PlanProgress, scene_progress};
use gs2e_build::cluster::scene_state::{AskedScene, ClusterView, SceneFailure, SceneState};
use gs2e_build::cluster::slurm::Slurm;
use gs2e_build::plan::Plan;
use gs2e_build::plan::survey::plan_all;
use gs2e_build::run::backends::RendererChoice;
use gs2e_files::is_there;
use gs2e_recipe::Recipe;
use gs2e_store::{Digest, Key, Store, StoreAccess, StoreOptions, is_bucket};
use std::path::{Path, PathBuf};

/// The scenes that a verb is about, and the store that their tasks share.
#[derive(Debug, clap::Args)]
pub(super) struct ClusterTargets {
    #[command(flatten)]
    pub(super) targets: RecipeTargets,
    /// Folder that the tasks share; `status` also takes a bucket, s3://BUCKET/PREFIX
    #[arg(long, value_name = "DIR")]
    pub(super) shared_store: PathBuf,
}

/// How the stores are opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ClusterAccess {
    /// Nothing is written, and nothing waits.
    Look,
    /// Steps of the own store are offered to the shared one.
    Offer,
}

/// Scenes with the state of each.
pub(super) struct ClusterScenes {
    pub(super) plan: Plan,
    pub(super) progress: PlanProgress,
    pub(super) view: ClusterView,
    pub(super) states: Vec<SceneState>,
}

impl ClusterScenes {
    /// The messages about the scenes that failed.
    pub(super) fn failures(&self) -> impl Iterator<Item = UserMessage> {
        self.plan.scenes().iter().zip(&self.states).filter_map(|(recipe, state)| match state {
            SceneState::Failed(failure) => Some(failure_message(&recipe.scene, failure)),
            _ => None,
        })
    }
}

impl ClusterTargets {
    /// Replaces scene ids by recipes, and makes all paths absolute: tasks and plans do not know the current
    /// folder.
    pub(super) fn resolve(&mut self) -> Result<(), VerbError> {
        self.targets.resolve()?;
        let shared = Some(&mut self.shared_store).filter(|shared| !is_bucket(shared));
        for path in self.targets.recipes.iter_mut().chain(shared) {
            *path = absolute(path)?;
        }
        Ok(())
    }

    /// Refuses a folder that is no shared store.
    pub(super) fn require_store(&self) -> Result<(), VerbError> {
        // A bucket answers when the store is opened.
        if is_bucket(&self.shared_store) || is_there(&self.shared_store.join("VERSION")) {
            return Ok(());
        }
        let what = format!("there is no shared store in {}", self.shared_store.display());
        Err(VerbError::usage("no-shared-store", what)
            .help("gs2e submit and gs2e build --shared-store make one"))
    }

    /// Refuses a bucket: plans and results of tasks are files in a folder.
    pub(super) fn require_folder(&self) -> Result<(), VerbError> {
        if !is_bucket(&self.shared_store) {
            return Ok(());
        }
        let what = format!("{} is not a folder", self.shared_store.display());
        Err(VerbError::usage("not-shared", what)
            .help("in a bucket, start gs2e build --shard I/N --shared-store s3://… once per task"))
    }

    /// Looks at the recipes, both stores and the batch system.
    pub(super) fn look(
        &self,
        common: &CommonArgs,
        access: ClusterAccess,
        slurm: Option<&Slurm>,
        console: &Console,
    ) -> Result<ClusterScenes, VerbError> {
        let chosen = cluster_renderers(common)?;
        let store = self.open(common, access, console)?;
        // Only an offer may run programs, for their versions. A look takes the versions that the store knows.
        let surveyed = match access {
            ClusterAccess::Look => plan_all(&self.targets.recipes, &chosen.knowing(&store))?,
            ClusterAccess::Offer => plan_all(&self.targets.recipes, &chosen.asking(&store))?,
        };
        takedown::report_takedown(surveyed.taken_down, &console.for_people());
        let plan = surveyed.plan;
        let progress = scene_progress(&plan, &store, access == ClusterAccess::Offer)?;
        if access == ClusterAccess::Offer {
            // The digests of sources are kept for the next time.
            store.flush()?;
        }
        let scenes = asked_scenes(&plan, &progress);
        let view = ClusterView::look(&self.shared_store, slurm, &scenes)?;
        for error in view.refused() {
            let what = format!("{error}; its tasks are not known");
            console.report(&UserMessage::warning("plan-unread", what));
        }
        let is_recorded = |key: &Key| matches!(store.shared_record(key), Ok(Some(_)));
        let states = scenes.iter().map(|scene| view.state(scene, &is_recorded)).collect();
        Ok(ClusterScenes { plan, progress, view, states })
    }

    fn open(
        &self,
        common: &CommonArgs,
        access: ClusterAccess,
        console: &Console,
    ) -> Result<Store, VerbError> {
        let shared = Some(self.shared_store.clone());
        if access == ClusterAccess::Offer {
            return open_store(common, &TrustOptions::sharing(shared), console);
        }
        let opening = StoreOptions { shared, ..store_options(common, StoreAccess::Read) };
        Ok(Store::open(&common.store, opening, &mut |_| {})?)
    }
}

/// The renderers of tasks. The keys must be known where jobs are submitted, so a machine does not choose by
/// its own GPU.
fn cluster_renderers(common: &CommonArgs) -> Result<RendererChoice, VerbError> {
    let backend = if common.backend == BackendArg::Auto { BackendArg::Cpu } else { common.backend };
    CommonArgs { backend, ..common.clone() }.renderers()
}

fn asked_scenes(plan: &Plan, progress: &PlanProgress) -> Vec<AskedScene> {
    let asked = |(recipe, progress): (&Recipe, _)| AskedScene {
        scene: recipe.scene.clone(),
        recipe: recipe_digest(recipe),
        progress,
    };
    plan.scenes().iter().zip(progress.scenes.iter().copied()).map(asked).collect()
}

/// Digest of a recipe with its defaults.
pub(super) fn recipe_digest(recipe: &Recipe) -> Digest {
    Digest::of_bytes(recipe.meta.merged.to_string().as_bytes())
}

pub(super) fn absolute(path: &Path) -> Result<PathBuf, VerbError> {
    std::path::absolute(path)
        .map_err(|e| VerbError::usage("input-missing", format!("failed to find {}: {e}", path.display())))
}

impl From<ClusterError> for VerbError {
    fn from(error: ClusterError) -> Self {
        let what = error.to_string();
        match error {
            ClusterError::Absent { .. } => Self::failed("no-slurm", what)
                .help("run this where jobs are submitted; --dry-run prints the script"),
            ClusterError::Failed { said, .. } => {
                let lines = said.lines().map(str::trim).filter(|line| !line.is_empty());
                Self::new(ExitKind::Failed, UserMessage::error("slurm", what).quote(lines))
            }
            ClusterError::Unread { .. } => Self::failed("slurm", what),
            ClusterError::Io { .. } => Self::failed("plan-files", what),
            ClusterError::Plan { .. } => Self::usage("plan-newer", what).help("use the gs2e that wrote it"),
            ClusterError::Altered { .. } => Self::failed("plan-altered", what)
                .help("nothing was built; find out who can write to that folder, and run gs2e submit again"),
        }
    }
}

/// The message about a scene that is not done.
fn failure_message(scene: &str, failure: &SceneFailure) -> UserMessage {
    let SceneFailure { task, because, last, .. } = failure;
    let what = format!("{scene}: task {task} failed: {because}");
    let message = UserMessage::error("task-failed", what).scene(scene);
    let log = (!last.is_empty()).then(|| "the last lines of its log:".to_owned());
    message.details(log).quote(last)
}
