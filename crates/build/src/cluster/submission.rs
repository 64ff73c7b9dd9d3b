//! The plan of one array job: which scenes each of its tasks builds. Its files never change.
//!
//! Other people can write to the shared store. A plan has the digests of the files of its tasks, and the
//! script has that of the plan, so a task builds what was submitted or nothing. No link in the store is
//! followed.

use super::ClusterError;
use gs2e_files as files;
use gs2e_files::below::FolderBelow;
use gs2e_files::{MAX_DOCUMENT, PathError};
use gs2e_recipe::RecipeFile;
use gs2e_store::{Digest, PLANS};
use serde::{Deserialize, Serialize};
use std::ffi::OsString;
use std::io;
use std::os::unix::ffi::{OsStrExt as _, OsStringExt as _};
use std::path::{Path, PathBuf};

const PLAN: &str = "plan.json";
/// Copy of the batch script, for people.
const SCRIPT: &str = "task.sh";
/// Folder of the results of tasks, in the folder of a plan.
pub const RESULTS: &str = "results";
/// Format of the files. A plan of another format is not used.
const FORMAT: u32 = 2;

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
    /// Digests of the files of the tasks.
    shards: Vec<Digest>,
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
    recipe: StoredPath,
    defaults: Option<StoredPath>,
}

/// A path in JSON: as text, or as bytes if it is not UTF-8.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
enum StoredPath {
    Text(String),
    Bytes(Vec<u8>),
}

impl From<&PathBuf> for StoredPath {
    fn from(path: &PathBuf) -> Self {
        path.to_str()
            .map_or_else(|| Self::Bytes(path.as_os_str().as_bytes().to_vec()), |p| Self::Text(p.into()))
    }
}

impl From<StoredPath> for PathBuf {
    fn from(path: StoredPath) -> Self {
        match path {
            StoredPath::Text(text) => text.into(),
            StoredPath::Bytes(bytes) => OsString::from_vec(bytes).into(),
        }
    }
}

/// A plan in a shared store.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Submission {
    /// Absolute path of the shared store.
    pub shared: PathBuf,
    /// Digest of the plan.
    pub digest: Digest,
    /// The plan.
    pub plan: SubmissionPlan,
}

/// The plans of a shared store.
#[derive(Debug, Default)]
pub struct FoundPlans {
    /// The sound ones, in the order of their names.
    pub sound: Vec<Submission>,
    /// Reasons why others are not used.
    pub refused: Vec<ClusterError>,
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
        let shards = tasks.iter().map(|task| Digest::of_bytes(&shard_bytes(task))).collect();
        let tasks = tasks.iter().map(scenes).collect();
        let plan = SubmissionPlan { format: FORMAT, memory_mb, cores, by_report: gpu, shards, tasks };
        Self { shared: shared.to_owned(), digest: Digest::of_bytes(&to_json(&plan)), plan }
    }

    /// Name of its jobs.
    #[must_use]
    pub fn name(&self) -> String {
        format!("gs2e-{}", self.digest.short())
    }

    /// Its folder, relative to the shared store.
    #[must_use]
    pub fn below(&self) -> PathBuf {
        Path::new(PLANS).join(self.digest.short())
    }

    /// Writes the plan, the files of its tasks, and the script.
    ///
    /// # Errors
    /// They cannot be written, or a folder on the way is a link.
    pub fn write(&self, tasks: &[PlannedTask], script: &str) -> Result<(), ClusterError> {
        let path = self.shared.join(self.below());
        let mut folder = FolderBelow::open(&self.shared).map_err(io_error(&self.shared))?;
        for name in [PLANS, &self.digest.short()] {
            folder = folder.enter_or_create(name).map_err(io_error(&path))?;
        }
        folder.enter_or_create(RESULTS).map_err(io_error(&path.join(RESULTS)))?;
        let put = |name: &str, bytes: &[u8]| {
            // Equal plans have equal files, so a file that is there is this one.
            let is_there = folder.read(name, MAX_DOCUMENT).is_ok_and(|there| there == bytes);
            if is_there { Ok(()) } else { folder.write(name, bytes).map_err(io_error(&path.join(name))) }
        };
        for (number, task) in (1..).zip(tasks) {
            put(&shard_name(number), &shard_bytes(task))?;
        }
        put(SCRIPT, script.as_bytes())?;
        // Last: a folder without it is not a plan yet.
        put(PLAN, &to_json(&self.plan))
    }

    /// The plans of a shared store, without those that cannot be read, were altered, or have another format.
    ///
    /// # Errors
    /// The folder of the plans cannot be listed.
    pub fn all(shared: &Path) -> Result<FoundPlans, ClusterError> {
        let path = shared.join(PLANS);
        let plans = match FolderBelow::open(shared).and_then(|shared| shared.enter(PLANS)) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(FoundPlans::default()),
            plans => plans.map_err(io_error(&path))?,
        };
        let mut names: Vec<String> =
            plans.names().map_err(io_error(&path))?.into_iter().filter_map(is_plan).collect();
        names.sort();
        let mut found = FoundPlans::default();
        for name in names {
            match Self::read(shared, &plans, &name) {
                Ok(plan) => found.sound.extend(plan),
                Err(error) => found.refused.push(error),
            }
        }
        Ok(found)
    }

    /// The plan in a folder; `None` if it is not complete yet.
    fn read(shared: &Path, plans: &FolderBelow, name: &str) -> Result<Option<Self>, ClusterError> {
        let path = shared.join(PLANS).join(name).join(PLAN);
        let bytes = match plans.enter(name).and_then(|folder| folder.read(PLAN, MAX_DOCUMENT)) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
            bytes => bytes.map_err(io_error(&path))?,
        };
        let plan: SubmissionPlan = parse(&path, &bytes)?;
        let digest = Digest::of_bytes(&bytes);
        if digest.short() != name {
            return Err(ClusterError::Altered { path });
        }
        Ok(Some(Self { shared: shared.to_owned(), digest, plan }))
    }
}

/// The name of a folder, if it can be that of a plan.
fn is_plan(name: OsString) -> Option<String> {
    let name = name.into_string().ok()?;
    let is_digit = |c: char| matches!(c, '0'..='9' | 'a'..='f');
    (name.len() == Digest::of_bytes(&[]).short().len() && name.chars().all(is_digit)).then_some(name)
}

/// The recipes of a task, from its file, beside which the plan with this digest lies.
///
/// # Errors
/// A file cannot be read, has another format, or is not that of the plan.
pub fn read_shard(path: &Path, digest: &Digest) -> Result<Vec<RecipeFile>, ClusterError> {
    let number = path.file_name().and_then(|name| shard_number(name.to_str()?));
    let wanted = |because: &str| ClusterError::Plan { path: path.to_owned(), because: because.to_owned() };
    let number = number.ok_or_else(|| wanted("its name is not shard-NUMBER.json"))?;
    let plan_path = path.with_file_name(PLAN);
    let plan = read_unaltered(&plan_path, digest)?;
    let plan: SubmissionPlan = parse(&plan_path, &plan)?;
    // `shard_number` returns numbers from 1 on, so this does not underflow.
    let of_task = plan.shards.get(number - 1).ok_or_else(|| wanted("its plan has no such task"))?;
    let shard: ShardFile = parse(path, &read_unaltered(path, of_task)?)?;
    let file = |recipe: ShardRecipe| RecipeFile {
        path: recipe.recipe.into(),
        defaults: recipe.defaults.map(Into::into),
    };
    Ok(shard.recipes.into_iter().map(file).collect())
}

fn read_unaltered(path: &Path, digest: &Digest) -> Result<Vec<u8>, ClusterError> {
    let bytes = files::read(path, MAX_DOCUMENT).map_err(io_error(path))?;
    if Digest::of_bytes(&bytes) == *digest {
        Ok(bytes)
    } else {
        Err(ClusterError::Altered { path: path.to_owned() })
    }
}

/// Name of the file of a task.
#[must_use]
pub fn shard_name(task: usize) -> String {
    format!("shard-{task:04}.json")
}

/// The number of the task of a file, from 1.
fn shard_number(name: &str) -> Option<usize> {
    let number = name.strip_prefix("shard-")?.strip_suffix(".json")?.parse().ok()?;
    (number > 0).then_some(number)
}

fn shard_bytes(task: &PlannedTask) -> Vec<u8> {
    let recipe = |(_, file): &(SubmittedScene, RecipeFile)| ShardRecipe {
        recipe: (&file.path).into(),
        defaults: file.defaults.as_ref().map(Into::into),
    };
    to_json(&ShardFile { format: FORMAT, recipes: task.iter().map(recipe).collect() })
}

fn to_json(value: &impl Serialize) -> Vec<u8> {
    serde_json::to_vec(value).expect("plans are plain data")
}

fn parse<T: serde::de::DeserializeOwned>(path: &Path, bytes: &[u8]) -> Result<T, ClusterError> {
    #[derive(Deserialize)]
    struct Format {
        format: u32,
    }
    let refused = |because: String| ClusterError::Plan { path: path.to_owned(), because };
    // The format alone first: a plan of another version may lack fields, and that message would mislead.
    let Format { format } = serde_json::from_slice(bytes).map_err(|e| refused(e.to_string()))?;
    if format != FORMAT {
        return Err(refused(format!("it has format {format}, wanted {FORMAT}")));
    }
    serde_json::from_slice(bytes).map_err(|e| refused(e.to_string()))
}

pub(super) fn io_error(path: &Path) -> impl FnOnce(io::Error) -> ClusterError {
    move |source| ClusterError::Io(PathError::new(path, source))
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
        let all = || Submission::all(folder.path()).unwrap().sound;
        assert_eq!(all(), []);
        let mut tasks = [task("a"), task("b")];
        tasks[1][0].1.path = OsString::from_vec(b"/r/\xff.yaml".to_vec()).into();
        let written = Submission::plan(folder.path(), NEED, &tasks);
        // Twice, as if it were submitted again.
        written.write(&tasks, "#!/bin/sh\n").unwrap();
        written.write(&tasks, "#!/bin/sh\n").unwrap();
        assert_eq!(all(), std::slice::from_ref(&written));
        let shard = folder.path().join(written.below()).join("shard-0002.json");
        assert_eq!(read_shard(&shard, &written.digest).unwrap(), [tasks[1][0].1.clone()]);
        let other = Submission::plan(folder.path(), TaskNeed { memory_mb: 8000, ..NEED }, &tasks);
        assert_ne!(other.name(), written.name());
        // Equal scenes with recipes elsewhere are another plan.
        tasks[0][0].1.path = "/other/a.yaml".into();
        assert_ne!(Submission::plan(folder.path(), NEED, &tasks).name(), written.name());
    }

    #[test]
    fn a_task_refuses_files_that_were_altered() {
        let folder = tempfile::tempdir().unwrap();
        let tasks = [task("a"), task("b")];
        let written = Submission::plan(folder.path(), NEED, &tasks);
        written.write(&tasks, "").unwrap();
        let at = |name: &str| folder.path().join(written.below()).join(name);
        let refused = |name: &str| read_shard(&at(name), &written.digest).unwrap_err().to_string();
        assert!(refused("shard-0003.json").contains("its plan has no such task"));
        assert!(refused("plan.json").contains("its name is not shard-NUMBER.json"));
        // The file of another task is sound, and not the one of this task.
        std::fs::copy(at("shard-0002.json"), at("shard-0001.json")).unwrap();
        assert!(refused("shard-0001.json").contains("shard-0001.json was altered"));
        let mut plan = std::fs::read(at("plan.json")).unwrap();
        plan.push(b' ');
        std::fs::write(at("plan.json"), plan).unwrap();
        assert!(refused("shard-0002.json").contains("plan.json was altered"));
        let FoundPlans { sound, refused } = Submission::all(folder.path()).unwrap();
        assert!(sound.is_empty() && refused[0].to_string().contains("plan.json was altered"), "{refused:?}");
    }

    #[test]
    fn plans_that_cannot_be_read_are_named_and_the_others_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let tasks = [task("a")];
        let written = Submission::plan(folder.path(), NEED, &tasks);
        written.write(&tasks, "").unwrap();
        let path = folder.path().join("gs2e-plans/0123456789ab/plan.json");
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        for (text, wanted) in
            [(r#"{"format":9}"#, "it has format 9"), ("{", "EOF"), (r#"{"format":2}"#, "missing")]
        {
            std::fs::write(&path, text).unwrap();
            let FoundPlans { sound, refused } = Submission::all(folder.path()).unwrap();
            assert_eq!((sound.len(), refused.len()), (1, 1));
            assert!(refused[0].to_string().contains(wanted), "{refused:?}");
        }
    }
}
