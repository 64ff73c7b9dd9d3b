//! The plan of one array job: which scenes each of its tasks builds. Its files never change.

use super::ClusterError;
use crate::files::rename::write_by_rename;
use crate::files::{self, MAX_DOCUMENT};
use crate::recipe::RecipeFile;
use crate::store::Digest;
use serde::{Deserialize, Serialize};
use std::io;
use std::path::{Path, PathBuf};

/// Folder of the plans in a shared store.
const PLANS: &str = "plans";
const PLAN: &str = "plan.json";
/// Folder of what tasks print, in the folder of a plan.
pub const RESULTS: &str = "results";
/// Format of the files. A plan of another format is refused.
const FORMAT: u32 = 1;

/// A scene of a plan.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SubmittedScene {
    /// Its id.
    pub scene: String,
    /// Digest of its recipe with defaults, and of the options that change its products.
    pub recipe: Digest,
}

/// Content of `plan.json`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SubmissionPlan {
    format: u32,
    /// Memory of a task, MB.
    pub memory_mb: u64,
    /// Cores of a task.
    pub cores: u16,
    /// True if a scene is done once its task says so. Otherwise its keys decide.
    pub by_report: bool,
    /// The scenes of each task. The first task has the number 1.
    pub tasks: Vec<Vec<SubmittedScene>>,
}

/// Content of the file of one task: the recipes that it builds, by absolute paths.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct ShardFile {
    format: u32,
    recipes: Vec<ShardRecipe>,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct ShardRecipe {
    recipe: PathBuf,
    defaults: Option<PathBuf>,
}

/// A plan with its folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Submission {
    /// Absolute path.
    pub folder: PathBuf,
    /// Name of its jobs.
    pub name: String,
    /// The plan.
    pub plan: SubmissionPlan,
}

/// Resources of each task.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TaskNeed {
    /// Memory, MB.
    pub memory_mb: u64,
    /// Cores.
    pub cores: u16,
    /// True if it needs a GPU. The keys of its steps depend on that GPU.
    pub gpu: bool,
}

/// A task to plan: scenes with their recipe files.
pub type PlannedTask = Vec<(SubmittedScene, RecipeFile)>;

impl Submission {
    /// Plans tasks, without writing anything.
    #[must_use]
    pub fn plan(shared: &Path, need: TaskNeed, tasks: &[PlannedTask]) -> Self {
        let TaskNeed { memory_mb, cores, gpu } = need;
        let scenes = |task: &PlannedTask| task.iter().map(|(scene, _)| scene.clone()).collect();
        let tasks = tasks.iter().map(scenes).collect();
        let plan = SubmissionPlan { format: FORMAT, memory_mb, cores, by_report: gpu, tasks };
        let digest = Digest::of_bytes(&to_json(&plan)).short();
        Self { folder: shared.join(PLANS).join(&digest), name: job_name(&digest), plan }
    }

    /// Writes the plan, the files of its tasks, and the script.
    ///
    /// # Errors
    /// They cannot be written.
    pub fn write(&self, tasks: &[PlannedTask], script: &str) -> Result<(), ClusterError> {
        let results = self.folder.join(RESULTS);
        std::fs::create_dir_all(&results).map_err(io_error(&results))?;
        for (number, task) in (1..).zip(tasks) {
            let recipe = |(_, file): &(SubmittedScene, RecipeFile)| ShardRecipe {
                recipe: file.path.clone(),
                defaults: file.defaults.clone(),
            };
            let shard = ShardFile { format: FORMAT, recipes: task.iter().map(recipe).collect() };
            put(&self.folder.join(shard_name(number)), &to_json(&shard))?;
        }
        put(&self.script(), script.as_bytes())?;
        // Last: a folder without it is not a plan yet.
        put(&self.folder.join(PLAN), &to_json(&self.plan))
    }

    /// Path of the batch script.
    #[must_use]
    pub fn script(&self) -> PathBuf {
        self.folder.join("task.sh")
    }

    /// The plans of a shared store, in unspecified order.
    ///
    /// # Errors
    /// A plan cannot be read, or has another format.
    pub fn all(shared: &Path) -> Result<Vec<Self>, ClusterError> {
        let folder = shared.join(PLANS);
        let entries = match std::fs::read_dir(&folder) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
            entries => entries.map_err(io_error(&folder))?,
        };
        let mut found = Vec::new();
        for entry in entries {
            let folder = entry.map_err(io_error(&folder))?.path();
            let path = folder.join(PLAN);
            if !files::is_there(&path) {
                continue;
            }
            let plan: SubmissionPlan = read(&path)?;
            let digest = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
            found.push(Self { name: job_name(&digest), folder, plan });
        }
        found.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(found)
    }
}

/// The recipes of a task, from its file.
///
/// # Errors
/// The file cannot be read, or has another format.
pub fn read_shard(path: &Path) -> Result<Vec<RecipeFile>, ClusterError> {
    let shard: ShardFile = read(path)?;
    let file = |recipe: ShardRecipe| RecipeFile { path: recipe.recipe, defaults: recipe.defaults };
    Ok(shard.recipes.into_iter().map(file).collect())
}

/// Name of the file of a task.
#[must_use]
pub fn shard_name(task: usize) -> String {
    format!("shard-{task:04}.json")
}

fn job_name(digest: &str) -> String {
    format!("gs2e-{digest}")
}

fn to_json(value: &impl Serialize) -> Vec<u8> {
    serde_json::to_vec(value).expect("plans are plain data")
}

fn read<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, ClusterError> {
    #[derive(Deserialize)]
    struct Format {
        format: u32,
    }
    let bytes = files::read(path, MAX_DOCUMENT).map_err(io_error(path))?;
    let refused = |because: String| ClusterError::Plan { path: path.to_owned(), because };
    let Format { format } = serde_json::from_slice(&bytes).map_err(|e| refused(e.to_string()))?;
    if format != FORMAT {
        return Err(refused(format!("it has format {format}, wanted {FORMAT}")));
    }
    serde_json::from_slice(&bytes).map_err(|e| refused(e.to_string()))
}

fn put(path: &Path, bytes: &[u8]) -> Result<(), ClusterError> {
    // Equal plans have equal files, so a file that is there is this one.
    if files::read(path, MAX_DOCUMENT).is_ok_and(|there| there == bytes) {
        return Ok(());
    }
    write_by_rename(path, |part| std::fs::write(part, bytes)).map_err(io_error(path))
}

pub(super) fn io_error(path: &Path) -> impl FnOnce(io::Error) -> ClusterError {
    let path = path.to_owned();
    move |source| ClusterError::Io { path, source }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NEED: TaskNeed = TaskNeed { memory_mb: 4000, cores: 2, gpu: false };

    fn task(scene: &str) -> PlannedTask {
        let submitted =
            SubmittedScene { scene: scene.to_owned(), recipe: Digest::of_bytes(scene.as_bytes()) };
        let file =
            RecipeFile { path: format!("/r/{scene}.yaml").into(), defaults: Some("/r/defaults.yaml".into()) };
        vec![(submitted, file)]
    }

    #[test]
    fn a_plan_is_read_as_it_was_written() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(Submission::all(folder.path()).unwrap(), []);
        let tasks = [task("a"), task("b")];
        let written = Submission::plan(folder.path(), NEED, &tasks);
        // Twice, as if it were submitted again.
        written.write(&tasks, "#!/bin/sh\n").unwrap();
        written.write(&tasks, "#!/bin/sh\n").unwrap();
        assert_eq!(Submission::all(folder.path()).unwrap(), std::slice::from_ref(&written));
        let shard = read_shard(&written.folder.join("shard-0002.json")).unwrap();
        assert_eq!(shard, [tasks[1][0].1.clone()]);
        let need = TaskNeed { memory_mb: 8000, ..NEED };
        let other = Submission::plan(folder.path(), need, &tasks);
        assert_ne!(other.name, written.name);
    }

    #[test]
    fn plans_of_other_formats_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plans/abc/plan.json");
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        for (text, wanted) in
            [(r#"{"format":2}"#, "it has format 2"), ("{", "EOF"), (r#"{"format":1}"#, "missing")]
        {
            std::fs::write(&path, text).unwrap();
            let error = Submission::all(folder.path()).unwrap_err().to_string();
            assert!(error.contains(wanted), "{error}");
        }
    }
}
